//! Params of `build_lut`, and everything that can be wrong with them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::Convention;
use turbid_contract::{Length, PerChannel, PerLength, Problems, Ratio, Usual, Wavelength};
use turbid_optics::{PhaseFunction, rte};

use crate::nodes::Nodes;
use crate::table::{self, Recipe};

/// Where the reflectance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// Radiative transport; absolute error below 1e-5 for |g| <= 0.9, up to some 1e-4 beyond: column `r_d_bound` says it for each row.
    Rte,
    /// Diffusion approximation with exact Fresnel moments; half-space only, 1 to 40 % off.
    Diffusion,
    /// One white Monte Carlo run, rescaled to every node; half-space only, with standard errors.
    MonteCarlo,
    /// Phantoms that were rendered or measured, against their reference.
    Empirical,
}

/// How a table reads between phantoms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// The ratio to the transport model, whose logarithm is a polynomial of ln mu_a and ln mu_s': the model gives the shape, phantoms the size.
    #[default]
    Guided,
    /// ln R itself as such a polynomial.
    LogLog,
    /// The paper's first step: raw R, linear between phantoms on a grid, to 100 x 100 nodes.
    Paper,
}

/// A medium: the phantom that `references` show, or one to be made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceMedium {
    /// Absorption coefficient.
    pub mu_a: PerLength,
    /// Reduced scattering coefficient mu_s (1 - g).
    pub mu_s_prime: PerLength,
}

/// Params of `build_lut`; `g` and `n` have no default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    pub model: Model,
    /// Spatial frequencies, mm^-1, increasing.
    pub f_x: Nodes,
    /// Left out: 28 nodes from 1e-4 to 0.5; of an empirical table 25 over what the phantoms span.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<Nodes>,
    /// Left out: 18 nodes from 0.1 to 5; of an empirical table 25 over what the phantoms span.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<Nodes>,
    /// Mean cosine of the scattering angle (Henyey-Greenstein); one for all, or a list with one for each of `wavelengths_nm`.
    pub g: PerChannel<Ratio>,
    /// Refractive index relative to the outside; one for all, or a list with one for each of `wavelengths_nm`.
    pub n: PerChannel<Ratio>,
    /// Wavelengths for which the lists `g` and `n` are. The artifact then holds one table for each pair of g and n that occurs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wavelengths_nm: Vec<Wavelength>,
    /// Thickness of a slab, mm; left out for a half-space.
    #[serde(default)]
    pub thickness: Option<Length>,
    #[serde(default)]
    pub convention: Convention,
    /// Paths of `model: monte_carlo`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u64>,
    /// Of `model: empirical`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<Interpolation>,
    /// What `references` show; of `model: empirical`, which needs it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<ReferenceMedium>,
    /// Media to be made: the port `design` says of what. Of `model: empirical`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wanted: Option<Vec<ReferenceMedium>>,
}

/// Paths of a Monte Carlo table where `samples` is left out.
pub const SAMPLES: u64 = 4_000_000;

fn default_mu_a() -> Nodes {
    Nodes::logspace(1e-4, 0.5, 28)
}

fn default_mu_s_prime() -> Nodes {
    Nodes::logspace(0.1, 5.0, 18)
}

impl Params {
    /// Reports every mistake.
    pub fn check(&self, problems: &mut Problems) {
        let not_negative = |x: f64| x >= 0.0 && x.is_finite();
        axis("f_x", &self.f_x.0, 1, not_negative, "be a finite number >= 0", problems);
        let positive = |x: f64| x > 0.0 && x.is_finite();
        for (name, nodes) in [("mu_a", &self.mu_a), ("mu_s_prime", &self.mu_s_prime)] {
            if let Some(Nodes(nodes)) = nodes {
                axis(name, nodes, 2, positive, "be a finite number > 0 (the axis is logarithmic)", problems);
            }
        }
        for (at, &Ratio(g)) in self.g.entries("g") {
            problems.require(g.abs() < 1.0, at, g, "", "lie in (-1, 1)");
        }
        for (at, &Ratio(n)) in self.n.entries("n") {
            problems.require(n >= 1.0 && n.is_finite(), at, n, "", "be a finite number >= 1");
        }
        self.check_wavelengths(problems);
        for recipe in self.recipes().iter().filter(|recipe| self.solves() && recipe.g.abs() < 1.0) {
            if let Err(error) = rte::solvable(&PhaseFunction::henyey_greenstein(recipe.g), recipe.n) {
                problems.push("g", error.to_string());
            }
        }
        if let Some(Length(d)) = self.thickness {
            problems.require(positive(d), "thickness", d, "mm", "be a finite number > 0");
            if !matches!(self.model, Model::Rte | Model::Empirical) {
                let message = "only transport and phantoms know slabs; the other models know the half-space";
                problems.push_with_hint("thickness", message, "leave `thickness` out or take `model: rte`");
            }
        }
        if let Some(samples) = self.samples {
            if self.model == Model::MonteCarlo {
                let rule = "lie in [1000, 1e12]: standard errors come from the spread of 128 parts";
                let holds = (1000..=1_000_000_000_000).contains(&samples);
                problems.require(holds, "samples", samples as f64, "", rule);
            } else {
                let message = "only `model: monte_carlo` has samples";
                problems.push_with_hint("samples", message, "leave `samples` out");
            }
        }
        self.check_empirical(problems);
        self.doubt(problems);
        if self.f_x.0.len() == 1 {
            problems.warn("f_x", "one spatial frequency cannot tell mu_a from mu_s': no map can be made of this table");
        }
    }

