//! From parameters to a checked scene: every mistake with its field, value, unit, rule and way out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec3;
use turbid_contract::payload::{Medium, Object, Scene};
use turbid_contract::{Length, Problems, Usual};
use turbid_geometry::solid;
use turbid_optics::solid::Solid;

use crate::params::Params;
use crate::per_channel::PerChannel;

mod detector;
mod lamp;
mod lost;
mod medium;
mod object;
mod plausible;
mod shape;
mod surface;
mod view;
mod whole;

use detector::detector;
use lamp::lamp;
use lost::warn_of_lost_light;
use medium::medium;
use object::object;
use plausible::doubt;
use view::{camera, projector};
use whole::check_whole;

/// The scene that the parameters describe; meaningless where `problems` got something.
///
/// `file` gives the bytes of the input file that a field names.
pub fn assemble(params: &Params, file: &dyn Fn(&str) -> Option<Arc<[u8]>>, problems: &mut Problems) -> Scene {
    let channels = params.wavelength_nm.len().max(1);
    let wavelengths_nm: Vec<f64> = params.wavelength_nm.iter().map(|w| w.0).collect();
    for (i, &w) in wavelengths_nm.iter().enumerate() {
        problems.require(w > 0.0, format!("wavelength_nm.{i}"), w, "nm", "be > 0");
        doubt(&Usual::WAVELENGTH, &format!("wavelength_nm.{i}"), w, problems);
        if wavelengths_nm[..i].contains(&w) {
            problems.push(format!("wavelength_nm.{i}"), format!("wavelength_nm = {w} nm stands twice"));
        }
    }
    let mut media: BTreeMap<String, Medium> =
        params.media.iter().map(|(name, m)| (name.clone(), medium(name, m, channels, params, problems))).collect();
    let mut objects = BTreeMap::new();
    for (name, o) in &params.objects {
        if let Some(object) = object(name, o, params, file, problems) {
            objects.insert(name.clone(), object);
        }
    }
    if params.objects.is_empty() {
        problems.push_with_hint("objects", "the scene has no object", "name at least one solid and its medium");
    }
    let camera = camera(params, problems);
    let projector = projector(params, problems);
    let lights = params.lights.iter().map(|(name, l)| (name.clone(), lamp(name, l, params, problems))).collect();
    let detectors = params.detectors.iter().map(|(name, d)| (name.clone(), detector(name, d, problems))).collect();
    let scene = {
        let used: BTreeSet<&str> = objects.values().filter_map(|o: &Object| o.medium.as_deref()).collect();
        media.retain(|name, _| used.contains(name.as_str()));
        Scene { wavelengths_nm, media, objects, camera, projector, lights, detectors }
    };
    if problems.is_empty() {
        check_whole(&scene, problems);
        warn_of_lost_light(&scene, problems);
    }
    scene
}

/// The objects of a scene with their solids.
pub struct Placed<'a> {
    pub name: &'a str,
    pub object: &'a Object,
    pub solid: Solid,
}

/// In the order of their names.
pub fn placed(scene: &Scene) -> Vec<Placed<'_>> {
    scene.objects.iter().map(|(name, object)| Placed { name, object, solid: solid(&object.shape) }).collect()
}

/// The object that fills a point, by its place: the one of highest priority, if any.
pub fn object_at(objects: &[Placed<'_>], p: DVec3) -> Option<usize> {
    (0..objects.len()).filter(|&i| objects[i].solid.contains(p)).max_by_key(|&i| objects[i].object.priority)
}

/// Whether light passes through the object as through nothing.
pub fn is_void(scene: &Scene, object: &Object) -> bool {
    !object.surface.is_opaque()
        && object.medium.as_ref().is_some_and(|m| scene.media.get(m).is_some_and(Medium::is_void))
}

fn plain<const N: usize>(lengths: [Length; N]) -> [f64; N] {
    // -0.0 and 0.0 are the same place and must give the same bytes.
    lengths.map(|l| l.0 + 0.0)
}

/// One value per channel, each tested by `rule`; a list must have as many values as there are wavelengths.
fn per_channel<T>(
    path: &str,
    given: &PerChannel<T>,
    number: impl Fn(&T) -> f64,
    params: &Params,
    problems: &mut Problems,
    rule: impl Fn(String, f64, &mut Problems),
) -> Vec<f64> {
    let channels = params.wavelength_nm.len().max(1);
    match given {
        PerChannel::One(value) => {
            rule(path.to_owned(), number(value), problems);
            vec![number(value); channels]
        }
        PerChannel::Each(values) => {
            for (i, value) in values.iter().enumerate() {
                rule(format!("{path}.{i}"), number(value), problems);
            }
            check_length(path, values.len(), params, problems);
            values.iter().map(number).collect()
        }
    }
}

/// A list has one value per channel.
fn check_length(path: &str, given: usize, params: &Params, problems: &mut Problems) {
    let name = path.rsplit('.').next().unwrap_or(path);
    let channels = params.wavelength_nm.len().max(1);
    if given == channels {
        return;
    }
    if params.wavelength_nm.is_empty() {
        problems.push_with_hint(
            path,
            format!("{name} lists {given} values, but the scene names no wavelengths"),
            "add `wavelength_nm: [..]` beside `media`, or give one number",
        );
    } else {
        problems.push_with_hint(
            path,
            format!("{name} lists {given} values for {channels} wavelengths"),
            "give one value per wavelength, or one number for all",
        );
    }
}
