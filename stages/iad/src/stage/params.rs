//! Params of `calibrate_iad`, and what is wrong with them.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use turbid_contract::{Length, MaxFile, PerLength, Problems, Ratio};

use super::line::Constraint;
use crate::{Instrument, Slide, Sphere, Spheres};

/// Params of `calibrate_iad`; what is left out is taken from the readings or the header of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Measured readings: `.csv` or `.rxt`; instead of the port `readings`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Refractive index of the sample, >= 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n: Option<Ratio>,
    /// Mean cosine of scattering, in (-1, 1); where M_U was measured, where the search for g starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub g: Option<Ratio>,
    /// Thickness of the sample, > 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness: Option<Length>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slides: Option<SlidesParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spheres: Option<SpheresChoice>,
    /// What the readings say of light that left by the sample's sides or beside the port.
    #[serde(default, skip_serializing_if = "LostLight::is_default")]
    pub lost_light: LostLight,
    /// Reflectance of the standard that defines M_R, in (0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub r_standard: Option<Ratio>,
    /// mu_a, where it is known: the rest is then found from all readings, or from `from` alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerLength>,
    /// mu_s', where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerLength>,
    /// mu_s, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s: Option<PerLength>,
    /// mu_s / (mu_a + mu_s), where it is known, in [0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub albedo: Option<Ratio>,
    /// (mu_a + mu_s) x thickness, where it is known, > 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub optical_thickness: Option<Ratio>,
    /// The only reading that a single unknown is found from; left out: a fit of both, whose residuals are reported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<FromParam>,
    /// Standard error of M_R, where the readings state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub m_r_se: Option<Ratio>,
    /// Standard error of M_T, where the readings state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub m_t_se: Option<Ratio>,
    /// Standard error of M_U, where the readings state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub m_u_se: Option<Ratio>,
    /// Share of the unscattered reflected light that M_R holds, where no spheres are given here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unscattered_r: Option<Ratio>,
    /// Share of the unscattered transmitted light that M_T holds, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unscattered_t: Option<Ratio>,
    /// Readings beyond a limit (more light out than in, less than the surfaces reflect) by no more than this many
    /// standard errors count as lying on it.
    #[serde(default = "three")]
    pub limit_sigmas: Ratio,
    /// Quadrature points: 8, 16, 32 or 64; left out: 16, doubled until twice as many change mu_a and mu_s' by less than a
    /// thousandth or a fifth of their standard errors, 64 at most.
    #[serde(default, rename = "N", skip_serializing_if = "Option::is_none")]
    pub points: Option<u32>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(default, skip_serializing)]
    pub max_file_mb: MaxFile,
}

fn three() -> Ratio {
    Ratio(3.0)
}

/// Light that a slab without sides would have sent back and on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LostLight {
    /// Reckoned with, as far as the columns `lost_r`, `lost_t`, ... of the readings tell it.
    #[default]
    Correct,
    /// Readings count as those of a slab without sides: what is lost is taken for absorbed.
    Ignore,
}

impl LostLight {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FromParam {
    #[serde(rename = "m_r")]
    MR,
    #[serde(rename = "m_t")]
    MT,
}

/// Index and absorption (optical thickness) of the slides; 1 and 0: none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlidesParams {
    /// Refractive index of the slide on the side of the light; 1: none.
    #[serde(default = "one")]
    pub top: Ratio,
    /// Refractive index of the other slide; 1: none.
    #[serde(default = "one")]
    pub bottom: Ratio,
    /// Optical thickness of absorption of the first slide.
    #[serde(default)]
    pub top_tau: Ratio,
    /// Optical thickness of absorption of the other slide.
    #[serde(default)]
    pub bottom_tau: Ratio,
}

fn one() -> Ratio {
    Ratio(1.0)
}

/// Spheres in place of those that the readings or the file name; `none`: M_R and M_T count as reflectance and transmittance
/// themselves, without correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpheresChoice {
    None,
    These(SpheresParams),
}

// By hand: an untagged enum would lose the message and the place of what is wrong inside.
impl Serialize for SpheresChoice {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::None => serializer.serialize_str("none"),
            Self::These(spheres) => spheres.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for SpheresChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Wanted)
    }
}

struct Wanted;

