//! From parameters to a checked scene: every mistake with its field, value, unit, rule and way out.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};
use turbid_contract::payload::{Camera, Medium, Object, Projector, Scene, Shape, Surface};
use turbid_contract::{Length, Problems};
use turbid_optics::solid::Solid;
use turbid_optics::view::{View, ViewError};

use crate::overlap::overlap;
use crate::params::{MediumParams, ObjectParams, Params, SurfaceParams};
use crate::per_channel::PerChannel;

/// The largest image that a scene may ask for, pixels.
const MOST_PIXELS: u64 = 1 << 28;

/// The scene that the parameters describe; meaningless where `problems` got something.
pub fn assemble(params: &Params, problems: &mut Problems) -> Scene {
    let channels = params.wavelength_nm.len().max(1);
    let wavelengths_nm: Vec<f64> = params.wavelength_nm.iter().map(|w| w.0).collect();
    for (i, &w) in wavelengths_nm.iter().enumerate() {
        problems.require(w > 0.0, format!("wavelength_nm.{i}"), w, "nm", "be > 0");
        if wavelengths_nm[..i].contains(&w) {
            problems.push(format!("wavelength_nm.{i}"), format!("wavelength_nm = {w} nm stands twice"));
        }
    }
    if let Some(name) = params.lights.keys().next() {
        problems.push_with_hint(
            format!("lights.{name}"),
            "the projector is the only kind of light that this version knows",
            "leave `lights` empty",
        );
    }
    let mut media: BTreeMap<String, Medium> =
        params.media.iter().map(|(name, m)| (name.clone(), medium(name, m, channels, params, problems))).collect();
    let mut objects = BTreeMap::new();
    for (name, o) in &params.objects {
        if let Some(object) = object(name, o, params, problems) {
            objects.insert(name.clone(), object);
        }
    }
    if params.objects.is_empty() {
        problems.push_with_hint("objects", "the scene has no object", "name at least one solid and its medium");
    }
    let camera = camera(params, problems);
    let projector = projector(params, problems);
    let scene = {
        let used: BTreeSet<&str> = objects.values().filter_map(|o: &Object| o.medium.as_deref()).collect();
        media.retain(|name, _| used.contains(name.as_str()));
        Scene { wavelengths_nm, media, objects, camera, projector }
    };
    if problems.is_empty() {
        check_whole(&scene, problems);
    }
    scene
}

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
    }
}

/// The object that fills a point: the one of highest priority, if any.
pub fn object_at(scene: &Scene, p: DVec3) -> Option<(&str, &Object)> {
    scene
        .objects
        .iter()
        .filter(|(_, o)| solid(&o.shape).contains(p))
        .max_by_key(|(_, o)| o.priority)
        .map(|(name, o)| (name.as_str(), o))
}

/// Whether light passes through the object as through nothing.
pub fn is_void(scene: &Scene, object: &Object) -> bool {
    object.surface == Surface::Smooth
        && object.medium.as_ref().is_some_and(|m| scene.media.get(m).is_some_and(Medium::is_void))
}

