//! The body of a PLY file: numbers and lists of them, one after the other.

use super::super::quoted;
use super::header::{Order, Property, Type, index};

const TORN: &str = "the file ends before its last element: it is torn";

pub enum Body<'a> {
    Text { rest: &'a str },
    Binary { rest: &'a [u8], big: bool },
}

impl<'a> Body<'a> {
    pub fn new(order: Order, bytes: &'a [u8]) -> Result<Self, String> {
        Ok(match order {
            Order::Text => {
                let text = std::str::from_utf8(bytes);
                let text =
                    text.map_err(|e| format!("its body is no text: byte {} behind the header", e.valid_up_to()))?;
                Self::Text { rest: text }
            }
            _ => Self::Binary { rest: bytes, big: order == Order::Big },
        })
    }

    /// Bytes that are not yet read.
    pub fn left(&self) -> usize {
        match self {
            // As if a space stood at the end: each number is a digit and a space.
            Self::Text { rest } => rest.len() + 1,
            Self::Binary { rest, .. } => rest.len(),
        }
    }

    /// The fewest bytes that a property takes: an empty list is its length only.
    pub fn least(&self, property: &Property<'_>) -> usize {
        self.size(property.length.unwrap_or(property.of))
    }

    fn size(&self, of: Type) -> usize {
        match self {
            Self::Text { .. } => 2,
            Self::Binary { .. } => of.size(),
        }
    }

    pub fn number(&mut self, of: Type) -> Result<f64, String> {
        match self {
            Self::Text { rest } => {
                let word = word(rest)?;
                word.parse().map_err(|_| format!("{} is no number", quoted(word)))
            }
            Self::Binary { rest, big } => match of {
                Type::I8 => bytes(rest, *big).map(|b| f64::from(i8::from_le_bytes(b))),
                Type::U8 => bytes(rest, *big).map(|b| f64::from(u8::from_le_bytes(b))),
                Type::I16 => bytes(rest, *big).map(|b| f64::from(i16::from_le_bytes(b))),
                Type::U16 => bytes(rest, *big).map(|b| f64::from(u16::from_le_bytes(b))),
                Type::I32 => bytes(rest, *big).map(|b| f64::from(i32::from_le_bytes(b))),
                Type::U32 => bytes(rest, *big).map(|b| f64::from(u32::from_le_bytes(b))),
                Type::F32 => bytes(rest, *big).map(|b| f64::from(f32::from_le_bytes(b))),
                Type::F64 => bytes(rest, *big).map(f64::from_le_bytes),
            },
        }
    }

    /// Appends the vertices that a list names.
    pub fn list(&mut self, length: Type, of: Type, vertices: &mut Vec<u32>) -> Result<(), String> {
        let n = self.length(length, of)?;
        for _ in 0..n {
            vertices.push(index(self.number(of)?)?);
        }
        Ok(())
    }

    pub fn skip(&mut self, property: &Property<'_>) -> Result<(), String> {
        let n = property.length.map_or(Ok(1), |length| self.length(length, property.of))?;
        match self {
            Self::Text { rest } => (0..n).try_for_each(|_| word(rest).map(drop)),
            Self::Binary { rest, .. } => {
                let size = n.checked_mul(property.of.size());
                *rest = size.and_then(|size| rest.get(size..)).ok_or(TORN)?;
                Ok(())
            }
        }
    }

    /// How many numbers a list has: no more than the rest of the file can hold.
    fn length(&mut self, length: Type, of: Type) -> Result<usize, String> {
        let n = self.number(length)?;
        let n = index(n).map_err(|_| format!("a list of {n} numbers"))? as usize;
        let left = self.left();
        if n.checked_mul(self.size(of)).is_none_or(|needed| needed > left) {
            return Err(format!("a list of {n} numbers, but {left} bytes are left: it is torn"));
        }
        Ok(n)
    }
}

/// The next word of a text.
fn word<'a>(rest: &mut &'a str) -> Result<&'a str, String> {
    let text = rest.trim_start();
    let (word, behind) = text.split_at(text.find(char::is_whitespace).unwrap_or(text.len()));
    *rest = behind;
    if word.is_empty() { Err(TORN.to_owned()) } else { Ok(word) }
}

/// The next N bytes, the lowest first.
fn bytes<const N: usize>(rest: &mut &[u8], big: bool) -> Result<[u8; N], String> {
    let (first, behind) = rest.split_first_chunk().ok_or(TORN)?;
    *rest = behind;
    let mut bytes: [u8; N] = *first;
    if big {
        bytes.reverse();
    }
    Ok(bytes)
}
