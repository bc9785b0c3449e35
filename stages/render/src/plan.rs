//! What a render is going to do: method, what the scene needs, what is left out, how long it will take.

use turbid_contract::payload::{Lamp, Medium, Object, Scene, Shape, Specular, Surface};
use turbid_contract::{Extent, Known, StagePlan};
use turbid_geometry::phase_function;
use turbid_optics::diffusion::a_robin;

use crate::channels::groups;
use crate::fit::{FIT_PATHS, Lattice};
use crate::form::sizes;
use crate::kernel::Kernels;
use crate::lamp_reflection::by_several_interfaces;
use crate::memory::{Asked, memory};
use crate::method::{Taken, bound};
use crate::mirrors::Mirrors;
use crate::outline::outline;
use crate::params::{Allocate, Method, Params};
use crate::projected_images::ProjectedImages;
use crate::rig::Rig;
use crate::strata::{Bending, bulges, turns_at_facets};
use crate::world::World;

/// ns per flight on one core, f32 lanes of AVX-512 (measured: 305, 547 and 2070 ns per path of 31, 67 and 387 flights; see
/// docs/theory/render.md). AVX2 takes about twice as long.
const NS_PER_FLIGHT: f64 = 5.0;
/// ns per path for its start and for next-event estimation, where that goes in lanes.
const NS_PER_PATH: f64 = 160.0;
/// The same where walls light each other (measured down a tube of 10 mm bore: 2.5 us a path of 31 flights; under pattern images 5.6 of 24, 16 of 201).
const NS_PER_FLIGHT_IN_BORES: f64 = 25.0;
const NS_PER_PATH_IN_BORES: f64 = 2000.0;
/// What the roulette of deep paths leaves of the flights in weakly absorbing media (measured: 405 of 902).
const LEFT_BY_ROULETTE: f64 = 0.45;

/// Variance of M_AC over paths / M_AC^2, at f_x l' of about 0.1 (1.5 to 5 in four scenes; see docs/theory/render.md).
const VARIANCE_PER_PATH: f64 = 4.0;

/// What a path costs where smooth interfaces turn light, over what it costs elsewhere (measured at n = 1.4: 131 s against 21 s to 1 % of M_AC).
const REFRACTED: f64 = 5.0;
/// ns more per path where interfaces are curved or tilted, or facets, and each estimate finds its connections by itself (measured at a half-embedded ball: 62 us a
/// path in all, of 1280 facets 130, of 81,920 facets 220; see docs/theory/render.md).
const NS_AT_INTERFACES: f64 = 6e4;
const NS_AT_FACETS: f64 = 1.6e5;
/// The same where lanes find the connections, but for those that are left to manifold sampling (2.9 us a path in all, of 1280 facets 10, of 81,920 facets 15).
const NS_AT_BULGES: f64 = 1e3;
const NS_AT_FACETS_IN_LANES: f64 = 1e4;

/// ns for each pixel and response after the paths: of a fit (measured with 300 x 300 and 500 x 500 pixels), and of pixels by their own paths
/// (300 x 300).
const NS_OF_FIT: f64 = 1000.0;
/// The same of fits on surfaces (64 x 64 pixels of a dome and of a bore: 4000 and 10,000).
const NS_OF_SURFACES: f64 = 7000.0;
const NS_OF_PIXEL: f64 = 500.0;

/// Flights that a path makes on average in the object where it makes most.
///
/// A path that enters a thick medium is absorbed there with a probability of about x / (1 + x), x = 2.6 k (1 + 4 k) (1 + A),
/// k^2 = mu_a / (3 (mu_a + mu_s')) (fitted to 31, 67 and 902 flights in three media, within 10 %), A the boundary constant of diffusion,
/// 1 for n = 1 (n = 1.4: 38 flights, measured 38), after 1 / (1 - albedo) flights; and it does not stay longer than twice the object's thickness on average (mean chord theorem).
pub fn flights_per_path(scene: &Scene) -> f64 {
    let in_object = |medium: &Medium, shape: &Shape| -> f64 {
        let thickness = thickness(shape);
        let channels = medium.mu_a.iter().zip(&medium.mu_s);
        let flights = channels.map(|(&mu_a, &mu_s)| {
            let k = (mu_a / (3.0 * (mu_a + mu_s * (1.0 - phase_function(&medium.phase).g())).max(f64::MIN_POSITIVE)))
                .sqrt();
            let x = 2.6 * k * (1.0 + 4.0 * k) * (1.0 + a_robin(medium.n));
            let until_absorbed = x / (1.0 + x) * (mu_a + mu_s) / mu_a;
            let until_out = 2.0 * mu_s * thickness;
            if mu_a > 0.0 { until_absorbed.min(until_out) } else { until_out }
        });
        flights.fold(0.0, f64::max)
    };
    scene
        .objects
        .values()
        .filter_map(|o| o.medium.as_ref().and_then(|m| scene.media.get(m)).map(|m| in_object(m, &o.shape)))
        .fold(1.0, f64::max)
}