fn medium(name: &str, m: &MediumParams, channels: usize, params: &Params, problems: &mut Problems) -> Medium {
    let at = |field: &str| format!("media.{name}.{field}");
    problems.require(m.g.0.abs() < 1.0, at("g"), m.g.0, "", "lie in (-1, 1)");
    problems.require(m.n.0 >= 1.0 && m.n.0 <= 10.0, at("n"), m.n.0, "", "lie in [1, 10]");
    let here = format!("media.{name}");
    let mut values = |given: Vec<f64>, is_list: bool, field: &str, unit: &str| -> Vec<f64> {
        for (i, &v) in given.iter().enumerate() {
            let path = if is_list { format!("{}.{i}", at(field)) } else { at(field) };
            problems.require(v >= 0.0, path, v, unit, "be >= 0");
        }
        if is_list && given.len() != channels {
            let (message, hint) = if params.wavelength_nm.is_empty() {
                (
                    format!("{field} lists {} values, but the scene names no wavelengths", given.len()),
                    "add `wavelength_nm: [..]` beside `media`, or give one number",
                )
            } else {
                (
                    format!("{field} lists {} values for {channels} wavelengths", given.len()),
                    "give one value per wavelength, or one number for all",
                )
            };
            problems.push_with_hint(at(field), message, hint);
        }
        if is_list { given } else { vec![given[0]; channels] }
    };
    let g = m.g.0;
    let coefficients = match (&m.mu_a, &m.mu_s, &m.mu_s_prime, &m.a_rho, &m.s_rho) {
        (Some(a), Some(s), None, None, None) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            Some((values(a, a_list, "mu_a", "mm^-1"), values(s, s_list, "mu_s", "mm^-1")))
        }
        (Some(a), None, Some(s), None, None) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            let reduced = values(s, s_list, "mu_s_prime", "mm^-1");
            Some((values(a, a_list, "mu_a", "mm^-1"), reduced.into_iter().map(|s| s / (1.0 - g)).collect()))
        }
        (None, None, None, Some(a), Some(s)) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            let (a, s) = (values(a, a_list, "A_rho", "m^-1"), values(s, s_list, "S_rho", "m^-1"));
            Some((a.into_iter().map(|v| v / 1000.0).collect(), s.into_iter().map(|v| v / 1000.0).collect()))
        }
        _ => {
            problems.push_with_hint(
                here,
                format!("{name} must have exactly one pair of absorption and scattering"),
                "write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1)",
            );
            None
        }
    };
    let (mu_a, mu_s): (Vec<f64>, Vec<f64>) = coefficients.unwrap_or((vec![0.0; channels], vec![0.0; channels]));
    Medium { mu_a: mu_a.into_iter().map(settle).collect(), mu_s: mu_s.into_iter().map(settle).collect(), g, n: m.n.0 }
}

fn numbers<T>(given: &PerChannel<T>, number: impl Fn(&T) -> f64) -> (Vec<f64>, bool) {
    match given {
        PerChannel::One(v) => (vec![number(v)], false),
        PerChannel::Each(v) => (v.iter().map(number).collect(), true),
    }
}

/// Rounds to 13 significant digits: 4236 m^-1 and mu_s' = 0.8472 mm^-1 at g = 0.8 differ in the last bits only, are the same
/// medium, and must not make anything stale.
fn settle(value: f64) -> f64 {
    if value.is_finite() { format!("{value:.12e}").parse().expect("a number that was just printed") } else { value }
}

fn object(name: &str, o: &ObjectParams, params: &Params, problems: &mut Problems) -> Option<Object> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let mut positive = |field: &str, v: f64| {
        problems.require(v > 0.0, at(field), v, "mm", "be > 0");
        v
    };
    let mut shapes = Vec::new();
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
        shapes.push(Shape::Box { size, center: plain(b.center) });
    }
    if let Some(s) = &o.sphere {
        shapes.push(Shape::Sphere { diameter: positive("sphere.diameter", s.diameter.0), center: plain(s.center) });
    }
    if let Some(s) = &o.spheroid {
        let diameters = [0, 1, 2].map(|i| positive(&format!("spheroid.diameters.{i}"), s.diameters[i].0));
        let center = plain(s.center);
        shapes.push(if diameters[0] == diameters[1] && diameters[1] == diameters[2] {
            Shape::Sphere { diameter: diameters[0], center }
        } else {
            Shape::Spheroid { diameters, center }
        });
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
    if shapes.len() != 1 {
        let rule = if shapes.is_empty() { "has no shape" } else { "has more than one shape" };
        problems.push_with_hint(
            format!("objects.{name}"),
            format!("{name} {rule}"),
            "give exactly one of slab, box, sphere, spheroid",
        );
    }
    let surface = match o.surface {
        SurfaceParams::Smooth => Surface::Smooth,
        SurfaceParams::Lambertian(rho) => {
            problems.require((0.0..=1.0).contains(&rho.0), at("surface.lambertian"), rho.0, "", "lie in [0, 1]");
            Surface::Lambertian(rho.0)
        }
    };
    match &o.medium {
        Some(medium) if !params.media.contains_key(medium) => {
            let known: Vec<&str> = params.media.keys().map(String::as_str).collect();
            let message = format!("there is no medium `{medium}`");
            match closest(medium, &known) {
                Some(near) => problems.push_with_hint(at("medium"), message, format!("did you mean `{near}`?")),
                None => problems.push_with_hint(at("medium"), message, format!("known: {}", known.join(", "))),
            }
        }
        None if surface == Surface::Smooth => {
            problems.push_with_hint(
                at("medium"),
                format!("{name} has no medium"),
                "name an entry of `media`; only an opaque surface needs none",
            );
        }
        _ => {}
    }
    // Light never enters an opaque object: what lies below cannot matter.
    let medium = if surface == Surface::Smooth { o.medium.clone() } else { None };
    Some(Object { shape: *shapes.first()?, medium, priority: o.priority, surface })
}

