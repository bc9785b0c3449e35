//! Whether the reflectance was seen the way the table takes it to have been, and what it does to the maps where it was not.
//!
//! Before a run from facts, in a run from attributes and, pixel by pixel, from layers of kind condition.

mod run;
mod say;

use std::collections::BTreeMap;
use std::sync::Mutex;

use turbid_contract::layers::wavelengths;
use turbid_contract::payload::{CONDITIONS, Conditions, REFERENCE_CONDITIONS, SaidBy, Seen, Thickness};
use turbid_contract::{Attributes, Known, Problems, serde_json};
use turbid_geometry::phase_function;
use turbid_optics::PhaseFunction;
use turbid_optics::misreading::{Reading, Setting, Side, misreading};

pub use run::tell;

use crate::lut::{of_table, places, same_f_x, table_of, tables};
use crate::params::Params;

/// Lines of light and view no more oblique than this (degrees) count as normal: what they do to mu_a stays below some 1 %.
const NEAR_NORMAL_DEG: f64 = 10.0;
/// A table of phantoms knows the angles that they were seen under, and so much (degrees) beside.
const BESIDE_DEG: f64 = 5.0;
/// A slab through which light that goes to and fro falls below this is as good as a half-space.
const THROUGH: f64 = 1e-3;
/// Thicknesses that differ by less than this of themselves are one.
const SAME_THICKNESS: f64 = 0.01;
/// CPU seconds to work out by how much maps of one table are off (1.4 to 3.7 measured, with angles and with a thickness unlike the table's).
const PER_TABLE_S: f64 = 2.2;
/// What changes mu_a and mu_s' by less is not told.
pub const LEAST_TOLD: f64 = 0.01;

/// In what the two may differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    Angles,
    Thickness,
    Phase,
    N,
}

impl Cause {
    pub const ALL: [Cause; 4] = [Self::Angles, Self::Thickness, Self::Phase, Self::N];

    /// `base` with what this cause is about as in `other`.
    fn taken(self, base: Setting, other: Setting) -> Setting {
        match self {
            Self::Angles => Setting { view_deg: other.view_deg, incidence_deg: other.incidence_deg, ..base },
            Self::Thickness => Setting { thickness: other.thickness, ..base },
            Self::Phase => Setting { phase: other.phase, ..base },
            Self::N => Setting { n: other.n, ..base },
        }
    }
}

/// A reflectance and the table that is to read it.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Nothing where nobody said anything.
    pub said: Option<Conditions>,
    /// The phantom of the calibration, as it was seen, and what it is taken for; `None` of a table of phantoms, which were seen beside the same.
    pub reference: Option<(Option<Seen>, Side)>,
    pub table: Setting,
    /// Least and most angle of view and of light under which the phantoms of the table were seen; `None` of a table of a model.
    of_phantoms: Option<[Option<[f64; 2]>; 2]>,
    /// The middle of the table's mu_a and mu_s', mm^-1, in the logarithm.
    pub middle: [f64; 2],
    pub f_x: [f64; 2],
    pub slopes_corrected: bool,
}

fn number(attributes: &Attributes, name: &str) -> Option<f64> {
    attributes.get(name).and_then(serde_json::Value::as_f64)
}

fn numbers(attributes: &Attributes, name: &str) -> Vec<f64> {
    attributes.get(name).and_then(|v| serde_json::from_value(v.clone()).ok()).unwrap_or_default()
}

