//! glTF 2.0: `.glb`, and `.gltf` whose buffers stand in it as base64. All triangles of the scene, each node in its place.
//!
//! glTF lengths are metres and y is up: `scale: 1000` and `rotation_deg: [90, 0, 0]` bring such a mesh into this world.
//! Nothing is taken on trust: counts times sizes are compared with the bytes that are there before any of them is read.

mod accessor;
mod document;
mod forest;

use std::borrow::Cow;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DMat4;
use turbid_contract::serde_json::Deserializer;

use super::{Soup, quoted};
use accessor::{Buffers, Elements};
use document::{Buffer, Document, Index, Kind, Primitive, Whole};
use forest::{mirrors, visit_nodes};

/// What the format calls its modes and chunks.
const TRIANGLES: u32 = 4;
const GLB_JSON: u32 = 0x4e4f_534a;
const GLB_BINARY: u32 = 0x004e_4942;

/// So many triangles and vertices may be made beyond those that the buffers' bytes hold: nodes may share meshes, primitives accessors, so that a file
/// of some kilobytes may ask for any number.
const MOST_COPIES: usize = 1_000_000;

pub fn binary(bytes: &[u8]) -> Result<Soup, String> {
    let word = |at: usize| bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b));
    if word(4) != Some(2) {
        return Err(format!("glTF version {}, but 2 is known", word(4).unwrap_or(0)));
    }
    if let Some(length) = word(8).filter(|&length| length as usize > bytes.len()) {
        return Err(format!("it says {length} bytes, but there are {}: it is torn", bytes.len()));
    }
    let (mut at, mut json, mut buffer) = (12, None, None);
    while let (Some(size), Some(kind)) = (word(at), word(at + 4)) {
        let chunk = bytes[at + 8..].get(..size as usize).ok_or_else(|| {
            format!("its chunk at byte {at} says {size} bytes, but {} are left: it is torn", bytes.len() - at - 8)
        })?;
        match kind {
            GLB_JSON => json = json.or(Some(chunk)),
            GLB_BINARY => buffer = buffer.or(Some(chunk)),
            _ => {}
        }
        at += 8 + chunk.len();
    }
    soup(json.ok_or("it has no JSON chunk")?, buffer)
}

pub fn text(bytes: &[u8]) -> Result<Soup, String> {
    soup(bytes, None)
}

fn soup(json: &[u8], binary: Option<&[u8]>) -> Result<Soup, String> {
    let mut json = Deserializer::from_slice(json);
    let document: Document<'_> = serde_path_to_error::deserialize(&mut json).map_err(|e| {
        let (path, what) = (e.path().to_string(), e.into_inner());
        if path == "." { format!("its JSON cannot be read: {what}") } else { format!("{path}: {what}") }
    })?;
    json.end().map_err(|e| format!("its JSON cannot be read: {e}"))?;
    let buffers = document.buffers.0.iter().enumerate();
    let buffers =
        buffers.map(|(i, buffer)| data(buffer, binary.filter(|_| i == 0)).map_err(|e| format!("buffer {i}{e}")));
    let buffers: Vec<Cow<'_, [u8]>> = buffers.collect::<Result<_, String>>()?;
    let bytes: usize = buffers.iter().map(|b| b.len()).sum();
    let mut build = Build { document: &document, buffers: &buffers, bytes, soup: Soup::default() };
    visit_nodes(&document, &mut |i, world| build.node(i, world).map_err(|e| format!("node {i}: {e}")))?;
    Ok(build.soup)
}

/// The bytes of a buffer: those that stand in it, or those of the file (the first of a `.glb`).
fn data<'a>(buffer: &Buffer<'_>, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>, String> {
    let data: Cow<'a, [u8]> = match (&buffer.uri, binary) {
        (Some(uri), _) if uri.0.starts_with("data:") => {
            let (_, base64) = uri.0.split_once("base64,").ok_or(" is not base64")?;
            STANDARD.decode(base64).map_err(|e| format!(": {e}"))?.into()
        }
        (Some(uri), _) => {
            let rule = "export it as .glb, or with embedded buffers";
            return Err(format!(" stands in another file, {}; {rule}", quoted(&uri.0)));
        }
        (None, Some(binary)) => binary.into(),
        (None, None) => return Err(" has no data".to_owned()),
    };
    match buffer.byte_length {
        Some(Whole(length)) if length > data.len() as u64 => {
            Err(format!(": byteLength is {length}, but it holds {} bytes: it is torn", data.len()))
        }
        _ => Ok(data),
    }
}

