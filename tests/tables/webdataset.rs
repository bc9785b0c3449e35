//! Shards for WebDataset hold what Parquet ones do, and are looked after like these.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::shard::{self, members};
use crate::space::{PIPELINE, Space};

const FORMAT: [&str; 2] = ["--format", "webdataset"];

/// Both formats of one set, sample by sample: the same names, numbers and tensors to the bit; what nobody drew is null.
#[test]
fn both_formats_hold_the_same() {
    let space = Space::with(PIPELINE);
    space.build("parquet", &[]);
    let built = space.build("tar", &FORMAT);
    assert_eq!(built["ran"], 0, "samples are in the store");
    space.verify("tar").ok();
    let mut compared = 0;
    let place = |file: &str| file.rsplit_once('.').expect("an ending").0.to_owned();
    let tars: BTreeMap<String, String> =
        space.shards("tar").into_iter().map(|(file, ..)| (place(&file), file)).collect();
    for (file, _, rows) in space.shards("parquet").into_iter().filter(|(_, _, rows)| *rows > 0) {
        let batch = shard::parquet(&space.path("parquet").join(&file));
        let samples = shard::webdataset(&space.path("tar").join(&tars[&place(&file)]));
        assert_eq!(samples.len() as u64, rows, "{file}");
        let schema = batch.schema();
        for (row, sample) in samples.iter().enumerate() {
            assert_eq!(sample.json["id"], sample.id.as_str());
            let names = schema.fields().iter().map(|field| field.name().clone());
            let known = |name: &String| sample.json.get(name).is_some() != sample.arrays.contains_key(name);
            assert!(names.clone().all(|name| known(&name)), "each column is in one of the members");
            for (name, (about, bytes)) in &sample.arrays {
                let column = batch.column(schema.index_of(name).expect("a feature"));
                let values = shard::leaf(column);
                let of_row = values.len() / batch.num_rows();
                let wanted: Vec<u8> =
                    values[row * of_row..(row + 1) * of_row].iter().flat_map(|v| v.to_le_bytes()).collect();
                assert!(*bytes == wanted, "{name} of {}", sample.id);
                assert!(about.contains("'descr': '<f4'") && about.contains("(1, 6, 6)"), "{about}");
                compared += 1;
            }
            let number = |name: &str| sample.json[name].as_f64().expect("a number");
            // A feature has the name `mu_a`.
            let product = number("draw.mu_a") * number("contrast");
            assert!((number("lesion_a") - product).abs() < 1e-12, "{}", sample.json);
            assert!(
                sample.json["group"].is_i64()
                    && ["spheroid", "none"].contains(&sample.json["shape"].as_str().unwrap_or(""))
            );
        }
    }
    assert!(compared >= 4 * 8, "{compared}");
    let card = fs::read_to_string(space.path("tar/README.md")).expect("the build wrote it");
    assert!(card.contains("path: data/train-*.tar") && card.contains("WebDataset("), "{card}");
}

/// A build leaves what is there, one of more points keeps full shards, and another folder gets the same bytes.
#[test]
fn tars_are_kept_and_grow() {
    let space = Space::with(PIPELINE);
    space.build("grown", &[&FORMAT[..], &["--set", "vars.n=8"]].concat());
    space.build("grown", &FORMAT);
    let times = |space: &Space| {
        let modified = |(file, ..): (String, String, u64)| {
            fs::metadata(space.path("grown").join(file)).unwrap().modified().unwrap()
        };
        space.shards("grown").into_iter().map(modified).collect::<Vec<_>>()
    };
    let before = times(&space);
    space.build("grown", &FORMAT);
    assert_eq!(times(&space), before, "nothing is written twice");
    space.build("at_once", &FORMAT);
    assert_eq!(space.shards("grown"), space.shards("at_once"));
    for name in ["README.md", "croissant.json", "dataset.json", "index.parquet", "statistics.parquet", "overview.png"] {
        let read = |to: &str| fs::read(space.path(to).join(name)).expect("the build wrote it");
        assert!(read("grown") == read("at_once"), "{name}");
    }
    assert_eq!(space.manifest("grown")["shard_format"], "webdataset");
}

fn write(at: &Path, members: &[(String, Vec<u8>)]) {
    let mut file = tar::Builder::new(Vec::new());
    for (name, bytes) in members {
        let mut header = tar::Header::new_ustar();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        file.append_data(&mut header, name, bytes.as_slice()).expect("memory takes it");
    }
    fs::write(at, file.into_inner().expect("memory takes it")).expect("the folder is ours");
}