impl Compared {
    /// From what both say of themselves; `None` where the table does not say what it is of.
    ///
    /// `channel`: the number of the wavelength whose reference stands for that of all that read this table; it is about the size of what is misread.
    pub fn of(
        reflectance: &Attributes,
        lut: &Attributes,
        (f_x, channel): ([f64; 2], usize),
        slopes_corrected: bool,
    ) -> Option<Self> {
        let normal = Setting {
            phase: PhaseFunction::henyey_greenstein(number(lut, "g")?),
            n: number(lut, "n")?,
            thickness: number(lut, "thickness"),
            view_deg: 0.0,
            incidence_deg: 0.0,
        };
        let phantoms = Conditions::of(lut, CONDITIONS).map(|said| said.seen).unwrap_or_default();
        let empirical = lut.get("model").and_then(|m| m.as_str()) == Some("empirical");
        let table = phantoms.first().map_or(normal, |seen| setting(seen, &normal));
        let range = |of: &dyn Fn(&Seen) -> Option<[f64; 3]>| {
            let all: Option<Vec<[f64; 3]>> = phantoms.iter().map(of).collect();
            let all = all.filter(|all| !all.is_empty())?;
            let [least, most] = [f64::INFINITY, f64::NEG_INFINITY];
            Some(all.iter().fold([least, most], |[a, b], [least, _, most]| [a.min(*least), b.max(*most)]))
        };
        let reference = reflectance.get("reference").filter(|_| !empirical).and_then(|phantom| {
            let of = |name: &str| {
                let value = phantom.get(name)?;
                value.as_f64().or_else(|| value.get(channel)?.as_f64())
            };
            let seen =
                Setting { phase: PhaseFunction::henyey_greenstein(of("g")?), n: of("n")?, thickness: None, ..normal };
            let seen_as = Conditions::of(reflectance, REFERENCE_CONDITIONS).and_then(|c| c.seen.into_iter().next());
            Some((seen_as, Side { mu: [of("mu_a")?, of("mu_s_prime")?], seen }))
        });
        let middle = ["mu_a", "mu_s_prime"].map(|name| {
            let nodes = numbers(lut, name);
            nodes.first().zip(nodes.last()).map_or(0.1, |(a, b)| (a * b).sqrt())
        });
        Some(Self {
            said: Conditions::of(reflectance, CONDITIONS),
            reference,
            table,
            of_phantoms: empirical.then(|| [range(&|s| s.view_deg), range(&|s| s.incidence_deg)]),
            middle,
            f_x,
            slopes_corrected,
        })
    }

    /// What is read of `mu` seen as `seen`, over `mu` and less 1, because of these causes; `None` where the solver does not know.
    pub fn reads(&self, mu: [f64; 2], seen: Setting, causes: &[Cause]) -> Option<[f64; 2]> {
        let all = |base: Setting, other: Setting| causes.iter().fold(base, |base, cause| cause.taken(base, other));
        let reference = self.reference.as_ref().map(|(seen, taken)| {
            let seen = seen.as_ref().map_or(taken.seen, |s| all(taken.seen, setting(s, &taken.seen)));
            (Side { seen, ..*taken }, *taken)
        });
        let (table, f_x) = (self.table, self.f_x);
        let sample = Side { mu, seen: all(table, seen) };
        let slopes_corrected = self.slopes_corrected || !causes.contains(&Cause::Angles);
        remembered(&rounded(Reading { sample, reference, table, f_x, slopes_corrected }))
    }

    /// The causes that may tell on `seen`, by what needs no solver.
    pub fn causes(&self, seen: &Seen, mu: [f64; 2]) -> Vec<Cause> {
        let reference = self.reference.as_ref();
        Cause::ALL
            .into_iter()
            .filter(|cause| {
                self.differs(*cause, seen, mu, &self.table, self.of_phantoms.as_ref())
                    || reference.is_some_and(|(seen, taken)| {
                        seen.as_ref().is_some_and(|seen| self.differs(*cause, seen, taken.mu, &taken.seen, None))
                    })
            })
            .collect()
    }

    fn differs(
        &self,
        cause: Cause,
        seen: &Seen,
        mu: [f64; 2],
        taken: &Setting,
        of_phantoms: Option<&[Option<[f64; 2]>; 2]>,
    ) -> bool {
        let other = |a: Option<f64>, b: f64| a.is_some_and(|a| !same_f_x(a, b));
        match cause {
            Cause::Phase => match (seen.phase.as_ref().map(phase_function), taken.phase) {
                (None, _) => false,
                (Some(PhaseFunction::HenyeyGreenstein { g }), PhaseFunction::HenyeyGreenstein { g: taken }) => {
                    other(Some(g), taken)
                }
                (Some(phase), taken) => phase != taken,
            },
            Cause::N => other(seen.n, taken.n),
            Cause::Angles => match of_phantoms {
                None => {
                    [seen.view_deg, seen.incidence_deg].iter().flatten().any(|[_, _, most]| *most > NEAR_NORMAL_DEG)
                }
                Some(ranges) => [seen.view_deg, seen.incidence_deg].iter().zip(ranges).any(|(seen, range)| {
                    matches!((seen, range), (Some([least, _, most]), Some([from, to]))
                        if *least < from - BESIDE_DEG || *most > to + BESIDE_DEG)
                }),
            },
            Cause::Thickness => match (seen.thickness, taken.thickness) {
                (None, _) | (Some(Thickness::HalfSpace), None) => false,
                (Some(Thickness::HalfSpace), Some(table)) => through(mu, table) > THROUGH,
                (Some(Thickness::Mm([least, _, _])), None) => through(mu, least) > THROUGH,
                (Some(Thickness::Mm([least, _, most])), Some(table)) => {
                    let unlike = |d: f64| (d - table).abs() > SAME_THICKNESS * table;
                    (unlike(least) || unlike(most)) && through(mu, least.min(table)) > THROUGH
                }
            },
        }
    }
}