    /// Lists are for wavelengths, as many as there are.
    fn check_wavelengths(&self, problems: &mut Problems) {
        let count = self.wavelengths_nm.len();
        for (k, &Wavelength(nm)) in self.wavelengths_nm.iter().enumerate() {
            let at = format!("wavelengths_nm.{k}");
            problems.require(nm > 0.0 && nm.is_finite(), at.clone(), nm, "nm", "be > 0");
            problems.doubt(&Usual::WAVELENGTH, at.clone(), nm);
            if self.wavelengths_nm[..k].contains(&Wavelength(nm)) {
                problems.push(at, format!("{nm} nm stands twice"));
            }
        }
        for (name, list) in [("g", &self.g), ("n", &self.n)] {
            let Some(length) = list.channels() else { continue };
            if count == 0 {
                let way_out = "wavelengths_nm: [660, 850], or one number for all";
                problems.push_with_hint(
                    name,
                    format!("{name} is a list, and for which wavelengths is not said"),
                    way_out,
                );
            } else if length != count {
                let way_out = "give one for each wavelength, or one number for all";
                problems.push_with_hint(name, format!("{length} values of {name} for {count} wavelengths"), way_out);
            }
        }
        if count > 0 && self.model == Model::Empirical {
            let way_out = "leave it out, and make a table for each wavelength";
            problems.push_with_hint("wavelengths_nm", "phantoms are seen at one wavelength", way_out);
        }
    }

    /// Warns of values that look as if they stood in another unit. Tables go beyond what tissue has, towards 0 above all: of an axis of coefficients
    /// only a middle node that is too high is doubted.
    fn doubt(&self, problems: &mut Problems) {
        for (i, &f_x) in self.f_x.0.iter().enumerate() {
            problems.doubt(&Usual::F_X, format!("f_x.{i}"), f_x);
        }
        for (field, usual, nodes) in
            [("mu_a", Usual::MU_A, &self.mu_a), ("mu_s_prime", Usual::MU_S_PRIME, &self.mu_s_prime)]
        {
            if let Some(Nodes(nodes)) = nodes
                && let Some(&middle) = nodes.get(nodes.len() / 2)
                && middle > usual.most
            {
                problems.doubt(&usual, format!("{field}.{}", nodes.len() / 2), middle);
            }
        }
        let wanted = self.wanted.iter().flatten().enumerate().map(|(i, medium)| (format!("wanted.{i}"), medium));
        for (field, medium) in self.reference.iter().map(|medium| ("reference".to_owned(), medium)).chain(wanted) {
            problems.doubt(&Usual::MU_A, format!("{field}.mu_a"), medium.mu_a.0);
            problems.doubt(&Usual::MU_S_PRIME, format!("{field}.mu_s_prime"), medium.mu_s_prime.0);
        }
    }

