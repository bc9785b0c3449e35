//! What concentrations hold: which layers, in which order, known before a run.

use turbid_contract::{Attributes, Form, Forms, Known, LayerInfo, LayerKind, serde_json::json};

use crate::params::{Fit, Params};
use crate::resolve::Resolved;

/// What standard errors are unknown together, by the number of their plane of flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// A concentration is held at 0, or an error of mu_a is unknown.
    Absorption = 0,
    /// The same, or a haemoglobin is near 0.
    Saturation = 1,
    /// An error of mu_s' is unknown.
    Scattering = 2,
}

/// The value layers: those of absorption, then those of scattering, then what is said of the fit.
pub struct Made {
    /// Each chromophore, and THb and StO2 where there is haemoglobin.
    pub absorption: Vec<LayerInfo>,
    pub scattering: Vec<LayerInfo>,
    /// `residual`, and `at_bound` where concentrations are held at 0.
    pub about: Vec<LayerInfo>,
    /// Whether standard errors of absorption and of scattering are known.
    pub errors: [bool; 2],
}

impl Made {
    pub fn of(params: &Params, resolved: &Resolved) -> Self {
        let mut absorption: Vec<LayerInfo> =
            resolved.species.iter().map(|s| LayerInfo::value(s.name.clone(), s.unit)).collect();
        if resolved.haemoglobin.is_some() {
            absorption.extend([LayerInfo::value("THb", "uM"), LayerInfo::value("StO2", "1")]);
        }
        let mut about = vec![LayerInfo::value("residual", "mm^-1")];
        if params.fit == Fit::NonNegative {
            about.push(LayerInfo::value("at_bound", "1"));
        }
        let law = [LayerInfo::value("scatter_a", "mm^-1"), LayerInfo::value("scatter_b", "1")];
        let channels = &resolved.channels;
        let scattering = channels.mu_s_prime.as_ref();
        Self {
            absorption,
            scattering: scattering.map_or_else(Vec::new, |_| law.to_vec()),
            about,
            errors: [channels.mu_a.errors.is_some(), scattering.is_some_and(|q| q.errors.is_some())],
        }
    }

    /// Quantities that have a standard error, each with what tells where it is unknown.
    pub fn with_errors(&self) -> Vec<(&LayerInfo, Doubt)> {
        let [of_absorption, of_scattering] = self.errors;
        let doubt = |info: &LayerInfo| if info.name == "StO2" { Doubt::Saturation } else { Doubt::Absorption };
        let absorption = self.absorption.iter().filter(|_| of_absorption).map(|info| (info, doubt(info)));
        let scattering = self.scattering.iter().filter(|_| of_scattering).map(|info| (info, Doubt::Scattering));
        absorption.chain(scattering).collect()
    }

    pub fn values(&self) -> impl Iterator<Item = &LayerInfo> {
        self.absorption.iter().chain(&self.scattering).chain(&self.about)
    }

    fn layers(&self) -> Vec<LayerInfo> {
        let errors = self.with_errors().into_iter().map(|(info, _)| info.standard_error()).collect::<Vec<_>>();
        self.values().cloned().chain(errors).chain([mask()]).collect()
    }

    fn perhaps(&self) -> Vec<LayerInfo> {
        self.with_errors().into_iter().map(|(info, _)| info.se_unknown()).collect()
    }
}

pub fn mask() -> LayerInfo {
    LayerInfo::new("mask", LayerKind::Mask, "1")
}

/// Attributes of the concentrations: those of the maps, and what the fit was.
pub fn attributes(of_maps: Attributes, resolved: &Resolved) -> Attributes {
    let mut attributes = of_maps;
    attributes.insert("wavelengths_nm".to_owned(), json!(resolved.channels.wavelengths_nm));
    attributes.insert("condition_number".to_owned(), json!(resolved.condition));
    attributes
}

pub fn describe(params: &Params, resolved: Option<&Resolved>, known: &Known) -> Forms {
    let Some(from) = known.form("maps") else { return Forms::new() };
    let mut form = Form { pixels: from.pixels, ..Form::default() };
    let mut forms = Forms::new();
    if let Some(resolved) = resolved {
        let made = Made::of(params, resolved);
        (form.layers, form.perhaps) = (Some(made.layers()), made.perhaps());
        form.carry_conditions(from);
        form.attributes = attributes(known.fact("maps"), resolved);
        if let Some(design) = resolved.design.as_ref().filter(|_| known.is_wanted("design")) {
            forms.insert("design", design.form());
        }
    }
    forms.insert("concentrations", form);
    forms
}
