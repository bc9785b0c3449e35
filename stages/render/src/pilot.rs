//! A small image of the scene by the very kernel of the render: how many flights the whole takes, for `turbid plan` to time.

use turbid_contract::payload::Scene;
use turbid_contract::{Ctx, MemoryHost, Pilot};

use crate::control_variate::{ControlVariates, control_variates};
use crate::fit::{FIT_PATHS, Lattice};
use crate::method::{FIRST_TEST, Taken, first_test_of_fit};
use crate::outline::projected;
use crate::params::{Allocate, Params};
use crate::plan;
use crate::projected::Projected;
use crate::rig::Rig;
use crate::served::Served;
use crate::stopping::{OfFit, OfPixels};
use crate::stopping_criterion::StoppingCriterion;
use crate::trace::{PILOT, Task, trace};

/// Pixels of the small image, at most: with 16 paths each they fill half a tile of a render, and their flights take some ms.
const PIXELS: f64 = 256.0;
/// Paths of each.
const SAMPLES: u32 = PILOT;
/// And so many more, by which it shows where control variates are walked.
const MORE_SAMPLES: u32 = 8;
/// ns that the paths may take by the figures of [`plan`]: connections through curved interfaces take as long as thousands of flights.
const MOST_NS: f64 = 3e7;
/// Functions of a fit to a surface whose error is 1 %, with what its bounds add (measured on a dome and in a bore: what they took over what 30 would have).
const FUNCTIONS: f64 = 120.0;
/// What is known of the paths before they are walked.
struct Walked {
    /// Flights of a path in the scene and of one in a control variate, those of all walks.
    flights: [f64; 2],
    /// The part of the pixels that may be walked with a control variate, and that for which it pays.
    with_control: [f64; 2],
    /// (SE / mean)^2 of the watched amplitude after one path in each pixel; of a fit after one path in all.
    variance: Option<f64>,
    done: f64,
}

/// `None` where no paths are walked, or the image cannot be rendered at all.
pub fn pilot(params: &Params, scene: &Scene, patterned: bool, ctx: Ctx<'_>) -> Option<Pilot> {
    let taken = Taken::of(params, scene, patterned);
    if matches!(taken, Taken::Rte { .. }) {
        return None;
    }
    let whole = Rig::of(scene).ok()?;
    let small = smaller(scene, &whole, &taken)?;
    let rig = Rig::of(&small).ok()?;
    let projected = projected(params, scene, patterned, rig.steady[0].shines());
    let controls = match taken {
        Taken::ControlVariates { .. } => control_variates(&small, &rig, params.target_error.map(|t| t.0)).ok()?,
        _ => None,
    };
    // Of meshes what camera and light see of them is found once, by the first paths: that is not theirs to be timed by.
    let walk = |samples, ctx| walk(params, &taken, (&rig, &projected, controls.as_ref()), samples, ctx);
    let unseen = MemoryHost::default();
    walk(2, Ctx::new(&unseen))?;
    let walked = walk(SAMPLES + if controls.is_some() { MORE_SAMPLES } else { 0 }, ctx)?;
    let lattice = Lattice::over(whole.camera.columns, whole.camera.rows);
    let lattice = (lattice.columns.len() * lattice.rows.len()) as f64;
    let pixels = if taken == Taken::Fit { lattice } else { whole.camera.pixels() as f64 };
    let fitted = if matches!(taken, Taken::Surfaces { .. }) { gain_of_fit(scene, &whole) } else { 1.0 };
    let samples = samples(params, &taken, pixels, walked.variance.map(|variance| fitted * variance))?;
    let tested = samples.min(f64::from(PILOT));
    let with_control = pixels * (walked.with_control[0] * tested + walked.with_control[1] * (samples - tested));
    let images = controls.filter(|_| walked.with_control[1] > 0.0).map_or(0.0, |controls| {
        controls.variates.len() as f64 * lattice * samples.max(f64::from(FIRST_TEST)) * f64::from(FIT_PATHS)
    });
    let flights = pixels * samples * walked.flights[0] + (with_control + images) * walked.flights[1];
    let rest_s = plan::after_paths(params, scene, &taken);
    Some(Pilot { done: walked.done, whole: flights, unit: "flights", rest_s })
}

