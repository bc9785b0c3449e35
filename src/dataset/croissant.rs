//! `croissant.json`: the data set in the vocabulary of MLCommons Croissant 1.1, with the digest of every file.

use serde_json::{Value, json};

use super::format::Format;
use super::manifest::{ColumnOf, Manifest};

/// The document. It describes Parquet shards column by column; arrays of NumPy inside of tar files are beyond its vocabulary,
/// so that of WebDataset shards it has the files and their digests, and as records the rows of `index.parquet`, which say of each
/// point in which shard and in which place it stands.
pub fn document(manifest: &Manifest) -> Value {
    let format = manifest.shard_format;
    let shards = manifest.shards.iter().map(|shard| file(&shard.file, shard.bytes, format.media_type(), &shard.sha256));
    let others = manifest.files.iter().filter_map(|(name, of)| {
        let kinds = [(".parquet", Format::Parquet.media_type()), (".png", "image/png")];
        let (_, kind) = kinds.into_iter().find(|(ending, _)| name.ends_with(ending))?;
        Some(file(name, of.bytes, kind, &of.sha256))
    });
    let mut splits: Vec<&str> = manifest.shards.iter().map(|shard| shard.split.as_str()).collect();
    splits.dedup();
    // A set that is contained in nothing is read from the folder of this document.
    let sets = splits.iter().map(|split| {
        json!({
            "@type": "cr:FileSet", "@id": format!("{split}-shards"), "name": format!("{split}-shards"),
            "description": format!("Shards of the split {split}"), "encodingFormat": format.media_type(),
            "includes": format!("data/{split}-*.{}", format.extension()),
        })
    });
    let distribution: Vec<Value> = shards.chain(others).chain(sets).collect();
    let records: Vec<Value> = match format {
        Format::Parquet => splits.iter().map(|split| samples(manifest, split)).collect(),
        Format::WebDataset => vec![points()],
    };
    let mut document = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": manifest.dataset,
        "description": manifest.about.clone().unwrap_or_else(|| format!("Simulated samples of the pipeline {}", manifest.pipeline)),
        "version": "1.0.0",
        "distribution": distribution,
        "recordSet": records,
    });
    let object = document.as_object_mut().expect("an object was written above");
    // No date of the build: the same samples make the same document.
    let said = [("license", &manifest.license), ("citeAs", &manifest.cite), ("datePublished", &manifest.published)];
    for (name, text) in said.into_iter().filter_map(|(name, text)| Some((name, text.as_ref()?))) {
        object.insert(name.to_owned(), json!(text));
    }
    document
}

fn file(path: &str, bytes: u64, media_type: &str, sha256: &str) -> Value {
    json!({
        "@type": "cr:FileObject", "@id": path, "name": path, "contentUrl": path,
        "contentSize": format!("{bytes} B"), "encodingFormat": media_type, "sha256": sha256,
    })
}

/// The rows of the Parquet shards of a split.
fn samples(manifest: &Manifest, split: &str) -> Value {
    let source = json!({"fileSet": {"@id": format!("{split}-shards")}});
    let fields: Vec<Value> = manifest.columns.iter().map(|column| field(column, split, &source)).collect();
    json!({
        "@type": "cr:RecordSet", "@id": split, "name": split, "description": format!("Samples of the split {split}"),
        "field": fields,
    })
}

/// The rows of `index.parquet`.
fn points() -> Value {
    let columns = [
        ColumnOf::scalar("id", "string", "name of the sample: of its members ID.json and ID.npz in the shard"),
        ColumnOf::scalar("draw", "int64", "raw index of the drawn point"),
        ColumnOf::scalar("split", "string", "split"),
        ColumnOf::scalar("shard", "string", "file of the shard; empty where the point is left out"),
        ColumnOf::scalar("row", "float64", "place of the sample in the shard"),
        ColumnOf::scalar("reject", "string", "why the point is left out"),
    ];
    let source = json!({"fileObject": {"@id": "index.parquet"}});
    let fields: Vec<Value> = columns.iter().map(|column| field(column, "points", &source)).collect();
    json!({
        "@type": "cr:RecordSet", "@id": "points", "name": "points", "description": "Every drawn point, with the place of its sample",
        "field": fields,
    })
}

/// A column of a record set whose files `source` names.
fn field(column: &ColumnOf, of: &str, source: &Value) -> Value {
    let data_type = match column.dtype.as_str() {
        "string" => "sc:Text",
        "int64" => "sc:Integer",
        _ => "sc:Float",
    };
    let mut field = json!({
        "@type": "cr:Field", "@id": format!("{of}/{}", column.name), "name": column.name,
        "description": column.about, "dataType": data_type, "source": source,
    });
    field["source"]["extract"] = json!({"column": column.name});
    if let Some([channels, rows, columns]) = column.shape {
        let object = field.as_object_mut().expect("an object was written above");
        object.insert("isArray".to_owned(), json!(true));
        object.insert("arrayShape".to_owned(), json!(format!("{channels},{rows},{columns}")));
    }
    field
}

/// The vocabulary of the document, as the specification gives it.
const CONTEXT: &str = r#"{
        "@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
        "dct": "http://purl.org/dc/terms/", "wd": "https://www.wikidata.org/wiki/",
        "arrayShape": "cr:arrayShape", "annotation": "cr:annotation", "citeAs": "cr:citeAs", "column": "cr:column",
        "conformsTo": "dct:conformsTo", "containedIn": "cr:containedIn",
        "data": {"@id": "cr:data", "@type": "@json"}, "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "equivalentProperty": "cr:equivalentProperty", "examples": {"@id": "cr:examples", "@type": "@json"},
        "excludes": "cr:excludes", "extract": "cr:extract", "field": "cr:field", "fileObject": "cr:fileObject",
        "fileProperty": "cr:fileProperty", "fileSet": "cr:fileSet", "format": "cr:format", "includes": "cr:includes",
        "isArray": "cr:isArray", "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath", "key": "cr:key",
        "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path", "readLines": "cr:readLines",
        "recordSet": "cr:recordSet", "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated",
        "replace": "cr:replace", "samplingRate": "cr:samplingRate", "separator": "cr:separator", "source": "cr:source",
        "subField": "cr:subField", "transform": "cr:transform", "unArchive": "cr:unArchive", "value": "cr:value"
    }"#;

fn context() -> Value {
    serde_json::from_str(CONTEXT).expect("the context is JSON")
}
