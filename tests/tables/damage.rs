//! Folders that somebody edited: `verify` names file and row, and a build mends them.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use bytes::Bytes;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use crate::space::{PIPELINE, Space};

fn read(at: &Path) -> RecordBatch {
    let bytes = Bytes::from(fs::read(at).expect("the shard is there"));
    let mut reader = ParquetRecordBatchReaderBuilder::try_new(bytes).and_then(|b| b.build()).expect("it is Parquet");
    reader.next().expect("it has rows").expect("they can be read")
}

fn write(at: &Path, batches: &[RecordBatch]) {
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, batches[0].schema(), None).expect("a schema that was read");
    batches.iter().for_each(|batch| writer.write(batch).expect("rows of this schema"));
    writer.close().expect("memory takes it");
    fs::write(at, bytes).expect("the folder is ours");
}

/// Rows of a batch in an order of their own.
fn taken(batch: &RecordBatch, rows: &[usize]) -> Vec<RecordBatch> {
    rows.iter().map(|&row| batch.slice(row, 1)).collect()
}

#[test]
fn every_damage_is_named_and_mended() {
    let space = Space::with(PIPELINE);
    space.build("set", &[]);
    let shards = space.shards("set");
    let (file, ..) = shards.iter().find(|(_, _, rows)| *rows >= 3).expect("a shard of several rows");
    let at = space.path("set").join(file);
    let whole = fs::read(&at).expect("the shard is there");

    let flip = |place: usize| {
        let mut bytes = whole.clone();
        bytes[place] ^= 1;
        fs::write(&at, bytes).expect("the folder is ours");
    };
    let batch = read(&at);
    let renamed = || {
        let schema = batch.schema();
        let fields = schema.fields().iter().map(|f| match f.name().as_str() {
            "mask" => f.as_ref().clone().with_name("masks"),
            _ => f.as_ref().clone(),
        });
        let schema = Arc::new(Schema::new(fields.collect::<Vec<_>>()));
        write(&at, &[RecordBatch::try_new(schema, batch.columns().to_vec()).expect("the same columns")]);
    };
    let others: Vec<usize> = (2..batch.num_rows()).collect();
    // Two samples whose values are swapped, and not their names.
    let edited = || {
        let swapped = |row: usize| {
            let (own, other) = (batch.slice(row, 1), batch.slice(if row < 2 { 1 - row } else { row }, 1));
            let place = batch.schema().index_of("mu_a").expect("a feature");
            let columns = own.columns().iter().enumerate();
            let columns =
                columns.map(|(at, column)| if at == place { other.column(at).clone() } else { column.clone() });
            RecordBatch::try_new(batch.schema(), columns.collect()).expect("the same schema")
        };
        write(&at, &(0..batch.num_rows()).map(swapped).collect::<Vec<_>>());
    };
    // What is done, how, and what is said of it.
    type Damage<'d> = (&'d str, &'d dyn Fn(), &'d [&'d str]);
    let damages: [Damage<'_>; 8] = [
        ("edited values", &edited, &["row 0 (sample ", "its values were changed"]),
        ("a byte among the values", &|| flip(whole.len() / 2), &[]),
        ("a byte at the beginning", &|| flip(5), &[]),
        ("a byte of the footer", &|| flip(whole.len() - 20), &[]),
        ("missing", &|| fs::remove_file(&at).expect("it is there"), &["the shard is missing"]),
        ("a renamed column", &renamed, &["`mask` is missing"]),
        ("swapped rows", &|| write(&at, &taken(&batch, &[&[1, 0], &others[..]].concat())), &["row 0"]),
        ("a row less", &|| write(&at, &[batch.slice(0, batch.num_rows() - 1)]), &["rows, and should have"]),
    ];
    for (name, damage, words) in damages {
        damage();
        let said = space.verify("set").fails(1);
        assert!(said.contains(file.as_str()), "{name}: {said}");
        for word in words {
            assert!(said.contains(word), "{name}: {word}: {said}");
        }
        let built = space.build("set", &[]);
        assert_eq!(built["ran"], 0, "{name}: samples are in the store");
        assert!(fs::read(&at).expect("it is back") == whole, "{name}");
        space.verify("set").ok();
    }

    for name in ["index.parquet", "README.md", "croissant.json", "statistics.parquet"] {
        let at = space.path("set").join(name);
        let mut bytes = fs::read(&at).expect("it is there");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&at, bytes).expect("the folder is ours");
        let said = space.verify("set").fails(1);
        assert!(said.contains(&format!("{name}: its bytes were changed")), "{said}");
        space.build("set", &[]);
        space.verify("set").ok();
    }

    fs::write(space.path("set/data/train-00009-of-00010.parquet"), b"not ours").expect("the folder is ours");
    let said = space.verify("set").fails(1);
    assert!(said.contains("data/train-00009-of-00010.parquet: no shard of this data set"), "{said}");
}
