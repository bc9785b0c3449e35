//! Shapes: from what a pipeline file says to solids with their dimensions in mm.

use std::sync::Arc;

use turbid_contract::payload::{Mesh, Port, Shape};
use turbid_contract::{AngleDeg, Problems};

use crate::assemble::plain;
use crate::mesh::Placing;
use crate::params::{MeshParams, ObjectParams, PortParams};

/// Every shape that it names; a scene needs exactly one.
pub fn shapes(name: &str, o: &ObjectParams, problems: &mut Problems) -> Vec<Shape> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let mut positive = |field: &str, v: f64| {
        problems.require(v > 0.0, at(field), v, "mm", "be > 0");
        v
    };
    let mut shapes = Vec::new();
    let (mut nowhere, mut wide, mut walls) = (Vec::new(), Vec::new(), Vec::new());
    if let Some(s) = &o.slab {
        let thickness = positive("slab.thickness", s.thickness.0);
        let (top, bottom) = (s.top.0, s.top.0 - thickness);
        shapes.push(match s.size {
            None => Shape::Slab { top, bottom },
            Some(size) => {
                let (x, y) = (positive("slab.size.0", size[0].0), positive("slab.size.1", size[1].0));
                let center = s.center.unwrap_or_default();
                Shape::Box { size: [x, y, thickness], center: [center[0].0, center[1].0, top - 0.5 * thickness] }
            }
        });
    }
    if let Some(b) = &o.cuboid {
        let size = [0, 1, 2].map(|i| positive(&format!("box.size.{i}"), b.size[i].0));
        let center = plain(b.center);
        shapes.push(turned(Shape::Box { size, center }, center, b.rotation_deg));
    }
    if let Some(s) = &o.sphere {
        shapes.push(Shape::Sphere { diameter: positive("sphere.diameter", s.diameter.0), center: plain(s.center) });
    }
    if let Some(s) = &o.spheroid {
        let diameters = [0, 1, 2].map(|i| positive(&format!("spheroid.diameters.{i}"), s.diameters[i].0));
        shapes.push(spheroid(diameters, plain(s.center), s.rotation_deg));
    }
    if let Some(c) = &o.cylinder {
        let (diameter, length) = (positive("cylinder.diameter", c.diameter.0), positive("cylinder.length", c.length.0));
        match c.axis.unit() {
            Some(axis) => shapes.push(cylinder(diameter, length, plain(c.center), axis)),
            None => nowhere.push("cylinder.axis".to_owned()),
        }
    }
    if let Some(t) = &o.tube {
        let (inner, outer) =
            (positive("tube.inner_diameter", t.inner_diameter.0), positive("tube.outer_diameter", t.outer_diameter.0));
        let (length, top) = (positive("tube.length", t.length.0), t.top.0 + 0.0);
        walls.push((inner > 0.0 && outer <= inner, "tube.outer_diameter", outer, inner));
        shapes.push(Shape::Tube {
            inner_diameter: inner,
            outer_diameter: outer,
            top,
            bottom: top - length,
            center: plain(t.center),
        });
    }
    if let Some(s) = &o.sphere_shell {
        let inner = positive("sphere_shell.inner_diameter", s.inner_diameter.0);
        let wall = positive("sphere_shell.wall", s.wall.0);
        let mut ports = Vec::new();
        for (i, port) in s.ports.iter().enumerate() {
            let (kind, direction) = match port {
                PortParams::Round(port) => ("round", port.direction),
                PortParams::Square(port) => ("square", port.direction),
            };
            let field = |name: &str| format!("sphere_shell.ports.{i}.{kind}.{name}");
            let Some(direction) = direction.unit() else {
                nowhere.push(field("direction"));
                continue;
            };
            // The widest extent of the opening must fit into the sphere.
            let (name, size, widest) = match port {
                PortParams::Round(port) => ("diameter", port.diameter.0, port.diameter.0),
                PortParams::Square(port) => ("side", port.side.0, port.side.0 * std::f64::consts::SQRT_2),
            };
            if positive(&field(name), size) >= 0.0 && widest >= inner {
                let rule = format!("{name} = {size} mm: the port is not narrower than the sphere, {inner} mm");
                wide.push((field(name), rule));
            }
            ports.push(match port {
                PortParams::Round(_) => Port::Round { direction, diameter: size },
                PortParams::Square(_) => Port::Square { direction, side: size },
            });
        }
        let center = plain(s.center);
        shapes.push(Shape::SphereShell { inner_diameter: inner, outer_diameter: inner + 2.0 * wall, center, ports });
    }
    for field in nowhere {
        problems.push_with_hint(
            at(&field),
            "[0, 0, 0] has no direction",
            "write x, y, z, or a vector that is not zero",
        );
    }
    for (path, rule) in wide {
        problems.push_with_hint(at(&path), rule, "make the port smaller, or the sphere larger");
    }
    for (_, field, outer, inner) in walls.into_iter().filter(|wall| wall.0) {
        problems.push_with_hint(
            at(field),
            format!("outer_diameter = {outer} mm must be > inner_diameter = {inner} mm"),
            "the wall between them must have a thickness",
        );
    }
    if let Some(s) = &o.slab
        && s.center.is_some()
        && s.size.is_none()
    {
        problems.push_with_hint(
            at("slab.center"),
            "a slab that is infinite sideways has no center",
            "add `size: [x, y]`, or leave `center` out",
        );
    }
    shapes
}