/// What diffuse light keeps of itself to the far side of a slab and back, exp(-2 mu_eff d).
fn through([mu_a, mu_s_prime]: [f64; 2], thickness: f64) -> f64 {
    libm::exp(-2.0 * (3.0 * mu_a * (mu_a + mu_s_prime)).sqrt() * thickness)
}

/// How an object was seen, in the middle of its pixels; what nobody said is as in `taken`.
pub fn setting(seen: &Seen, taken: &Setting) -> Setting {
    let median = |spread: Option<[f64; 3]>, taken: f64| spread.map_or(taken, |[_, median, _]| median);
    Setting {
        phase: seen.phase.as_ref().map_or(taken.phase, phase_function),
        n: seen.n.unwrap_or(taken.n),
        thickness: match seen.thickness {
            None => taken.thickness,
            Some(Thickness::HalfSpace) => None,
            Some(Thickness::Mm([_, median, _])) => Some(median),
        },
        view_deg: median(seen.view_deg, taken.view_deg),
        incidence_deg: median(seen.incidence_deg, taken.incidence_deg),
    }
}

/// Rounded to what changes the answer by next to nothing, so that instances of a sweep and pixels share answers: mu by 10 %, thickness by 2 %,
/// angles by half a degree.
fn rounded(reading: Reading) -> Reading {
    let steps = |x: f64, step: f64| (x / step).round() * step;
    let ln_steps = |x: f64, step: f64| if x > 0.0 { libm::exp(steps(libm::log(x), step)) } else { x };
    let of = |side: Side| Side {
        mu: side.mu.map(|mu| ln_steps(mu, 0.1)),
        seen: Setting {
            thickness: side.seen.thickness.map(|d| ln_steps(d, 0.02)),
            view_deg: steps(side.seen.view_deg, 0.5),
            incidence_deg: steps(side.seen.incidence_deg, 0.5),
            ..side.seen
        },
    };
    // A slab that the table knows is that of the sample, and stays it.
    let table = of(Side { mu: reading.sample.mu, seen: reading.table }).seen;
    Reading { sample: of(reading.sample), reference: reading.reference.map(|(a, b)| (of(a), of(b))), table, ..reading }
}

/// The answer of the solver, asked once for each reading.
fn remembered(reading: &Reading) -> Option<[f64; 2]> {
    static KNOWN: Mutex<BTreeMap<String, Option<[f64; 2]>>> = Mutex::new(BTreeMap::new());
    let key = format!("{reading:?}");
    if let Some(known) = KNOWN.lock().expect("no holder panics").get(&key) {
        return *known;
    }
    let found = misreading(reading).ok().filter(|found| found.iter().all(|x| x.is_finite()));
    KNOWN.lock().expect("no holder panics").insert(key, found);
    found
}

/// Warns of all that is known to differ before anything runs.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    let mut said = false;
    for (compared, objects) in known_before(params, known) {
        if let Some(message) = say::unsaid(&compared).filter(|_| !said) {
            problems.warn("", message);
            said = true;
        }
        for (seen, mu) in objects {
            warn_of(&compared, &seen, mu, problems);
        }
    }
}

/// CPU seconds that a run takes to tell what the maps are off by, as far as what differs is known before.
pub fn seconds(params: &Params, known: &Known) -> f64 {
    let unlike = |(compared, objects): &(Compared, Vec<Object>)| {
        objects.iter().any(|(seen, mu)| !compared.causes(seen, *mu).is_empty())
    };
    PER_TABLE_S * known_before(params, known).iter().filter(|of| unlike(of)).count() as f64
}

/// How an object was seen, and its mu_a and mu_s', mm^-1.
type Object = (Seen, [f64; 2]);

