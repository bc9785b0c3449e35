//! What is said of the image stacks of many instances beside their pixels.

use turbid_contract::{Attributes, Axes, Cells, ImageStack, LayerInfo};

use super::ExportError;
use super::gather::cells;

/// What is said of stacks beside their pixels.
#[derive(Default)]
pub(super) struct Heads {
    size: [usize; 2],
    pub values: Vec<Axes>,
    pub layers: Vec<Vec<LayerInfo>>,
    /// Standard errors of the means of layers; NaN where they are not known.
    pub mean_se: Vec<Vec<f64>>,
    pub attributes: Vec<Attributes>,
    pitch_mm: Vec<Option<[f64; 2]>>,
}

/// Stacks in memory, pixels down the columns.
#[derive(Default)]
pub(super) struct Stacked {
    pub heads: Heads,
    pub pixels: Vec<u8>,
    /// How many instances are in the files before.
    pub first: usize,
}

impl Heads {
    /// Error: another size, or number of layers, than that of those before.
    pub fn add(&mut self, label: String, values: Axes, stack: &ImageStack) -> Result<(), ExportError> {
        let (size, count) = ([stack.rows(), stack.columns()], stack.layers.len());
        if let Some(layers) = self.layers.first()
            && (self.size != size || layers.len() != count)
        {
            let [r, c] = self.size;
            let what = format!("{count} layers of {} x {} pixels, not {} of {r} x {c}", size[0], size[1], layers.len());
            return Err(ExportError::Differs { label, what });
        }
        self.size = size;
        self.values.push(values);
        self.mean_se.push(stack.layers.iter().map(|layer| layer.info.mean_se.unwrap_or(f64::NAN)).collect());
        self.layers.push(stack.layers.iter().map(|l| LayerInfo { mean_se: None, ..l.info.clone() }).collect());
        self.pitch_mm.push(stack.pixel_pitch_mm());
        self.attributes.push(stack.attributes.clone());
        Ok(())
    }

    /// Layers, rows, columns.
    pub fn shape(&self) -> [usize; 3] {
        [self.layers.first().map_or(0, Vec::len), self.size[0], self.size[1]]
    }

    pub fn same_layers(&self) -> bool {
        self.layers.iter().all(|layers| *layers == self.layers[0])
    }

    pub fn same_attributes(&self) -> bool {
        self.attributes.iter().all(|own| *own == self.attributes[0])
    }

    /// The pitch of the pixels, of all or of each; `None` where it is not known of all.
    pub fn pitches(&self) -> Option<Vec<[f64; 2]>> {
        let pitches: Vec<[f64; 2]> = self.pitch_mm.iter().copied().collect::<Option<_>>()?;
        let same = pitches.iter().all(|pitch| *pitch == pitches[0]);
        Some(if same { pitches[..1].to_vec() } else { pitches })
    }

    /// The axes, each with its value for every instance.
    pub fn axes(&self) -> Vec<(String, Cells)> {
        let names = self.values.first().map(Axes::keys).into_iter().flatten();
        names.map(|axis| (axis.clone(), cells(self.values.iter().map(|values| values.get(axis))))).collect()
    }
}
