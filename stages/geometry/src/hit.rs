//! What a ray through a scene meets first.

use glam::DVec3;
use turbid_contract::payload::{Medium, Scene, Surface};
use turbid_optics::solid::{Chord, Solid};

use crate::solid::solid;

/// The objects of a scene as solids, in the order of their names.
pub struct Bodies {
    bodies: Vec<Body>,
}

struct Body {
    solid: Solid,
    priority: i32,
    /// Light passes through it as through nothing.
    void: bool,
    /// A medium fills it, behind a surface that lets light in.
    turbid: bool,
}

/// Where a ray first meets something that is not void.
#[derive(Clone, Debug, PartialEq)]
pub struct Hit {
    /// mm along the ray.
    pub t: f64,
    pub r: DVec3,
    /// Unit normal, towards where the ray comes from.
    pub normal: DVec3,
    /// Place of the object that fills the space behind.
    pub object: usize,
    /// The objects whose surfaces meet here, with the face of each: one, or several that coincide (a wall of the object itself, and
    /// that of a void which is cut into it).
    pub walls: Vec<(usize, u32)>,
}

/// Surfaces that are closer than this (mm) along a ray are one.
const TOUCHING: f64 = 1e-9;

impl Bodies {
    pub fn of(scene: &Scene) -> Self {
        let void = |medium: &Option<String>| {
            medium.as_ref().is_some_and(|name| scene.media.get(name).is_some_and(Medium::is_void))
        };
        let bodies = scene.objects.values().map(|o| Body {
            solid: solid(&o.shape),
            priority: o.priority,
            void: !matches!(o.surface, Surface::Lambertian(_)) && void(&o.medium),
            turbid: !o.surface.is_opaque() && o.medium.is_some() && !void(&o.medium),
        });
        Self { bodies: bodies.collect() }
    }

    /// The solid of the object at a place.
    pub fn solid(&self, place: usize) -> &Solid {
        &self.bodies[place].solid
    }

    /// Whether light enters the object at a place and is scattered or absorbed there.
    pub fn is_turbid(&self, place: usize) -> bool {
        self.bodies[place].turbid
    }

    /// How far media reach from `r` on the surface along the unit vector `w` into them, whatever they are, mm: to the first void, opaque
    /// object, or end of all objects.
    pub fn depth(&self, r: DVec3, w: DVec3) -> f64 {
        let mut chords: Vec<(usize, Chord)> = Vec::new();
        let mut own = Vec::new();
        for (place, body) in self.bodies.iter().enumerate() {
            own.clear();
            body.solid.cut(r, w, None, &mut own);
            chords.extend(own.iter().filter(|chord| chord.leave > TOUCHING).map(|&chord| (place, chord)));
        }
        let mut ends: Vec<f64> =
            chords.iter().flat_map(|(_, s)| [s.enter, s.leave]).filter(|&t| t > TOUCHING).collect();
        ends.push(0.0);
        ends.sort_by(f64::total_cmp);
        for &t in &ends {
            let behind = t + TOUCHING;
            let holds = chords.iter().filter(|(_, s)| s.enter < behind && behind < s.leave);
            let inside = holds.max_by_key(|(place, _)| self.bodies[*place].priority);
            if !inside.is_some_and(|(place, _)| self.bodies[*place].turbid) {
                return t;
            }
        }
        ends.last().copied().unwrap_or(0.0)
    }

