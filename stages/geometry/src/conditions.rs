//! Under which angles, and how thick, a camera sees what stands in a scene.

use glam::DVec3;
use turbid_contract::payload::{Conditions, Projector, SaidBy, Scene, Seen, Thickness};
use turbid_optics::view::View;

use crate::hit::Bodies;
use crate::phase_function::phase_function;
use crate::view::{camera_view, projector_view};

/// Rays along a side of the image that conditions are read from.
const LATTICE: u32 = 7;
/// The same for whether anything is lit.
const COARSE: u32 = 3;

/// What the ray through a place of the image meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// Place of the object among those of the scene.
    pub object: usize,
    /// Whether light enters it.
    pub turbid: bool,
    /// Between the normal of the surface and the way to the camera, degrees in [0, 90].
    pub view_deg: f64,
    /// The same to the projector, in [0, 180]: beyond 90 its light falls on the other side. `None` without a projector.
    pub incidence_deg: Option<f64>,
    /// Of all media below the surface, along its normal, mm.
    pub thickness: f64,
    /// Whether the place lies in the projector's field.
    in_field: bool,
}

/// Rays of a camera into a scene.
pub struct Sights<'a> {
    bodies: Bodies,
    view: View,
    projector: Option<(&'a Projector, View)>,
}

impl<'a> Sights<'a> {
    /// `None` for a scene without a camera, or with one that is none.
    pub fn of(scene: &'a Scene) -> Option<Self> {
        let view = camera_view(scene.camera.as_ref()?).ok()?;
        let projector = scene.projector.as_ref().and_then(|p| Some((p, projector_view(p).ok()?)));
        Some(Self { bodies: Bodies::of(scene), view, projector })
    }

    /// At the image position (x, y), (0, 0) its top left corner, (1, 1) its bottom right; `None` where nothing is met.
    pub fn at(&self, x: f64, y: f64) -> Option<Angles> {
        let (origin, w) = self.view.ray(x, y);
        let hit = self.bodies.first_hit(origin, w)?;
        let angle = |to: DVec3| libm::acos(hit.normal.dot(to).clamp(-1.0, 1.0)).to_degrees();
        let to_light = |p: &(&Projector, View)| (DVec3::from(p.0.position) - hit.r).try_normalize().map(angle);
        let in_field = |(_, view): &(&Projector, View)| view.project(hit.r).is_some_and(|p| view.in_field(p));
        Some(Angles {
            object: hit.object,
            turbid: self.bodies.is_turbid(hit.object),
            view_deg: angle(-w),
            incidence_deg: self.projector.as_ref().and_then(to_light),
            thickness: self.bodies.depth(hit.r, -hit.normal),
            in_field: self.projector.as_ref().is_some_and(in_field),
        })
    }

    /// At the middles of a lattice of up to `side` x `side` pixels of a camera of `columns` x `rows`.
    fn lattice(&self, side: u32, [columns, rows]: [u32; 2]) -> Vec<Angles> {
        let middle = |k: u32, count: u32| {
            let steps = count.min(side);
            let pixel = u64::from(k) * u64::from(count - 1) / u64::from((steps - 1).max(1));
            (pixel as f64 + 0.5) / f64::from(count)
        };
        let of = |count: u32| (0..count.min(side)).map(move |k| middle(k, count));
        of(rows).flat_map(|y| of(columns).map(move |x| (x, y))).filter_map(|(x, y)| self.at(x, y)).collect()
    }
}

/// What the camera of a scene sees, and how; `None` without a camera, or where it sees no medium.
pub fn conditions(scene: &Scene) -> Option<Conditions> {
    let found = Sights::of(scene)?.lattice(LATTICE, scene.camera.as_ref()?.pixels);
    let mut of_object: Vec<(usize, Vec<&Angles>)> = Vec::new();
    for angles in found.iter().filter(|a| a.turbid) {
        match of_object.iter_mut().find(|(object, _)| *object == angles.object) {
            Some((_, list)) => list.push(angles),
            None => of_object.push((angles.object, vec![angles])),
        }
    }
    of_object.sort_by_key(|(object, list)| (std::cmp::Reverse(list.len()), *object));
    let seen = of_object.iter().filter_map(|(object, list)| {
        let (name, object) = scene.objects.iter().nth(*object)?;
        let medium = scene.media.get(object.medium.as_ref()?)?;
        let incidence: Option<Vec<f64>> = list.iter().map(|a| a.incidence_deg).collect();
        Some(Seen {
            object: name.clone(),
            mu_a: medium.mu_a.clone(),
            mu_s_prime: medium.mu_s.iter().map(|mu_s| mu_s * (1.0 - phase_function(&medium.phase).g())).collect(),
            phase: Some(medium.phase),
            n: Some(medium.n),
            thickness: Some(Thickness::Mm(spread(list.iter().map(|a| a.thickness).collect()))),
            view_deg: Some(spread(list.iter().map(|a| a.view_deg).collect())),
            incidence_deg: incidence.map(spread),
        })
    });
    let seen: Vec<Seen> = seen.collect();
    (!seen.is_empty()).then_some(Conditions { said_by: SaidBy::Scene, seen })
}

