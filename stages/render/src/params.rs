//! The parameters of a render.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{AngleDeg, At, Error, LayerInfo, PerLength, Problem, Ratio, Seconds};

use crate::light::Carrier;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct Params {
    /// Spatial frequencies, mm^-1; 0 is one frame at half the pattern. Left out where a pattern is given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub f_x: Vec<PerLength>,
    /// Frames per spatial frequency, shifted by 2 pi / phases.
    #[serde(default = "three")]
    pub phases: u32,
    /// Directions along which the pattern varies, turned from world x towards world y.
    #[serde(default = "along_x")]
    pub orientation_deg: Vec<AngleDeg>,
    /// Paths per pixel; with `target_error` the most there will be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u32>,
    /// Stop once the median over the pixels of SE(M_AC) / M_AC at the highest f_x is this small.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_error: Option<Ratio>,
    /// Stop after this time, with whatever samples were reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_seconds: Option<Seconds>,
    /// Photons of each wavelength for the port `power`.
    #[serde(default = "hundred_thousand")]
    pub photons: u32,
    #[serde(default)]
    pub method: Method,
    /// Where the paths go: the same number to every pixel, or more to where the error is (`samples` is then the mean).
    #[serde(default)]
    pub allocate: Allocate,
}

/// Where paths go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum Allocate {
    /// The same number to every pixel.
    #[default]
    Even,
    /// So that SE(M_AC) / M_AC at the highest f_x becomes the same in all pixels.
    Adaptive,
}

/// How the radiance is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum Method {
    /// The cheapest method that is right for the scene; `plan` says which.
    #[default]
    Auto,
    /// Path tracing, every pixel on its own.
    Path,
    /// Path tracing, with smooth functions fitted to the pixels of smooth surfaces; where that does not hold, pixels on their own.
    Fit,
    /// The deterministic transport solver for laterally uniform scenes.
    Rte,
}

fn hundred_thousand() -> u32 {
    100_000
}

fn three() -> u32 {
    3
}

fn along_x() -> Vec<AngleDeg> {
    vec![AngleDeg(0.0)]
}

impl Params {
    /// Carriers with f_x > 0: by frequency, then orientation.
    pub fn carriers(&self) -> Vec<Carrier> {
        let positive = self.f_x.iter().map(|f| f.0).filter(|&f| f > 0.0);
        positive.flat_map(|f| self.orientation_deg.iter().map(move |o| Carrier::new(f, o.0))).collect()
    }

    /// With the fringes that the layers of a pattern say.
    pub fn showing<'l>(&self, pattern: impl IntoIterator<Item = &'l LayerInfo>) -> Self {
        let mut projected = Self { f_x: Vec::new(), orientation_deg: Vec::new(), ..self.clone() };
        for info in pattern {
            let (f, o) = (info.f_x_per_mm.map(PerLength), AngleDeg(info.orientation_deg.unwrap_or(0.0)));
            projected.f_x.extend(f.filter(|f| !projected.f_x.contains(f)));
            projected.orientation_deg.extend((!projected.orientation_deg.contains(&o)).then_some(o));
        }
        projected
    }

    /// Where f_x is given beside a pattern, both must say the same.
    ///
    /// Error: the fringes of the pattern's layers are others than f_x, orientation_deg and phases ask for.
    pub fn agree_with(&self, layers: &[&LayerInfo]) -> Result<(), Error> {
        if self.f_x.is_empty() {
            return Ok(());
        }
        let mut asked = Vec::new();
        for f in &self.f_x {
            let fringes = if f.0 == 0.0 { 1 } else { self.orientation_deg.len() };
            for o in &self.orientation_deg[..fringes] {
                let orientation = if f.0 == 0.0 { 0.0 } else { o.0 };
                asked.push((f.0, orientation, if f.0 == 0.0 { 1 } else { self.phases as usize }));
            }
        }
        let of = |info: &LayerInfo| {
            let f = info.f_x_per_mm.unwrap_or(f64::NAN);
            (f, if f == 0.0 { 0.0 } else { info.orientation_deg.unwrap_or(0.0) })
        };
        let count = |f: f64, o: f64| layers.iter().filter(|info| of(info) == (f, o)).count();
        let other = |message: String| {
            let hint = Some("leave f_x, phases and orientation_deg out: the pattern says them".to_owned());
            Error::Invalid(Problem { at: At::With, path: "f_x".to_owned(), message, hint })
        };
        let total: usize = asked.iter().map(|a| a.2).sum();
        if let Some((f, o, n)) = asked.iter().find(|(f, o, n)| count(*f, *o) != *n) {
            return Err(other(format!(
                "f_x = {f} mm^-1 at {o} deg asks for {n} frames, the pattern has {} such layers",
                count(*f, *o)
            )));
        }
        if total != layers.len() {
            return Err(other(format!(
                "f_x, phases and orientation_deg ask for {total} frames, the pattern has {} layers",
                layers.len()
            )));
        }
        Ok(())
    }
}
