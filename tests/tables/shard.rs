//! What shards hold, read without turbid.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::DataType;
use bytes::Bytes;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

pub fn parquet(at: &Path) -> RecordBatch {
    let bytes = Bytes::from(fs::read(at).expect("the shard is there"));
    let mut reader = ParquetRecordBatchReaderBuilder::try_new(bytes).and_then(|b| b.build()).expect("it is Parquet");
    reader.next().expect("it has rows").expect("they can be read")
}

/// The numbers of a tensor column, row after row, as 32-bit floats; none of them is null.
pub fn leaf(column: &ArrayRef) -> Vec<f32> {
    let mut leaf = column.clone();
    while let DataType::FixedSizeList(..) = leaf.data_type() {
        assert_eq!(leaf.null_count(), 0);
        leaf = leaf.as_fixed_size_list().values().clone();
    }
    assert_eq!(leaf.null_count(), 0);
    match leaf.data_type() {
        DataType::Float16 => leaf.as_primitive::<Float16Type>().values().iter().map(|v| v.to_f32()).collect(),
        _ => leaf.as_primitive::<Float32Type>().values().to_vec(),
    }
}

/// A sample of a tar file.
pub struct Sample {
    pub id: String,
    pub json: Value,
    /// Description and bytes of each array.
    pub arrays: BTreeMap<String, (String, Vec<u8>)>,
}

/// Name and bytes of each member of a tar file.
pub fn members(at: &Path) -> Vec<(String, Vec<u8>)> {
    let bytes = fs::read(at).expect("the shard is there");
    let mut file = tar::Archive::new(Cursor::new(bytes));
    let member = |entry: std::io::Result<tar::Entry<'_, _>>| {
        let mut entry: tar::Entry<'_, Cursor<Vec<u8>>> = entry.expect("it is a tar file");
        let header = entry.header();
        assert_eq!((header.mtime().ok(), header.uid().ok(), header.gid().ok()), (Some(0), Some(0), Some(0)));
        let name = entry.path().expect("a name").to_string_lossy().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).expect("it is whole");
        (name, bytes)
    };
    file.entries().expect("it is a tar file").map(member).collect()
}

pub fn webdataset(at: &Path) -> Vec<Sample> {
    let members = members(at);
    let pairs = members.chunks(2).map(|pair| {
        let [(json, known), (npz, archive)] = pair else { panic!("members come in pairs") };
        let id = json.strip_suffix(".json").expect("the first is JSON").to_owned();
        assert_eq!(*npz, format!("{id}.npz"));
        Sample { id, json: serde_json::from_slice(known).expect("it is JSON"), arrays: arrays(archive) }
    });
    pairs.collect()
}

fn arrays(bytes: &[u8]) -> BTreeMap<String, (String, Vec<u8>)> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).expect("it is an archive");
    let names: Vec<String> = archive.file_names().map(str::to_owned).collect();
    let array = |name: String| {
        let mut bytes = Vec::new();
        archive.by_name(&name).expect("it is listed").read_to_end(&mut bytes).expect("it is whole");
        let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let about = String::from_utf8_lossy(&bytes[10..head]).trim().to_owned();
        (name.trim_end_matches(".npy").to_owned(), (about, bytes[head..].to_vec()))
    };
    names.into_iter().map(array).collect()
}