/// The mesh of a file in its place; `None` where it bounds no solid.
pub fn mesh(
    name: &str,
    m: &MeshParams,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Option<Mesh> {
    let at = |field: &str| format!("objects.{name}.mesh.{field}");
    problems.require(m.scale.0 > 0.0, at("scale"), m.scale.0, "", "be > 0");
    if m.scale.0 <= 0.0 {
        return None;
    }
    let Some(bytes) = file(&at("file")) else {
        problems.push(at("file"), format!("`{}` has not been read", m.file));
        return None;
    };
    let placing =
        Placing { scale: m.scale.0, rotation_deg: m.rotation_deg.map(|a| a.0 + 0.0), position: plain(m.position) };
    // What was read goes before it is checked: both take memory.
    let mesh = match crate::mesh::read(&bytes).map(|soup| crate::mesh::place(&soup, &placing)) {
        Ok(mesh) => mesh,
        Err(error) => {
            problems.push(at("file"), format!("`{}`: {error}", m.file));
            return None;
        }
    };
    let wrong = crate::mesh::check(&mesh);
    for (what, way_out) in &wrong {
        problems.push_with_hint(at("file"), format!("`{}`: {what}", m.file), *way_out);
    }
    wrong.is_empty().then_some(mesh)
}

/// Of equal diameters it is a sphere.
pub fn spheroid(diameters: [f64; 3], center: [f64; 3], rotation_deg: [AngleDeg; 3]) -> Shape {
    if diameters[0] == diameters[1] && diameters[1] == diameters[2] {
        Shape::Sphere { diameter: diameters[0], center }
    } else {
        turned(Shape::Spheroid { diameters, center }, center, rotation_deg)
    }
}

pub fn cylinder(diameter: f64, length: f64, center: [f64; 3], axis: [f64; 3]) -> Shape {
    Shape::Cylinder { diameter, length, center, axis: upward(axis) }
}

/// The shape turned about its center, or as it is where it is not turned.
fn turned(shape: Shape, about: [f64; 3], rotation_deg: [AngleDeg; 3]) -> Shape {
    let rotation_deg = rotation_deg.map(|angle| angle.0 + 0.0);
    if rotation_deg == [0.0; 3] { shape } else { Shape::Turned { shape: Box::new(shape), about, rotation_deg } }
}

/// Of the two directions of an axis, the one whose last coordinate that is not 0 is positive: they are the same cylinder.
fn upward(axis: [f64; 3]) -> [f64; 3] {
    let last = axis.iter().rev().find(|x| **x != 0.0);
    if last.is_some_and(|x| *x < 0.0) { axis.map(|x| 0.0 - x) } else { axis }
}