fn plain<const N: usize>(lengths: [Length; N]) -> [f64; N] {
    // -0.0 and 0.0 are the same place and must give the same bytes.
    lengths.map(|l| l.0 + 0.0)
}

fn camera(params: &Params, problems: &mut Problems) -> Option<Camera> {
    let c = params.camera.as_ref()?;
    check_view("camera", plain(c.position), plain(c.look_at), c.up, plain(c.field), problems);
    check_pixels("camera", c.pixels, problems);
    Some(Camera {
        position: plain(c.position),
        look_at: plain(c.look_at),
        up: c.up,
        field: plain(c.field),
        pixels: c.pixels,
        specular: c.specular,
    })
}

fn projector(params: &Params, problems: &mut Problems) -> Option<Projector> {
    let p = params.projector.as_ref()?;
    check_view("projector", plain(p.position), plain(p.look_at), p.up, plain(p.field), problems);
    problems.require(p.power.0 > 0.0, "projector.power", p.power.0, "W", "be > 0");
    if let Some(pixels) = p.pixels {
        check_pixels("projector", pixels, problems);
    }
    Some(Projector {
        position: plain(p.position),
        look_at: plain(p.look_at),
        up: p.up,
        field: plain(p.field),
        power: p.power.0,
        profile: p.profile,
        pixels: p.pixels,
    })
}

fn check_pixels(who: &str, pixels: [u32; 2], problems: &mut Problems) {
    for (i, &n) in pixels.iter().enumerate() {
        problems.require(
            n > 0,
            format!("{who}.pixels.{i}"),
            f64::from(n),
            "",
            "be >= 1: the image would have no pixel",
        );
    }
    let total = u64::from(pixels[0]) * u64::from(pixels[1]);
    if total > MOST_PIXELS {
        problems.push(format!("{who}.pixels"), format!("{total} pixels are more than {MOST_PIXELS}"));
    }
}

fn check_view(
    who: &str,
    position: [f64; 3],
    look_at: [f64; 3],
    up: [f64; 3],
    field: [f64; 2],
    problems: &mut Problems,
) {
    for (i, &f) in field.iter().enumerate() {
        problems.require(f > 0.0, format!("{who}.field.{i}"), f, "mm", "be > 0");
    }
    match View::new(position.into(), look_at.into(), up.into(), field.into()) {
        Ok(_) => {}
        Err(ViewError::NoDirection) => problems.push_with_hint(
            format!("{who}.look_at"),
            format!("look_at = {look_at:?} mm is the {who}'s own position"),
            "move one of them",
        ),
        Err(ViewError::AlongUp) => problems.push_with_hint(
            format!("{who}.up"),
            format!("the {who} looks along its up vector {up:?}, so that its image has no upper side"),
            "choose an `up` across the line of sight, such as [0, 1, 0]",
        ),
        Err(ViewError::Grazing) => problems.push_with_hint(
            format!("{who}.position"),
            format!("the {who} looks along the plane z = {} mm in which its field is measured", look_at[2]),
            "raise or lower the position above or below look_at",
        ),
    }
}

