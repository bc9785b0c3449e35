//! The truth port: what stands at the centre of every pixel.

use glam::DVec3;
use serde_json::json;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Scene, Surface, Truth};
use turbid_contract::{Attributes, ImageStack, LayerInfo, LayerKind};
use turbid_geometry::phase_function;

use crate::camera::Camera;
use crate::world::{Chords, Interface, World};

/// The first thing that the ray through a pixel's centre meets that is not void.
///
/// `names` are the objects in the order of the scene; `object_of` gives for each body its place among them.
pub fn truth(scene: &Scene, world: &World, object_of: &[usize], camera: &Camera) -> Truth {
    let (rows, columns) = (camera.rows, camera.columns);
    let mut stack = ImageStack::new(rows, columns);
    stack.attributes = said(scene);
    // Optical properties of the object; an opaque one has none and shows 0.
    let media: Vec<_> = scene.objects.values().map(|o| o.medium.as_ref().map(|m| &scene.media[m])).collect();
    let media = &media;
    let mut values: Vec<Value<'_>> = Vec::new();
    for channel in 0..scene.channels() {
        let of = |hit: &Hit| media[object_of[hit.body]];
        values.push(Box::new(move |hit| of(hit).map_or(0.0, |m| m.mu_a[channel])));
        values
            .push(Box::new(move |hit| of(hit).map_or(0.0, |m| m.mu_s[channel] * (1.0 - phase_function(&m.phase).g()))));
    }
    values.push(Box::new(|hit| hit.height));
    values.push(Box::new(|hit| hit.depth));
    values.extend((0..3).map(|i| -> Value<'_> { Box::new(move |hit| hit.normal[i]) }));
    values.push(Box::new(|hit| object_of[hit.body] as f64));
    // Where surfaces have textures.
    values.push(Box::new(|hit| hit.albedo.unwrap_or(0.0)));
    let (infos, mask_info) = layers(scene);
    let mut chords = Chords::default();
    // Pixel by pixel into all layers: a hit takes more room than what is said of it.
    let zeros = || Array2::<f32>::zeros((rows, columns));
    let mut data: Vec<Array2<f32>> = infos.iter().map(|_| zeros()).collect();
    let mut mask = zeros();
    for (pixel, mask) in mask.iter_mut().enumerate() {
        let Some(hit) = first_hit(world, camera, pixel, &mut chords) else {
            *mask = MaskReason::Background.code();
            continue;
        };
        for (value, data) in values.iter().zip(&mut data) {
            data[(pixel / columns, pixel % columns)] = value(&hit) as f32;
        }
    }
    infos.into_iter().zip(data).for_each(|(info, data)| stack.push(info, data));
    stack.push(mask_info, mask);
    Truth(stack)
}

/// The layers of a truth in their order, and its mask.
pub fn layers(scene: &Scene) -> (Vec<LayerInfo>, LayerInfo) {
    let of = |channel: usize| {
        let wavelength_nm = scene.wavelengths_nm.get(channel).copied();
        ["mu_a", "mu_s_prime"].map(|name| LayerInfo { wavelength_nm, ..LayerInfo::value(name, "mm^-1") })
    };
    let mut layers: Vec<LayerInfo> = (0..scene.channels()).flat_map(of).collect();
    layers.extend(["height", "depth"].map(|name| LayerInfo::value(name, "mm")));
    layers.extend(["normal_x", "normal_y", "normal_z", "object"].map(|name| LayerInfo::value(name, "1")));
    if scene.objects.values().any(|o| matches!(o.surface, Surface::Textured(_))) {
        // Of opaque objects; light that enters others is not a matter of their surface alone.
        layers.push(LayerInfo::value("albedo", "1"));
    }
    (layers, LayerInfo::new("mask", LayerKind::Mask, "1"))
}

/// What a truth says beside its layers.
pub fn said(scene: &Scene) -> Attributes {
    let names: Vec<&String> = scene.objects.keys().collect();
    let mut attributes = Attributes::from([("objects".to_owned(), json!(names))]);
    if let Some(camera) = &scene.camera {
        attributes.insert("field".to_owned(), json!(camera.field));
        camera.insert_pitch_into(&mut attributes);
    }
    scene.rig().insert_into(&mut attributes);
    attributes
}

/// What a layer says of a hit.
type Value<'a> = Box<dyn Fn(&Hit) -> f64 + 'a>;

pub(crate) struct Hit {
    /// The body that fills the space behind the boundary.
    pub body: usize,
    /// The boundary itself, which may be that of another body whose void ends there.
    pub interface: Interface,
    /// Where, mm.
    pub r: DVec3,
    /// World z, mm.
    height: f64,
    /// Along the camera's axis, mm.
    pub depth: f64,
    /// Towards the camera.
    pub normal: DVec3,
    /// Of an opaque object.
    albedo: Option<f64>,
}

/// What the ray through a pixel's centre meets first that is not void.
pub(crate) fn first_hit(world: &World, camera: &Camera, pixel: usize, chords: &mut Chords) -> Option<Hit> {
    first_hit_at(world, camera, (pixel, 0.5, 0.5), chords)
}

/// The same through the place (x, y) of a pixel: (0, 0) is its top left corner, (1, 1) its bottom right.
pub(crate) fn first_hit_at(
    world: &World,
    camera: &Camera,
    (pixel, x, y): (usize, f64, f64),
    chords: &mut Chords,
) -> Option<Hit> {
    let (origin, w) = camera.ray(pixel, x, y);
    let mut interface = None;
    for segment in world.trace(origin, w, None, chords) {
        if segment.material != 0 {
            let r = origin + segment.start * w;
            // Parallel rays start beside the camera's place.
            let axis = camera.view.forward;
            let depth = segment.start * w.dot(axis) + (origin - camera.view.position).dot(axis);
            let interface = interface?;
            let albedo = world.albedo(world.materials[segment.material].bsdf, interface, r);
            let normal = world.normal(interface, r);
            let normal = if normal.dot(w) > 0.0 { -normal } else { normal };
            // Which body fills it: the first, in order of priority, that holds a point just inside.
            let inside = origin + (segment.start + 1e-6 * (segment.end - segment.start).min(1.0)) * w;
            let body = world.bodies.iter().position(|b| b.solid.contains(inside))?;
            return Some(Hit { body, interface, r, height: r.z, depth, normal, albedo });
        }
        interface = segment.interface;
    }
    None
}
