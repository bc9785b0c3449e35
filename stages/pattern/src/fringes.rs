//! Which fringes are shown: spatial frequencies, orientations and phase steps.

use std::f64::consts::TAU;

use turbid_contract::{AngleDeg, LayerInfo, PerLength, Problems, Usual};
use turbid_optics::elementary::sin_cos_turns;

/// One layer of a pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fringe {
    /// mm^-1.
    pub f_x: f64,
    pub orientation_deg: f64,
    /// Phase in turns.
    pub turns: f64,
}

/// The most layers of one pattern.
const MOST_LAYERS: usize = 4096;

/// By f_x, then orientation, then phase; f_x = 0 is one layer.
pub fn fringes(f_x: &[PerLength], orientation_deg: &[AngleDeg], phases: u32) -> Vec<Fringe> {
    let mut all = Vec::new();
    for f in f_x {
        if f.0 == 0.0 {
            all.push(Fringe { f_x: 0.0, orientation_deg: 0.0, turns: 0.0 });
            continue;
        }
        for o in orientation_deg {
            let steps = (0..phases).map(|k| f64::from(k) / f64::from(phases));
            all.extend(steps.map(|turns| Fringe { f_x: f.0, orientation_deg: o.0, turns }));
        }
    }
    all
}

impl Fringe {
    /// Cycles per mm along world x and y in the pattern's plane.
    pub fn along(&self) -> (f64, f64) {
        let (sin, cos) = sin_cos_turns(self.orientation_deg / 360.0);
        (self.f_x * cos, self.f_x * sin)
    }

    /// What its layer says.
    pub fn info(&self) -> LayerInfo {
        let mut info = LayerInfo::value("pattern", "1").with_f_x(self.f_x);
        info.phase_rad = Some(TAU * self.turns);
        info.orientation_deg = (self.f_x > 0.0).then_some(self.orientation_deg);
        info
    }
}

/// Reports what no fringes can be.
pub fn check(f_x: &[PerLength], orientation_deg: &[AngleDeg], phases: u32, problems: &mut Problems) {
    for (i, f) in f_x.iter().enumerate() {
        problems.require(f.0 >= 0.0, format!("f_x.{i}"), f.0, "mm^-1", "be >= 0");
        if f_x[..i].contains(f) {
            problems.push(format!("f_x.{i}"), format!("f_x = {f} stands twice"));
        }
        problems.doubt(&Usual::F_X, format!("f_x.{i}"), f.0);
    }
    let rule = "be >= 3: fewer do not fix mean, amplitude and phase";
    problems.require(phases >= 3, "phases", f64::from(phases), "", rule);
    if orientation_deg.is_empty() {
        problems.push_with_hint("orientation_deg", "orientation_deg is empty", "leave it out for [0]");
    }
    for (i, o) in orientation_deg.iter().enumerate() {
        problems.require(o.0.abs() <= 360.0, format!("orientation_deg.{i}"), o.0, "deg", "lie in [-360, 360]");
        if orientation_deg[..i].contains(o) {
            problems.push(format!("orientation_deg.{i}"), format!("orientation_deg = {o} stands twice"));
        }
    }
    let layers = f_x.len().saturating_mul(phases as usize).saturating_mul(orientation_deg.len());
    if layers > MOST_LAYERS {
        problems.push("f_x", format!("f_x, phases and orientations make {layers} layers, more than {MOST_LAYERS}"));
    }
}