struct Build<'a> {
    document: &'a Document<'a>,
    buffers: &'a Buffers<'a>,
    /// In all buffers.
    bytes: usize,
    soup: Soup,
}

impl Build<'_> {
    fn node(&mut self, i: usize, world: DMat4) -> Result<(), String> {
        let node = &self.document.nodes.0[i];
        if node.extensions.instancing.is_some() {
            return Err(
                "its instances (EXT_mesh_gpu_instancing) are not read; make them real before the export".to_owned()
            );
        }
        let Some(Index(mesh)) = node.mesh else { return Ok(()) };
        let meshes = &self.document.meshes.0;
        let there = meshes.len();
        let found = meshes.get(mesh as usize);
        let found = found.ok_or_else(|| format!("it names mesh {mesh}, but there are only {there} (from 0)"))?;
        for (k, primitive) in found.primitives.0.iter().enumerate() {
            self.primitive(primitive, world).map_err(|e| format!("mesh {mesh}: primitive {k}: {e}"))?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, world: DMat4) -> Result<(), String> {
        if let Some(Index(mode)) = primitive.mode.filter(|mode| mode.0 != TRIANGLES) {
            return Err(format!("mode {mode} is not that of single triangles, {TRIANGLES}; export it as triangles"));
        }
        if primitive.extensions.draco.is_some() {
            return Err("it is compressed (Draco); export it without compression".to_owned());
        }
        let position = primitive.attributes.position.ok_or("it has no POSITION")?;
        let points = Elements::of(self.document, self.buffers, position, Kind::Vec3)?;
        let indices =
            primitive.indices.map(|i| Elements::of(self.document, self.buffers, i, Kind::Scalar)).transpose()?;
        let corners = indices.as_ref().map_or(points.count, |indices| indices.count);
        if corners % 3 != 0 {
            return Err(format!("{corners} corners are no whole number of triangles"));
        }
        self.room(points.count, corners / 3)?;
        let first = self.soup.vertices.len() as u32;
        self.soup.vertices.extend((0..points.count).map(|k| world.transform_point3(points.get(k).into()).to_array()));
        // A node that mirrors turns its triangles inside out: their order is mended.
        let order = if mirrors(world) { [0, 2, 1] } else { [0, 1, 2] };
        for k in 0..corners / 3 {
            let mut triangle = order.map(|c| 3 * k as u32 + c);
            if let Some(indices) = &indices {
                triangle = order.map(|c| indices.get::<1>(3 * k + c as usize)[0] as u32);
                if let Some(i) = triangle.iter().find(|&&i| i as usize >= points.count) {
                    let there = points.count;
                    return Err(format!("triangle {k} names the vertex {i}, but there are only {there} (from 0)"));
                }
            }
            self.soup.triangles.push(triangle.map(|i| first + i));
        }
        Ok(())
    }

    /// Whether so many more vertices and triangles are within what the bytes hold and [`MOST_COPIES`].
    fn room(&self, vertices: usize, triangles: usize) -> Result<(), String> {
        // A triangle takes three bytes at least, those of its indices; positions are rarely less than floats.
        let limits = [
            (&"vertices", self.soup.vertices.len(), vertices, 12),
            (&"triangles", self.soup.triangles.len(), triangles, 3),
        ];
        for (what, there, more, each) in limits {
            let most = self.bytes / each + MOST_COPIES;
            if there.saturating_add(more) > most.min(u32::MAX as usize) {
                return Err(format!(
                    "{there} and {more} {what}, but the buffers' {} bytes hold {}, and copies of them may make {MOST_COPIES} more; \
                     use fewer instances, or make them real before the export",
                    self.bytes,
                    self.bytes / each
                ));
            }
        }
        Ok(())
    }
}