/// Each damage is named with shard and sample, and the next build mends it.
#[test]
fn every_damage_is_named_and_mended() {
    let space = Space::with(PIPELINE);
    space.build("set", &FORMAT);
    let shards = space.shards("set");
    let (file, ..) = shards.iter().find(|(_, _, rows)| *rows >= 3).expect("a shard of several samples");
    let at = space.path("set").join(file);
    let whole = fs::read(&at).expect("the shard is there");
    let all = members(&at);
    let id = all[2].0.trim_end_matches(".json").to_owned();
    let place_of =
        |bytes: &[u8]| whole.windows(bytes.len()).position(|w| w == bytes).expect("members are stored as they are");

    let flip = |place: usize| {
        let mut bytes = whole.clone();
        bytes[place] ^= 1;
        fs::write(&at, bytes).expect("the folder is ours");
    };
    let without = |gone: usize| {
        let kept: Vec<_> = all.iter().enumerate().filter(|(at, _)| *at != gone).map(|(_, m)| m.clone()).collect();
        write(&at, &kept);
    };
    let renamed = |from: &str, to: &str, member: usize| {
        let mut members = all.clone();
        let bytes = &mut members[member].1;
        assert_eq!(from.len(), to.len());
        while let Some(place) = bytes.windows(from.len()).position(|w| w == from.as_bytes()) {
            bytes[place..place + from.len()].copy_from_slice(to.as_bytes());
        }
        write(&at, &members);
    };
    let swapped = || write(&at, &[&all[2..4], &all[..2], &all[4..]].concat());
    let more = || write(&at, &[&all[..], &[("notes.txt".to_owned(), b"mine".to_vec())]].concat());
    let row = format!("row 1 (sample {id})");
    type Damage<'d> = (&'d str, &'d dyn Fn(), Vec<String>);
    let damages: [Damage<'_>; 10] = [
        (
            "a byte of a tensor",
            &|| flip(place_of(&all[3].1) + all[3].1.len() / 2),
            vec![format!("{row}: its values were changed")],
        ),
        ("a byte of what is drawn", &|| flip(place_of(&all[2].1) + 12), vec![row.clone()]),
        ("a byte of a header", &|| flip(place_of(&all[2].1) - 400), vec![]),
        ("missing", &|| fs::remove_file(&at).expect("it is there"), vec!["the shard is missing".to_owned()]),
        ("a missing archive", &|| without(3), vec![format!("{row}: {id}.npz is missing")]),
        ("a missing description", &|| without(2), vec![format!("{row}: {id}.json is missing")]),
        (
            "a renamed array",
            &|| renamed("mask.npy", "task.npy", 3),
            vec![format!("{row}: `mask` is missing; it has "), "task".to_owned()],
        ),
        (
            "a renamed number",
            &|| renamed("\"contrast\"", "\"kontrast\"", 2),
            vec![format!("{row}: `contrast` is missing")],
        ),
        ("swapped samples", &swapped, vec!["stands where".to_owned()]),
        ("another member", &more, vec!["notes.txt is of no sample of this shard".to_owned()]),
    ];
    for (name, damage, words) in damages {
        damage();
        let said = space.verify("set").fails(1);
        assert!(said.contains(file.as_str()), "{name}: {said}");
        for word in words {
            assert!(said.contains(&word), "{name}: {word}: {said}");
        }
        assert_eq!(space.build("set", &FORMAT)["ran"], 0, "{name}: samples are in the store");
        assert!(fs::read(&at).expect("it is back") == whole, "{name}");
        space.verify("set").ok();
    }
    fs::write(&at, &whole[..whole.len() / 2]).expect("the folder is ours");
    space.verify("set").fails(1);
}

/// A folder has shards of one format, and says which.
#[test]
fn folders_of_another_format_are_refused() {
    let space = Space::with(PIPELINE);
    space.build("tar", &[&FORMAT[..], &["--set", "vars.n=4"]].concat());
    let before = fs::read(space.path("tar/dataset.json")).expect("the build wrote it");
    let of =
        |command: &str, more: &[&str]| space.turbid(&[&["dataset", command, "p.yaml", "--to", "tar"], more].concat());
    for command in ["build", "plan"] {
        let said = of(command, &["--format", "parquet"]).fails(2);
        assert!(said.contains("holds `spots` with shards of the format webdataset, not parquet"), "{command}: {said}");
        assert!(said.contains("--format webdataset"), "{command}: {said}");
    }
    for command in ["verify", "stats"] {
        let said = of(command, &["--format", "parquet"]).fails(2);
        assert!(said.contains("shards of the format webdataset, not parquet"), "{command}: {said}");
        of(command, &FORMAT).ok();
    }
    assert!(fs::read(space.path("tar/dataset.json")).expect("it is there") == before);
    let said = of("build", &["--format", "hdf5"]).fails(2);
    assert!(said.contains("hdf5") && said.contains("webdataset"), "{said}");
}

/// What Croissant says of tar files: every file with its digest, and the points of the index.
#[test]
fn croissant_has_the_files_and_the_index() {
    let space = Space::with(
        &PIPELINE.replace("    license:", "    cite: Somebody, 2026\n    published: 2026-03-31\n    license:"),
    );
    space.build("set", &[&FORMAT[..], &["--set", "vars.n=4"]].concat());
    let text = fs::read_to_string(space.path("set/croissant.json")).expect("the build wrote it");
    let document: Value = serde_json::from_str(&text).expect("it is JSON");
    assert_eq!((&document["citeAs"], &document["datePublished"]), (&"Somebody, 2026".into(), &"2026-03-31".into()));
    let files = document["distribution"].as_array().expect("a list");
    for (file, sha256, _) in space.shards("set") {
        let found = files.iter().find(|of| of["contentUrl"] == file.as_str()).expect("every shard is described");
        assert_eq!((&found["sha256"], &found["encodingFormat"]), (&sha256.into(), &"application/x-tar".into()));
    }
    let fields = document["recordSet"][0]["field"].as_array().expect("a list");
    assert!(fields.iter().all(|field| field["source"]["fileObject"]["@id"] == "index.parquet"), "{fields:?}");
}
