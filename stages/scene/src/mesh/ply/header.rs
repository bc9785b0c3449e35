//! The header of a PLY file.

use super::super::{number, quoted};

/// More elements and properties in all has no file that is meant well.
const MOST_LINES: usize = 1 << 16;

/// How numbers stand in the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy, Debug)]
pub enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    /// Bytes of a number in a binary body.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

#[derive(Debug)]
pub struct Property<'a> {
    pub name: &'a str,
    pub of: Type,
    /// The type of its length, for a list.
    pub length: Option<Type>,
}

#[derive(Debug)]
pub struct Element<'a> {
    pub name: &'a str,
    pub count: usize,
    pub properties: Vec<Property<'a>>,
}

/// How the body is written, what stands in it, and its bytes.
pub fn header(bytes: &[u8]) -> Result<(Order, Vec<Element<'_>>, &[u8]), String> {
    let (mut order, mut elements): (Option<Order>, Vec<Element<'_>>) = (None, Vec::new());
    let (mut rest, mut line_number, mut known) = (bytes, 0, 0);
    loop {
        let end = rest.iter().position(|&b| b == b'\n').ok_or("its header has no end (`end_header`): it is torn")?;
        let line = &rest[..end];
        rest = &rest[end + 1..];
        line_number += 1;
        // Names in comments are written in whatever way.
        if [&b"comment"[..], b"obj_info"].iter().any(|word| line.starts_with(word)) {
            continue;
        }
        let line = std::str::from_utf8(line).map_err(|_| format!("line {line_number}: its header is no text"))?;
        let wrong = |what: &str| format!("line {line_number}: {what}: {}", quoted(line.trim()));
        let mut words = line.split_whitespace();
        match words.next() {
            Some("end_header") => break,
            Some("format") => {
                order = Some(match words.next() {
                    Some("ascii") => Order::Text,
                    Some("binary_little_endian") => Order::Little,
                    Some("binary_big_endian") => Order::Big,
                    _ => return Err(wrong("this format is not known")),
                });
            }
            Some("element") => {
                let name = words.next().unwrap_or_default();
                if ["vertex", "face"].contains(&name) && elements.iter().any(|e| e.name == name) {
                    return Err(wrong("this element stands twice"));
                }
                let count = number(&mut words, line_number, "how many of them")?;
                let count = index(count).map_err(|e| wrong(&e))? as usize;
                elements.push(Element { name, count, properties: Vec::new() });
                known += 1;
            }
            Some("property") => {
                let element = elements.last_mut().ok_or_else(|| wrong("a property before any element"))?;
                let mut word = || words.next().unwrap_or_default();
                let first = word();
                let (length, of) = if first == "list" { (Some(word()), word()) } else { (None, first) };
                let known_type = |name: &str| Type::named(name).ok_or_else(|| wrong("this type is not known"));
                let (length, of) = (length.map(known_type).transpose()?, known_type(of)?);
                element.properties.push(Property { name: word(), of, length });
                known += 1;
            }
            _ => {}
        }
        if known > MOST_LINES {
            return Err(wrong(&format!("more than {MOST_LINES} elements and properties")));
        }
    }
    Ok((order.ok_or("its header names no format")?, elements, rest))
}

/// A number of vertices, or the place of one.
pub fn index(x: f64) -> Result<u32, String> {
    // What a cast would change is no index.
    let i = x as u32;
    if f64::from(i) == x { Ok(i) } else { Err(format!("{x} is neither a vertex nor a number of them")) }
}
