//! From params to setups, with everything that can be wrong with them.

use std::f64::consts::PI;

use glam::DVec3;
use turbid_contract::{Problems, Usual};
use turbid_optics::PhaseFunction;

use crate::light::{Beam, Method, Setup, Target};
use crate::opening::{Opening, Outline};
use crate::params::{BeamParams, MediumParams, MethodParam, Params, RoundParams, SeesParam, SquareParams};
use crate::plate::Plate;
use crate::sphere::{Baffle, Port, Sphere};

/// The experiment as numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// By name, in the order of the names.
    pub media: Vec<(String, Plate)>,
    pub spheres: [Sphere; 2],
    pub beam: Beam,
    pub method: Method,
    /// True reflectance of the standard, and what it is taken for.
    pub standard: [f64; 2],
    pub photons: u64,
    /// Limit of bounces on white surfaces.
    pub bounces: Option<u32>,
}

impl Experiment {
    /// Those of all readings: of each medium, the standard, the open port and the straight beam.
    pub fn all_photons(&self) -> f64 {
        self.photons as f64 * (self.media.len() + 3) as f64
    }

    /// The setup with this at the sample port.
    pub fn with(&self, target: Target) -> Setup {
        Setup { spheres: self.spheres.clone(), target, beam: self.beam, method: self.method, bounces: self.bounces }
    }
}

/// The experiment, or nothing and the problems.
pub fn assemble(params: &Params, problems: &mut Problems) -> Option<Experiment> {
    let spheres = spheres(params, problems);
    let beam = beam(params, problems);
    let media = media(params, problems);
    let reflectance = params.standard.reflectance.0;
    let taken = params.standard.taken_as.map_or(reflectance, |r| r.0);
    for (at, value) in [("standard.reflectance", reflectance), ("standard.taken_as", taken)] {
        problems.require(value > 0.0 && value <= 1.0, at, value, "", "lie in (0, 1]");
    }
    if params.samples == 0 {
        problems.push("samples", "samples = 0 must be > 0: no photon, no reading");
    }
    let baffled = params.spheres.baffle.is_some();
    let method = match params.method {
        MethodParam::Auto if baffled => Method::Traced,
        MethodParam::Auto | MethodParam::Summed => Method::Summed,
        MethodParam::Traced => Method::Traced,
        MethodParam::Counted => Method::Counted,
    };
    if method == Method::Summed && baffled {
        let message = "light beside a baffle has no closed form";
        problems.push_with_hint("method", message, "take `method: traced`, or leave `baffle` out");
    }
    if !problems.is_empty() {
        return None;
    }
    let (spheres, beam) = (spheres?, beam?);
    leaks(params, problems);
    Some(Experiment {
        media,
        spheres,
        beam,
        method,
        standard: [reflectance, taken],
        photons: params.samples,
        bounces: params.spheres.bounces,
    })
}

fn media(params: &Params, problems: &mut Problems) -> Vec<(String, Plate)> {
    if params.media.is_empty() {
        problems.push("media", "media is empty; name at least one medium");
    }
    let sample = &params.sample;
    problems.require(sample.thickness.0 > 0.0, "sample.thickness", sample.thickness.0, "mm", "be > 0");
    for (i, side) in sample.size.iter().flatten().enumerate() {
        problems.require(side.0 > 0.0, format!("sample.size.{i}"), side.0, "mm", "be > 0");
    }
    let slides = sample.slides.map_or(1.0, |n| n.0);
    problems.require((1.0..=10.0).contains(&slides), "sample.slides", slides, "", "lie in [1, 10]");
    let plates = params.media.iter().map(|(name, medium)| {
        let [mu_a, mu_s] = coefficients(name, medium, sample.thickness.0, problems);
        let size = sample.size.map_or([f64::INFINITY; 2], |size| size.map(|side| side.0));
        let phase = PhaseFunction::henyey_greenstein(medium.g.0);
        let plate = Plate { mu_a, mu_s, phase, n: medium.n.0, thickness: sample.thickness.0, size, slides };
        (name.clone(), plate)
    });
    plates.collect()
}

/// Films thinner than this, mm, are no tissue: whatever their coefficients, they are meant so.
const FILM: f64 = 0.05;

/// mu_a and mu_s of a medium in a plate so thick, mm.
fn coefficients(name: &str, m: &MediumParams, thickness: f64, problems: &mut Problems) -> [f64; 2] {
    let at = |field: &str| format!("media.{name}.{field}");
    problems.require(m.g.0.abs() < 1.0, at("g"), m.g.0, "", "lie in (-1, 1)");
    problems.require((1.0..=10.0).contains(&m.n.0), at("n"), m.n.0, "", "lie in [1, 10]");
    let mut checked = |value: f64, usual: Usual| {
        problems.require(value >= 0.0, at(usual.name), value, usual.unit, "be >= 0");
        if thickness >= FILM {
            problems.doubt(&usual, at(usual.name), value);
        }
        value
    };
    match (m.mu_a, m.mu_s, m.mu_s_prime, m.a_rho, m.s_rho) {
        (Some(a), Some(s), None, None, None) => [checked(a.0, Usual::MU_A), checked(s.0, Usual::MU_S)],
        (Some(a), None, Some(s), None, None) => {
            [checked(a.0, Usual::MU_A), checked(s.0, Usual::MU_S_PRIME) / (1.0 - m.g.0)]
        }
        (None, None, None, Some(a), Some(s)) => {
            [checked(a.0, Usual::A_RHO) / 1000.0, checked(s.0, Usual::S_RHO) / 1000.0]
        }
        _ => {
            problems.push_with_hint(
                format!("media.{name}"),
                format!("{name} must have exactly one pair of absorption and scattering"),
                "write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1)",
            );
            [0.0; 2]
        }
    }
}

