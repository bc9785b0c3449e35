//! Meshes of triangles from files: STL (text, binary), PLY (text, binary of both orders), OBJ, glTF (.gltf with embedded buffers, .glb).

mod check;
mod crossing;
mod gltf;
mod nearby;
mod nesting;
mod obj;
mod place;
mod ply;
mod stl;
mod topology;

pub use check::check;
pub use crossing::first_crossing;
pub use place::{Placing, place};

/// Triangles as a file lists them: vertices in its units, perhaps the same one several times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Soup {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// Adds a flat polygon as a fan of triangles around its first corner.
    fn push_polygon(&mut self, corners: &[u32]) {
        for pair in corners[1..].windows(2) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }

    /// The number of the next vertex.
    fn corner(&self) -> Result<u32, String> {
        let n = self.vertices.len();
        // A triangle's further corners have numbers, too.
        u32::try_from(n)
            .ok()
            .filter(|n| *n < u32::MAX - 3)
            .ok_or_else(|| format!("{n} corners: there must be less than 2^32"))
    }
}

/// The triangles of a file; which format it has is seen by its content. It takes no more memory
/// than four times what it returns and the file.
///
/// Error: what is wrong with it, with the line, node, accessor, face or vertex.
pub fn read(bytes: &[u8]) -> Result<Soup, String> {
    let begins = |with: &str| bytes.trim_ascii_start().starts_with(with.as_bytes());
    let soup = if bytes.starts_with(b"glTF") {
        gltf::binary(bytes)?
    } else if begins("{") {
        gltf::text(bytes)?
    } else if begins("ply") {
        ply::read(bytes)?
    } else if stl::is_binary(bytes) {
        stl::binary(bytes)?
    } else if begins("solid") {
        stl::text(bytes)?
    } else {
        obj::read(bytes)?
    };
    if let Some(i) = soup.vertices.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
        return Err(format!("vertex {i} (from 0) at {:?} is not a finite place", soup.vertices[i]));
    }
    let (n, triangles) = (soup.vertices.len(), soup.triangles.len());
    if triangles > i32::MAX as usize {
        return Err(format!("{triangles} triangles: there must be less than 2^31"));
    }
    if let Some(i) = soup.triangles.iter().flatten().find(|&&i| i as usize >= n) {
        return Err(format!("a triangle names the vertex {i}, but there are only {n}"));
    }
    Ok(soup)
}

/// The next number of a text, as `what` of a line; finite.
fn number<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize, what: &str) -> Result<f64, String> {
    let word = words.next().ok_or_else(|| format!("line {line}: {what} is missing"))?;
    let x: f64 = word.parse().map_err(|_| format!("line {line}: {} is no number ({what})", quoted(word)))?;
    if x.is_finite() { Ok(x) } else { Err(format!("line {line}: {} is not a finite place ({what})", quoted(word))) }
}

/// A word of a file as an error shows it: not all of a long one, and nothing that a terminal would obey.
fn quoted(word: &str) -> String {
    const SHOWN: usize = 40;
    let more = if word.chars().nth(SHOWN).is_some() { ".." } else { "" };
    let shown: String = word
        .chars()
        .take(SHOWN)
        .flat_map(|c| if c.is_control() { c.escape_default().collect() } else { vec![c] })
        .collect();
    format!("`{shown}{more}`")
}

/// The text of a file.
fn text_of(bytes: &[u8]) -> Result<&str, String> {
    std::str::from_utf8(bytes).map_err(|e| {
        format!(
            "it is neither STL, PLY, OBJ nor glTF: byte {} is no text, and no binary format begins like that",
            e.valid_up_to()
        )
    })
}

#[cfg(test)]
mod tests;