/// Of nine places that the camera looks at: how many show an object, and on how many of those the projector's light falls from the side that is seen,
/// other objects aside; `None` without camera or projector. Where none of nine is lit, of 49: eight of the nine lie on the border of the image.
pub fn lit_points(scene: &Scene) -> Option<(usize, usize)> {
    scene.projector.as_ref()?;
    let (sights, pixels) = (Sights::of(scene)?, scene.camera.as_ref()?.pixels);
    let look = |side: u32| {
        let found = sights.lattice(side, pixels);
        let lit = found.iter().filter(|a| a.in_field && a.incidence_deg.is_some_and(|angle| angle < 90.0)).count();
        (found.len(), lit)
    };
    match look(COARSE) {
        (_, 0) => Some(look(LATTICE)),
        found => Some(found),
    }
}

/// Least, median and most.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [values[0], values[values.len() / 2], values[values.len() - 1]]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use turbid_contract::payload::{Camera, Medium, Object, PhaseFunction, Profile, Projection, Shape, Surface};

    use super::*;

    fn scene(camera: [f64; 3], projector: [f64; 3], bottom: f64) -> Scene {
        let medium = Medium { mu_a: vec![0.1], mu_s: vec![5.0], phase: PhaseFunction::HenyeyGreenstein(0.8), n: 1.4 };
        let shape = Shape::Slab { top: 0.0, bottom };
        let object = Object { shape, medium: Some("m".to_owned()), priority: 0, surface: Surface::Smooth };
        let (look_at, up) = ([0.0; 3], [0.0, 1.0, 0.0]);
        Scene {
            wavelengths_nm: Vec::new(),
            media: BTreeMap::from([("m".to_owned(), medium)]),
            objects: BTreeMap::from([("block".to_owned(), object)]),
            camera: Some(Camera {
                position: camera,
                look_at,
                up,
                field: [1.0, 1.0],
                pixels: [5, 3],
                specular: None,
                projection: Projection::Pinhole,
                distortion: None,
                aperture: None,
            }),
            projector: Some(Projector {
                position: projector,
                look_at,
                up,
                field: [100.0, 100.0],
                power: vec![1.0],
                profile: Profile::Flat,
                pixels: None,
                distortion: None,
            }),
            lights: BTreeMap::new(),
            detectors: BTreeMap::new(),
        }
    }

    /// A rig at 45 and 60 degrees sees a slab of 2 mm as that, within the angle that half a field of 1 mm takes at 1 m.
    #[test]
    fn angles_and_thickness_are_those_of_the_rig() {
        let side = 1000.0 * 0.5f64.sqrt();
        let scene = scene([0.0, -side, side], [0.0, 1000.0 * 0.75f64.sqrt(), 500.0], -2.0);
        let found = conditions(&scene).expect("a camera that sees a medium");
        let [seen] = &found.seen[..] else { panic!("{found:?}") };
        assert_eq!(
            (seen.object.as_str(), seen.phase, seen.n),
            ("block", Some(PhaseFunction::HenyeyGreenstein(0.8)), Some(1.4))
        );
        assert!((seen.mu_s_prime[0] - 1.0).abs() < 1e-15);
        let within = |spread: Option<[f64; 3]>, angle: f64| spread.unwrap().iter().all(|a| (a - angle).abs() < 0.05);
        assert!(within(seen.view_deg, 45.0) && within(seen.incidence_deg, 60.0), "{seen:?}");
        let Some(Thickness::Mm(mm)) = seen.thickness else { panic!("{seen:?}") };
        assert!(mm.iter().all(|d| (d - 2.0).abs() < 1e-8), "{mm:?}");
        assert_eq!(lit_points(&scene), Some((9, 9)));
    }

    /// Light on a spot between the middle and the border of the image is found.
    #[test]
    fn a_spot_of_light_is_found() {
        let mut small = scene([0.0, 0.0, 500.0], [0.0, 0.0, 500.0], -2.0);
        let (camera, projector) = (small.camera.as_mut().unwrap(), small.projector.as_mut().unwrap());
        camera.pixels = [7, 7];
        // The middle of the last pixel but one.
        let at = 2.0 / 7.0;
        (projector.position, projector.look_at, projector.field) = ([at, at, 500.0], [at, at, 0.0], [0.1, 0.1]);
        assert_eq!(lit_points(&small), Some((49, 1)));
    }

    /// Light from below falls on no place that a camera above sees, and an opaque floor ends the media.
    #[test]
    fn light_from_below_is_told() {
        let mut below = scene([0.0, 0.0, 500.0], [0.0, 35.0, -500.0], -100.0);
        assert_eq!(lit_points(&below), Some((15, 0)), "every pixel");
        let floor = Object {
            shape: Shape::Slab { top: -3.0, bottom: -100.0 },
            medium: None,
            priority: 1,
            surface: Surface::Lambertian(0.5),
        };
        below.objects.insert("floor".to_owned(), floor);
        let found = conditions(&below).expect("a medium is seen");
        let Some(Thickness::Mm(mm)) = found.seen[0].thickness else { panic!("{found:?}") };
        assert!(mm.iter().all(|d| (d - 3.0).abs() < 1e-8), "{mm:?}");
    }
}