    /// What the ray from `origin` (outside all that is not void) along the unit vector `w` meets first.
    pub fn first_hit(&self, origin: DVec3, w: DVec3) -> Option<Hit> {
        let mut chords: Vec<(usize, Chord)> = Vec::new();
        let mut own = Vec::new();
        for (place, body) in self.bodies.iter().enumerate() {
            own.clear();
            body.solid.cut(origin, w, None, &mut own);
            chords.extend(own.iter().filter(|chord| chord.leave > 0.0).map(|&chord| (place, chord)));
        }
        let mut ends: Vec<f64> = chords.iter().flat_map(|(_, s)| [s.enter, s.leave]).collect();
        ends.retain(|&t| t > 0.0 && t < f64::INFINITY);
        ends.sort_by(f64::total_cmp);
        for &t in &ends {
            // Just behind this end; what is thinner than that is rounding.
            let behind = t + TOUCHING;
            let holds = chords.iter().filter(|(_, s)| s.enter < behind && behind < s.leave);
            let Some(&(object, _)) = holds.max_by_key(|(place, _)| self.bodies[*place].priority) else { continue };
            if self.bodies[object].void {
                continue;
            }
            let r = origin + t * w;
            let near = |end: f64| (end - t).abs() <= TOUCHING;
            let walls: Vec<(usize, u32)> = chords
                .iter()
                .flat_map(|&(place, s)| [(place, s.enter, s.into), (place, s.leave, s.out_of)])
                .filter(|&(_, end, _)| near(end))
                .map(|(place, _, face)| (place, face))
                .collect();
            let &(place, face) = walls.first()?;
            let normal = self.bodies[place].solid.normal(face, r);
            let normal = if normal.dot(w) > 0.0 { -normal } else { normal };
            return Some(Hit { t, r, normal, object, walls });
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use turbid_contract::payload::{Object, PhaseFunction, Shape};

    use super::*;

    fn scene() -> Scene {
        let medium = |mu_s: f64| Medium {
            mu_a: vec![0.0],
            mu_s: vec![mu_s],
            phase: PhaseFunction::HenyeyGreenstein(0.0),
            n: 1.0,
        };
        let object = |shape, medium: &str, priority| Object {
            shape,
            medium: Some(medium.to_owned()),
            priority,
            surface: Surface::Smooth,
        };
        let bore = Shape::Cylinder { diameter: 20.0, length: 300.0, center: [0.0; 3], axis: [0.0, 0.0, 1.0] };
        let tube =
            Shape::Tube { inner_diameter: 20.0, outer_diameter: 80.0, top: 0.0, bottom: -250.0, center: [0.0; 2] };
        let quarter = Shape::Box { size: [40.0, 40.0, 250.0], center: [20.0, 20.0, -125.0] };
        Scene {
            wavelengths_nm: Vec::new(),
            media: BTreeMap::from([("air".into(), medium(0.0)), ("a".into(), medium(1.0)), ("b".into(), medium(2.0))]),
            objects: BTreeMap::from([
                ("bore".into(), object(bore, "air", 2)),
                ("quarter".into(), object(quarter, "b", 1)),
                ("tube".into(), object(tube, "a", 0)),
            ]),
            camera: None,
            projector: None,
            lights: BTreeMap::new(),
            detectors: BTreeMap::new(),
        }
    }

    /// A tube with a quarter of another medium, both behind the wall of a void: the filling is told by priority, the wall is that of the
    /// void and of the tube.
    #[test]
    fn a_void_cuts_what_it_overlaps() {
        let bodies = Bodies::of(&scene());
        let eye = DVec3::new(0.0, 0.0, 100.0);
        for (x, y, filling) in [(1.0, 1.0, 1), (-1.0, 1.0, 2), (1.0, -1.0, 2)] {
            let w = DVec3::new(0.06 * x, 0.06 * y, -1.0).normalize();
            let hit = bodies.first_hit(eye, w).expect("the wall is hit");
            assert_eq!(hit.object, filling, "({x}, {y})");
            assert!((hit.r.truncate().length() - 10.0).abs() < 1e-12);
            assert!((hit.normal - DVec3::new(-x, -y, 0.0).normalize()).length() < 1e-12);
            assert_eq!(hit.walls, [(0, 0), (2, 1)], "the void's side and the tube's bore");
        }
        // Down the middle nothing is met; beside the mouth the rim is.
        assert_eq!(bodies.first_hit(eye, DVec3::NEG_Z), None);
        let rim = bodies.first_hit(DVec3::new(-20.0, 0.0, 100.0), DVec3::NEG_Z).expect("the rim is hit");
        assert_eq!((rim.object, rim.r.z, rim.normal), (2, 0.0, DVec3::Z));
    }
}
