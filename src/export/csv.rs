//! CSV: columns under their names, numbers in the shortest digits that give them back exactly.

use std::fmt::Write;

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::{Artifact, Cells, ImageStack, Record, Table};

/// Tables as they are, images in long form (one line per pixel), records as `field,value`. UTF-8, lines end in LF.
pub fn encode(artifact: &Artifact) -> Vec<u8> {
    match artifact {
        Artifact::Table(table) => encode_table(table),
        Artifact::Images(stack) => encode_images(stack),
        Artifact::Record(record) => encode_record(record),
    }
    .into_bytes()
}

fn encode_table(table: &Table) -> String {
    let names: Vec<String> = table.columns.iter().map(|c| quoted(&c.name)).collect();
    let mut out = names.join(",") + "\n";
    for row in 0..table.rows() {
        for (i, column) in table.columns.iter().enumerate() {
            if i > 0 {
                out.push(',');
            }
            match &column.cells {
                Cells::F64(v) => write!(out, "{:?}", v[row]),
                // Unknown is an empty field.
                Cells::MaybeF64(v) => v[row].map_or(Ok(()), |x| write!(out, "{x:?}")),
                Cells::I64(v) => write!(out, "{}", v[row]),
                Cells::Bool(v) => write!(out, "{}", v[row]),
                Cells::Text(v) => out.write_str(&quoted(&v[row])),
            }
            .expect("a string takes every text");
        }
        out.push('\n');
    }
    out
}

fn encode_images(stack: &ImageStack) -> String {
    let mut out =
        "layer,name,kind,unit,f_x_per_mm,phase_rad,orientation_deg,wavelength_nm,row,column,value\n".to_owned();
    for (index, layer) in stack.layers.iter().enumerate() {
        let info = &layer.info;
        let kind = super::json(&info.kind);
        let kind = kind.as_str().expect("a layer's kind is a word");
        let numbers = [info.f_x_per_mm, info.phase_rad, info.orientation_deg, info.wavelength_nm];
        let numbers = numbers.map(|n| n.map_or(String::new(), |n| format!("{n:?}"))).join(",");
        let head = format!("{index},{},{kind},{},{numbers}", quoted(&info.name), quoted(&info.unit));
        for ((row, column), value) in layer.data.indexed_iter() {
            writeln!(out, "{head},{row},{column},{value:?}").expect("a string takes every text");
        }
    }
    out
}

fn encode_record(record: &Record) -> String {
    let mut out = "field,value\n".to_owned();
    for (field, value) in &record.fields {
        let text = match value {
            Value::String(text) => text.clone(),
            other => canonical_text(other),
        };
        writeln!(out, "{},{}", quoted(field), quoted(&text)).expect("a string takes every text");
    }
    out
}

/// RFC 4180: quotes around what would be read as more than one cell, quotes inside doubled.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