/// For each table the comparison, and the objects that are read by it.
fn known_before(params: &Params, known: &Known) -> Vec<(Compared, Vec<Object>)> {
    let (reflectance, lut) = (known.fact("reflectance"), known.fact("lut"));
    let f_x = match &params.f_x {
        Some(f_x) => Some(f_x.iter().map(|f| f.0).collect()),
        None => {
            let own = known.form("reflectance").and_then(|form| form.f_x()).unwrap_or_default();
            [own, numbers(&lut, "f_x")].into_iter().find(|f| f.len() > 1)
        }
    };
    let f_x = extremes(f_x.unwrap_or_default());
    let corrected = known.connected.iter().any(|port| port == "height");
    if !reflectance.contains_key("convention") {
        return Vec::new();
    }
    let layers = known.form("reflectance").and_then(|form| form.layers.as_deref());
    let wavelengths_nm = layers.map(|layers| wavelengths(layers, "r_d")).unwrap_or_default();
    let places = places(&lut, &wavelengths_nm).unwrap_or_default();
    let several = tables(&lut) > 1;
    let of = |table: usize| {
        let reads = |channel: usize| table_of(&lut, places.get(channel).copied().flatten()) == table;
        let channel = if several { (0..places.len()).find(|&k| reads(k)) } else { Some(0) };
        let compared = Compared::of(&reflectance, &of_table(&lut, table), (f_x?, channel?), corrected)?;
        let mut objects = Vec::new();
        for seen in compared.said.iter().flat_map(|said| &said.seen) {
            let media = media(seen, &compared).into_iter().enumerate();
            let own = media.filter(|(k, _)| !several || seen.mu_a.is_empty() || reads(*k));
            objects.extend(own.map(|(_, mu)| (seen.clone(), mu)));
        }
        Some((compared, objects))
    };
    (0..tables(&lut)).filter_map(of).collect()
}

/// Warns of each cause that tells on an object of mu_a and mu_s' `mu`.
fn warn_of(compared: &Compared, seen: &Seen, mu: [f64; 2], problems: &mut Problems) {
    for cause in compared.causes(seen, mu) {
        let found = worst(compared, seen, mu, cause);
        if found.is_some_and(|(_, off)| off.iter().all(|x| x.abs() < LEAST_TOLD)) {
            continue;
        }
        let (message, way_out) = say::differs(compared, seen, mu, cause, found);
        let size = found.map_or(1.0, |(_, off)| off[0].abs().max(off[1].abs()));
        problems.warn_ranked(size, "", message, way_out);
    }
}

/// The lowest and the highest.
pub fn extremes(f_x: Vec<f64>) -> Option<[f64; 2]> {
    let [low, high] = f_x.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &f| [a.min(f), b.max(f)]);
    (low < high).then_some([low, high])
}

/// mu_a and mu_s' of an object, by channels; where they are not known the middle of the table.
fn media(seen: &Seen, compared: &Compared) -> Vec<[f64; 2]> {
    let pairs = seen.mu_a.iter().zip(&seen.mu_s_prime).map(|(&a, &s)| [a, s]);
    let known: Vec<[f64; 2]> = pairs.filter(|[_, s]| *s > 0.0).collect();
    if seen.mu_a.is_empty() { vec![compared.middle] } else { known }
}

/// What is read in the middle of the object's pixels; where that is too little to be told and angles differ, at the most oblique.
fn worst(compared: &Compared, seen: &Seen, mu: [f64; 2], cause: Cause) -> Option<(Setting, [f64; 2])> {
    let middle = setting(seen, &compared.table);
    let found = compared.reads(mu, middle, &[cause])?;
    if cause != Cause::Angles || found.iter().any(|x| x.abs() >= LEAST_TOLD) {
        return Some((middle, found));
    }
    let most = |spread: Option<[f64; 3]>, middle: f64| spread.map_or(middle, |[_, _, most]| most);
    let edge = Setting {
        view_deg: most(seen.view_deg, middle.view_deg),
        incidence_deg: most(seen.incidence_deg, middle.incidence_deg),
        ..middle
    };
    Some((edge, compared.reads(mu, edge, &[cause])?))
}

/// Whether a scene said it, and so that nothing is left open.
fn by_scene(said: &Option<Conditions>) -> bool {
    said.as_ref().is_some_and(|said| said.said_by == SaidBy::Scene)
}
