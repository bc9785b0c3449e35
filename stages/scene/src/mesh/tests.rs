use glam::DVec3;
use turbid_contract::payload::Mesh;

use super::*;

mod hostile_gltf;
mod hostile_text;
mod many_parts;
mod mutations;

const STRAIGHT: Placing = Placing { scale: 1.0, rotation_deg: [0.0; 3], position: [0.0; 3] };

/// A tetrahedron with right angles at the origin, its coordinates exact in f32.
const VERTICES: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, 0.25]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn stl_text() -> Vec<u8> {
    let facet = |t: &[u32; 3]| {
        let vertex = |&i: &u32| {
            let [x, y, z] = VERTICES[i as usize];
            format!("      vertex {x:e} {y} {z}\n")
        };
        format!(
            "  facet normal 0 0 0\n    outer loop\n{}    endloop\n  endfacet\n",
            t.iter().map(vertex).collect::<String>()
        )
    };
    format!("solid corner\n{}endsolid corner\n", FACES.iter().map(facet).collect::<String>()).into_bytes()
}

fn stl_binary() -> Vec<u8> {
    // A head that says `solid`, as some programs write.
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, 0);
    bytes.extend(4_u32.to_le_bytes());
    for t in FACES {
        bytes.extend([0; 12]);
        bytes.extend(t.iter().flat_map(|&i| VERTICES[i as usize]).flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply(order: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {order} 1.0\ncomment a corner\nelement vertex 4\nproperty double x\nproperty float y\nproperty uchar red\n\
         property float z\nelement face 4\nproperty list uchar int vertex_indices\nelement edge 1\nproperty list short ushort ends\nend_header\n"
    )
    .into_bytes();
    let mut put = |text: String, mut number: Vec<u8>| {
        if order == "ascii" {
            bytes.extend(text.bytes().chain(*b" "));
        } else {
            if order == "binary_big_endian" {
                number.reverse();
            }
            bytes.extend(number);
        }
    };
    for [x, y, z] in VERTICES {
        put(x.to_string(), x.to_le_bytes().to_vec());
        put(y.to_string(), (y as f32).to_le_bytes().to_vec());
        put("7".to_owned(), vec![7]);
        put(z.to_string(), (z as f32).to_le_bytes().to_vec());
    }
    for t in FACES {
        put("3".to_owned(), vec![3]);
        for i in t {
            put(i.to_string(), (i as i32).to_le_bytes().to_vec());
        }
    }
    put("1".to_owned(), 1_i16.to_le_bytes().to_vec());
    put("3".to_owned(), 3_u16.to_le_bytes().to_vec());
    bytes
}

fn obj() -> Vec<u8> {
    let vertices: String = VERTICES.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    // Every way to name a corner.
    format!(
        "# a corner\no corner\n{vertices}vn 0 0 1\nf 1//1 3//1 2//1\nf -4 -3 -1\nf 1/1 4/1 3/1\nf 2/1/1 3/1/1 4/1/1\n"
    )
    .into_bytes()
}

/// Positions (f32), then indices (u16); the node below a node moves it by (1, 0, 0) and back, scales it by 2 and a half.
fn gltf_parts() -> (String, Vec<u8>) {
    let mut data: Vec<u8> = VERTICES.iter().flatten().flat_map(|&x| (x as f32).to_le_bytes()).collect();
    data.extend(FACES.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()));
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
        "nodes": [{{"children": [1], "translation": [1, 0, 0], "scale": [2, 2, 2]}}, {{"mesh": 0, "matrix": [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, -0.5, 0, 0, 1]}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}}, {{"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteOffset": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 24}}],
        "buffers": [{{"byteLength": {}URI}}]}}"#,
        data.len()
    );
    (json, data)
}

