//! Stored artifacts: EXR and Parquet as the store wrote them, and as disks and others leave them.

use serde_json::json;
use turbid::store::{decode, encode};
use turbid_contract::ndarray::Array2;
use turbid_contract::{Artifact, ArtifactKind, Cells, ImageStack, LayerInfo, LayerKind, Record, Table};

use super::{Reader, Seen, no_more, nothing};
use crate::mutate::Form;

pub fn readers() -> Vec<Reader> {
    // What decodes needs no checksum to be right here: the store compares bytes with their digest before.
    let reader =
        |name, seeds, read| Reader { name, form: Form::Binary, share: 3, claims: nothing, seeds, read, law: no_more };
    vec![
        reader("images", || vec![images(1, 1), images(5, 7), images(40, 30)], |i| Ok(seen(ArtifactKind::Images, i))),
        reader("table", || vec![table(0), table(3), table(300)], |i| Ok(seen(ArtifactKind::Table, i))),
        reader("record", || vec![record(0), record(3)], |i| Ok(seen(ArtifactKind::Record, i))),
    ]
}

fn seen(kind: ArtifactKind, input: &[u8]) -> Seen {
    let decoded = decode(kind, input).ok().map(|artifact| size_of(&artifact));
    Seen { taken: decoded.is_some(), decoded: decoded.unwrap_or(input.len()) }
}

fn size_of(artifact: &Artifact) -> usize {
    match artifact {
        Artifact::Images(stack) => 4 * stack.rows() * stack.columns() * stack.layers.len(),
        Artifact::Table(table) => table.columns.iter().map(|c| cells(&c.cells)).sum(),
        Artifact::Record(record) => serde_json::to_vec(&record.fields).map_or(0, |json| json.len()),
    }
}

fn cells(cells: &Cells) -> usize {
    match cells {
        Cells::Text(texts) => texts.iter().map(|t| size_of_val(t) + t.len()).sum(),
        Cells::Bool(flags) => flags.len(),
        other => 16 * other.len(),
    }
}

fn images(rows: usize, columns: usize) -> Vec<u8> {
    let mut stack = ImageStack::new(rows, columns);
    let pixel = |scale: f32| Array2::from_shape_fn((rows, columns), |(r, c)| scale * (r * columns + c) as f32);
    stack.push(LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(0.1), pixel(0.1));
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), pixel(0.0));
    stack.attributes.insert("pixel_pitch_mm".to_owned(), json!([0.5, 0.5]));
    encode(&Artifact::Images(stack)).expect("every pixel is finite")
}

fn table(rows: usize) -> Vec<u8> {
    let mut table = Table::default();
    table.push("mu_a", "mm^-1", Cells::F64((0..rows).map(|i| i as f64 / 3.0).collect()));
    table.push("se", "mm^-1", Cells::MaybeF64((0..rows).map(|i| (i % 2 == 0).then_some(i as f64)).collect()));
    table.push("count", "1", Cells::I64((0..rows).map(|i| i as i64).collect()));
    table.push("good", "1", Cells::Bool((0..rows).map(|i| i % 3 == 0).collect()));
    table.push("name", "", Cells::Text((0..rows).map(|i| format!("Gewebe µ {i}")).collect()));
    encode(&Artifact::Table(table)).expect("every cell is finite")
}

fn record(fields: usize) -> Vec<u8> {
    let all = [("a number", json!(0.3)), ("text", json!("µ")), ("nested", json!({"b": [1.0, 2, {"c": "d"}]}))];
    let fields = all.into_iter().take(fields).map(|(name, value)| (name.to_owned(), value)).collect();
    encode(&Artifact::Record(Record { fields })).expect("every number is finite")
}
