//! What the reference is said to be: the params, and every mistake in them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{PerChannel, PerLength, Problems, Ratio, Usual};

/// What the reference arm shows, said in one of four ways: a half-space by `mu_a`, `mu_s_prime`, `g` and `n`; the same by a `table` over wavelength; by
/// the `object` of the scene that the arm shows; a plate by its `reflectance`. Each quantity is one number for all wavelengths, or a list with one for
/// each, in the order of the sample's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Absorption coefficient, mm^-1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerChannel<PerLength>>,
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerChannel<PerLength>>,
    /// Anisotropy of scattering, in (-1, 1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub g: Option<PerChannel<f64>>,
    /// Refractive index, >= 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n: Option<PerChannel<f64>>,
    /// Text with the columns wavelength_nm, mu_a, mu_s_prime and, where `g` and `n` are not given here, g and n; or wavelength_nm and reflectance, or
    /// reflectance@0, reflectance@0.1 for f_x = 0 and 0.1 mm^-1. Linear between its wavelengths, never beyond. Relative to the pipeline file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table: Option<String>,
    /// Unit of mu_a and mu_s_prime in `table`, where their columns are not called mu_a_per_cm, for example; mm^-1 where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<CoefficientUnit>,
    /// R_d of a plate at all f_x, in (0, 1.5]: that of a Lambertian surface is the same at each f_x and in each direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reflectance: Option<PerChannel<Ratio>>,
    /// The object of the scene whose properties are taken, where the reference arm was rendered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
}

/// What coefficients are given in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoefficientUnit {
    /// mm^-1.
    #[default]
    PerMm,
    /// cm^-1.
    PerCm,
    /// m^-1.
    PerM,
}

impl CoefficientUnit {
    /// Units by the ends of names of columns.
    pub const BY_SUFFIX: [(&'static str, Self); 3] =
        [("_per_mm", Self::PerMm), ("_per_cm", Self::PerCm), ("_per_m", Self::PerM)];

    pub fn to_mm(self) -> f64 {
        match self {
            Self::PerMm => 1.0,
            Self::PerCm => 0.1,
            Self::PerM => 1e-3,
        }
    }
}

/// Where the table stands below `with`.
pub const TABLE: &str = "reference.table";
/// The most that a plate sends back straight up, over what a Lambertian one of albedo 1 does.
pub const MOST_REFLECTANCE: f64 = 1.5;
const WAYS: &str = "say it in one way: `mu_a`, `mu_s_prime`, `g` and `n`; or `table: FILE`; or `object: NAME`; or `reflectance: 0.99` of a plate";

/// The rules of single values; `Err` holds what they must.
pub fn rule(quantity: &str, value: f64) -> Result<(), &'static str> {
    let (holds, rule) = match quantity {
        "mu_a" => (value >= 0.0, "be >= 0"),
        "mu_s_prime" => (value > 0.0, "be > 0"),
        "g" => (value.abs() < 1.0, "lie in (-1, 1)"),
        "n" => (value >= 1.0, "be >= 1"),
        _ => (value > 0.0 && value <= MOST_REFLECTANCE, "lie in (0, 1.5]"),
    };
    if holds && value.is_finite() { Ok(()) } else { Err(rule) }
}

impl Reference {
    /// Reports every value that no phantom can have, and what is said twice or not at all.
    pub fn check(&self, problems: &mut Problems) {
        self.check_way(problems);
        let mut require = |name: &str, unit: &str, at: String, value: f64| {
            if let Err(rule) = rule(name, value) {
                problems.require(false, at, value, unit, rule);
            }
        };
        for (name, list) in [("mu_a", &self.mu_a), ("mu_s_prime", &self.mu_s_prime)] {
            for (at, &PerLength(value)) in list.iter().flat_map(|list| list.entries(&format!("reference.{name}"))) {
                require(name, "mm^-1", at, value);
            }
        }
        for (name, list) in [("g", &self.g), ("n", &self.n)] {
            for (at, &value) in list.iter().flat_map(|list| list.entries(&format!("reference.{name}"))) {
                require(name, "", at, value);
            }
        }
        for (at, &Ratio(value)) in self.reflectance.iter().flat_map(|list| list.entries("reference.reflectance")) {
            require("reflectance", "", at, value);
        }
        for (usual, name, list) in
            [(&Usual::MU_A, "mu_a", &self.mu_a), (&Usual::MU_S_PRIME, "mu_s_prime", &self.mu_s_prime)]
        {
            for (at, &PerLength(value)) in list.iter().flat_map(|list| list.entries(&format!("reference.{name}"))) {
                problems.doubt(usual, at, value);
            }
        }
    }

    /// It is said in one way, and wholly.
    fn check_way(&self, problems: &mut Problems) {
        let coefficients = self.mu_a.is_some() || self.mu_s_prime.is_some();
        let ways = [
            ("mu_a", coefficients),
            ("table", self.table.is_some()),
            ("reflectance", self.reflectance.is_some()),
            ("object", self.object.is_some()),
        ];
        let said: Vec<&str> = ways.iter().filter(|(_, given)| *given).map(|(name, _)| *name).collect();
        match said[..] {
            [] if self.g.is_none() && self.n.is_none() => {
                problems.push_with_hint("reference", "what the reference is, is not said", WAYS);
            }
            [] | ["mu_a"] => {
                for (name, given) in [
                    ("mu_a", self.mu_a.is_some()),
                    ("mu_s_prime", self.mu_s_prime.is_some()),
                    ("g", self.g.is_some()),
                    ("n", self.n.is_some()),
                ] {
                    if !given {
                        let at = format!("reference.{name}");
                        problems.push_with_hint(at, format!("`{name}` of the reference is missing"), WAYS);
                    }
                }
            }
            ["table"] => {}
            [one] => {
                if self.g.is_some() || self.n.is_some() {
                    let message = format!("g and n say nothing beside `{one}`");
                    problems.push_with_hint(format!("reference.{one}"), message, "leave them out");
                }
            }
            [first, .., last] => {
                let message = format!("the reference is said by `{first}` and by `{last}`");
                problems.push_with_hint(format!("reference.{last}"), message, WAYS);
            }
        }
        if self.unit.is_some() && self.table.is_none() {
            let way_out = "leave it out: values here carry their unit, `0.2 cm^-1`";
            problems.push_with_hint("reference.unit", "only the columns of a `table` have this unit", way_out);
        }
    }

    /// Lists whose length is not the number of the sample's wavelengths: where each stands, and how many values it has.
    pub fn unfit(&self, channels: usize) -> impl Iterator<Item = (&'static str, usize)> {
        fn length<T>(list: &Option<PerChannel<T>>) -> Option<usize> {
            list.as_ref().and_then(PerChannel::channels)
        }
        let lengths = [
            ("mu_a", length(&self.mu_a)),
            ("mu_s_prime", length(&self.mu_s_prime)),
            ("g", length(&self.g)),
            ("n", length(&self.n)),
            ("reflectance", length(&self.reflectance)),
        ];
        lengths.into_iter().filter_map(move |(name, length)| Some((name, length.filter(|&length| length != channels)?)))
    }
}