fn gltf_text() -> Vec<u8> {
    use base64::Engine;
    let (json, data) = gltf_parts();
    let uri = base64::engine::general_purpose::STANDARD.encode(data);
    json.replace("URI", &format!(r#", "uri": "data:application/octet-stream;base64,{uri}""#)).into_bytes()
}

fn gltf_binary() -> Vec<u8> {
    let (json, data) = gltf_parts();
    let mut json = json.replace("URI", "").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, part) in [(b"JSON", json), (b"BIN\0", data)] {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(part);
    }
    bytes
}

fn files() -> [(&'static str, Vec<u8>); 8] {
    [
        ("STL, text", stl_text()),
        ("STL, binary", stl_binary()),
        ("PLY, text", ply("ascii")),
        ("PLY, little-endian", ply("binary_little_endian")),
        ("PLY, big-endian", ply("binary_big_endian")),
        ("OBJ", obj()),
        ("glTF, text", gltf_text()),
        ("glTF, binary", gltf_binary()),
    ]
}

#[test]
fn all_formats_read_the_same_mesh() {
    let expected = place(&read(&stl_text()).unwrap(), &STRAIGHT);
    assert_eq!((expected.vertices.len(), expected.triangles.len()), (4, 4));
    assert_eq!(check(&expected), []);
    for (name, bytes) in files() {
        let soup = read(&bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(place(&soup, &STRAIGHT), expected, "{name}");
    }
    let placing = Placing { scale: 4.0, rotation_deg: [0.0, 0.0, 90.0], position: [10.0, 0.0, -1.0] };
    let moved = place(&read(&obj()).unwrap(), &placing);
    let far =
        moved.vertices.iter().map(|&v| DVec3::from(v).distance(DVec3::new(10.0, 8.0, -1.0))).fold(f64::MAX, f64::min);
    assert!(far < 1e-14, "(2, 0, 0) becomes (0, 8, 0) and is moved: {moved:?}");
}

/// Whatever is cut off or flipped: an error or a mesh, never a panic, never a wrong index.
#[test]
fn torn_files_are_errors() {
    for (name, bytes) in files() {
        for length in 0..bytes.len() {
            if let Ok(soup) = read(&bytes[..length]) {
                assert!(
                    soup.triangles.iter().flatten().all(|&i| (i as usize) < soup.vertices.len()),
                    "{name} {length}"
                );
            }
            let mut flipped = bytes.clone();
            flipped[length] ^= 1 << (length % 8);
            let _ = read(&flipped);
        }
        let half = read(&bytes[..bytes.len() / 2]);
        assert!(half.is_err() || half.unwrap().triangles.len() < 4, "{name}");
    }
    for (bytes, words) in [
        (&b"hello"[..], "neither STL"),
        (b"\xff\xfe\x00", "neither STL"),
        (b"v 0 0 0\nf 1 2 3\n", "line 2: a face names the vertex 3, but there are only 1"),
        (b"v 0 0 zero\n", "line 1: `zero`"),
        (b"v 0 0 0\nf 1 1\n", "2 vertices"),
        (b"v 0 0 0\nf 0 1 1\n", "`0` names no vertex"),
        (b"ply\nformat ascii 2\nelement vertex 1\nproperty float x\nend_header\n0\n", "no `y`"),
        (b"v 1e999 0 0\nf 1 1 1\n", "line 1: `1e999` is not a finite place (x)"),
        (br#"{"scenes": [{"nodes": [0]}], "buffers": [{"uri": "other.bin"}]}"#, "another file"),
    ] {
        let error = read(bytes).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

/// A unit cube from `low`, twelve triangles with their normals outwards.
fn cube(low: f64, side: f64) -> Mesh {
    let vertices = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|bit| low + side * f64::from(bit))).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { vertices, triangles }
}

fn join(a: &Mesh, b: &Mesh, flip: bool) -> Mesh {
    let n = a.vertices.len() as u32;
    let other = b.triangles.iter().map(|&[x, y, z]| if flip { [x, z, y] } else { [x, y, z] }.map(|i| n + i));
    Mesh {
        vertices: a.vertices.iter().chain(&b.vertices).copied().collect(),
        triangles: a.triangles.iter().copied().chain(other).collect(),
    }
}

fn flipped(mesh: &Mesh) -> Mesh {
    let triangles = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    Mesh { triangles, ..mesh.clone() }
}

#[test]
fn what_is_no_solid_is_said() {
    let good = cube(0.0, 1.0);
    for solid in [&good, &join(&good, &cube(5.0, 2.0), false), &join(&cube(-1.0, 4.0), &good, true)] {
        assert_eq!(check(solid), []);
    }
    // A rod through the cube's top whose end lies inside.
    let rod = {
        let mut rod = cube(0.3, 0.4);
        rod.vertices.iter_mut().for_each(|v| v[2] += 0.5);
        rod
    };
    let broken: [(&str, Mesh, &[&str]); 10] = [
        ("empty", Mesh { triangles: vec![], ..good.clone() }, &["no triangle"]),
        ("hole", Mesh { triangles: good.triangles[1..].to_vec(), ..good.clone() }, &["3 edges", "holes", "(0."]),
        (
            "turned",
            {
                let mut m = good.clone();
                m.triangles[3].swap(0, 1);
                m
            },
            &["3 edges", "different sides"],
        ),
        (
            "crowded",
            {
                let mut m = good.clone();
                m.triangles.push(m.triangles[0]);
                m
            },
            &["3 edges", "more than two"],
        ),
        (
            "flat",
            {
                let mut m = good.clone();
                m.vertices[7] = m.vertices[6];
                m
            },
            &["2 triangles without area", "(0.0000, 0.0000, 1.0000)"],
        ),
        ("inward", flipped(&good), &["inwards", "-1.0"]),
        ("crossing", join(&good, &rod, false), &["pairs of triangles run through each other", "1.0000) mm"]),
        ("doubled", join(&good, &cube(0.25, 0.5), false), &["inside another part"]),
        ("cavity outside", join(&good, &cube(5.0, 1.0), true), &["inwards"]),
        (
            "sheet",
            {
                let mut m = good.clone();
                m.vertices.iter_mut().for_each(|v| v[2] *= 1e-12);
                m
            },
            &["without area"],
        ),
    ];
    for (name, mesh, words) in broken {
        let found = check(&mesh);
        assert!(!found.is_empty(), "{name} passes");
        let text = found.iter().map(|f| format!("{} {}\n", f.0, f.1)).collect::<String>();
        assert!(words.iter().all(|w| text.contains(w)), "{name}: {text} lacks one of {words:?}");
    }
}
