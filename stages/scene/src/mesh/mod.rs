//! Meshes of triangles from files: STL (text, binary), PLY (text, binary of both orders), OBJ, glTF (.gltf with embedded buffers, .glb).

use std::collections::HashMap;

use glam::DVec3;
use turbid_contract::payload::Mesh;
use turbid_optics::solid::Frame;

mod check;
mod crossing;
mod gltf;
mod obj;
mod ply;
mod stl;
mod topology;

pub use check::check;

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
}

/// Where a mesh goes: its file's lengths times `scale` are mm, then it is turned about the file's origin, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    pub scale: f64,
    pub rotation_deg: [f64; 3],
    pub position: [f64; 3],
}

/// The triangles of a file; which format it has is seen by its content.
///
/// Error: what is wrong with it.
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
    if let Some(v) = soup.vertices.iter().find(|v| v.iter().any(|x| !x.is_finite())) {
        return Err(format!("a vertex at {v:?} is not a finite place"));
    }
    let n = soup.vertices.len();
    if let Some(i) = soup.triangles.iter().flatten().find(|&&i| i as usize >= n) {
        return Err(format!("a triangle names the vertex {i}, but there are only {n}"));
    }
    Ok(soup)
}

/// Brings a mesh into the world. Vertices at the same place, to the last bit, become one; they are counted in the order in which
/// triangles name them, so that all formats give the same mesh.
pub fn place(soup: &Soup, placing: &Placing) -> Mesh {
    let frame = Frame::turned(placing.position.into(), placing.rotation_deg);
    let straight = placing.rotation_deg == [0.0; 3];
    let mut known: HashMap<[u64; 3], u32> = HashMap::with_capacity(soup.vertices.len());
    let mut vertices = Vec::new();
    let mut index = |i: u32| {
        // -0.0 and 0.0 are the same place.
        let v = soup.vertices[i as usize].map(|x| x + 0.0);
        *known.entry(v.map(f64::to_bits)).or_insert_with(|| {
            let p = placing.scale * DVec3::from(v);
            let p = if straight { DVec3::from(placing.position) + p } else { frame.point_out(p) };
            vertices.push(p.to_array().map(|x| x + 0.0));
            vertices.len() as u32 - 1
        })
    };
    let triangles = soup.triangles.iter().map(|t| t.map(&mut index)).collect();
    Mesh { vertices, triangles }
}

/// The next number of a text, as `what` of a line.
fn number<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize, what: &str) -> Result<f64, String> {
    let word = words.next().ok_or_else(|| format!("line {line}: {what} is missing"))?;
    word.parse().map_err(|_| format!("line {line}: `{word}` is no number ({what})"))
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
