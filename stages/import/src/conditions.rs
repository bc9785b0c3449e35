//! How measured frames were taken, as far as somebody says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::{Conditions, PhaseFunction, SaidBy, Seen, Thickness};
use turbid_contract::{AngleDeg, Length, Problems, Ratio};

/// What is left out is taken as what the table is of; `invert` then says so.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ConditionsParams {
    /// Between the normal of the surface and the camera, in [0, 90).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view_deg: Option<AngleDeg>,
    /// The same to the projector.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub incidence_deg: Option<AngleDeg>,
    /// Of the sample; in its place `half_space: true` where nothing of its far side shows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thickness: Option<Length>,
    /// Nothing of the sample's far side shows.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub half_space: bool,
    /// Mean cosine of the scattering angle, in (-1, 1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub g: Option<Ratio>,
    /// Refractive index, >= 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n: Option<Ratio>,
}

impl ConditionsParams {
    /// Reports every value that nothing can have.
    pub fn check(&self, problems: &mut Problems) {
        for (name, angle) in [("view_deg", self.view_deg), ("incidence_deg", self.incidence_deg)] {
            if let Some(AngleDeg(angle)) = angle {
                problems.require((0.0..90.0).contains(&angle), at(name), angle, "deg", "lie in [0, 90)");
            }
        }
        if let Some(Length(d)) = self.thickness {
            problems.require(d > 0.0 && d.is_finite(), at("thickness"), d, "mm", "be a finite number > 0");
            if self.half_space {
                problems.push(at("half_space"), "a thickness is given, which a half-space has not; give one of them");
            }
        }
        if let Some(Ratio(g)) = self.g {
            problems.require(g.abs() < 1.0, at("g"), g, "", "lie in (-1, 1)");
        }
        if let Some(Ratio(n)) = self.n {
            problems.require(n >= 1.0 && n.is_finite(), at("n"), n, "", "be a finite number >= 1");
        }
    }

    /// The same for all pixels.
    pub fn said(&self) -> Conditions {
        let thickness = self.thickness.map(|d| Thickness::Mm([d.0; 3]));
        let seen = Seen {
            phase: self.g.map(|g| PhaseFunction::HenyeyGreenstein(g.0)),
            n: self.n.map(|n| n.0),
            thickness: thickness.or(self.half_space.then_some(Thickness::HalfSpace)),
            view_deg: self.view_deg.map(|a| [a.0; 3]),
            incidence_deg: self.incidence_deg.map(|a| [a.0; 3]),
            ..Seen::default()
        };
        Conditions { said_by: SaidBy::User, seen: vec![seen] }
    }
}

fn at(name: &str) -> String {
    format!("conditions.{name}")
}
