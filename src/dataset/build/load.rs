//! What goes into a shard: its key, and the tensors and numbers of its samples.

use std::collections::HashMap;

use rayon::prelude::*;
use serde_json::Value;
use turbid_contract::Artifact;
use turbid_draw::Type;

use super::{Building, Found, State, Stopped};
use crate::dataset::feature::Shape;
use crate::dataset::manifest::ColumnOf;
use crate::dataset::shard::Sample;
use crate::digest::PartHasher;
use crate::store::Blob;

/// So often samples are computed again whose bytes were found damaged or gone; after that the disk is to blame.
const MOST_ROUNDS: usize = 3;

/// Why a sample could not be read.
enum NotRead<'f> {
    /// The feature at fault, and what is wrong.
    Feature(&'f str, String),
    /// The bytes of the sample of this raw index are damaged or gone.
    Lost(u64, String),
    Failed(String),
}

impl Building<'_> {
    /// What a shard is made from.
    pub(super) fn key(&self, found: &[Found]) -> Result<String, Stopped> {
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let group = self.group(draw);
        let mut parts = PartHasher::new("turbid dataset shard 3");
        parts.add("format", self.format.name().as_bytes());
        for (name, of) in draw.names().zip(draw.types()) {
            parts.add("drawn", format!("{name} {of:?}").as_bytes());
        }
        for feature in &self.dataset.features {
            parts.add("feature", format!("{:?}", (&feature.spec, feature.port, &feature.part)).as_bytes());
        }
        for Found { index, blobs } in found {
            let draws = draw.point(*index).map_err(Stopped::Failed)?;
            parts.add("sample", &index.to_le_bytes());
            parts.add("group", format!("{:?}", group.and_then(|at| draws[at].as_i64())).as_bytes());
            parts.add("draws", Value::from(draws).to_string().as_bytes());
            blobs.iter().for_each(|blob| parts.add("blob", &blob.digest.0));
        }
        Ok(parts.finish().to_string())
    }

    /// Reads the features of the samples; all samples must hold the same. Those whose bytes are not there are computed again.
    pub(super) fn load(&self, found: &[Found], state: &mut State) -> Result<Vec<Sample>, Stopped> {
        for _ in 0..MOST_ROUNDS {
            let gone = |found: &&Found| found.blobs.iter().any(|blob| self.store.is_released(blob));
            let gone: Vec<u64> = found.iter().filter(gone).map(|found| found.index).collect();
            self.again(&gone, state)?;
            match self.read(found) {
                Ok(read) => return self.alike(read, state),
                Err(NotRead::Lost(index, _)) => self.again(&[index], state)?,
                Err(NotRead::Feature(name, message)) => return Err(self.wrong(&["sample", name], message, None)),
                Err(NotRead::Failed(message)) => return Err(Stopped::Failed(message)),
            }
        }
        match self.read(found) {
            Ok(read) => self.alike(read, state),
            Err(NotRead::Feature(name, message)) => Err(self.wrong(&["sample", name], message, None)),
            Err(NotRead::Lost(_, message) | NotRead::Failed(message)) => Err(Stopped::Failed(message)),
        }
    }

    fn read(&self, found: &[Found]) -> Result<Vec<(Sample, Vec<Shape>)>, NotRead<'_>> {
        let (features, store) = (&self.dataset.features, self.store);
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let group = self.group(draw);
        let read = |Found { index, blobs }: &Found| {
            let draws = draw.point(*index).map_err(NotRead::Failed)?;
            let group = group.and_then(|at| draws[at].as_i64());
            let mut sample = Sample { index: *index, group, draws, values: Vec::new() };
            let mut shapes = Vec::new();
            let mut artifacts: HashMap<Blob, Artifact> = HashMap::new();
            for (feature, blob) in features.iter().zip(blobs) {
                if !artifacts.contains_key(blob) {
                    let artifact = store.get(blob).map_err(|error| match error.is_lost_blob() {
                        true => NotRead::Lost(*index, error.to_string()),
                        false => NotRead::Failed(error.to_string()),
                    })?;
                    artifacts.insert(*blob, artifact);
                }
                let taken = feature.take(&artifacts[blob]);
                let (shape, values) = taken.map_err(|message| NotRead::Feature(feature.spec.name.as_str(), message))?;
                shapes.push(shape);
                sample.values.push(values);
            }
            Ok((sample, shapes))
        };
        found.par_iter().map(read).collect()
    }

    /// The samples, which have the columns of those before.
    fn alike(&self, read: Vec<(Sample, Vec<Shape>)>, state: &mut State) -> Result<Vec<Sample>, Stopped> {
        for (sample, shapes) in &read {
            let columns = self.columns(shapes);
            match &state.columns {
                None => state.columns = Some(columns),
                Some(first) if *first != columns => {
                    let (a, b) = first.iter().zip(&columns).find(|(a, b)| a != b).expect("they differ");
                    let message = format!(
                        "`{}` differs between samples: {} in the first, {} in sample {}",
                        a.name,
                        a.form(),
                        b.form(),
                        sample.index
                    );
                    let hint = "all samples have the same pixels, layers and units: draw none of them".to_owned();
                    return Err(self.wrong(&["sample", &a.name], message, Some(hint)));
                }
                Some(_) => {}
            }
        }
        Ok(read.into_iter().map(|(sample, _)| sample).collect())
    }

    fn columns(&self, shapes: &[Shape]) -> Vec<ColumnOf> {
        let mut columns = vec![
            ColumnOf::scalar("id", "string", "name of the sample"),
            ColumnOf::scalar("draw", "int64", "raw index of the drawn point"),
            ColumnOf::scalar("group", "int64", "group that no two splits share"),
        ];
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        for (name, of) in draw.names().zip(draw.types()) {
            let dtype = match of {
                Type::Float => "float64",
                Type::Integer => "int64",
                Type::Text => "string",
            };
            // A feature may be the map of what is drawn as a number.
            let taken = self.dataset.features.iter().any(|feature| feature.spec.name == name);
            let name = if taken { format!("draw.{name}") } else { name.to_owned() };
            columns.push(ColumnOf::scalar(&name, dtype, "drawn"));
        }
        for (feature, shape) in self.dataset.features.iter().zip(shapes) {
            let dtype = if shape.tensor.is_some() { feature.spec.dtype.name() } else { "float64" };
            columns.push(ColumnOf {
                shape: shape.tensor,
                unit: shape.unit.clone(),
                channels: shape.channels.clone(),
                pixel_mm: shape.pixel_mm,
                ..ColumnOf::scalar(&feature.spec.name, dtype, &feature.spec.from.join("."))
            });
        }
        columns
    }
}
