//! Studies as they were run last, read from their files beside the pictures: what makes them needs polars, what shows them does not.

use std::path::Path;
use std::{fs, io};

use serde_json::{Value, json};

use crate::input_file;
use crate::plan::Plan;
use crate::run::latest::file_name;
use crate::spec::StudySpec;

use super::page::{Cell, Figure, Grid, Image, Study};
use super::params::shortened;
use super::pictures::href;

/// What a study found, for those who show it: in the folder of its table.
pub const FILE: &str = "study.json";
/// Bytes of a file of a study.
const MOST: u64 = 16 << 20;
/// Points that are shown.
const SHOWN: usize = 500;

/// What a study asks, as it is noted with what it found.
pub fn definition(study: &StudySpec) -> Value {
    let vary: Vec<Value> = study.vary.iter().map(|(path, values)| json!({"path": path, "values": values})).collect();
    json!({
        "vary": vary, "repeats": study.repeats, "estimate": study.estimate, "truth": study.truth, "error": study.error, "also": study.also,
    })
}

/// The studies of the pipeline; those that were not run say so.
pub fn studies(plan: &Plan, outputs: &Path, page: &Path) -> Vec<Study> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline)).join("studies");
    plan.spec.studies.iter().map(|study| one(study, &folder.join(file_name(&study.name)), page)).collect()
}

fn one(study: &StudySpec, folder: &Path, page: &Path) -> Study {
    let mut shown =
        Study { name: study.name.clone(), about: study.about.clone(), figure: None, points: None, notes: Vec::new() };
    let found = match read(&folder.join(FILE)) {
        Ok(None) => {
            shown.notes.push(format!("it has not run yet: `turbid study FILE {}`", study.name));
            return shown;
        }
        Ok(Some(bytes)) => serde_json::from_slice::<Value>(&bytes).map_err(|error| error.to_string()),
        Err(message) => Err(message),
    };
    let found = match found {
        Ok(found) if found["points"].is_array() => found,
        Ok(_) => return damaged(shown, study, "it holds no points"),
        Err(message) => return damaged(shown, study, &message),
    };
    if found["definition"] != definition(study) {
        shown.notes.push("it was run with another definition than the file has now".to_owned());
    }
    let text = |value: &Value| match value {
        Value::String(text) => shortened(text),
        Value::Number(number) => number.to_string(),
        _ => "-".to_owned(),
    };
    let points = found["points"].as_array().map(Vec::as_slice).unwrap_or_default();
    let names = ["point", "error", "stated", "ratio", "cpu_seconds", "efficiency"];
    let row = |point: &Value| -> Vec<Cell> {
        let cell = |name: &&str| match *name {
            "cpu_seconds" | "efficiency" => Cell::run(text(&point[*name])),
            name => Cell::text(text(&point[name])),
        };
        names.iter().map(cell).collect()
    };
    shown.points = Some(Grid {
        caption: format!("{} of {}, over {} repeats", study.error, study.estimate, study.repeats),
        head: ["point", "error", "stated", "error / stated (95 %)", "CPU s", "1 / (error² CPU s)"]
            .map(str::to_owned)
            .to_vec(),
        rows: points.iter().take(SHOWN).map(row).collect(),
        more: (points.len() > SHOWN).then(|| format!("and {} more points: study.csv", points.len() - SHOWN)),
    });
    let said = |key: &str| found[key].as_array().cloned().unwrap_or_default();
    shown.notes.extend(said("slopes").iter().chain(&said("failed")).filter_map(|v| v.as_str().map(str::to_owned)));
    match read(&folder.join("study.svg")) {
        Ok(Some(bytes)) if bytes.starts_with(b"<svg") => {
            shown.figure = Some(Figure {
                title: format!("{}: error over CPU seconds", study.name),
                alt: format!("{}: error over CPU seconds; the table below has its numbers", study.name),
                image: Image::SvgFile(bytes),
                file: href(page, &folder.join("study.csv")),
                behind: None,
            });
        }
        Ok(Some(_)) => shown.notes.push("study.svg is damaged; the study draws it again".to_owned()),
        Ok(None) => {}
        Err(message) => shown.notes.push(message),
    }
    shown
}

fn damaged(mut shown: Study, study: &StudySpec, why: &str) -> Study {
    shown.notes.push(format!("what it found is damaged ({why}): `turbid study FILE {}` writes it again", study.name));
    shown
}

/// A file that a study wrote; `None` where there is none.
fn read(path: &Path) -> Result<Option<Vec<u8>>, String> {
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        _ => input_file::read(path, MOST)
            .map(|bytes| Some(bytes.to_vec()))
            .map_err(|e| format!("{}: {e}", path.display())),
    }
}
