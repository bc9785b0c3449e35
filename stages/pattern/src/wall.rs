//! The surface that a pattern is made for: a face of an object with a coordinate along it.

use glam::DVec3;
use turbid_contract::payload::Scene;
use turbid_geometry::{Bodies, Hit};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::solid::Solid;

/// An object of a scene, and the way along it.
pub struct Wall<'a> {
    pub bodies: &'a Bodies,
    place: usize,
    /// Of the direction in which the pattern varies, from the first coordinate to the second.
    turn: (f64, f64),
}

/// Where a ray meets the surface.
pub struct Met {
    pub hit: Hit,
    pub face: u32,
    /// Coordinate, mm along the surface.
    pub s: f64,
}

impl<'a> Wall<'a> {
    /// The object `name`; `orientation_deg` turns the direction on flat faces.
    ///
    /// Error: there is none of that name, it has no coordinate, or it is not flat and the pattern shall be turned. With the way out.
    pub fn of(scene: &Scene, bodies: &'a Bodies, name: &str, orientation_deg: f64) -> Result<Self, (String, String)> {
        let Some(place) = scene.objects.keys().position(|object| object == name) else {
            let names: Vec<&str> = scene.objects.keys().map(String::as_str).collect();
            return Err((format!("the scene has no object `{name}`"), format!("it has {}", names.join(", "))));
        };
        let solid = bodies.solid(place);
        if !has_coordinate(solid) {
            return Err((
                format!(
                    "`{name}` has no coordinate along its surface: meshes and spheroids of three different axes have none"
                ),
                "choose a slab, box, cylinder, tube, sphere, sphere shell or a spheroid that is round about its z axis"
                    .to_owned(),
            ));
        }
        if orientation_deg != 0.0 && !is_flat(solid) {
            return Err((
                format!(
                    "orientation_deg = {orientation_deg} deg turns the pattern on flat faces only, and `{name}` is round"
                ),
                "leave orientation_deg out: the pattern then varies along the surface from its upper end".to_owned(),
            ));
        }
        let (sin, cos) = sin_cos_turns(orientation_deg / 360.0);
        Ok(Self { bodies, place, turn: (cos, sin) })
    }

    pub fn solid(&self) -> &Solid {
        self.bodies.solid(self.place)
    }

    /// Radius and length of the bore of a straight tube, or of a void that is cut straight into something, mm.
    pub fn bore(&self) -> Option<(f64, f64)> {
        fn upright(solid: &Solid) -> Option<(f64, f64)> {
            match solid {
                Solid::Turned(turned) => upright(&turned.solid),
                Solid::Carved(carved) => match (&carved.whole, carved.holes.as_slice()) {
                    (Solid::Cylinder { bottom, top, .. }, [Solid::Cylinder { radius, .. }]) => {
                        Some((*radius, top - bottom))
                    }
                    _ => None,
                },
                Solid::Cylinder { radius, bottom, top, .. } => Some((*radius, top - bottom)),
                _ => None,
            }
        }
        upright(self.solid())
    }

    /// What the ray meets first, where that is this surface.
    #[inline]
    pub fn meet(&self, origin: DVec3, w: DVec3) -> Option<Met> {
        let hit = self.bodies.first_hit(origin, w)?;
        let &(_, face) = hit.walls.iter().find(|(place, _)| *place == self.place)?;
        let s = along(self.solid(), face, hit.r, self.turn)?;
        Some(Met { hit, face, s })
    }
}

/// The coordinate on the faces that patterns are made for: the ends of tubes and cylinders, the sides of boxes and the ports of shells
/// have none.
fn along(solid: &Solid, face: u32, p: DVec3, turn: (f64, f64)) -> Option<f64> {
    match solid {
        Solid::Turned(turned) => along(&turned.solid, face, turned.frame.point_into(p), turn),
        Solid::Cylinder { .. } if solid.normal(face, p).z.abs() > 0.5 => None,
        Solid::Box { .. } if solid.normal(face, p).z.abs() < 0.5 => None,
        // Of a tube the bore, of a shell both sides of its wall.
        Solid::Carved(carved) if matches!(carved.whole, Solid::Cylinder { .. }) && face == 0 => None,
        Solid::Carved(_) if face > 1 => None,
        _ => solid.coordinates(face, p).map(|c| turn.0 * c.x + turn.1 * c.y),
    }
}

fn has_coordinate(solid: &Solid) -> bool {
    match solid {
        Solid::Mesh(_) => false,
        Solid::Turned(turned) => has_coordinate(&turned.solid),
        Solid::Ellipsoid { radii, .. } => radii.x == radii.y,
        _ => true,
    }
}

fn is_flat(solid: &Solid) -> bool {
    match solid {
        Solid::Turned(turned) => is_flat(&turned.solid),
        Solid::Slab { .. } | Solid::Box { .. } => true,
        _ => false,
    }
}
