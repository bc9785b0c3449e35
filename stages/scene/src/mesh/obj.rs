//! Wavefront OBJ: `v x y z` and `f a b c ..`, where a is `i`, `i/t`, `i//n` or `i/t/n`; negative i count from the end.

use super::{Soup, number, text_of};

pub fn read(bytes: &[u8]) -> Result<Soup, String> {
    let mut soup = Soup::default();
    let mut known = false;
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
                let corners: Vec<u32> =
                    words.map(|word| corner(word, soup.vertices.len(), i + 1)).collect::<Result<_, String>>()?;
                if corners.len() < 3 {
                    return Err(format!("line {}: a face of {} vertices", i + 1, corners.len()));
                }
                soup.push_polygon(&corners);
            }
            _ => {}
        }
    }
    if known { Ok(soup) } else { Err("it is neither STL, PLY, OBJ nor glTF".to_owned()) }
}

fn corner(word: &str, vertices: usize, line: usize) -> Result<u32, String> {
    let index = word.split('/').next().unwrap_or_default();
    let wrong = || format!("line {line}: `{word}` names no vertex; {vertices} stand before it");
    let i: i64 = index.parse().map_err(|_| wrong())?;
    let i = if i < 0 { vertices as i64 + i } else { i - 1 };
    // A vertex may also stand behind the face; then the bound is seen in the end.
    u32::try_from(i).map_err(|_| wrong())
}
