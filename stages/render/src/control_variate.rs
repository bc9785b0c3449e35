//! Laterally uniform control variates of a scene: their images are smooth and so cheaply known, and what the scene's own objects add to
//! them varies much less than the image, if both are seen by the same random numbers.

use turbid_contract::Error;
use turbid_contract::payload::{Medium, PhaseFunction, Scene, Shape, Surface};

use crate::rig::Rig;
use crate::truth::first_hit;
use crate::uniform::obstacle;
use crate::world::Chords;

/// Name of the medium that fills what does not show; not one that a file can give.
const NOTHING: &str = " ";
/// The surface that a pixel sees may lie off the reference's by this part of its distance: rounding.
const LEVEL: f64 = 1e-9;

/// A laterally uniform scene, twice.
pub struct ControlVariate {
    /// Slabs only.
    pub plain: Rig,
    /// The same as paths see it, with all surfaces of the scene: those that do not show there still decide how paths are cut into
    /// flights, so that a path that meets none of the scene's objects is the same path in both.
    pub paired: Rig,
}

/// The control variates of a scene.
pub struct ControlVariates {
    pub variates: Vec<ControlVariate>,
    /// For each pixel one of them, where its middle sees their surface and their medium.
    pub of_pixel: Vec<Option<usize>>,
}

impl ControlVariates {
    /// Only in the pixels that are `taken`; in all where it says nothing.
    pub fn within(mut self, taken: Option<&[bool]>) -> Self {
        if let Some(taken) = taken {
            self.of_pixel.iter_mut().zip(taken).for_each(|(of, &taken)| *of = of.filter(|_| taken));
        }
        self
    }
}

/// Why no part of a scene has a control variate; `None` where there may be one.
pub fn no_control(scene: &Scene, target_error: Option<f64>) -> Option<String> {
    let base = slabs_of(scene);
    if base.objects.len() == scene.objects.len() || base.objects.is_empty() {
        return Some("there is no slab without bounds sideways beside other objects".to_owned());
    }
    obstacle(&base, target_error)
}

/// The control variates, one for each medium that shows at the level of the uppermost slab; `None` where there are none.
pub fn control_variates(scene: &Scene, rig: &Rig, target_error: Option<f64>) -> Result<Option<ControlVariates>, Error> {
    if no_control(scene, target_error).is_some() {
        return Ok(None);
    }
    let base = slabs_of(scene);
    let level = Rig::of(&base)?;
    let (objects, slabs): (Vec<_>, Vec<_>) = (scene.objects.iter().collect(), base.objects.iter().collect());
    // By the names of the top slab and of the medium in it.
    let mut known: Vec<((&str, &str), ControlVariate)> = Vec::new();
    let mut chords = Chords::default();
    let mut of_pixel = Vec::with_capacity(rig.camera.pixels());
    for pixel in 0..rig.camera.pixels() {
        let seen = first_hit(&rig.worlds[0], &rig.camera, pixel, &mut chords);
        let slab = first_hit(&level.worlds[0], &rig.camera, pixel, &mut chords);
        let (Some(seen), Some(slab)) = (seen, slab) else {
            of_pixel.push(None);
            continue;
        };
        let (_, object) = objects[rig.object_of[seen.body]];
        let (name, _) = slabs[level.object_of[slab.body]];
        let medium = match (&object.medium, &object.surface) {
            (Some(medium), Surface::Smooth) if (seen.depth - slab.depth).abs() <= LEVEL * slab.depth => medium,
            _ => {
                of_pixel.push(None);
                continue;
            }
        };
        let place = match known.iter().position(|(key, _)| *key == (name.as_str(), medium.as_str())) {
            Some(place) => place,
            None => {
                let mut plain = base.clone();
                if let Some(top) = plain.objects.get_mut(name) {
                    top.medium = Some(medium.clone());
                }
                if obstacle(&plain, target_error).is_some() {
                    of_pixel.push(None);
                    continue;
                }
                let variate = ControlVariate { paired: Rig::of(&paired(scene, &plain))?, plain: Rig::of(&plain)? };
                known.push(((name, medium), variate));
                known.len() - 1
            }
        };
        of_pixel.push(Some(place));
    }
    let variates: Vec<ControlVariate> = known.into_iter().map(|(_, variate)| variate).collect();
    Ok((!variates.is_empty()).then_some(ControlVariates { variates, of_pixel }))
}

/// The scene without all that is bounded sideways.
fn slabs_of(scene: &Scene) -> Scene {
    let mut base = scene.clone();
    base.objects.retain(|_, object| matches!(object.shape, Shape::Slab { .. }));
    base
}

/// The slabs of `plain` above all, then the scene's other objects, filled with nothing.
fn paired(scene: &Scene, plain: &Scene) -> Scene {
    let mut paired = scene.clone();
    let nothing = vec![0.0; scene.channels()];
    paired.media.insert(
        NOTHING.to_owned(),
        Medium { mu_a: nothing.clone(), mu_s: nothing, phase: PhaseFunction::HenyeyGreenstein(0.0), n: 1.0 },
    );
    // Ranks instead of priorities, which may be as large as they like.
    let mut ranks: Vec<i32> = scene.objects.values().map(|object| object.priority).collect();
    ranks.sort_unstable();
    ranks.dedup();
    let count = ranks.len() as i32;
    for (name, object) in &mut paired.objects {
        let rank = ranks.partition_point(|&priority| priority < object.priority) as i32;
        match plain.objects.get(name) {
            Some(slab) => {
                object.medium = slab.medium.clone();
                object.priority = count + rank;
            }
            None => {
                object.medium = Some(NOTHING.to_owned());
                object.surface = Surface::Smooth;
                object.priority = rank;
            }
        }
    }
    paired
}