    /// What only phantoms need, and what they need.
    fn check_empirical(&self, problems: &mut Problems) {
        if self.model != Model::Empirical {
            let way_out = "leave it out, or take `model: empirical`";
            for (name, given) in [
                ("interpolation", self.interpolation.is_some()),
                ("reference", self.reference.is_some()),
                ("wanted", self.wanted.is_some()),
            ] {
                if given {
                    problems.push_with_hint(name, format!("only `model: empirical` has {name}"), way_out);
                }
            }
            if self.convention == Convention::Relative {
                let message = "a model knows no reference phantom that its reflectance could be relative to";
                problems.push_with_hint("convention", message, "take another convention, or `model: empirical`");
            }
            return;
        }
        if self.wanted.as_ref().is_some_and(Vec::is_empty) {
            problems.push_with_hint(
                "wanted",
                "wanted names no medium",
                "leave it out, or list {mu_a: .., mu_s_prime: ..}",
            );
        }
        for (i, medium) in self.wanted.iter().flatten().enumerate() {
            for (name, PerLength(value)) in [("mu_a", medium.mu_a), ("mu_s_prime", medium.mu_s_prime)] {
                let holds = value > 0.0 && value.is_finite();
                problems.require(holds, format!("wanted.{i}.{name}"), value, "mm^-1", "be a finite number > 0");
            }
        }
        match self.reference {
            Some(ReferenceMedium { mu_a: PerLength(mu_a), mu_s_prime: PerLength(mu_s_prime) }) => {
                let finite = |x: f64, holds: bool| holds && x.is_finite();
                problems.require(finite(mu_a, mu_a >= 0.0), "reference.mu_a", mu_a, "mm^-1", "be >= 0");
                let holds = finite(mu_s_prime, mu_s_prime > 0.0);
                problems.require(holds, "reference.mu_s_prime", mu_s_prime, "mm^-1", "be > 0");
            }
            None => problems.push_with_hint(
                "reference",
                "what phantoms reflect is told relative to the reference, whose properties are not given",
                "reference: {mu_a: .., mu_s_prime: ..}, as in the `calibrate` whose reflectance is to be inverted",
            ),
        }
    }

    /// Whether the transport solver is asked.
    fn solves(&self) -> bool {
        match self.model {
            Model::Rte => true,
            Model::Empirical => {
                self.interpolation() == Interpolation::Guided || self.convention != Convention::Relative
            }
            _ => false,
        }
    }

    pub fn interpolation(&self) -> Interpolation {
        self.interpolation.unwrap_or_default()
    }

    /// g and n of each table of the artifact, in the order of the wavelengths that need them first.
    pub fn media(&self) -> Vec<[f64; 2]> {
        let mut found: Vec<[f64; 2]> = Vec::new();
        for channel in 0..self.wavelengths_nm.len().max(1) {
            if let Some((g, n)) = self.g.of(channel).zip(self.n.of(channel))
                && !found.contains(&[g.0, n.0])
            {
                found.push([g.0, n.0]);
            }
        }
        found
    }

    /// Each table of the artifact as plain numbers: at least one of params that `check` let pass.
    pub fn recipes(&self) -> Vec<Recipe> {
        self.media().into_iter().map(|medium| self.recipe(medium)).collect()
    }

    /// The table of these g and n; the axes of an empirical one may be empty, for the phantoms to fill.
    fn recipe(&self, [g, n]: [f64; 2]) -> Recipe {
        let nodes = |given: &Option<Nodes>, default: fn() -> Nodes| match given {
            Some(Nodes(nodes)) => nodes.clone(),
            None if self.model == Model::Empirical => Vec::new(),
            None => default().0,
        };
        Recipe {
            transport: matches!(self.model, Model::Rte | Model::Empirical),
            f_x: self.f_x.0.clone(),
            mu_a: nodes(&self.mu_a, default_mu_a),
            mu_s_prime: nodes(&self.mu_s_prime, default_mu_s_prime),
            g,
            n,
            thickness: self.thickness.map(|d| d.0),
            convention: match self.convention {
                // What guides a relative table is the camera's view, as its phantoms are.
                Convention::Camera | Convention::Relative => table::Convention::Camera,
                Convention::HemisphericalIncident => table::Convention::HemisphericalIncident,
                Convention::HemisphericalEntered => table::Convention::HemisphericalEntered,
            },
        }
    }
}

fn axis(name: &str, nodes: &[f64], least: usize, holds: impl Fn(f64) -> bool, rule: &str, problems: &mut Problems) {
    if nodes.len() < least {
        problems.push(name, format!("{name} has {} nodes; at least {least} are needed", nodes.len()));
    }
    for (i, &node) in nodes.iter().enumerate() {
        let at = format!("{name}.{i}");
        problems.require(holds(node), at.as_str(), node, "mm^-1", rule);
        // Only where both are numbers at all, or one mistake is told twice.
        if i > 0 && node <= nodes[i - 1] {
            problems.push(at, format!("{name} must increase, but {node} follows {} (mm^-1)", nodes[i - 1]));
        }
    }
}
