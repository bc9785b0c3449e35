//! Half precision, and what is not known.

use arrow_array::Array;

use crate::shard;
use crate::space::{PIPELINE, Space};

/// The set without frames, whose radiances are too small for half precision.
fn without_frames(dtype: &str) -> String {
    let frames =
        "      frames: {from: frames.frames, f_x: 0.1, phase: 0}\n      ac: {from: maps.modulation.m_ac, f_x: 0.1}\n";
    assert!(PIPELINE.contains(frames));
    PIPELINE.replace(frames, "").replace("rows: 4", &format!("rows: 4, dtype: {dtype}"))
}

/// Maps keep eleven bits in both formats: each value is that of 32 bits, rounded; nothing is null that is known.
#[test]
fn halves_are_rounded_values() {
    let space = Space::with(&without_frames("float32"));
    space.build("single", &[]);
    space.write("p.yaml", without_frames("float16"));
    assert_eq!(space.build("half", &[])["ran"], 0, "samples are in the store");
    assert_eq!(space.build("tar", &["--format", "webdataset"])["ran"], 0);
    space.verify("half").ok();
    space.verify("tar").ok();
    let mut compared = 0;
    let files = space.shards("single").into_iter().zip(space.shards("half")).zip(space.shards("tar"));
    for (((single, ..), (half, ..)), (tar, _, rows)) in files.filter(|(_, (_, _, rows))| *rows > 0) {
        let (single, half) = (space.path("single").join(single), space.path("half").join(half));
        let (single, half) = (shard::parquet(&single), shard::parquet(&half));
        let samples = shard::webdataset(&space.path("tar").join(tar));
        for name in ["mu_a", "mask"] {
            let column = |batch: &arrow_array::RecordBatch| shard::leaf(batch.column_by_name(name).expect("a feature"));
            let (single, half) = (column(&single), column(&half));
            assert_eq!(single.len(), half.len());
            // Half of 2^-10 is what rounding to eleven bits costs at most.
            let near = |(a, b): (&f32, &f32)| (a - b).abs() <= a.abs() / 2048.0;
            assert!(single.iter().zip(&half).all(near), "{name}");
            let of_row = half.len() / rows as usize;
            for (row, sample) in samples.iter().enumerate() {
                let (about, bytes) = &sample.arrays[name];
                let wanted = &half[row * of_row..(row + 1) * of_row];
                assert!(about.contains("'<f2'") && bytes.len() == 2 * of_row, "{about}");
                let bits = |value: &f32| half_bits(*value);
                assert!(wanted.iter().flat_map(|value| bits(value).to_le_bytes()).eq(bytes.iter().copied()), "{name}");
                compared += of_row;
            }
        }
    }
    assert!(compared > 500, "{compared}");

    let space = Space::with(&PIPELINE.replace("rows: 4", "rows: 4, dtype: float16"));
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "set"]).fails(2);
    assert!(said.contains("`frames` holds") && said.contains("dtype: float32"), "{said}");
}

/// Bits of a number that half precision holds exactly and normally, or of 0.
fn half_bits(value: f32) -> u16 {
    let bits = value.to_bits();
    let sign = (bits >> 16) as u16 & 0x8000;
    if value == 0.0 { sign } else { sign | (((bits >> 13) & 0x3_ffff) - ((127 - 15) << 10)) as u16 & 0x7fff }
}

/// Without `by` no sample has a group: null in Parquet, null in JSON, and nothing to verify goes wrong.
#[test]
fn groups_that_there_are_not_are_null() {
    let space = Space::with(&PIPELINE.replace(", by: patient", ""));
    let built = space.build("set", &[]);
    space.build("tar", &["--format", "webdataset"]);
    let mut found = 0;
    for ((file, _, rows), (tar, ..)) in space.shards("set").into_iter().zip(space.shards("tar")) {
        let batch = shard::parquet(&space.path("set").join(file));
        assert_eq!(batch.column_by_name("group").expect("a column").null_count() as u64, rows);
        assert_eq!(batch.column_by_name("patient").expect("a column").null_count(), 0);
        let samples = shard::webdataset(&space.path("tar").join(tar));
        assert!(samples.iter().all(|sample| sample.json["group"].is_null() && sample.json["patient"].is_i64()));
        found += rows;
    }
    assert_eq!(built["samples"], found);
    space.verify("set").ok();
    space.verify("tar").ok();
}