impl<'de> Visitor<'de> for Wanted {
    type Value = SpheresChoice;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("spheres, {count: 2, diameter: .., ..}, or none")
    }

    fn visit_str<E: de::Error>(self, v: &str) -> Result<SpheresChoice, E> {
        if v == "none" { Ok(SpheresChoice::None) } else { Err(E::invalid_value(de::Unexpected::Str(v), &self)) }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SpheresChoice, A::Error> {
        SpheresParams::deserialize(MapAccessDeserializer::new(map)).map(SpheresChoice::These)
    }
}

impl JsonSchema for SpheresChoice {
    fn schema_name() -> Cow<'static, str> {
        "SpheresChoice".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let spheres = generator.subschema_for::<SpheresParams>();
        json_schema!({"anyOf": [{"const": "none", "description": "readings without sphere correction"}, spheres]})
    }
}

/// Spheres of one size with round ports (diameters in mm); the entrance is in the reflectance sphere only, the exit in the other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpheresParams {
    /// 1: each reading with its sphere alone; 2: both spheres at the sample.
    pub count: u32,
    /// Inner diameter of a sphere.
    pub diameter: Length,
    /// Diameter of the port at the sample.
    pub sample: Length,
    /// Diameter of the port through which the light comes in; 0: none.
    #[serde(default)]
    pub entrance: Length,
    /// Diameter of the port opposite the sample in the transmittance sphere; 0: none.
    #[serde(default)]
    pub exit: Length,
    /// Diameter of the port of the detector.
    pub detector: Length,
    /// In [0, 1].
    pub wall_reflectance: Ratio,
    /// Reflectance of the detector, in [0, 1].
    #[serde(default)]
    pub detector_reflectance: Ratio,
    /// Light falls straight from the sample into the detector; false behind a baffle.
    #[serde(default)]
    pub sees_sample: bool,
    /// The sample closes its port as a plane; false: as a piece of the sphere.
    #[serde(default = "yes")]
    pub flat: bool,
    /// Unscattered light first meets the wall opposite; false: it counts as diffuse.
    #[serde(default = "yes")]
    pub straight: bool,
    /// Share of the unscattered reflected light that is collected; 0 where it leaves through the entrance.
    #[serde(default = "one")]
    pub unscattered_r: Ratio,
    /// Share of the unscattered transmitted light that is collected; 0 where it leaves through the exit.
    #[serde(default = "one")]
    pub unscattered_t: Ratio,
}

fn yes() -> bool {
    true
}

impl Params {
    pub fn slab_sides(&self) -> Option<[Slide; 2]> {
        let s = self.slides?;
        Some([Slide { n: s.top.0, tau: s.top_tau.0 }, Slide { n: s.bottom.0, tau: s.bottom_tau.0 }])
    }

    /// What is known beforehand, each under its name.
    pub fn known(&self) -> Vec<(&'static str, Constraint)> {
        [
            ("mu_a", self.mu_a.map(|x| Constraint::MuA(x.0))),
            ("mu_s_prime", self.mu_s_prime.map(|x| Constraint::MuSPrime(x.0))),
            ("mu_s", self.mu_s.map(|x| Constraint::MuS(x.0))),
            ("albedo", self.albedo.map(|x| Constraint::Albedo(x.0))),
            ("optical_thickness", self.optical_thickness.map(|x| Constraint::OpticalThickness(x.0))),
        ]
        .into_iter()
        .filter_map(|(name, known)| Some((name, known?)))
        .collect()
    }

