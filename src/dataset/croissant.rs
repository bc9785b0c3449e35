//! `croissant.json`: the data set in the vocabulary of MLCommons Croissant 1.1, with the digest of every file.

use serde_json::{Value, json};

use super::manifest::{ColumnOf, Manifest};

/// The document; `files` are path, bytes and SHA-256 of what it describes.
pub fn document(manifest: &Manifest) -> Value {
    let file = |path: &str, bytes: u64, sha256: &str| {
        json!({
            "@type": "cr:FileObject", "@id": path, "name": path, "contentUrl": path,
            "contentSize": format!("{bytes} B"), "encodingFormat": "application/x-parquet", "sha256": sha256,
        })
    };
    let mut distribution: Vec<Value> =
        manifest.shards.iter().map(|shard| file(&shard.file, shard.bytes, &shard.sha256)).collect();
    distribution.extend(
        manifest
            .files
            .iter()
            .filter(|(name, _)| name.ends_with(".parquet"))
            .map(|(name, of)| file(name, of.bytes, &of.sha256)),
    );
    // A set that is contained in nothing is read from the folder of this document.
    let mut splits: Vec<&str> = manifest.shards.iter().map(|shard| shard.split.as_str()).collect();
    splits.dedup();
    let sets: Vec<Value> = splits
        .iter()
        .map(|split| {
            json!({
                "@type": "cr:FileSet", "@id": format!("{split}-shards"), "name": format!("{split}-shards"),
                "description": format!("Shards of the split {split}"), "encodingFormat": "application/x-parquet",
                "includes": format!("data/{split}-*.parquet"),
            })
        })
        .collect();
    distribution.extend(sets);
    let records: Vec<Value> = splits
        .iter()
        .map(|split| {
            let field = |column: &ColumnOf| field(column, split);
            json!({
                "@type": "cr:RecordSet", "@id": split, "name": split, "description": format!("Samples of the split {split}"),
                "field": manifest.columns.iter().map(field).collect::<Vec<_>>(),
            })
        })
        .collect();
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
    if let Some(license) = &manifest.license {
        object.insert("license".to_owned(), json!(license));
    }
    if let Some(cite) = &manifest.cite {
        object.insert("citeAs".to_owned(), json!(cite));
    }
    document
}

fn field(column: &ColumnOf, split: &str) -> Value {
    let data_type = match column.dtype.as_str() {
        "string" => "sc:Text",
        "int64" => "sc:Integer",
        _ => "sc:Float",
    };
    let mut field = json!({
        "@type": "cr:Field", "@id": format!("{split}/{}", column.name), "name": column.name,
        "description": column.about, "dataType": data_type,
        "source": {"fileSet": {"@id": format!("{split}-shards")}, "extract": {"column": column.name}},
    });
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