fn outline(
    at: &str,
    round: Option<&RoundParams>,
    square: Option<&SquareParams>,
    problems: &mut Problems,
) -> Option<Outline> {
    let (outline, field, size) = match (round, square) {
        (Some(r), None) => (Outline::Round { radius: 0.5 * r.diameter.0 }, "round.diameter", r.diameter.0),
        (None, Some(s)) => (Outline::Square { half: 0.5 * s.side.0 }, "square.side", s.side.0),
        _ => {
            let hint = "write `round: {diameter: 10}` or `square: {side: 10}`";
            problems.push_with_hint(at, "a port has exactly one of `round` and `square`", hint);
            return None;
        }
    };
    problems.require(size > 0.0, format!("{at}.{field}"), size, "mm", "be > 0");
    (size > 0.0).then_some(outline)
}

fn spheres(params: &Params, problems: &mut Problems) -> Option<[Sphere; 2]> {
    let p = &params.spheres;
    problems.require(p.diameter.0 > 0.0, "spheres.diameter", p.diameter.0, "mm", "be > 0");
    problems.require(p.neck.0 >= 0.0, "spheres.neck", p.neck.0, "mm", "be >= 0");
    let reflectance = p.wall_reflectance.0;
    let white = (0.0..=1.0).contains(&reflectance);
    problems.require(white, "spheres.wall_reflectance", reflectance, "", "lie in [0, 1]");
    let polar = p.ports.detector.polar_deg.0;
    let polar_fits = (0.0..=180.0).contains(&polar);
    problems.require(polar_fits, "spheres.ports.detector.polar_deg", polar, "deg", "lie in [0, 180]");
    if p.diameter.0 <= 0.0 || !polar_fits {
        return None;
    }
    if p.bounces == Some(0) {
        problems.push("spheres.bounces", "bounces = 0 must be > 0: no light would leave the wall");
    }
    let radius = 0.5 * p.diameter.0;
    let mut port = |name: &str, round, square, turns| {
        let at = format!("spheres.ports.{name}");
        let outline = outline(&at, round, square, problems)?;
        if Opening::reach(outline) >= radius {
            problems.push(at, format!("a {} does not fit into a sphere of {} mm", described(outline), p.diameter.0));
            return None;
        }
        Some(Opening::new(outline, turns, radius))
    };
    let ports = &p.ports;
    let sample = port("sample", ports.sample.round.as_ref(), ports.sample.square.as_ref(), 0.0);
    let entrance = port("entrance", ports.entrance.round.as_ref(), ports.entrance.square.as_ref(), 0.5);
    let detector = port("detector", ports.detector.round.as_ref(), ports.detector.square.as_ref(), polar / 360.0);
    let exit = match &ports.exit {
        None => None,
        Some(exit) => Some(port("exit", exit.round.as_ref(), exit.square.as_ref(), 0.5)?),
    };
    let (sample, entrance, detector) = (sample?, entrance?, detector?);
    apart([("sample", &sample), ("entrance", &entrance)], problems);
    apart([("sample", &sample), ("detector", &detector)], problems);
    apart([("entrance", &entrance), ("detector", &detector)], problems);
    if let Some(exit) = &exit {
        apart([("sample", &sample), ("exit", exit)], problems);
        apart([("detector", &detector), ("exit", exit)], problems);
    }
    let baffle = baffle(params, &sample, &detector, problems);
    let sphere = |ports| Sphere {
        radius,
        reflectance,
        plane: Sphere::rim(radius, sample.outline) + p.neck.0,
        sample,
        ports,
        baffle,
        sees_sample: params.spheres.ports.detector.sees == SeesParam::All,
    };
    let behind = exit.map(|exit| (Port::Exit, exit));
    Some([
        sphere(vec![(Port::Entrance, entrance), (Port::Detector, detector)]),
        sphere(behind.into_iter().chain([(Port::Detector, detector)]).collect()),
    ])
}

fn described(outline: Outline) -> String {
    match outline {
        Outline::Round { radius } => format!("round port of {} mm", 2.0 * radius),
        Outline::Square { half } => format!("square port of {} mm", 2.0 * half),
    }
}

