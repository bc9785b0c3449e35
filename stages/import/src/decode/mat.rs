//! MATLAB's `.mat` of version 5 to 7 (`save -v6`, `save -v7`, SciPy's `savemat`): one numeric array of rows by columns, or pages of them.
//!
//! Source: MathWorks, "MAT-File Format" (2023), chapter 1. Version 7.3 is HDF5, which no well-kept reader without C libraries reads: it is refused by name.

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::array::{Array, Order};
use super::numbers::{Numbers, room};

/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Bytes of a file before its first element.
const HEADER: usize = 128;

/// Dimensions and letters of a name that an array may have.
const MOST_DIMENSIONS: usize = 8;
const MOST_LETTERS: usize = 256;

/// The array of this name, or the only numeric one.
///
/// Error: what is wrong with the file, or which arrays it holds.
pub fn array(bytes: &[u8], variable: Option<&str>) -> Result<Array, String> {
    if bytes.get(HEADER - 2..HEADER).ok_or("it is cut off within its header")? != b"IM" {
        return Err("it was written by a big-endian machine, or is of another version than 5 to 7".to_owned());
    }
    let mut rest = &bytes[HEADER..];
    let mut found: Vec<Matrix> = Vec::new();
    let mut others: Vec<String> = Vec::new();
    while !rest.is_empty() {
        let Tag { kind, size, .. } = Tag::read(&mut rest)?;
        let (own, behind) = rest.split_at_checked(size).ok_or("it is cut off within an array")?;
        // Only compressed elements are not padded to eight bytes.
        rest = if kind == COMPRESSED { behind } else { behind.get(size.next_multiple_of(8) - size..).unwrap_or(&[]) };
        let matrix = match kind {
            MATRIX => Matrix::read(&mut { own }, variable)?,
            COMPRESSED => {
                let mut inside = ZlibDecoder::new(own);
                if Tag::read(&mut inside)?.kind != MATRIX {
                    continue;
                }
                Matrix::read(&mut inside, variable)?
            }
            _ => continue,
        };
        match matrix {
            Ok(matrix) => found.push(matrix),
            Err(name) => others.push(name),
        }
    }
    if found.len() == 1 {
        return Ok(found.remove(0).array);
    }
    let names = |names: Vec<String>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    Err(match variable {
        Some(variable) => format!("it holds no array `{variable}` of numbers; it holds {}", names(others)),
        None if found.is_empty() => format!("it holds no array of numbers; it holds {}", names(others)),
        None => {
            let found = found.into_iter().map(|m| m.name).collect();
            format!("it holds several arrays: say which by `variable`: {}", names(found))
        }
    })
}

/// What stands before the bytes of an element.
struct Tag {
    kind: u32,
    size: usize,
    /// Up to four bytes stand within the tag.
    within: Option<[u8; 4]>,
}

impl Tag {
    fn read(from: &mut impl Read) -> Result<Self, String> {
        let [first, second]: [[u8; 4]; 2] = [exactly(from)?, exactly(from)?];
        let first = u32::from_le_bytes(first);
        if first >> 16 != 0 {
            let size = (first >> 16) as usize;
            let kind = first & 0xffff;
            return if size <= 4 { Ok(Self { kind, size, within: Some(second) }) } else { Err(damaged()) };
        }
        Ok(Self { kind: first, size: u32::from_le_bytes(second) as usize, within: None })
    }

    /// The bytes of the element; a file that ends before is never asked for memory that it does not fill.
    fn bytes(&self, from: &mut impl Read, most: usize) -> Result<Vec<u8>, String> {
        if let Some(within) = self.within {
            return Ok(within[..self.size].to_vec());
        }
        if self.size > most {
            return Err(damaged());
        }
        let mut bytes = Vec::new();
        from.take(self.size as u64).read_to_end(&mut bytes).map_err(|_| damaged())?;
        if bytes.len() < self.size {
            return Err(format!("it ends after {} of {} bytes of an array", bytes.len(), self.size));
        }
        let mut padding = [0; 8];
        // The last element of a file may lack it.
        let _ = from.read(&mut padding[..self.size.next_multiple_of(8) - self.size]).map_err(|_| damaged())?;
        Ok(bytes)
    }
}

