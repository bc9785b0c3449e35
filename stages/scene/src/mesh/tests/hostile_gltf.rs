//! glTF files that ask for what they do not hold.

use turbid_contract::serde_json::{self, Value, json};

use super::super::*;
use super::{FACES, STRAIGHT, gltf_text, stl_text};

/// The tetrahedron, with entries replaced by their JSON pointers.
fn with(changes: &[(&str, Value)]) -> Vec<u8> {
    let mut file: Value = serde_json::from_slice(&gltf_text()).unwrap();
    for (pointer, value) in changes {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match (file.pointer_mut(parent).unwrap(), key.parse::<usize>()) {
            (Value::Array(list), Ok(i)) => list[i] = value.clone(),
            (parent, _) => parent[key] = value.clone(),
        }
    }
    file.to_string().into_bytes()
}

fn refused(changes: &[(&str, Value)], words: &str) {
    let error = read(&with(changes)).map(|soup| soup.triangles.len()).expect_err(words);
    assert!(error.contains(words), "{error}\nlacks\n{words}");
}

/// What the format forbids, and what reaches beyond the bytes that are there, is said before memory is taken for it.
#[test]
fn what_a_gltf_does_not_hold_is_refused() {
    let doubled = |depth: u32, end: Value| {
        let nodes = (0..depth).map(|i| json!({"children": [i + 1, i + 1]})).chain([end]);
        nodes.collect::<Value>()
    };
    refused(&[("/nodes", doubled(60, json!({})))], "node 1 stands twice among the children of node 0");
    refused(&[("/nodes", doubled(25, json!({"mesh": 0})))], "node 1 stands twice among the children of node 0");
    let diamond = json!([{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}]);
    refused(&[("/nodes", diamond)], "node 3 is a child of node 1 and of node 2: it must have one parent");
    let circle = json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}]);
    refused(&[("/nodes", circle)], "node 1, a child of node 2, is below itself");
    refused(&[("/nodes", json!([{"children": [0]}]))], "node 0, a child of node 0, is below itself");
    refused(&[("/nodes", json!([{"children": [7]}]))], "node 0 has the child 7, but there are only 1 nodes");
    refused(
        &[("/nodes", json!([{"children": [-1]}]))],
        "nodes[0].children[0]: invalid type: integer `-1`, expected a whole number >= 0",
    );
    refused(&[("/scenes", json!([{"nodes": [1]}]))], "scene 0 names node 1, which is a child of node 0");
    refused(&[("/scenes", json!([{"nodes": [0, 0]}]))], "scene 0 names node 0 twice");
    refused(&[("/scenes", json!([{"nodes": [9]}]))], "scene 0 names node 9, but there are only 2");
    refused(&[("/scene", json!(3))], "it has no scene 3");
    refused(&[("/nodes", json!([{"mesh": 5}]))], "node 0: it names mesh 5, but there are only 1");
    refused(&[("/nodes", json!([{"mesh": 0, "matrix": [1, 0]}]))], "nodes[0].matrix: invalid length 2");

    let view = |key: &str, value: Value| (format!("/bufferViews/0/{key}"), value);
    let huge = json!(u64::MAX - 3);
    for (key, value, words) in [
        ("byteStride", json!(0), "accessor 0: bufferView 0: byteStride 0 must be >= the 12 bytes of an element"),
        ("byteStride", json!(8), "byteStride 8 must be >= the 12 bytes"),
        ("byteStride", json!(u64::MAX), "4 elements of 12 bytes"),
        ("byteStride", json!(13), "reach beyond the 48 bytes of bufferView 0: it is torn"),
        (
            "byteOffset",
            huge.clone(),
            "its 48 bytes from byte 18446744073709551612 on reach beyond the 72 bytes of buffer 0",
        ),
        ("byteOffset", json!(25), "its 48 bytes from byte 25 on reach beyond"),
        ("byteLength", huge.clone(), "reach beyond the 72 bytes of buffer 0"),
        ("buffer", json!(1), "it names buffer 1, but there are only 1"),
    ] {
        let (pointer, value) = view(key, value);
        refused(&[(&pointer, value)], words);
    }
    for (key, value, words) in [
        ("count", json!(1_u64 << 40), "1099511627776 elements of 12 bytes"),
        ("count", json!(u64::MAX), "18446744073709551615 elements"),
        ("count", json!(0), "count is 0: it must be >= 1"),
        ("byteOffset", huge, "reach beyond the 48 bytes of bufferView 0"),
        ("componentType", json!(5130), "componentType 5130 is not known"),
        ("normalized", json!(true), "its numbers are normalized"),
        ("type", json!("VEC4"), "its type is not VEC3"),
        ("bufferView", json!(2), "bufferView 2: it is named, but there are only 2"),
    ] {
        refused(&[(&format!("/accessors/0/{key}"), value)], words);
    }
    // Zeros of no bytes count as copies.
    let zeros = json!({"componentType": 5126, "type": "VEC3", "count": 1_u64 << 40, "sparse": {"count": 1,
        "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}});
    refused(&[("/accessors/0", zeros)], "1099511627776 vertices");
    refused(&[("/buffers/0/byteLength", json!(73))], "buffer 0: byteLength is 73, but it holds 72 bytes: it is torn");
    refused(&[("/accessors/1/count", json!(11))], "11 corners are no whole number of triangles");
    refused(&[("/accessors/1/bufferView", json!(0))], "triangle 2 names the vertex 16384, but there are only 4");
}

/// A thousand nodes with a mesh of a thousand and one triangles are more copies than are made; one less is not.
#[test]
fn copies_are_counted() {
    let nodes = |n: u32| {
        let all = (0..n).map(|_| json!({"mesh": 0})).collect::<Value>();
        let roots = (0..n).collect::<Value>();
        [("/nodes", all), ("/scenes", json!([{"nodes": roots}]))]
    };
    assert_eq!(read(&with(&nodes(2000))).unwrap().triangles.len(), 8000);
    let primitives: Value = (0..250).map(|_| json!({"attributes": {"POSITION": 0}, "indices": 1})).collect();
    let mut changes = nodes(1001).to_vec();
    changes.push(("/meshes/0/primitives", primitives));
    refused(&changes, "copies of them may make 1000000 more; use fewer instances");
}

/// A chain of nodes as deep as the file is long, and no deeper than the stack.
#[test]
fn deep_chains_are_walked() {
    let n = 100_000;
    let nodes = (0..n).map(|i| json!({"children": [i + 1]})).chain([json!({"mesh": 0})]).collect::<Value>();
    let soup = read(&with(&[("/nodes", nodes)])).unwrap();
    assert_eq!(soup.triangles, FACES);
    // JSON in JSON, where a number should be and where nobody looks.
    let nested = |pointer: &str| format!(r#"{{"{pointer}": {}{}}}"#, "[".repeat(n), "]".repeat(n));
    assert!(read(nested("nodes").as_bytes()).is_err());
    assert!(read(nested("extras").as_bytes()).unwrap_err().contains("scene"));
    let long = format!(r#"{{"nodes": [{}{{}}]}}"#, "{},".repeat(200_000));
    assert!(read(long.as_bytes()).unwrap_err().contains("nodes: a list of more than 131072 entries"));
}

/// The tetrahedron, two of whose vertices are wrong in the buffer and right in a list with its indices from a byte on.
pub fn sparse(indices: u32) -> Vec<u8> {
    use base64::Engine;
    let file: Value = serde_json::from_slice(&gltf_text()).unwrap();
    let uri = file["buffers"][0]["uri"].as_str().unwrap();
    let engine = base64::engine::general_purpose::STANDARD;
    let mut data = engine.decode(uri.split_once("base64,").unwrap().1).unwrap();
    // Vertices 1 and 3 are wrong in the view, and right in the list.
    let right: Vec<u8> = data[12..24].iter().chain(&data[36..48]).copied().collect();
    data[12..24].fill(7);
    data[36..48].fill(7);
    data.extend([1, 3]);
    data.extend(right);
    let views = json!([{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        {"buffer": 0, "byteOffset": indices, "byteLength": 2}, {"buffer": 0, "byteOffset": 74, "byteLength": 24}]);
    let listed = json!({"count": 2, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}});
    let uri = format!("data:application/octet-stream;base64,{}", engine.encode(&data));
    let buffers = json!([{"byteLength": data.len(), "uri": uri}]);
    with(&[("/bufferViews", views), ("/accessors/0/sparse", listed), ("/buffers", buffers)])
}

/// Elements that a sparse accessor lists replace those of its view.
#[test]
fn sparse_elements_replace_others() {
    assert_eq!(place(&read(&sparse(72)).unwrap(), &STRAIGHT), place(&read(&stl_text()).unwrap(), &STRAIGHT));
    let error = read(&sparse(0)).unwrap_err();
    assert!(error.contains("accessor 0: sparse index 1 is 0: they must ascend and be below 4"), "{error}");
}
