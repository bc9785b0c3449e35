//! PLY, OBJ and STL files that ask for what they do not hold.

use std::time::Instant;

use super::super::*;
use super::{STRAIGHT, ply, stl_binary};

fn refused(bytes: &[u8], words: &str) {
    let begun = Instant::now();
    let error = read(bytes).map(|soup| soup.triangles.len()).expect_err(words);
    assert!(error.contains(words), "{error}\nlacks\n{words}");
    assert!(begun.elapsed().as_secs() < 60, "{words}: {:?}", begun.elapsed());
}

#[test]
fn what_a_ply_does_not_hold_is_refused() {
    let ply = |format: &str, elements: &str, body: &[u8]| {
        let head = format!("ply\nformat {format} 1.0\n{elements}end_header\n");
        [head.as_bytes(), body].concat()
    };
    let nothing = "element nothing 4294967295\n".repeat(200);
    let vertex = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    refused(&ply("ascii", &nothing, b""), "element nothing: 4294967295 rows without a property");
    for (format, least) in [("ascii", 6), ("binary_little_endian", 12)] {
        let many = vertex.replace('3', "4294967295");
        refused(&ply(format, &many, b"0 0 0\n"), &format!("4294967295 rows of at least {least} bytes each, but"));
        let lists = "element strip 4000000000\nproperty list uchar int vertex_indices\n";
        refused(&ply(format, lists, b"0 0 0 0\n"), "element strip: 4000000000 rows of at least");
    }
    let face = format!("{vertex}element face 1\nproperty list uint int vertex_indices\n");
    refused(
        &ply("ascii", &face, b"0 0 0 1 0 0 0 1 0\n4000000000 0 1 2\n"),
        "face 0: a list of 4000000000 numbers, but",
    );
    refused(&ply("ascii", &face, b"0 0 0 1 0 0 0 1 0\n-1 0 1 2\n"), "face 0: a list of -1 numbers");
    refused(&ply("ascii", &face, b"0 0 0 1 0 0 0 1 0\n3 0 1 3\n"), "face 0 names the vertex 3, but there are only 3");
    refused(&ply("ascii", &face, b"0 0 0 1 0 0 0 1 0\n3 0 1 -2\n"), "face 0: -2 is neither a vertex");
    refused(&ply("ascii", &face, b"0 0 0 1 nan 0 0 1 0\n3 0 1 2\n"), "vertex 1: y is NaN, not a finite place");
    let skipped = format!("{vertex}element edge 2\nproperty list uint double ends\n");
    let body = [vec![0; 36], 1_u32.to_le_bytes().to_vec(), vec![0; 8], u32::MAX.to_le_bytes().to_vec()].concat();
    refused(
        &ply("binary_little_endian", &skipped, &body),
        "edge 1: a list of 4294967295 numbers, but 0 bytes are left",
    );
    refused(&ply("ascii", &vertex.repeat(2), b""), "line 7: this element stands twice");
    refused(&ply("ascii", &"element a 0\n".repeat(70_000), b""), "more than 65536 elements and properties");
    refused(&ply("ascii", "element vertex -3\n", b""), "line 3: -3 is neither a vertex nor a number of them");
}

/// Comments are in whatever encoding their writers use, and as long as they like.
#[test]
fn comments_of_a_ply_are_not_read() {
    let plain = ply("ascii");
    let comment = [&b"\ncomment Gr\xf6\xdfe "[..], &vec![b'x'; 1 << 20], b"\n"].concat();
    let at = plain.windows(9).position(|w| w == b"\ncomment ").unwrap();
    let said = [&plain[..at], &comment, &plain[at + 1..]].concat();
    assert_eq!(read(&said).unwrap(), read(&plain).unwrap());
}

#[test]
fn what_an_obj_or_stl_does_not_hold_is_refused() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (face, words) in [
        ("f 1 2 4294967296", "line 4: a face names the vertex 4294967296, but there are only 3"),
        ("f 1 2 4294967297", "line 4: `4294967297` names no vertex"),
        ("f 1 2 -4", "line 4: `-4` names no vertex; 3 stand before it"),
        ("f 1 2 -9223372036854775808", "line 4: `-9223372036854775808` names no vertex"),
        ("f 1 2 99999999999999999999", "names no vertex"),
        ("v 0 0 \x1b[31m0", "`\\u{1b}[31m0` is no number (z)"),
    ] {
        refused(format!("{vertices}{face}\n").as_bytes(), words);
    }
    let word = "7".repeat(1 << 20);
    let error = read(format!("{vertices}f 1 2 {word}\n").as_bytes()).unwrap_err();
    assert!(error.len() < 200, "{} bytes", error.len());
    let mut stl = stl_binary();
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    stl[..5].copy_from_slice(b"other");
    refused(&stl, "it says 4294967295 triangles, but its 284 bytes hold 4: it is torn");
    let mut stl = stl_binary();
    stl[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    refused(&stl, "triangle 1 (from 0): its corner [NaN, 0.0, 0.0] is not a finite place");
}

/// A polygon of a million corners is a fan of as many triangles; what it is not is a matter of seconds.
#[test]
fn large_polygons_are_read() {
    let n = 1_000_000;
    let corners: String = (0..n).map(|i| format!(" {}", i % 3 + 1)).collect();
    let soup = read(format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf{corners}\n").as_bytes()).unwrap();
    assert_eq!(soup.triangles.len(), n - 2);
}

/// Coordinates whose products are no numbers, or nothing, are said as what they are.
#[test]
fn extents_have_bounds() {
    for (coordinate, words) in [
        ("1e308", "a vertex lies at (1e308, 0e0, 0e0) mm: coordinates must be within 1e9 mm of 0"),
        ("-3e9", "(-3e9, 0e0, 0e0) mm"),
        ("1e-310", "it is 1e-310 mm across: it must be at least 1e-6 mm"),
    ] {
        let small = if coordinate == "1e-310" { "1e-320" } else { "1" };
        let text =
            format!("v 0 0 0\nv {coordinate} 0 0\nv 0 {small} 0\nv 0 0 {small}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
        let found = check(&place(&read(text.as_bytes()).unwrap(), &STRAIGHT));
        assert!(found.len() == 1 && found[0].0.contains(words), "{found:?}\nlacks\n{words}");
    }
    let overflow = Placing { scale: 1e300, ..STRAIGHT };
    let found = check(&place(&read(&stl_binary()).unwrap(), &overflow));
    assert!(found[0].0.contains("coordinates must be within"), "{found:?}");
}