/// What fits leave of the variance of the pixel that a target asks for, the middle one: one pixel's over so many as there are for each function.
fn gain_of_fit(scene: &Scene, rig: &Rig) -> f64 {
    let served = Served::of(scene);
    let largest = served.largest_region * rig.camera.pixels() as f64;
    if served.by_fits > 0.5 { (FUNCTIONS / largest).min(1.0) } else { 1.0 }
}

/// The scene in few pixels: all of the image, or where it looks the same everywhere a part of it with pixels as they are.
fn smaller(scene: &Scene, rig: &Rig, taken: &Taken) -> Option<Scene> {
    let mut small = scene.clone();
    let camera = small.camera.as_mut()?;
    let per_path =
        plan::ns_per_path(scene, Some(rig)) * if matches!(taken, Taken::ControlVariates { .. }) { 2.0 } else { 1.0 };
    let most = (MOST_NS / (per_path * f64::from(SAMPLES))).clamp(4.0, PIXELS);
    let side = most.sqrt();
    let [columns, rows] = camera.pixels.map(f64::from);
    // A row of pixels stays one.
    let wide = side.max(most / rows).min(columns);
    let high = (most / wide).min(rows);
    let pixels = [wide, high].map(|n| (n.floor() as u32).max(1));
    if *taken == Taken::Fit {
        for ((field, &now), n) in camera.field.iter_mut().zip(&camera.pixels).zip(pixels) {
            *field *= f64::from(n) / f64::from(now);
        }
    }
    camera.pixels = pixels;
    Some(small)
}

/// Walks the paths of the small image.
fn walk(
    params: &Params,
    taken: &Taken,
    (rig, projected, controls): (&Rig, &Projected, Option<&ControlVariates>),
    samples: u32,
    ctx: Ctx<'_>,
) -> Option<Walked> {
    let pixels: Vec<u32> = (0..rig.camera.pixels() as u32).collect();
    let few = Params { samples: Some(samples), target_error: None, max_seconds: None, ..params.clone() };
    let lattice = Lattice::over(rig.camera.columns, rig.camera.rows);
    let of_pixels = OfPixels::new(rig, projected, controls, Allocate::Even);
    let of_fit = OfFit { rig, projected, lattice: &lattice };
    let criterion: &dyn StoppingCriterion = if *taken == Taken::Fit { &of_fit } else { &of_pixels };
    let task = Task {
        params: &few,
        rig,
        projected,
        pixels: &pixels,
        controls,
        salt: 0,
        kept: false,
        first_test: u32::MAX,
        allocate: Allocate::Even,
        criterion,
        so_far: None,
    };
    let sums = trace(&task, ctx).ok()?;
    let count = pixels.len() as f64;
    let candidates = controls.map_or(0, |s| s.of_pixel.iter().flatten().count()) as f64;
    let chosen =
        sums.with_control.as_ref().map_or(0, |with_control| with_control.iter().filter(|&&b| b).count()) as f64;
    let tested = f64::from(PILOT.min(samples));
    let pairs = candidates * tested + chosen * (f64::from(samples) - tested);
    let [scene, paired] = sums.flights.map(|flights| flights as f64);
    let variance = params.target_error.and_then(|_| {
        let error = criterion.error(&sums.channels, &sums.paths, sums.with_control.as_deref())?;
        Some(error * error * f64::from(samples) * if *taken == Taken::Fit { count } else { 1.0 })
    });
    let walked = Walked {
        flights: [scene / (count * f64::from(samples)), if pairs > 0.0 { paired / pairs } else { 0.0 }],
        with_control: [candidates / count, chosen / count],
        variance,
        done: scene + paired,
    };
    (walked.done > 0.0).then_some(walked)
}

/// Paths of each pixel, on average; `None` where only the clock ends a run.
fn samples(params: &Params, taken: &Taken, pixels: f64, variance: Option<f64>) -> Option<f64> {
    let most = params.samples.map(f64::from);
    let Some(target) = params.target_error else { return most };
    let (first, variance) = match *taken {
        Taken::Fit => (f64::from(first_test_of_fit(pixels as usize)), variance? / pixels),
        _ => (f64::from(FIRST_TEST), variance?),
    };
    let needed = variance / (target.0 * target.0);
    // It is tested after every doubling: as likely just before one as just behind.
    let until = if needed <= first { first } else { std::f64::consts::SQRT_2 * needed };
    Some(most.map_or(until, |most| most.min(until)))
}
