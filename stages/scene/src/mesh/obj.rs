//! Wavefront OBJ: `v x y z` and `f a b c ..`, where a is `i`, `i/t`, `i//n` or `i/t/n`; negative i count from the end.

use super::{Soup, number, quoted, text_of};

pub fn read(bytes: &[u8]) -> Result<Soup, String> {
    let mut soup = Soup::default();
    let (mut known, mut corners) = (false, Vec::new());
    // The highest vertex that a face names, and its line: vertices may also stand behind faces.
    let mut highest: Option<(u32, usize)> = None;
    for (i, line) in text_of(bytes)?.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                known = true;
                let mut coordinate = |what| number(&mut words, i + 1, what);
                soup.vertices.push([coordinate("x")?, coordinate("y")?, coordinate("z")?]);
            }
            Some("f") => {
                known = true;
                corners.clear();
                for word in words {
                    corners.push(corner(word, soup.vertices.len(), i + 1)?);
                }
                if corners.len() < 3 {
                    let n = corners.len();
                    return Err(format!("line {}: a face of {n} vertices; it must have at least 3", i + 1));
                }
                let most = corners.iter().copied().max().expect("at least three");
                if highest.is_none_or(|(known, _)| most > known) {
                    highest = Some((most, i + 1));
                }
                soup.push_polygon(&corners);
            }
            _ => {}
        }
    }
    let there = soup.vertices.len();
    match highest {
        // As the file counts: from 1.
        Some((vertex, line)) if vertex as usize >= there => {
            Err(format!("line {line}: a face names the vertex {}, but there are only {there}", u64::from(vertex) + 1))
        }
        _ if known => Ok(soup),
        _ => Err("it is neither STL, PLY, OBJ nor glTF".to_owned()),
    }
}

fn corner(word: &str, vertices: usize, line: usize) -> Result<u32, String> {
    let index = word.split('/').next().unwrap_or_default();
    let wrong = || format!("line {line}: {} names no vertex; {vertices} stand before it", quoted(word));
    let i: i64 = index.parse().map_err(|_| wrong())?;
    let i = if i < 0 { vertices as i64 + i } else { i - 1 };
    u32::try_from(i).map_err(|_| wrong())
}
