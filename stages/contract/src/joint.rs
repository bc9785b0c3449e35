//! Joints: whether what is connected fits, found before a run by the rule that the run itself goes by.

use serde_json::json;

use crate::artifact::{Attributes, LayerInfo, LayerKind};
use crate::error::Error;
use crate::form::Form;
use crate::known::Known;
use crate::payload::Camera;
use crate::pitch::{PIXEL_PITCH_MM, PIXEL_PITCH_RAD};
use crate::problem::{At, Problems};

impl Problems {
    /// Reports what a rule says against the artifact on `port`, with the name of who makes it. A mistake that the rule sees in a param stands there.
    pub fn unfit(&mut self, known: &Known, port: &str, error: Error) {
        self.misfit(port, &format!("`{}`: ", known.producer(port)), error);
    }

    /// The same of two inputs that do not belong together.
    pub fn unfit_beside(&mut self, known: &Known, port: &str, other: &str, error: Error) {
        let names = format!("`{}` does not belong to `{}`: ", known.producer(port), known.producer(other));
        self.misfit(port, &names, error);
    }

    fn misfit(&mut self, port: &str, names: &str, error: Error) {
        match error {
            Error::Failed { what, way_out } => {
                let way_out = way_out.unwrap_or_else(|| format!("connect another output to `{port}`"));
                self.at_input(port, format!("{names}{what}"), way_out);
            }
            Error::Invalid(problem) => {
                let message = format!("{names}{}", problem.message);
                match (problem.at, problem.hint) {
                    (At::In, hint) => self.at_input(problem.path, message, hint.unwrap_or_default()),
                    (At::With, Some(hint)) => self.push_with_hint(problem.path, message, hint),
                    (At::With, None) => self.push(problem.path, message),
                }
            }
            Error::Interrupted => {}
        }
    }
}

impl Form {
    /// The layers that are quantities, in their order; `None` where they are open.
    pub fn values(&self) -> Option<Vec<&LayerInfo>> {
        Some(self.layers.as_ref()?.iter().filter(|info| info.kind == LayerKind::Value).collect())
    }

    /// The spatial frequencies of the quantities, each once, rising, mm^-1; `None` where they are open.
    pub fn f_x(&self) -> Option<Vec<f64>> {
        let mut all: Vec<f64> = self.values()?.into_iter().filter_map(|info| info.f_x_per_mm).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        Some(all)
    }

    /// Whether the artifact will have the standard error of the quantity `info`; `None` where only a run can tell.
    pub fn has_error_of(&self, info: &LayerInfo) -> Option<bool> {
        let among = |layers: &[LayerInfo]| layers.iter().any(|layer| layer.is_standard_error_of(info));
        match among(self.layers.as_ref()?) {
            false if among(&self.perhaps) => None,
            known => Some(known),
        }
    }

    /// Whether the artifact may have flags of unknown errors of the quantity `info`.
    pub fn may_flag(&self, info: &LayerInfo) -> bool {
        self.layers.iter().flatten().chain(&self.perhaps).any(|layer| layer.flags_errors_of(info))
    }

    /// What [`ImageStack::carry_conditions`](crate::ImageStack::carry_conditions) adds to a stack of this form.
    pub fn carry_conditions(&mut self, from: &Form) {
        let Some(layers) = &mut self.layers else { return };
        let carried = |info: &&LayerInfo| info.kind == LayerKind::Condition;
        for info in from.layers.iter().flatten().filter(carried) {
            if layers.iter().all(|layer| layer.name != info.name) {
                layers.push(info.clone());
            }
        }
        self.perhaps.extend(from.perhaps.iter().filter(carried).cloned());
    }
}

impl Camera {
    /// What [`ImageStack::set_pixel_pitch`](crate::ImageStack::set_pixel_pitch) says of images of this camera.
    pub fn insert_pitch_into(&self, attributes: &mut Attributes) {
        let (name, pitch) = self.pixel_pitch();
        attributes.insert(name.to_owned(), json!(pitch));
    }
}

/// What [`ImageStack::take_pixel_pitch`](crate::ImageStack::take_pixel_pitch) takes of these attributes.
pub fn pixel_pitch_of(attributes: &Attributes) -> Attributes {
    let pitch = |name: &&str| Some(((*name).to_owned(), attributes.get(*name)?.clone()));
    [PIXEL_PITCH_MM, PIXEL_PITCH_RAD].iter().filter_map(pitch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifact::ImageStack;
    use crate::problem::Problem;
    use ndarray::Array2;

    fn known() -> Known {
        let producers = [("frames", "shots.frames"), ("covariance", "other.covariance")];
        let producers = producers.map(|(port, label)| (port.to_owned(), label.to_owned())).into();
        Known { producers, ..Known::default() }
    }

    fn told(report: impl Fn(&mut Problems)) -> Problem {
        let mut problems = Problems::default();
        report(&mut problems);
        problems.into_parts().0.remove(0)
    }

    /// A rule's words stand behind the producers' names, at the port; those about a param stay with the param.
    #[test]
    fn rules_are_told_at_the_port() {
        let rule = || Error::failed_with_hint("8 pixels, not 9", "take others");
        let one = told(|p| p.unfit(&known(), "frames", rule()));
        assert_eq!(one.to_string(), "in.frames: `shots.frames`: 8 pixels, not 9 (take others)");
        let two = told(|p| p.unfit_beside(&known(), "covariance", "frames", rule()));
        let both = "in.covariance: `other.covariance` does not belong to `shots.frames`: 8 pixels, not 9 (take others)";
        assert_eq!(two.to_string(), both);
        let param = told(|p| p.unfit(&known(), "frames", Error::invalid("f_x", "too high")));
        assert_eq!(param.to_string(), "f_x: `shots.frames`: too high");
        assert!(told(|p| p.unfit(&known(), "frames", Error::failed("dark"))).hint.is_some(), "there is a way out");
    }

    /// What a form says of layers is what a stack of that form does.
    #[test]
    fn forms_are_asked_as_stacks_are() {
        let dim = (1, 2);
        let info = LayerInfo::value("radiance", "1").with_f_x(0.1);
        let mut frames = ImageStack::new(dim.0, dim.1);
        for info in [info.clone(), LayerInfo::value("radiance", "1").with_f_x(0.0), info.standard_error()] {
            frames.push(info, Array2::zeros(dim));
        }
        frames.push(LayerInfo::new("view_deg", LayerKind::Condition, "deg"), Array2::zeros(dim));
        let form = Form::of(&crate::Artifact::Images(frames.clone()));
        assert_eq!(form.f_x(), Some(vec![0.0, 0.1]));
        let other = LayerInfo::value("radiance", "1").with_f_x(0.2);
        assert_eq!((form.has_error_of(&info), form.has_error_of(&other)), (Some(true), Some(false)));
        let perhaps = Form { perhaps: vec![other.standard_error(), other.se_unknown()], ..form.clone() };
        assert_eq!((perhaps.has_error_of(&other), perhaps.may_flag(&other)), (None, true));
        assert!(!perhaps.may_flag(&info) && Form::default().has_error_of(&info).is_none());
        let mut made = ImageStack::new(dim.0, dim.1);
        made.push(LayerInfo::value("m_dc", "1"), Array2::zeros(dim));
        let mut said = Form::of(&crate::Artifact::Images(made.clone()));
        made.carry_conditions(&frames);
        said.carry_conditions(&form);
        assert_eq!(said, Form::of(&crate::Artifact::Images(made)));
    }
}
