//! From parameters to a checked scene: every mistake with its field, value, unit, rule and way out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec3;
use turbid_contract::payload::{Medium, Object, Scene};
use turbid_contract::{Length, Problems, Usual};
use turbid_geometry::solid;
use turbid_optics::solid::Solid;

use crate::params::Params;

mod channels;
mod chromophores;
mod detector;
mod drawn;
mod lamp;
mod medium;
mod object;
mod path;
mod phase_function;
mod plausible;
mod relief;
mod rig;
mod scatter;
mod shape;
mod surface;
mod view;
mod whole;

use channels::Channels;
use detector::detector;
use lamp::lamp;
use medium::medium;
use object::objects;
use plausible::doubt;
use scatter::at_their_origin;
use view::{camera, projector};
use whole::check_whole;

pub use rig::RigInput;
pub use scatter::scattered;

/// The scene that the parameters describe; meaningless where `problems` got something.
///
/// `file` gives the bytes of the input file that a field names.
pub fn assemble(
    params: &Params,
    rig: &RigInput,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Scene {
    let wavelengths_nm = wavelengths(params, rig, problems);
    let channels = match rig {
        RigInput::Unknown if wavelengths_nm.is_empty() => Channels::Open,
        _ => Channels::of(wavelengths_nm.len()),
    };
    let mut media: BTreeMap<String, Medium> = params
        .media
        .iter()
        .map(|(name, m)| (name.clone(), medium(name, m, (channels, &wavelengths_nm), problems)))
        .collect();
    let scattered = scattered(params);
    let mut objects = BTreeMap::new();
    for (name, o) in &params.objects {
        if let Some(of) = scattered.get(name) {
            let message = format!("a body of `{of}: {{scatter: ..}}` has the name {name}, too");
            problems.push_with_hint(format!("objects.{name}"), message, "give one of the two another name");
        }
        objects.extend(self::objects(name, o, params, file, problems));
    }
    if params.objects.is_empty() && !is_rig(params) {
        problems.push_with_hint(
            "objects",
            "the scene has no object",
            "name at least one solid and its medium; a scene of camera, projector and lights alone is a rig for others",
        );
    }
    let camera = params.camera.as_ref().map(|c| camera(c, problems));
    let projector = params.projector.as_ref().map(|p| projector(p, channels, problems));
    let lights = params.lights.iter().map(|(name, l)| (name.clone(), lamp(name, l, channels, problems))).collect();
    let detectors = params.detectors.iter().map(|(name, d)| (name.clone(), detector(name, d, problems))).collect();
    let mut scene = {
        let used: BTreeSet<&str> = objects.values().filter_map(|o: &Object| o.medium.as_deref()).collect();
        media.retain(|name, _| used.contains(name.as_str()));
        Scene { wavelengths_nm, media, objects, camera, projector, lights, detectors }
    };
    let taken = rig.complete(&mut scene, params, problems);
    if problems.is_empty() && !matches!(rig, RigInput::Unknown) {
        let mut whole = Problems::default();
        check_whole(&scene, &scattered, &mut whole);
        taken.replace(at_their_origin(whole, &scattered), problems);
    }
    scene
}

/// Whether all that it says is how other scenes are lit and seen.
fn is_rig(params: &Params) -> bool {
    let lit_or_seen = params.camera.is_some() || params.projector.is_some() || !params.lights.is_empty();
    lit_or_seen && params.media.is_empty()
}

/// Those of the scene, or of its rig.
fn wavelengths(params: &Params, rig: &RigInput, problems: &mut Problems) -> Vec<f64> {
    let own: Vec<f64> = params.wavelength_nm.iter().map(|w| w.0).collect();
    for (i, &w) in own.iter().enumerate() {
        problems.require(w > 0.0, format!("wavelength_nm.{i}"), w, "nm", "be > 0");
        doubt(&Usual::WAVELENGTH, &format!("wavelength_nm.{i}"), w, problems);
        if own[..i].contains(&w) {
            problems.push(format!("wavelength_nm.{i}"), format!("wavelength_nm = {w} nm stands twice"));
        }
    }
    match rig {
        RigInput::Known { scene, .. } if own.is_empty() => scene.wavelengths_nm.clone(),
        _ => own,
    }
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