/// What speaks against the transport solver, to be said behind the reason for a fit.
fn solver(params: &Params, scene: Option<&Scene>) -> String {
    let bound = scene.and_then(|scene| bound(params, scene));
    bound.map_or_else(String::new, |bound| format!("; rte is bounded by {:.2} % only", 100.0 * bound))
}

/// How often paths are walked for all channels.
fn walks(params: &Params, scene: &Scene) -> usize {
    if scene.channels() == 1 {
        return 1;
    }
    Rig::of(scene).map_or(scene.channels(), |rig| groups(&rig, &params.carriers(), &ProjectedImages::NONE).len())
}

/// The least extent of a shape, mm.
fn thickness(shape: &Shape) -> f64 {
    let least = |extents: [f64; 3]| extents.into_iter().fold(f64::INFINITY, f64::min);
    match shape {
        Shape::Slab { top, bottom } => top - bottom,
        Shape::Box { size, .. } => least(*size),
        Shape::Sphere { diameter, .. } => *diameter,
        Shape::Spheroid { diameters, .. } => least(*diameters),
        Shape::Cylinder { diameter, length, .. } => diameter.min(*length),
        Shape::Tube { inner_diameter, outer_diameter, .. } => 0.5 * (outer_diameter - inner_diameter),
        Shape::SphereShell { inner_diameter, outer_diameter, .. } => 0.5 * (outer_diameter - inner_diameter),
        Shape::Mesh(mesh) => least([0, 1, 2].map(|axis| {
            let along = || mesh.vertices.iter().map(|v| v[axis]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        })),
        Shape::Turned { shape, .. } => thickness(shape),
    }
}

/// The plan for known params and, where it is known, scene.
pub fn plan(params: &Params, scene: Option<&Scene>, known: &Known) -> StagePlan {
    let patterned = known.connected.iter().any(|port| port == "pattern");
    let power = known.wanted.iter().any(|port| port == "power");
    let rig = scene.and_then(|scene| Rig::of(scene).ok());
    let taken = match params.method {
        Method::Path => Some(Taken::Path { because: None }),
        _ => scene.map(|scene| Taken::of(params, scene, patterned)),
    };
    let mut plan = StagePlan { method: Some(named(params, scene, taken.as_ref())), ..StagePlan::default() };
    let mut sort = |needed: bool, what: &str| {
        if needed { plan.needs.push(what.to_owned()) } else { plan.left_out.push(what.to_owned()) }
    };
    let walks = scene.map_or(1, |scene| walks(params, scene));
    if let Some(scene) = scene {
        sort_objects(scene, rig.as_ref(), walks, &mut sort);
        sort_glints(scene, &mut sort);
    }
    sort_work(params, scene, taken.as_ref(), patterned, &mut sort);
    if let Some(scene) = scene
        && let Some(taken) = &taken
        && let Some(rig) = &rig
    {
        let projected = outline(params, scene, patterned, rig.steady[0].shines());
        let Kernels { name, refused } = Kernels::of(taken, rig, &projected, power);
        (plan.kernel, plan.refused) = (Some(name), refused);
    }
    if let (Some(scene), Some(taken)) = (scene, &taken) {
        plan.seconds = seconds(params, scene, taken, rig.as_ref(), walks);
    }
    if let (Some(scene), Some(taken), Some(rig)) = (scene, &taken, &rig) {
        let pattern = known.extent("pattern");
        let mut made = sizes(params, scene, known);
        made.retain(|port, _| *port == "frames" || known.is_wanted(port));
        let asked = Asked { params, scene, rig, taken, pattern, patterned, made: &made };
        if let Some(bytes) = memory(&asked) {
            plan.memory = Some(bytes);
            plan.bytes = Some(made.values().filter_map(|form| form.extent()).map(Extent::bytes).sum());
        }
    }
    plan
}

/// What is done, and why `auto` chose it.
fn named(params: &Params, scene: Option<&Scene>, taken: Option<&Taken>) -> String {
    match (params.method, taken) {
        (_, None) => "auto: known once the scene is".to_owned(),
        (Method::Auto, Some(Taken::Fit)) => {
            format!("fit (auto: the scene is laterally uniform{})", solver(params, scene))
        }
        (Method::Auto, Some(Taken::Rte { bound })) => {
            format!("rte (auto: its bound, {:.2} % of a frame, is within the target)", 100.0 * bound)
        }
        (_, Some(Taken::Rte { bound })) => format!("rte, off by {:.2} % of a frame at most", 100.0 * bound),
        (_, Some(Taken::Fit)) => "fit".to_owned(),
        (_, Some(Taken::Surfaces { because })) => {
            let because = because.as_ref().map_or_else(String::new, |because| format!(" (auto: {because})"));
            format!("fit of smooth surfaces where it holds, path elsewhere{because}")
        }
        (_, Some(Taken::ControlVariates { because })) => {
            format!("path, with laterally uniform control variates where a pilot finds that it pays (auto: {because})")
        }
        (_, Some(Taken::Path { because: Some(because) })) => format!("path (auto: {because})"),
        (_, Some(Taken::Path { because: None })) => "path".to_owned(),
    }
}

/// What the objects and lights of a scene need.
fn sort_objects(scene: &Scene, rig: Option<&Rig>, walks: usize, sort: &mut impl FnMut(bool, &str)) {
    let used = scene.objects.values().filter_map(|o| o.medium.as_ref());
    let scattering = used.filter(|m| scene.media[*m].mu_s.iter().any(|&s| s > 0.0));
    let scattering = scattering.collect::<std::collections::BTreeSet<_>>().len();
    sort(scattering > 0, "volume scattering");
    sort(scattering > 1, "several media");
    let diffuse = |o: &Object| o.surface.is_opaque() && o.surface != Surface::Mirror;
    sort(scene.objects.values().any(diffuse), "Lambertian surfaces");
    sort(scene.objects.values().any(|o| o.surface == Surface::Mirror), "mirrors");
    sort(scene.objects.len() > 1, "shadow rays through several objects");
    sort(scene.channels() > 1, "several channels");
    sort(walks < scene.channels(), "paths shared by channels");
    sort(scene.media.values().any(|m| m.n != 1.0), "Fresnel boundaries");
    let world = rig.map(|rig| &rig.worlds[0]);
    let at_interfaces = world.is_some_and(|world| Bending::of(world) == Bending::AtInterfaces);
    let refracts = world.is_some_and(|world| world.materials.iter().any(|m| m.n != 1.0));
    sort(at_interfaces && refracts, "refraction at curved or tilted walls");
    sort(world.is_some_and(|world| Mirrors::of(world).curved), "curved mirrors");
    sort(rig.is_some_and(by_several_interfaces), "glints by several walls, by chance");
    sort(scene.objects.values().any(|o| matches!(o.surface, Surface::Rough(_))), "rough boundaries");
    let ambient = scene.lights.values().filter(|l| matches!(l, Lamp::Ambient { .. })).count();
    sort(scene.projector.is_some(), "projector");
    sort(scene.lights.len() > ambient, "steady lights");
    sort(ambient > 0, "ambient light");
    sort(!scene.detectors.is_empty(), "detectors (for the port `power`)");
}

fn sort_glints(scene: &Scene, sort: &mut impl FnMut(bool, &str)) {
    let included = scene.camera.as_ref().is_some_and(|c| c.specular == Some(Specular::Include));
    let smooth = |o: &Object| {
        let bends = o.medium.as_ref().is_some_and(|m| scene.media[m].n != 1.0);
        o.surface == Surface::Mirror || (o.surface == Surface::Smooth && bends)
    };
    sort(included && scene.objects.values().any(smooth), "glints");
}

/// What the method, the parameters and the cameras need.
fn sort_work(
    params: &Params,
    scene: Option<&Scene>,
    taken: Option<&Taken>,
    patterned: bool,
    sort: &mut impl FnMut(bool, &str),
) {
    if let Some(taken) = taken {
        sort(!matches!(taken, Taken::Rte { .. }), "paths");
        sort(!matches!(taken, Taken::Fit | Taken::Rte { .. }), "paths for every pixel");
        sort(matches!(taken, Taken::ControlVariates { .. }), "control variates");
    }
    sort(params.f_x.iter().any(|f| f.0 > 0.0), "carriers");
    sort(params.orientation_deg.len() > 1, "several orientations");
    sort(patterned, "pattern images");
    sort(params.target_error.is_some(), "error target");
    sort(
        params.allocate == Allocate::Adaptive && !matches!(taken, Some(Taken::Fit | Taken::Surfaces { .. })),
        "paths to where the error is",
    );
    let camera = scene.and_then(|s| s.camera.as_ref());
    let projector = scene.and_then(|s| s.projector.as_ref());
    let distorted = camera.is_some_and(|c| c.distortion.is_some()) || projector.is_some_and(|p| p.distortion.is_some());
    sort(distorted, "lens distortion");
    sort(camera.is_some_and(|c| c.aperture.is_some()), "depth of field");
    let meshes = scene.is_some_and(|s| s.objects.values().any(|o| matches!(o.shape, Shape::Mesh(_))));
    sort(meshes, "BVH");
    let textured = |scene: &Scene| scene.objects.values().any(|o| matches!(o.surface, Surface::Textured(_)));
    sort(scene.is_some_and(textured), "textures");
}

/// CPU s on one core; `None` where the clock alone ends a run.
fn seconds(params: &Params, scene: &Scene, taken: &Taken, rig: Option<&Rig>, walks: usize) -> Option<f64> {
    let [columns, rows] = scene.camera.as_ref()?.pixels.map(|n| n as usize);
    let channels = scene.channels() as f64;
    if matches!(taken, Taken::Rte { .. }) {
        // Some ms for each spatial frequency (measured; see docs/theory/rte.md).
        return Some(5e-3 * channels * (1 + params.carriers().len()) as f64);
    }
    let pixels = (columns * rows) as f64;
    let lattice = Lattice::over(columns, rows);
    let of_lattice = (lattice.columns.len() * lattice.rows.len()) as f64;
    // The error of a fit of 6 terms is that of as many pixels with all the paths.
    let (traced, terms) = if *taken == Taken::Fit { (of_lattice, 6.0) } else { (pixels, pixels) };
    let for_target = params.target_error.map(|t| (VARIANCE_PER_PATH * terms / traced / (t.0 * t.0)).max(8.0));
    let most = params.samples.map(f64::from);
    let samples = for_target.into_iter().chain(most).reduce(f64::min)?;
    let with_control = matches!(taken, Taken::ControlVariates { .. });
    // At most: all pixels have the one control variate, and it pays.
    let paths = if with_control { 2.0 * traced + f64::from(FIT_PATHS) * of_lattice } else { traced };
    Some(paths * walks as f64 * samples * ns_per_path(scene, rig) * 1e-9)
}

/// ns that a path takes on one core, with its next-event estimation, by figures measured in other scenes.
pub fn ns_per_path(scene: &Scene, rig: Option<&Rig>) -> f64 {
    let flights = flights_per_path(scene);
    // Many flights are those of a weakly absorbing medium.
    let flights = if flights > 300.0 { LEFT_BY_ROULETTE * flights } else { flights };
    let hollow = |o: &Object| matches!(o.shape, Shape::Tube { .. } | Shape::SphereShell { .. });
    let per_path = if scene.objects.values().any(hollow) {
        NS_PER_PATH_IN_BORES + NS_PER_FLIGHT_IN_BORES * flights
    } else {
        NS_PER_PATH + NS_PER_FLIGHT * flights
    };
    let refracts =
        |o: &Object| o.surface == Surface::Smooth && o.medium.as_ref().is_some_and(|m| scene.media[m].n != 1.0);
    let per_path = if scene.objects.values().any(refracts) { REFRACTED * per_path } else { per_path };
    let at_interfaces = |world: &World| {
        if Bending::of(world) != Bending::AtInterfaces {
            return 0.0;
        }
        let in_lanes = bulges(world) && Mirrors::of(world).is_empty();
        match (turns_at_facets(world), in_lanes) {
            // Channels that share paths look for facets one by one.
            (true, true) if scene.channels() == 1 => NS_AT_FACETS_IN_LANES,
            (true, _) => NS_AT_FACETS,
            (false, true) => NS_AT_BULGES,
            (false, false) => NS_AT_INTERFACES,
        }
    };
    per_path + rig.map_or(0.0, |rig| at_interfaces(&rig.worlds[0]))
}

/// CPU seconds for what follows the paths: standard errors, fits and frames of all pixels.
pub fn after_paths(params: &Params, scene: &Scene, taken: &Taken) -> f64 {
    let Some(camera) = &scene.camera else { return 0.0 };
    let pixels = camera.pixels.iter().map(|&n| f64::from(n)).product::<f64>() * scene.channels() as f64;
    let q = 1.0 + 2.0 * params.carriers().len() as f64;
    let ns = match taken {
        Taken::Fit => NS_OF_FIT,
        Taken::Surfaces { .. } => NS_OF_SURFACES,
        _ => NS_OF_PIXEL,
    };
    1e-9 * ns * q * pixels
}
