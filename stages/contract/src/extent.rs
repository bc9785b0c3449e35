//! How large an artifact is, or is going to be: what memory is reckoned from before anything is taken.

use crate::artifact::{Artifact, Cells};

/// The size of an artifact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    Images {
        pixels: u64,
        layers: u64,
    },
    Table {
        rows: u64,
        columns: u64,
    },
    /// A record by the bytes of its text.
    Record {
        bytes: u64,
    },
}

impl Extent {
    /// Images of `columns` x `rows` pixels.
    pub fn images(columns: u64, rows: u64, layers: u64) -> Self {
        Self::Images { pixels: columns.saturating_mul(rows), layers }
    }

    /// Bytes in memory: 4 for each pixel of a layer, 8 for each cell of a table.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Images { pixels, layers } => pixels.saturating_mul(layers).saturating_mul(4),
            Self::Table { rows, columns } => rows.saturating_mul(columns).saturating_mul(8),
            Self::Record { bytes } => bytes,
        }
    }

    /// Pixels of a layer; 0 where there are none.
    pub fn pixels(self) -> u64 {
        match self {
            Self::Images { pixels, .. } => pixels,
            _ => 0,
        }
    }

    /// Layers of an image stack; 0 of anything else.
    pub fn layers(self) -> u64 {
        match self {
            Self::Images { layers, .. } => layers,
            _ => 0,
        }
    }
}

impl Artifact {
    /// How large it is. Of text and of nested fields the lengths of their characters.
    pub fn extent(&self) -> Extent {
        match self {
            Self::Images(stack) => {
                Extent::images(stack.columns() as u64, stack.rows() as u64, stack.layers.len() as u64)
            }
            Self::Table(table) => {
                let wide = |cells: &Cells| matches!(cells, Cells::Text(_) | Cells::MaybeF64(_));
                // A number that may be unknown takes two places; so, about, does text.
                let columns = table.columns.iter().map(|c| if wide(&c.cells) { 2 } else { 1 }).sum();
                Extent::Table { rows: table.rows() as u64, columns }
            }
            Self::Record(record) => {
                let text = record.fields.iter().map(|(name, value)| name.len() + value.to_string().len());
                Extent::Record { bytes: text.sum::<usize>() as u64 }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifact::{ImageStack, LayerInfo, Table};
    use ndarray::Array2;

    #[test]
    fn bytes_are_those_of_the_numbers() {
        let mut stack = ImageStack::new(3, 5);
        stack.push(LayerInfo::value("r_d", "1"), Array2::zeros((3, 5)));
        stack.push(LayerInfo::value("r_d", "1"), Array2::zeros((3, 5)));
        let extent = Artifact::Images(stack).extent();
        assert_eq!((extent, extent.bytes()), (Extent::Images { pixels: 15, layers: 2 }, 120));
        let mut table = Table::default();
        table.push("mu_a", "mm^-1", Cells::F64(vec![0.0; 7]));
        assert_eq!(Artifact::Table(table).extent().bytes(), 56);
        // No image is so large that its size wraps around to a small one.
        assert_eq!(Extent::images(u64::MAX, 2, 3).bytes(), u64::MAX);
    }
}
