//! Meshes of objects: STL, OBJ, PLY, glTF.

use serde_json::json;

use super::stage::FileOf;
use super::{Reader, Seen, nothing};
use crate::mutate::Form;

/// A tetrahedron, its faces seen from outside.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, 0.25]];
const FACES: [[u16; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn mesh() -> FileOf {
    let params = json!({
        "media": {"m": {"mu_a": 0.05, "mu_s_prime": 1, "g": 0.8, "n": 1.0}},
        "objects": {"s": {"mesh": {"file": "mesh", "position": [0, 0, -50]}, "medium": "m"}},
        "camera": {"position": [0, 0, 500], "look_at": [0, 0, 0], "field": [8, 8], "pixels": [4, 4]},
        "projector": {"position": [35, 0, 500], "look_at": [0, 0, 0], "field": [32, 32], "power": 5},
    });
    FileOf { stage: "scene", at: "objects.s.mesh.file", params }
}

fn read(input: &[u8]) -> Result<Seen, String> {
    Ok(Seen::as_large(mesh().check(input), input))
}

fn law(input: &[u8]) -> Result<(), String> {
    mesh().run(input)
}

pub fn readers() -> Vec<Reader> {
    let reader = |name, form, seeds| Reader { name, form, share: 2, claims: nothing, seeds, read, law };
    vec![
        reader("stl", Form::Binary, stl_binary),
        reader("stl_text", Form::Text, || vec![stl_text(1), stl_text(3)]),
        reader("obj", Form::Text, obj),
        reader("ply_text", Form::Text, || vec![ply_text(false), ply_text(true)]),
        reader("ply", Form::Binary, || vec![ply_binary(false), ply_binary(true)]),
        reader("gltf", Form::Text, gltf),
        reader("glb", Form::Binary, glb),
    ]
}

fn stl_binary() -> Vec<Vec<u8>> {
    let of = |parts: u32| {
        let mut bytes = vec![0; 80];
        bytes.extend((4 * parts).to_le_bytes());
        for part in 0..parts {
            for face in FACES {
                bytes.extend([0; 12]);
                let corners = face.map(|i| CORNERS[usize::from(i)]);
                bytes.extend(
                    corners.iter().flat_map(|c| [c[0] + 4.0 * part as f32, c[1], c[2]]).flat_map(f32::to_le_bytes),
                );
                bytes.extend([0; 2]);
            }
        }
        bytes
    };
    vec![of(1), of(20), include_bytes!("../../../pipelines/checks/icosphere.stl").to_vec()]
}

fn stl_text(parts: usize) -> Vec<u8> {
    let mut text = "solid s\n".to_owned();
    for part in 0..parts {
        for face in FACES {
            text += "facet normal 0 0 0\n outer loop\n";
            for [x, y, z] in face.map(|i| CORNERS[usize::from(i)]) {
                text += &format!("  vertex {} {y} {z:e}\n", x + 4.0 * part as f32);
            }
            text += " endloop\nendfacet\n";
        }
    }
    (text + "endsolid s\n").into_bytes()
}

fn obj() -> Vec<Vec<u8>> {
    let mut text = "# a tetrahedron\no s\n".to_owned();
    CORNERS.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    let face = |f: [u16; 3], slash: &str| format!("f {}\n", f.map(|i| format!("{}{slash}", i + 1)).join(" "));
    let plain: String = FACES.iter().map(|&f| face(f, "")).collect();
    let rich: String = FACES.iter().map(|&f| face(f, "//1")).collect();
    let back = "f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n";
    [plain, format!("vn 0 0 1\n{rich}"), back.to_owned()].map(|faces| format!("{text}{faces}").into_bytes()).to_vec()
}

fn ply_head(format: &str, more: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment none\n{more}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn ply_text(more: bool) -> Vec<u8> {
    let mut text = ply_head("ascii", if more { "element odd 2\nproperty list uchar short s\n" } else { "" });
    if more {
        text += "2 5 6\n0\n";
    }
    CORNERS.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    FACES.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text.into_bytes()
}

fn ply_binary(big: bool) -> Vec<u8> {
    let mut bytes = ply_head(if big { "binary_big_endian" } else { "binary_little_endian" }, "").into_bytes();
    let four = |bits: u32| if big { bits.to_be_bytes() } else { bits.to_le_bytes() };
    bytes.extend(CORNERS.iter().flatten().flat_map(|x| four(x.to_bits())));
    for face in FACES {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|&i| four(u32::from(i))));
    }
    bytes
}

/// Corners (48 bytes), then faces (24 bytes).
fn gltf_buffer() -> Vec<u8> {
    let corners = CORNERS.iter().flatten().flat_map(|x| x.to_le_bytes());
    corners.chain(FACES.iter().flatten().flat_map(|i| i.to_le_bytes())).collect()
}

fn gltf_json(nodes: &str, buffer: &str) -> String {
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":{nodes},\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1,\"mode\":4}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"byteOffset\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}},\
         {{\"bufferView\":1,\"componentType\":5123,\"count\":12,\"type\":\"SCALAR\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteOffset\":0,\"byteLength\":48,\"byteStride\":12}},\
         {{\"buffer\":0,\"byteOffset\":48,\"byteLength\":24}}],\"buffers\":[{{\"byteLength\":72{buffer}}}]}}"
    )
}

const ONE_NODE: &str = "[{\"mesh\":0}]";
const TREE: &str = "[{\"children\":[1,2]},{\"mesh\":0,\"translation\":[9,0,0],\"rotation\":[0,0,0,1],\"scale\":[1,2,1]},\
                    {\"children\":[3]},{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,-9,0,0,1]}]";

fn gltf() -> Vec<Vec<u8>> {
    let uri = format!(",\"uri\":\"data:application/octet-stream;base64,{}\"", base64(&gltf_buffer()));
    [ONE_NODE, TREE].map(|nodes| gltf_json(nodes, &uri).into_bytes()).to_vec()
}

fn glb() -> Vec<Vec<u8>> {
    let of = |nodes: &str| {
        let mut json = gltf_json(nodes, "").into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let buffer = gltf_buffer();
        let total = 12 + 8 + json.len() + 8 + buffer.len();
        let number = |n: usize| (n as u32).to_le_bytes();
        let head = [&b"glTF"[..], &number(2), &number(total), &number(json.len()), b"JSON"].concat();
        [head, json, number(buffer.len()).to_vec(), b"BIN\0".to_vec(), buffer].concat()
    };
    vec![of(ONE_NODE), of(TREE)]
}

/// Base64 (RFC 4648, section 4) of bytes whose number is a multiple of 3.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let three = |b: &[u8; 3]| u32::from(b[0]) << 16 | u32::from(b[1]) << 8 | u32::from(b[2]);
    let digits = bytes.as_chunks::<3>().0.iter().map(three);
    digits.flat_map(|n| [18, 12, 6, 0].map(|shift| char::from(DIGITS[(n >> shift & 63) as usize]))).collect()
}
