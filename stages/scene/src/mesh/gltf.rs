//! glTF 2.0: `.glb`, and `.gltf` whose buffers stand in it as base64. All triangles of the scene, each node in its place.
//!
//! glTF lengths are metres and y is up: `scale: 1000` and `rotation_deg: [90, 0, 0]` bring such a mesh into this world.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat4, DQuat, DVec3};
use turbid_contract::serde_json::{self, Value};

use super::Soup;

/// Nodes below nodes; a tree is not deeper, a circle is.
const DEEPEST: usize = 64;
/// What the format calls its types and kinds.
const TRIANGLES: u64 = 4;
const FLOAT: u64 = 5126;
const GLB_JSON: u32 = 0x4e4f_534a;
const GLB_BINARY: u32 = 0x004e_4942;

pub fn binary(bytes: &[u8]) -> Result<Soup, String> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b));
    if word(4) != Some(2) {
        return Err(format!("glTF version {}, but 2 is known", word(4).unwrap_or(0)));
    }
    let (mut at, mut json, mut buffer) = (12, None, None);
    while let (Some(size), Some(kind)) = (word(at), word(at + 4)) {
        let chunk = bytes.get(at + 8..at + 8 + size as usize).ok_or("its last part is cut off: it is torn")?;
        match kind {
            GLB_JSON => json = Some(chunk),
            GLB_BINARY => buffer = Some(chunk),
            _ => {}
        }
        at += 8 + size as usize;
    }
    document(json.ok_or("it has no JSON part")?, buffer)
}

pub fn text(bytes: &[u8]) -> Result<Soup, String> {
    document(bytes, None)
}

fn document(json: &[u8], binary: Option<&[u8]>) -> Result<Soup, String> {
    let root: Value = serde_json::from_slice(json).map_err(|e| format!("its JSON cannot be read: {e}"))?;
    let buffers = root["buffers"].as_array().into_iter().flatten().enumerate();
    let buffers = buffers.map(|(i, buffer)| match (buffer["uri"].as_str(), binary) {
        (Some(uri), _) if uri.starts_with("data:") => {
            let data = uri.split_once("base64,").ok_or_else(|| format!("buffer {i} is not base64"))?.1;
            STANDARD.decode(data).map_err(|e| format!("buffer {i}: {e}"))
        }
        (None, Some(binary)) if i == 0 => Ok(binary.to_vec()),
        (Some(uri), _) => {
            Err(format!("buffer {i} stands in another file, `{uri}`; export it as .glb, or with embedded buffers"))
        }
        (None, _) => Err(format!("buffer {i} has no data")),
    });
    let file = File { buffers: buffers.collect::<Result<_, String>>()?, root };
    let mut soup = Soup::default();
    let scene = file.root["scene"].as_u64().unwrap_or(0) as usize;
    let roots: Vec<u64> = match &file.root["scenes"][scene]["nodes"] {
        Value::Array(nodes) => nodes.iter().filter_map(Value::as_u64).collect(),
        _ => return Err("it has no scene with nodes".to_owned()),
    };
    for node in roots {
        file.node(node as usize, DMat4::IDENTITY, 0, &mut soup)?;
    }
    Ok(soup)
}

struct File {
    root: Value,
    buffers: Vec<Vec<u8>>,
}

