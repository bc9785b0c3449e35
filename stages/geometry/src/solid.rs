//! Shapes as solids.

use glam::DVec3;
use turbid_contract::payload::{Port, Shape};
use turbid_optics::solid::{Frame, Mesh, Solid};

/// The solid of a shape.
pub fn solid(shape: &Shape) -> Solid {
    match *shape {
        Shape::Slab { top, bottom } => Solid::Slab { bottom, top },
        Shape::Box { size, center } => {
            let (half, center) = (0.5 * DVec3::from(size), DVec3::from(center));
            Solid::Box { low: center - half, high: center + half }
        }
        Shape::Sphere { diameter, center } => {
            Solid::Ellipsoid { center: center.into(), radii: DVec3::splat(0.5 * diameter) }
        }
        Shape::Spheroid { diameters, center } => {
            Solid::Ellipsoid { center: center.into(), radii: 0.5 * DVec3::from(diameters) }
        }
        Shape::Cylinder { diameter, length, center, axis } => {
            Solid::cylinder(diameter, length, center.into(), axis.into())
        }
        Shape::Tube { inner_diameter, outer_diameter, top, bottom, center } => {
            Solid::tube(inner_diameter, outer_diameter, center.into(), bottom, top)
        }
        Shape::SphereShell { inner_diameter, outer_diameter, center, ref ports } => {
            let holes = ports.iter().map(|port| match *port {
                Port::Round { direction, diameter } => Solid::round_port(diameter, center.into(), direction.into()),
                Port::Square { direction, side } => Solid::square_port(side, center.into(), direction.into()),
            });
            Solid::sphere_shell(inner_diameter, outer_diameter, center.into(), holes.collect())
        }
        // Its tree of boxes is made once for all scenes that hold the same mesh.
        Shape::Mesh(ref mesh) => Solid::Mesh(mesh.made(|mesh| Mesh::new(&mesh.vertices, &mesh.triangles))),
        Shape::Turned { ref shape, about, rotation_deg } => {
            solid(shape).turned(Frame::turned_about(about.into(), rotation_deg))
        }
    }
}
