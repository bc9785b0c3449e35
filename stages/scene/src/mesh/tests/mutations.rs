//! Files with bits turned, bytes moved and numbers replaced: an error or a mesh, at once.

use std::time::{Duration, Instant};

use super::super::*;
use super::hostile_gltf::sparse;
use super::{STRAIGHT, cube, files, join};

/// Of each file; `TURBID_MUTATIONS` in the environment says more.
const EACH: u64 = 150;

/// Numbers that break counts, sizes and coordinates.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "2147483648",
    "4294967295",
    "4294967296",
    "1099511627776",
    "9223372036854775808",
    "18446744073709551612",
    "nan",
    "1e308",
    "-1e308",
    "1e-320",
    "5e999",
];

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n.max(1) as u64) as usize
    }

    fn range(&mut self, n: usize) -> std::ops::Range<usize> {
        let (a, b) = (self.below(n + 1), self.below(n + 1));
        a.min(b)..a.max(b)
    }
}

fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    let n = bytes.len();
    match random.below(8) {
        0 | 1 => {
            for _ in 0..=random.below(4) {
                let at = random.below(n);
                bytes[at] ^= 1 << random.below(8);
            }
        }
        2 => bytes.truncate(random.below(n)),
        3 => drop(bytes.drain(random.range(n))),
        4 => {
            // A block doubled, there or elsewhere, several times.
            let block = bytes[random.range(n)].repeat(1 + random.below(3));
            let at = random.below(n + 1);
            bytes.splice(at..at, block);
        }
        5 => {
            let at = random.below(n.saturating_sub(8));
            let value = [0, 1, 0xff, 0x7f, 0x80][random.below(5)];
            let size = [1, 2, 4, 8][random.below(4)];
            bytes[at..].iter_mut().take(size).for_each(|b| *b = value);
        }
        _ => {
            // A number of a text becomes another.
            let starts: Vec<usize> = (0..n)
                .filter(|&i| bytes[i].is_ascii_digit() && (i == 0 || !bytes[i - 1].is_ascii_alphanumeric()))
                .collect();
            let Some(&start) = starts.get(random.below(starts.len())) else { return };
            let length = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
            bytes.splice(start..start + length, NUMBERS[random.below(NUMBERS.len())].bytes());
        }
    }
}

/// Beside the tetrahedron in every format: a cube with a cavity, and a sparse accessor.
fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mesh = join(&cube(-1.0, 4.0), &cube(0.0, 1.0), true);
    let mut stl = vec![0; 80];
    stl.extend((mesh.triangles.len() as u32).to_le_bytes());
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uint uint vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    ply.extend(mesh.vertices.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let mut obj: String = mesh.vertices.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    for t in &mesh.triangles {
        stl.extend([0; 12]);
        stl.extend(t.iter().flat_map(|&i| mesh.vertices[i as usize]).flat_map(|x| (x as f32).to_le_bytes()));
        stl.extend([0; 2]);
        ply.extend([3, t[0], t[1], t[2]].iter().flat_map(|i| i.to_le_bytes()));
        let [a, b, c] = t.map(|i| i + 1);
        obj += &format!("f {a}/1/1 {b} {}\n", i64::from(c) - 17);
    }
    let mut seeds = files().to_vec();
    seeds.extend([
        ("STL, cavity", stl),
        ("PLY, cavity", ply),
        ("OBJ, cavity", obj.into_bytes()),
        ("glTF, sparse", sparse(72)),
    ]);
    seeds
}

/// Never a panic, never a second, never more triangles than the bytes hold; what passes the reader is checked as well.
#[test]
fn mutated_files_are_errors_or_meshes() {
    let each = std::env::var("TURBID_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(EACH);
    for (name, seed) in seeds() {
        assert!(check(&place(&read(&seed).unwrap(), &STRAIGHT)).is_empty(), "{name}");
        let (mut read_well, mut solids, mut slowest) = (0, 0, Duration::ZERO);
        for i in 0..each {
            let mut random = Random(i);
            let mut bytes = seed.clone();
            for _ in 0..=random.below(3) {
                if !bytes.is_empty() {
                    mutate(&mut bytes, &mut random);
                }
            }
            let begun = Instant::now();
            if let Ok(soup) = read(&bytes) {
                read_well += 1;
                assert!(soup.triangles.len() <= bytes.len() + 1_000_000, "{name} {i}: {}", soup.triangles.len());
                assert!(soup.triangles.iter().flatten().all(|&v| (v as usize) < soup.vertices.len()), "{name} {i}");
                solids += u64::from(check(&place(&soup, &STRAIGHT)).is_empty());
            }
            slowest = slowest.max(begun.elapsed());
            assert!(begun.elapsed().as_secs() < 60, "{name} {i}: {:?}", begun.elapsed());
        }
        println!("{name}: {each} mutations, {read_well} read, {solids} solids, at most {slowest:?}");
    }
}