impl File {
    fn node(&self, i: usize, parent: DMat4, depth: usize, soup: &mut Soup) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("its nodes are nested deeper than {DEEPEST}, or in a circle"));
        }
        let node = &self.root["nodes"][i];
        let world = parent * local(node);
        if let Some(mesh) = node["mesh"].as_u64() {
            for primitive in self.root["meshes"][mesh as usize]["primitives"].as_array().into_iter().flatten() {
                self.primitive(primitive, world, soup)?;
            }
        }
        for child in node["children"].as_array().into_iter().flatten().filter_map(Value::as_u64) {
            self.node(child as usize, world, depth + 1, soup)?;
        }
        Ok(())
    }

    fn primitive(&self, primitive: &Value, world: DMat4, soup: &mut Soup) -> Result<(), String> {
        if primitive["mode"].as_u64().unwrap_or(TRIANGLES) != TRIANGLES {
            return Err("a part of it is not made of single triangles; export it as triangles".to_owned());
        }
        if primitive["extensions"].as_object().is_some_and(|e| e.contains_key("KHR_draco_mesh_compression")) {
            return Err("it is compressed (Draco); export it without compression".to_owned());
        }
        let position = primitive["attributes"]["POSITION"].as_u64().ok_or("a part of it has no positions")?;
        let first = soup.vertices.len() as u32;
        let numbers = self.accessor(position as usize, 3)?;
        let points = numbers.as_chunks::<3>().0;
        soup.vertices.extend(points.iter().map(|&p| world.transform_point3(p.into()).to_array()));
        let corners: Vec<u32> = match primitive["indices"].as_u64() {
            Some(indices) => self.accessor(indices as usize, 1)?.into_iter().map(|i| i as u32).collect(),
            None => (0..points.len() as u32).collect(),
        };
        if let Some(i) = corners.iter().find(|&&i| i as usize >= points.len()) {
            return Err(format!("a triangle names the vertex {i}, but there are only {}", points.len()));
        }
        // A node that mirrors turns its triangles inside out: their order is mended.
        let mirrors = world.determinant() < 0.0;
        for &[a, b, c] in corners.as_chunks::<3>().0 {
            let [b, c] = if mirrors { [c, b] } else { [b, c] };
            soup.triangles.push([a, b, c].map(|i| first + i));
        }
        Ok(())
    }

    /// The numbers of an accessor of `width` components each.
    fn accessor(&self, i: usize, width: usize) -> Result<Vec<f64>, String> {
        let accessor = &self.root["accessors"][i];
        let wrong = |what: &str| format!("accessor {i} {what}");
        let kind = if width == 3 { "VEC3" } else { "SCALAR" };
        if accessor["type"].as_str() != Some(kind) || accessor.get("sparse").is_some() {
            return Err(wrong(&format!("is not a plain list of {kind}")));
        }
        let whole = |value: &Value| value.as_u64().unwrap_or(0) as usize;
        let count = accessor["count"].as_u64().ok_or_else(|| wrong("has no count"))? as usize;
        let component = accessor["componentType"].as_u64().unwrap_or(0);
        let size = match component {
            5121 => 1,
            5123 => 2,
            5125 | FLOAT => 4,
            _ => return Err(wrong("holds numbers of a type that is not known")),
        };
        let view = accessor["bufferView"].as_u64().ok_or_else(|| wrong("has no data"))? as usize;
        let view = &self.root["bufferViews"][view];
        let buffer = self.buffers.get(whole(&view["buffer"])).ok_or_else(|| wrong("names no buffer"))?;
        let stride = view["byteStride"].as_u64().map_or(size * width, |s| s as usize);
        let start = whole(&view["byteOffset"]) + whole(&accessor["byteOffset"]);
        let mut numbers = Vec::new();
        for at in (0..count).flat_map(|k| (0..width).map(move |c| start + k * stride + c * size)) {
            let bytes = buffer.get(at..at + size).ok_or_else(|| wrong("reaches beyond its buffer: it is torn"))?;
            let mut four = [0; 4];
            four[..size].copy_from_slice(bytes);
            let bits = u32::from_le_bytes(four);
            numbers.push(if component == FLOAT { f64::from(f32::from_bits(bits)) } else { f64::from(bits) });
        }
        Ok(numbers)
    }
}

/// The transform of a node into its parent's frame.
fn local(node: &Value) -> DMat4 {
    let numbers = |name: &str| -> Option<Vec<f64>> { node[name].as_array()?.iter().map(Value::as_f64).collect() };
    if let Some(matrix) = numbers("matrix").and_then(|m| m.try_into().ok()) {
        return DMat4::from_cols_array(&matrix);
    }
    let three = |name: &str, default: DVec3| {
        numbers(name).and_then(|v| <[f64; 3]>::try_from(v).ok()).map_or(default, DVec3::from)
    };
    let rotation = numbers("rotation").and_then(|q| <[f64; 4]>::try_from(q).ok());
    let rotation = rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q).normalize());
    DMat4::from_scale_rotation_translation(three("scale", DVec3::ONE), rotation, three("translation", DVec3::ZERO))
}