/// Ports may not come closer than the circles about them.
fn apart(pair: [(&str, &Opening); 2], problems: &mut Problems) {
    let [(a, first), (b, second)] = pair;
    let half_angle = |port: &Opening| libm::asin(Opening::reach(port.outline) / port.sphere);
    let between = libm::acos(first.axis.dot(second.axis).clamp(-1.0, 1.0));
    let needed = half_angle(first) + half_angle(second);
    if between < needed {
        let deg = 180.0 / PI;
        problems.push_with_hint(
            format!("spheres.ports.{b}"),
            format!(
                "{b} overlaps {a}: their middles are {:.1} deg apart, the circles about them need {:.1} deg",
                between * deg,
                needed * deg
            ),
            "make a port smaller, the sphere larger, or turn the detector by `polar_deg`",
        );
    }
}

fn baffle(params: &Params, sample: &Opening, detector: &Opening, problems: &mut Problems) -> Option<Baffle> {
    let p = params.spheres.baffle.as_ref()?;
    let (size, position) = (p.diameter.0, p.position.0);
    problems.require(size > 0.0, "spheres.baffle.diameter", size, "mm", "be > 0");
    problems.require(position > 0.0 && position < 1.0, "spheres.baffle.position", position, "", "lie in (0, 1)");
    let (from, to) = (sample.sphere * sample.axis, detector.sphere * detector.axis);
    let way = to - from;
    if size <= 0.0 || !(position > 0.0 && position < 1.0) || way.length() == 0.0 {
        return None;
    }
    let baffle = Baffle { center: from + position * way, normal: way.normalize(), radius: 0.5 * size };
    let along = baffle.center.dot(baffle.normal);
    let across = (baffle.center - along * baffle.normal).length() + baffle.radius;
    if along * along + across * across >= sample.sphere * sample.sphere {
        problems.push("spheres.baffle", format!("a baffle of {size} mm at this place touches the wall of the sphere"));
    }
    let beam = params.beam.collimated.as_ref().map_or(0.0, |beam| 0.5 * beam.diameter.0);
    // Where the beam's axis meets the plane of the baffle.
    let height = baffle.center.dot(baffle.normal) / baffle.normal.z;
    let miss = (DVec3::new(0.0, 0.0, height) - baffle.center).length();
    if miss < baffle.radius + beam {
        problems.push("spheres.baffle", format!("a baffle of {size} mm at this place stands in the beam"));
    }
    let needed = (1.0 - position) * Opening::reach(sample.outline) + position * Opening::reach(detector.outline);
    if baffle.radius < needed {
        problems.warn(
            "spheres.baffle.diameter",
            format!(
                "a baffle of {size} mm does not hide all of the sample from all of the detector; {:.1} mm would",
                2.0 * needed
            ),
        );
    }
    Some(baffle)
}

fn beam(params: &Params, problems: &mut Problems) -> Option<Beam> {
    let BeamParams { collimated, conical } = &params.beam;
    let (at, diameter, cos_half_angle) = match (collimated, conical) {
        (Some(beam), None) => ("beam.collimated.diameter", beam.diameter.0, 1.0),
        (None, Some(beam)) => {
            let angle = beam.half_angle_deg.0;
            let fits = angle > 0.0 && angle < 90.0;
            problems.require(fits, "beam.conical.half_angle_deg", angle, "deg", "lie in (0, 90)");
            ("beam.conical.diameter", beam.diameter.0, libm::cos(angle * PI / 180.0))
        }
        _ => {
            let hint = "write `collimated: {diameter: 1}` or `conical: {half_angle_deg: 3}`";
            problems.push_with_hint("beam", "a beam is exactly one of `collimated` and `conical`", hint);
            return None;
        }
    };
    problems.require(diameter >= 0.0, at, diameter, "mm", "be >= 0");
    let ports = &params.spheres.ports;
    let entrance = &ports.entrance;
    let widest = entrance.round.as_ref().map(|r| r.diameter.0).or(entrance.square.as_ref().map(|s| s.side.0));
    if let Some(widest) = widest
        && diameter > widest
    {
        problems.push(at, format!("a beam of {diameter} mm does not pass an entrance port of {widest} mm"));
    }
    Some(Beam { radius: 0.5 * diameter, cos_half_angle })
}

/// Warns of light that passes beside a sample smaller than its port.
fn leaks(params: &Params, problems: &mut Problems) {
    let Some(size) = params.sample.size else { return };
    let port = &params.spheres.ports.sample;
    let half = size.map(|side| 0.5 * side.0);
    // Covered share of the port, by strips along x.
    let strips = 2000;
    let (mut covered, mut whole) = (0.0, 0.0);
    let reach = port.round.as_ref().map(|r| 0.5 * r.diameter.0).or(port.square.as_ref().map(|s| 0.5 * s.side.0));
    let Some(reach) = reach else { return };
    for i in 0..strips {
        let x = reach * (f64::from(i) + 0.5) / f64::from(strips);
        let y = if port.round.is_some() { (reach * reach - x * x).sqrt() } else { reach };
        whole += y;
        if x < half[0] {
            covered += y.min(half[1]);
        }
    }
    let open = 1.0 - covered / whole;
    if open > 0.0 {
        problems.warn(
            "sample.size",
            format!(
                "the sample is smaller than its port: {:.2} % of the port stay open, and as much of the light that the spheres throw onto it leaks out",
                100.0 * open
            ),
        );
    }
}
