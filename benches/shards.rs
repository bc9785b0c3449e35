//! What writing a shard costs: `cargo bench --bench shards`.
//!
//! Samples as those of `examples/train/ssop64.yaml`, 64 x 64 pixels: a noisy frame, two exact maps, four noisy ones, two masks. MB of values (4 bytes
//! each, 2 of float16) per CPU second of all threads, the best of five rounds, and bytes of the file per byte of values. The digest that a folder keeps of
//! the file is part of it; putting the file on the disk is not.

use std::time::Duration;

use cpu_time::ProcessTime;
use serde_json::Value;
use turbid::dataset::feature::Values;
use turbid::dataset::folder::sha256;
use turbid::dataset::manifest::ColumnOf;
use turbid::dataset::shard::{self, Sample};
use turbid::dataset::webdataset;
use turbid_draw::Type;

const SIDE: usize = 64;
const ROWS: u64 = 512;
const DRAWN: usize = 12;

/// Noise of its own per pixel, about normal, standard deviation 1: the sum of four uniform numbers.
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        let mut sum = 0.0;
        for _ in 0..4 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5;
        }
        sum * 1.732
    }
}

fn tensors(index: u64) -> Vec<Values> {
    let mut noise = noise(index + 1);
    let (lesion, tissue) = (0.02 + 0.0001 * (index % 400) as f32, 0.8 + 0.001 * (index % 300) as f32);
    let inside = |pixel: usize| {
        let (x, y) = ((pixel % SIDE) as f32 - 30.0, (pixel / SIDE) as f32 - 34.0);
        x * x + y * y < 100.0 + (index % 200) as f32
    };
    let mut tensor = |of: &mut dyn FnMut(usize, f32) -> f32| {
        Values::Tensor((0..SIDE * SIDE).map(|pixel| of(pixel, noise())).collect())
    };
    let fringe = |pixel: usize| 1.0 + 0.4 * ((pixel % SIDE) as f32 * 0.628).cos();
    let map = |pixel: usize| if inside(pixel) { lesion } else { 0.01 };
    let mut all = vec![
        tensor(&mut |pixel, noise| fringe(pixel) * (1.0 + 0.02 * noise)),
        tensor(&mut |pixel, _| map(pixel)),
        tensor(&mut |pixel, _| if inside(pixel) { tissue } else { 1.0 }),
    ];
    for spread in [0.05, 0.03, 0.04, 0.02] {
        all.push(tensor(&mut |pixel, noise| map(pixel) * (1.0 + spread * noise)));
    }
    for _ in 0..2 {
        all.push(tensor(&mut |_, noise| if noise > 2.5 { 13.0 } else { 0.0 }));
    }
    all
}

fn column(name: &str, dtype: &str, shape: Option<[usize; 3]>) -> ColumnOf {
    ColumnOf {
        name: name.to_owned(),
        dtype: dtype.to_owned(),
        shape,
        unit: "mm^-1".to_owned(),
        channels: vec!["mu_a".to_owned()],
        pixel_mm: Some([1.0, 1.0]),
        about: String::new(),
    }
}

fn main() {
    let samples: Vec<Sample> = (0..ROWS)
        .map(|index| Sample {
            index,
            group: None,
            draws: (0..DRAWN).map(|name| Value::from(index as f64 / (name + 3) as f64)).collect(),
            values: tensors(index),
        })
        .collect();
    let types = [Type::Float; DRAWN];
    for dtype in ["float32", "float16"] {
        let mut columns: Vec<ColumnOf> =
            [("id", "string"), ("draw", "int64"), ("group", "int64")].map(|(name, of)| column(name, of, None)).into();
        columns.extend((0..DRAWN).map(|name| column(&format!("drawn_{name}"), "float64", None)));
        let count = samples[0].values.len();
        columns.extend((0..count).map(|name| column(&format!("map_{name}"), dtype, Some([1, SIDE, SIDE]))));
        let payload = ROWS as usize * count * SIDE * SIDE * if dtype == "float16" { 2 } else { 4 };
        for (format, encode) in [("parquet", shard::encode as Encode), ("webdataset", webdataset::encode as Encode)] {
            let round = |_| {
                let began = ProcessTime::now();
                let (bytes, _) = encode(&columns, &types, &samples).expect("they fit their columns");
                let digest = sha256(&bytes);
                assert_eq!(digest.len(), 64);
                (began.elapsed(), bytes.len())
            };
            let (best, bytes) = (0..5).map(round).min().unwrap_or((Duration::ZERO, 0));
            let rate = payload as f64 / 1e6 / best.as_secs_f64();
            let share = bytes as f64 / payload as f64;
            println!(
                "{format}, {dtype}: {rate:.0} MB per CPU s; {share:.2} bytes a byte, {:.1} MB",
                bytes as f64 / 1e6
            );
        }
    }
}

type Encode = fn(&[ColumnOf], &[Type], &[Sample]) -> Result<(Vec<u8>, String), String>;
