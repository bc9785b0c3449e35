//! PLY, text and binary of both byte orders: the elements `vertex` (x, y, z) and `face` (a list of vertices), all others skipped.

use super::{Soup, number};

/// How numbers stand in the body.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Order {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy, Debug)]
enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Debug)]
struct Property {
    name: String,
    of: Type,
    /// The type of its length, for a list.
    length: Option<Type>,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

pub fn read(bytes: &[u8]) -> Result<Soup, String> {
    let (order, elements, body) = header(bytes)?;
    let mut body = match order {
        Order::Text => {
            let text = std::str::from_utf8(body).map_err(|_| "its body is no text".to_owned())?;
            Body::Text(Box::new(text.split_whitespace()))
        }
        _ => Body::Binary { rest: body, big: order == Order::Big },
    };
    let mut soup = Soup::default();
    for element in &elements {
        let place = |name: &str| element.properties.iter().position(|p| p.name == name && p.length.is_none());
        let axes = match element.name.as_str() {
            "vertex" => {
                let axis = |name: &str| place(name).ok_or_else(|| format!("its vertices have no `{name}`"));
                Some([axis("x")?, axis("y")?, axis("z")?])
            }
            _ => None,
        };
        let is_corners = |p: &Property| {
            element.name == "face"
                && p.length.is_some()
                && ["vertex_indices", "vertex_index"].contains(&p.name.as_str())
        };
        for _ in 0..element.count {
            let mut values = Vec::with_capacity(element.properties.len());
            for property in &element.properties {
                let Some(length) = property.length else {
                    values.push(body.number(property.of)?);
                    continue;
                };
                let n = index(body.number(length)?)?;
                let list = (0..n).map(|_| body.number(property.of)).collect::<Result<Vec<f64>, String>>()?;
                values.push(f64::NAN);
                if is_corners(property) {
                    let corners = list.into_iter().map(index).collect::<Result<Vec<u32>, String>>()?;
                    if corners.len() < 3 {
                        return Err(format!("a face of {} vertices", corners.len()));
                    }
                    soup.push_polygon(&corners);
                }
            }
            if let Some(axes) = axes {
                soup.vertices.push(axes.map(|i| values[i]));
            }
        }
    }
    Ok(soup)
}

fn index(x: f64) -> Result<u32, String> {
    // What a cast would change is no index.
    let i = x as u32;
    if f64::from(i) == x { Ok(i) } else { Err(format!("{x} is neither a vertex nor a number of them")) }
}

enum Body<'a> {
    Text(Box<std::str::SplitWhitespace<'a>>),
    Binary { rest: &'a [u8], big: bool },
}

impl Body<'_> {
    fn number(&mut self, of: Type) -> Result<f64, String> {
        match self {
            Self::Text(words) => {
                let word = words.next().ok_or("it ends before its last element: it is torn")?;
                word.parse().map_err(|_| format!("`{word}` is no number"))
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
}

/// The next N bytes, the lowest first.
fn bytes<const N: usize>(rest: &mut &[u8], big: bool) -> Result<[u8; N], String> {
    let (first, behind) = rest.split_first_chunk().ok_or("it ends before its last element: it is torn")?;
    *rest = behind;
    let mut bytes: [u8; N] = *first;
    if big {
        bytes.reverse();
    }
    Ok(bytes)
}

fn header(bytes: &[u8]) -> Result<(Order, Vec<Element>, &[u8]), String> {
    let (mut order, mut elements): (Option<Order>, Vec<Element>) = (None, Vec::new());
    let (mut rest, mut line_number) = (bytes, 0);
    loop {
        let end = rest.iter().position(|&b| b == b'\n').ok_or("its header has no end")?;
        let line = std::str::from_utf8(&rest[..end]).map_err(|_| "its header is no text".to_owned())?;
        rest = &rest[end + 1..];
        line_number += 1;
        let wrong = |what: &str| format!("line {line_number}: {what}: `{}`", line.trim());
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
                let name = words.next().unwrap_or_default().to_owned();
                let count = index(number(&mut words, line_number, "how many of them")?)? as usize;
                elements.push(Element { name, count, properties: Vec::new() });
            }
            Some("property") => {
                let element = elements.last_mut().ok_or_else(|| wrong("a property before any element"))?;
                let mut word = || words.next().unwrap_or_default();
                let first = word();
                let (length, of) = if first == "list" { (Some(word()), word()) } else { (None, first) };
                let known = |name: &str| type_named(name).ok_or_else(|| wrong("this type is not known"));
                let (length, of) = (length.map(known).transpose()?, known(of)?);
                element.properties.push(Property { name: word().to_owned(), of, length });
            }
            _ => {}
        }
    }
    Ok((order.ok_or("its header names no format")?, elements, rest))
}

fn type_named(name: &str) -> Option<Type> {
    Some(match name {
        "char" | "int8" => Type::I8,
        "uchar" | "uint8" => Type::U8,
        "short" | "int16" => Type::I16,
        "ushort" | "uint16" => Type::U16,
        "int" | "int32" => Type::I32,
        "uint" | "uint32" => Type::U32,
        "float" | "float32" => Type::F32,
        "double" | "float64" => Type::F64,
        _ => return None,
    })
}
