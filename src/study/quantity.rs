//! What a study looks at: `STAGE.LAYER`, `STAGE.PORT.LAYER` or `STAGE.PORT`.

use turbid_contract::{ArtifactKind, Axes, ImageStack, Layer, LayerKind};

use crate::plan::{InstanceId, Plan, StageId};

/// A layer of an output of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    pub stage: StageId,
    pub port: &'static str,
    /// Left out of a truth: that of the estimate.
    pub layer: Option<String>,
}

impl Quantity {
    /// The second word is a port, if the stage has one of that name, else a layer of its first port.
    ///
    /// Error: what is wrong with it.
    pub fn read(text: &str, plan: &Plan) -> Result<Self, String> {
        let words: Vec<&str> = text.split('.').collect();
        let stage = plan.spec.stage(words[0]).ok_or_else(|| format!("there is no stage `{}`", words[0]))?;
        let outputs = plan.outputs(stage);
        let named = words.get(1).and_then(|word| outputs.iter().find(|port| port.name == *word));
        let (port, rest) = match (named, outputs.first()) {
            (Some(port), _) => (port, &words[2..]),
            (None, Some(port)) => (port, &words[1..]),
            (None, None) => return Err(format!("`{}` has no outputs", words[0])),
        };
        if port.kind != ArtifactKind::Images {
            return Err(format!("`{}.{}` is no image, and a study scores images", words[0], port.name));
        }
        if rest.len() > 1 {
            let ports: Vec<&str> = outputs.iter().map(|port| port.name).collect();
            return Err(format!("`{}` has no output `{}`; it has {}", words[0], words[1], ports.join(", ")));
        }
        Ok(Self { stage, port: port.name, layer: rest.first().map(|word| (*word).to_owned()) })
    }

    /// The instance that belongs to one with these axes: all axes that both have agree.
    pub fn instance_for(&self, axes: &Axes, plan: &Plan) -> Option<InstanceId> {
        let agrees =
            |id: &InstanceId| plan.point(*id).all(|(name, value)| axes.get(name).is_none_or(|other| other == value));
        plan.instances_of(self.stage).find(agrees)
    }
}

/// The value layers of a name; of all frequencies and wavelengths.
pub fn layers<'a>(stack: &'a ImageStack, name: &'a str) -> impl Iterator<Item = &'a Layer> {
    stack.layers.iter().filter(move |layer| layer.info.kind == LayerKind::Value && layer.info.name == name)
}

/// The layer of the truth that belongs to one of the estimate: of its wavelength and frequency, where the truth names these.
pub fn truth_of<'a>(estimate: &Layer, truth: &'a ImageStack, name: &str) -> Option<&'a Layer> {
    let (info, fits) = (&estimate.info, |own: Option<f64>, of: Option<f64>| own.is_none() || own == of);
    let belongs = |layer: &&Layer| {
        let own = &layer.info;
        own.kind == LayerKind::Value
            && own.name == name
            && fits(own.wavelength_nm, info.wavelength_nm)
            && fits(own.f_x_per_mm, info.f_x_per_mm)
            && fits(own.orientation_deg, info.orientation_deg)
    };
    truth.layers.iter().find(belongs)
}