    /// Everything that is wrong whatever the readings are.
    pub fn check(&self, problems: &mut Problems) {
        if let Some(n) = self.n {
            problems.require(n.0 >= 1.0 && n.0.is_finite(), "n", n.0, "", "be a refractive index >= 1");
        }
        if let Some(g) = self.g {
            problems.require(g.0.abs() < 1.0, "g", g.0, "", "lie in (-1, 1)");
        }
        if let Some(d) = self.thickness {
            problems.require(d.0 > 0.0, "thickness", d.0, "mm", "be > 0");
        }
        if let Some(r) = self.r_standard {
            problems.require(r.0 > 0.0 && r.0 <= 1.0, "r_standard", r.0, "", "lie in (0, 1]");
            if self.spheres == Some(SpheresChoice::None) {
                let message = "r_standard says how spheres scale M_R; with `spheres: none` it says nothing";
                problems.push_with_hint("r_standard", message, "leave it out, or leave `spheres: none` out");
            }
        }
        if let Some(slides) = self.slides {
            for (name, n) in [("top", slides.top), ("bottom", slides.bottom)] {
                problems.require(n.0 >= 1.0, format!("slides.{name}"), n.0, "", "be a refractive index >= 1");
            }
            for (name, tau) in [("top_tau", slides.top_tau), ("bottom_tau", slides.bottom_tau)] {
                problems.require(tau.0 >= 0.0, format!("slides.{name}"), tau.0, "", "be >= 0");
            }
        }
        let known = self.known();
        for (name, constraint) in &known {
            if let Err(rule) = constraint.check() {
                problems.require(false, *name, constraint.value(), constraint.unit(), rule);
            }
        }
        if let [(first, _), (second, _), ..] = known[..] {
            let message = format!("{first} and {second} are both given: nothing is left to find");
            problems.push_with_hint(second, message, "leave one of them out");
        }
        for (name, se) in [("m_r_se", self.m_r_se), ("m_t_se", self.m_t_se), ("m_u_se", self.m_u_se)] {
            if let Some(se) = se {
                problems.require(se.0 >= 0.0, name, se.0, "", "be >= 0");
            }
        }
        for (name, share) in [("unscattered_r", self.unscattered_r), ("unscattered_t", self.unscattered_t)] {
            let Some(share) = share else { continue };
            problems.require((0.0..=1.0).contains(&share.0), name, share.0, "", "lie in [0, 1]");
            if matches!(self.spheres, Some(SpheresChoice::These(_))) {
                let message = format!("{name} stands beside `spheres`, which have one of their own");
                problems.push_with_hint(name, message, format!("give it as spheres.{name}"));
            }
        }
        let sigmas = self.limit_sigmas.0;
        problems.require((0.0..=100.0).contains(&sigmas), "limit_sigmas", sigmas, "", "lie in [0, 100]");
        if let Some(points) = self.points {
            problems.require([8, 16, 32, 64].contains(&points), "N", f64::from(points), "", "be 8, 16, 32 or 64");
        }
        if let Some(SpheresChoice::These(spheres)) = &self.spheres {
            spheres.check(problems);
        }
    }
}

impl SpheresParams {
    pub fn instrument(&self) -> Instrument {
        let of = |third: Length| Sphere {
            detector_reflectance: self.detector_reflectance.0,
            sees_sample: self.sees_sample,
            flat: self.flat,
            ..Sphere::with_round_ports(
                self.diameter.0,
                self.sample.0,
                third.0,
                self.detector.0,
                self.wall_reflectance.0,
            )
        };
        let pair = [of(self.entrance), of(self.exit)];
        Instrument {
            spheres: if self.count == 1 { Spheres::One(pair) } else { Spheres::Two(pair) },
            unscattered: [self.unscattered_r.0, self.unscattered_t.0],
            straight: self.straight,
            ..Instrument::NONE
        }
    }

    fn check(&self, problems: &mut Problems) {
        let count = f64::from(self.count);
        problems.require(
            (1..=2).contains(&self.count),
            "spheres.count",
            count,
            "",
            "be 1 or 2; `spheres: none` for none",
        );
        let diameter = self.diameter.0;
        problems.require(diameter > 0.0, "spheres.diameter", diameter, "mm", "be > 0");
        let before = problems.is_empty();
        for (name, port, least) in [
            ("sample", self.sample, f64::MIN_POSITIVE),
            ("entrance", self.entrance, 0.0),
            ("exit", self.exit, 0.0),
            ("detector", self.detector, 0.0),
        ] {
            let fits = port.0 >= least && port.0 < diameter;
            let rule =
                format!("be {} and smaller than the sphere of {diameter} mm", if least > 0.0 { "> 0" } else { ">= 0" });
            problems.require(fits, format!("spheres.{name}"), port.0, "mm", &rule);
        }
        for (name, share) in [
            ("wall_reflectance", self.wall_reflectance),
            ("detector_reflectance", self.detector_reflectance),
            ("unscattered_r", self.unscattered_r),
            ("unscattered_t", self.unscattered_t),
        ] {
            problems.require((0.0..=1.0).contains(&share.0), format!("spheres.{name}"), share.0, "", "lie in [0, 1]");
        }
        // What no single field shows: ports that together leave no wall.
        if before
            && problems.is_empty()
            && let Err(error) = self.instrument().check()
        {
            problems.push("spheres", error.to_string());
        }
    }
}
