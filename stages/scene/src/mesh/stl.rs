//! STL: triangles with three corners each, without shared vertices. Its normals are not looked at: the order of the corners counts.

use super::{Soup, number, text_of};

/// Bytes before the first triangle, and of each.
const HEAD: usize = 84;
const EACH: usize = 50;

/// Text files also begin with `solid`, and binary ones may: the size tells.
pub fn is_binary(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|n| n.checked_mul(EACH).is_some_and(|size| bytes.len() == HEAD + size))
        || (bytes.len() >= HEAD && !bytes.starts_with(b"solid") && bytes[..HEAD].contains(&0))
}

fn count(bytes: &[u8]) -> Option<usize> {
    let n = bytes.get(80..HEAD)?.first_chunk()?;
    Some(u32::from_le_bytes(*n) as usize)
}

pub fn binary(bytes: &[u8]) -> Result<Soup, String> {
    let n = count(bytes).unwrap_or(0);
    let there = bytes.len().saturating_sub(HEAD) / EACH;
    if n != there || bytes.len() != HEAD + there * EACH {
        return Err(format!("it says {n} triangles, but its {} bytes hold {there}: it is torn", bytes.len()));
    }
    let mut soup = Soup { vertices: Vec::with_capacity(3 * n), triangles: Vec::with_capacity(n) };
    for (i, triangle) in bytes[HEAD..].chunks_exact(EACH).enumerate() {
        let floats = triangle[12..48].as_chunks::<4>().0;
        let at = |i: usize| f64::from(f32::from_le_bytes(floats[i]));
        let first = soup.corner()?;
        let corners = [0, 3, 6].map(|i| [at(i), at(i + 1), at(i + 2)]);
        if let Some(corner) = corners.iter().find(|c| c.iter().any(|x| !x.is_finite())) {
            return Err(format!("triangle {i} (from 0): its corner {corner:?} is not a finite place"));
        }
        soup.vertices.extend(corners);
        soup.triangles.push([first, first + 1, first + 2]);
    }
    Ok(soup)
}

pub fn text(bytes: &[u8]) -> Result<Soup, String> {
    let mut soup = Soup::default();
    let mut corners = 0;
    for (i, line) in text_of(bytes)?.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => {
                let mut coordinate = |what| number(&mut words, i + 1, what);
                soup.vertices.push([coordinate("x")?, coordinate("y")?, coordinate("z")?]);
                corners += 1;
            }
            Some("endloop") if corners == 3 => {
                let last = soup.corner()?;
                soup.triangles.push([last - 3, last - 2, last - 1]);
                corners = 0;
            }
            Some("endloop") => return Err(format!("line {}: a facet of {corners} vertices, not 3", i + 1)),
            _ => {}
        }
    }
    if corners > 0 {
        return Err("it ends within a facet: it is torn".to_owned());
    }
    Ok(soup)
}
