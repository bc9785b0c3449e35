//! Files without a header: numbers one after another, row by row from the top.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::npy::numbers;
use super::{Picture, bounded};

/// What a file without a header holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Raw {
    /// Type of the numbers.
    pub dtype: RawType,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Bytes before the first number.
    #[serde(default)]
    pub offset: u64,
    /// Whether the first byte of a number is the highest.
    #[serde(default)]
    pub big_endian: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RawType {
    Uint8,
    Uint16,
    Int16,
    Uint32,
    Float32,
    Float64,
}

impl RawType {
    /// As NumPy writes it, without the order of bytes.
    fn name(self) -> &'static str {
        match self {
            Self::Uint8 => "|u1",
            Self::Uint16 => "|u2",
            Self::Int16 => "|i2",
            Self::Uint32 => "|u4",
            Self::Float32 => "|f4",
            Self::Float64 => "|f8",
        }
    }

    fn bytes(self) -> u64 {
        self.name()[2..].parse().expect("a digit")
    }
}

impl Raw {
    /// Bytes of a picture.
    fn page(&self) -> Result<u64, String> {
        let (columns, rows) = bounded(self.size[0].into(), self.size[1].into())?;
        Ok((columns * rows) as u64 * self.dtype.bytes())
    }

    /// Pictures of this size in a file.
    ///
    /// Error: what is behind the last of them is no picture.
    pub fn pages(&self, bytes: &[u8]) -> Result<usize, String> {
        let (page, all) = (self.page()?, bytes.len() as u64);
        let held = all.checked_sub(self.offset).filter(|held| held % page == 0 && *held > 0);
        let held = held.ok_or_else(|| {
            let Self { size: [columns, rows], offset, .. } = self;
            format!(
                "it has {all} bytes, which are no whole number of pictures of {columns} x {rows} pixels, {page} bytes each, behind {offset}"
            )
        })?;
        Ok((held / page) as usize)
    }

    pub(super) fn read(&self, bytes: &[u8], page: usize) -> Result<Picture, String> {
        let (pages, length) = (self.pages(bytes)?, self.page()? as usize);
        if page >= pages {
            return Err(super::no_page(page, pages));
        }
        let start = self.offset as usize + page * length;
        let read = numbers(self.dtype.name(), &bytes[start..start + length], self.big_endian).expect("a known type");
        Picture::whole((self.size[0] as usize, self.size[1] as usize), read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::Numbers;

    #[test]
    fn numbers_behind_an_offset_are_read() {
        let raw = Raw { dtype: RawType::Uint16, size: [2, 1], offset: 3, big_endian: false };
        let bytes = [9, 9, 9, 1, 0, 2, 0, 3, 0, 4, 1];
        assert_eq!(raw.read(&bytes, 1).unwrap().values, Numbers::U16(vec![3, 260]));
        let big = Raw { big_endian: true, ..raw };
        assert_eq!(big.read(&bytes, 0).unwrap().values, Numbers::U16(vec![256, 512]));
        assert_eq!(raw.pages(&bytes), Ok(2));
        assert!(raw.read(&bytes, 2).unwrap_err().contains("page 3 is asked for"));
        assert!(raw.read(&bytes[..10], 0).unwrap_err().contains("no whole number of pictures of 2 x 1 pixels"));
        assert!(raw.read(&bytes[..2], 0).unwrap_err().contains("it has 2 bytes"));
        let none = Raw { size: [0, 4], ..raw };
        assert!(none.read(&bytes, 0).unwrap_err().contains("0 x 4 pixels"));
    }
}