fn exactly<const N: usize>(from: &mut impl Read) -> Result<[u8; N], String> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes).map_err(|_| damaged())?;
    Ok(bytes)
}

fn damaged() -> String {
    "it is cut off or damaged".to_owned()
}

/// A numeric array and its name.
struct Matrix {
    name: String,
    array: Array,
}

impl Matrix {
    /// The inner error is the name of an array that is not wanted, or that holds no real numbers.
    fn read(from: &mut impl Read, wanted: Option<&str>) -> Result<Result<Self, String>, String> {
        let flags = Tag::read(from)?.bytes(from, 8)?;
        let class = *flags.first().ok_or_else(damaged)?;
        let complex = flags.get(1).is_some_and(|bits| bits & 0x08 != 0);
        let dimensions = Tag::read(from)?.bytes(from, 4 * MOST_DIMENSIONS)?;
        let dimensions: Vec<u64> = dimensions.as_chunks().0.iter().map(|&n| u32::from_le_bytes(n).into()).collect();
        let name = String::from_utf8_lossy(&Tag::read(from)?.bytes(from, MOST_LETTERS)?).into_owned();
        let Some(class) = Class::of(class).filter(|_| !complex) else { return Ok(Err(name)) };
        if wanted.is_some_and(|wanted| wanted != name) {
            return Ok(Err(name));
        }
        // A number has no rows and columns: it is no picture.
        if wanted.is_none() && dimensions.iter().all(|&n| n <= 1) {
            return Ok(Err(name));
        }
        let array = Array::new(&dimensions, Order::Columns)?;
        let numbers = Tag::read(from)?;
        let bytes = numbers.bytes(from, array.count().saturating_mul(8))?;
        let numbers = class.numbers(numbers.kind, &bytes)?;
        if numbers.len() != array.count() {
            return Err(format!("`{name}` ends after {} of {} numbers", numbers.len(), array.count()));
        }
        Ok(Ok(Self { name, array: array.with(numbers) }))
    }
}

/// Type of the numbers as MATLAB sees them; a file holds them in any type that has room for them.
#[derive(Clone, Copy)]
enum Class {
    Double,
    Single,
    Uint8,
    Int16,
    Uint16,
    Uint32,
}

impl Class {
    fn of(class: u8) -> Option<Self> {
        Some(match class {
            6 => Self::Double,
            7 => Self::Single,
            9 => Self::Uint8,
            10 => Self::Int16,
            11 => Self::Uint16,
            13 => Self::Uint32,
            _ => return None,
        })
    }

    fn numbers(self, kind: u32, bytes: &[u8]) -> Result<Numbers, String> {
        macro_rules! all {
            ($type:ty, $size:literal) => {
                self.collect(
                    bytes.len() / $size,
                    bytes.as_chunks::<$size>().0.iter().map(|&b| <$type>::from_le_bytes(b) as f64),
                )
            };
        }
        match kind {
            1 => all!(i8, 1),
            2 => all!(u8, 1),
            3 => all!(i16, 2),
            4 => all!(u16, 2),
            5 => all!(i32, 4),
            6 => all!(u32, 4),
            7 => all!(f32, 4),
            9 => all!(f64, 8),
            other => Err(format!("its numbers are of the type {other} of MAT-files, which is not read")),
        }
    }

    fn collect(self, n: usize, numbers: impl Iterator<Item = f64>) -> Result<Numbers, String> {
        macro_rules! of {
            ($variant:ident, $type:ty) => {{
                let mut all = room(n)?;
                all.extend(numbers.map(|v| v as $type));
                Numbers::$variant(all)
            }};
        }
        Ok(match self {
            Self::Double => of!(F64, f64),
            Self::Single => of!(F32, f32),
            Self::Uint8 => of!(U8, u8),
            Self::Int16 => of!(I16, i16),
            Self::Uint16 => of!(U16, u16),
            Self::Uint32 => of!(U32, u32),
        })
    }
}