/// What can only be seen with all parts in place.
fn check_whole(scene: &Scene, problems: &mut Problems) {
    let objects: Vec<(&String, &Object)> = scene.objects.iter().collect();
    for (i, (a_name, a)) in objects.iter().enumerate() {
        for (b_name, b) in &objects[i + 1..] {
            if a.priority == b.priority && overlap(&solid(&a.shape), &solid(&b.shape)) {
                problems.push_with_hint(
                    format!("objects.{b_name}"),
                    format!("{a_name} and {b_name} overlap and have the same priority {}", a.priority),
                    "give the one that shall win a higher `priority`",
                );
            }
        }
    }
    let places = [
        ("camera", scene.camera.as_ref().map(|c| c.position)),
        ("projector", scene.projector.as_ref().map(|p| p.position)),
    ];
    for (who, position) in places {
        if let Some(position) = position
            && let Some((name, object)) = object_at(scene, position.into())
            && !is_void(scene, object)
        {
            problems.push_with_hint(
                format!("{who}.position"),
                format!("the {who} at {position:?} mm is inside the solid {name}"),
                "move it out, or carve a hole with an object of higher priority whose medium has mu_a = mu_s = 0",
            );
        }
    }
    if let Some(p) = &scene.projector
        && !sees_something(scene, p.position, p.look_at, p.up, p.field)
    {
        problems.push_with_hint(
            "projector.look_at",
            "the projector lights nothing: no ray of its field meets an object",
            "check position, look_at and field against the objects",
        );
    }
    if let Some(c) = &scene.camera {
        if !sees_something(scene, c.position, c.look_at, c.up, c.field) {
            problems.warn("camera.look_at", "the camera sees no object");
        }
        let refracting = scene
            .objects
            .iter()
            .find(|(_, o)| o.surface == Surface::Smooth && o.medium.as_ref().is_some_and(|m| scene.media[m].n != 1.0));
        if let (Some((name, _)), None) = (refracting, c.specular) {
            problems.push_with_hint(
                "camera.specular",
                format!("the smooth surface of {name} has n != 1, so it must be said whether its reflexes are seen"),
                "write `specular: exclude` (crossed polarisers) or `specular: include`",
            );
        }
    }
}

/// Whether a ray of the view meets anything that is not void: on a grid of 65 x 65 and at every object's middle.
fn sees_something(scene: &Scene, position: [f64; 3], look_at: [f64; 3], up: [f64; 3], field: [f64; 2]) -> bool {
    let Ok(view) = View::new(position.into(), look_at.into(), up.into(), DVec2::from(field)) else {
        return false;
    };
    let solids: Vec<Solid> = scene.objects.values().filter(|o| !is_void(scene, o)).map(|o| solid(&o.shape)).collect();
    let meets = |direction: DVec3| {
        solids.iter().any(|s| s.interval(view.position, direction).is_some_and(|(_, leave)| leave > 0.0))
    };
    let steps = 64;
    let grid = (0..=steps).flat_map(|i| (0..=steps).map(move |j| (f64::from(i), f64::from(j))));
    let n = f64::from(steps);
    // An object smaller than the grid's mesh is found by its middle.
    let middles = solids.iter().filter_map(|s| {
        let (low, high) = s.bounds();
        let middle = 0.5 * (low + high);
        middle.is_finite().then_some(middle)
    });
    grid.map(|(i, j)| view.direction(i / n, j / n)).any(meets)
        || middles
            .filter(|&m| view.project(m).is_some_and(|p| view.in_field(p)))
            .any(|m| meets((m - view.position).normalize()))
}

/// The known name nearest to `name` by edit distance, if it is near enough to be a slip.
fn closest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let distance = |a: &str, b: &str| {
        let b: Vec<char> = b.chars().collect();
        let mut row: Vec<usize> = (0..=b.len()).collect();
        for (i, x) in a.chars().enumerate() {
            let mut diagonal = row[0];
            row[0] = i + 1;
            for (j, &y) in b.iter().enumerate() {
                let next = (diagonal + usize::from(x != y)).min(row[j] + 1).min(row[j + 1] + 1);
                diagonal = row[j + 1];
                row[j + 1] = next;
            }
        }
        row[b.len()]
    };
    let (d, near) = known.iter().map(|k| (distance(name, k), *k)).min()?;
    (d <= 1 + name.chars().count() / 3).then_some(near)
}
