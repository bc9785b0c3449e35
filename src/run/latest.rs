//! `outputs/latest`: for people, the newest outputs by name, with pictures.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use turbid_contract::{Artifact, ArtifactKind, Axes, Cells, Table};

use crate::digest::{Digest, PartHasher};
use crate::key::{axes_text, value_text};
use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan};
use crate::preview::{self, Caption};
use crate::store::{Blob, InstanceRecord, PortRecord, Store, encode, extension};

use super::Summary;
use super::caption::{self, caption};

/// Which blob each file under `latest/<pipeline>` stands for, and which look each picture has, so that an unchanged one is not touched.
const LINKS: &str = ".links";

/// Which pipeline file the folder was last filled from.
const SOURCE: &str = ".source";

/// Another pipeline file that fills the same folder, because it has the same `pipeline:` name; noted for the next run.
pub fn rival(plan: &Plan, outputs: &Path) -> Option<PathBuf> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
    let main = plan.spec.sources.first()?;
    let own = std::path::absolute(&main.name).ok()?;
    let before = fs::read_to_string(folder.join(SOURCE)).ok().map(PathBuf::from);
    if before.as_ref() != Some(&own) {
        // A service: what cannot be noted is not warned of.
        let _ = own.to_str().map(|own| write(&folder.join(SOURCE), own.as_bytes()));
    }
    // A copy of the same file makes the same outputs, and one that is gone makes none.
    let other = |path: &PathBuf| *path != own && fs::read_to_string(path).is_ok_and(|text| text != main.text);
    before.filter(other)
}

/// Brings `latest/<pipeline>` in line with what the run left; returns the folder.
pub fn publish(plan: &Plan, store: &Store, summary: &Summary, outputs: &Path) -> Result<PathBuf, String> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
    let before = read_links(&folder);
    let mut now: BTreeMap<String, String> = before
        .iter()
        .filter(|(path, _)| keeps(plan, path))
        .map(|(path, content)| (path.clone(), content.clone()))
        .collect();
    let overrides = caption::overrides(plan);
    for &stage in &plan.needed {
        let set = overrides.get(&stage).map_or(&[][..], Vec::as_slice);
        let records: Vec<(usize, &Arc<InstanceRecord>)> =
            plan.instances_of(stage).filter_map(|id| summary.record(id).map(|r| (id, r))).collect();
        let name = file_name(&plan.spec.stages[stage].name);
        if records.len() > PREVIEW_INSTANCES {
            let path = format!("{name}/instances.parquet");
            let content = fingerprint(&records);
            if before.get(&path) != Some(&content) || !folder.join(&path).exists() {
                write_instances(&folder.join(&path), plan, store, &records)?;
            }
            now.insert(path, content);
            continue;
        }
        for (id, record) in records {
            let place = place(&plan.spec.stages[stage].name, &plan.instances[id].axes);
            for (port, described) in &record.ports {
                let content = described.blob.digest.to_string();
                let path = format!("{place}/{port}.{}", extension(described.blob.kind));
                let picture = format!("{place}/{port}.png");
                let caption = caption(plan, id, record, port, &described.blob, set);
                let look = caption::fingerprint(&caption);
                let current = |path: &str| before.get(path) == Some(&content) && folder.join(path).exists();
                if !current(&path) {
                    link(store, &described.blob, &folder.join(&path))?;
                }
                if before.get(&picture) == Some(&look) && folder.join(&picture).exists() {
                    now.insert(picture, look);
                } else {
                    let fresh = drawn(described) && before.get(&path) != Some(&content);
                    if (fresh || before.contains_key(&picture))
                        && draw(store, &described.blob, &caption, &folder.join(&picture))?
                    {
                        now.insert(picture, look);
                    }
                }
                now.insert(path, content);
            }
        }
    }
    if now != before {
        for path in before.keys().filter(|path| !now.contains_key(*path)) {
            let _ = fs::remove_file(folder.join(path));
            // A folder that still holds something stays.
            let _ = folder.join(path).parent().map(fs::remove_dir);
        }
        let text: String = now.iter().map(|(path, content)| format!("{content} {path}\n")).collect();
        write(&folder.join(LINKS), text.as_bytes())?;
    }
    Ok(folder)
}

/// Whether somebody would look at a picture of it: not of the covariances of every pair of quantities.
fn drawn(port: &PortRecord) -> bool {
    port.blob.kind != ArtifactKind::Record && port.payload != "covariance"
}

/// Files of stages that are still in the pipeline but were not asked for this time.
fn keeps(plan: &Plan, path: &str) -> bool {
    let stage = path.split('/').next().unwrap_or_default();
    let known = plan.spec.stages.iter().position(|s| file_name(&s.name) == stage);
    known.is_some_and(|stage| !plan.needed.contains(&stage))
}

fn read_links(folder: &Path) -> BTreeMap<String, String> {
    let text = fs::read_to_string(folder.join(LINKS)).unwrap_or_default();
    text.lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(content, path)| (path.to_owned(), content.to_owned()))
        .collect()
}

fn fingerprint(records: &[(usize, &Arc<InstanceRecord>)]) -> String {
    let mut parts = PartHasher::new("turbid instances 1");
    for (_, record) in records {
        parts.add("key", &record.key.0);
        for (port, described) in &record.ports {
            parts.add(port, &described.blob.digest.0);
        }
    }
    parts.finish().to_string()
}

/// A link to the blob's file, or a copy where the blob lives in a pack or links are not to be had.
fn link(store: &Store, blob: &Blob, at: &Path) -> Result<(), String> {
    prepare(at)?;
    #[cfg(unix)]
    if let Some(file) = store.file_of(blob) {
        // Made beside and renamed: two runs may do this at once, and a reader must always find one.
        let fresh = at.with_extension(format!("{}.new", std::process::id()));
        let _ = fs::remove_file(&fresh);
        if std::os::unix::fs::symlink(relative(at, &file), &fresh).is_ok() && fs::rename(&fresh, at).is_ok() {
            return Ok(());
        }
    }
    store.materialise(blob, at).map_err(|e| format!("{}: {e}", at.display()))
}

/// `to` as seen from the folder of `at`; both lie below one outputs folder.
fn relative(at: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<_>, Vec<_>) = (at.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let mut path: PathBuf = std::iter::repeat_n("..", from.len() - shared - 1).collect();
    path.extend(&to[shared..]);
    path
}

fn draw(store: &Store, blob: &Blob, caption: &Caption, at: &Path) -> Result<bool, String> {
    let Ok(artifact) = store.get(blob) else { return Ok(false) };
    let Some(png) = preview::picture(&artifact, caption) else { return Ok(false) };
    prepare(at)?;
    write(at, &png)?;
    Ok(true)
}

/// The file of `latest/<pipeline>` that holds a copy of this blob of an instance, if it is there and up to date.
pub fn copy_of(plan: &Plan, id: InstanceId, port: &str, blob: &Blob, outputs: &Path) -> Option<PathBuf> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
    let instance = &plan.instances[id];
    let place = place(&plan.spec.stages[instance.stage].name, &instance.axes);
    let path = format!("{place}/{port}.{}", extension(blob.kind));
    let current = read_links(&folder).get(&path) == Some(&blob.digest.to_string());
    Some(folder.join(path)).filter(|path| current && path.is_file())
}

/// `stage` or `stage/axes`.
fn place(stage: &str, axes: &Axes) -> String {
    let axes = axes_text(axes);
    if axes.is_empty() { file_name(stage) } else { format!("{}/{}", file_name(stage), file_name(&axes)) }
}

/// One row per instance: axes, key, seconds, and digest and path of each port.
fn write_instances(
    at: &Path,
    plan: &Plan,
    store: &Store,
    records: &[(usize, &Arc<InstanceRecord>)],
) -> Result<(), String> {
    let mut table = Table::default();
    let axes = &plan.instances[records[0].0].axes;
    for name in axes.keys() {
        let values = || records.iter().map(|(id, _)| &plan.instances[*id].axes[name]);
        let cells = match values().map(|v| v.as_f64()).collect::<Option<Vec<f64>>>() {
            Some(numbers) => Cells::F64(numbers),
            None => Cells::Text(values().map(value_text).collect()),
        };
        table.push(name.clone(), "", cells);
    }
    table.push("key", "", Cells::Text(records.iter().map(|(_, r)| r.key.to_string()).collect()));
    table.push("seconds", "s", Cells::F64(records.iter().map(|(_, r)| r.cost.wall_s).collect()));
    for port in records[0].1.ports.keys() {
        let blobs = || records.iter().map(|(_, r)| r.ports.get(port).map(|p| &p.blob));
        let digest = |blob: Option<&Blob>| blob.map(|b| b.digest.to_string()).unwrap_or_default();
        let path = |blob: Option<&Blob>| {
            blob.and_then(|b| store.file_of(b)).map(|p| p.display().to_string()).unwrap_or_default()
        };
        table.push(format!("{port}.digest"), "", Cells::Text(blobs().map(digest).collect()));
        table.push(format!("{port}.path"), "", Cells::Text(blobs().map(path).collect()));
    }
    let bytes = encode(&Artifact::Table(table)).map_err(|e| e.to_string())?;
    prepare(at)?;
    write(at, &bytes)
}

/// A name that every file system takes: other characters replaced, the end cut off; then a digest keeps it distinct.
fn file_name(text: &str) -> String {
    const MOST: usize = 200;
    let plain: String =
        text.chars().map(|c| if c.is_alphanumeric() || "-_=,.+ ".contains(c) { c } else { '_' }).collect();
    if plain == text && text.len() <= MOST {
        return plain;
    }
    let end = (0..=MOST.min(plain.len())).rev().find(|&i| plain.is_char_boundary(i)).unwrap_or(0);
    format!("{}-{}", &plain[..end], &Digest::of(text.as_bytes()).to_string()[..8])
}

fn prepare(at: &Path) -> Result<(), String> {
    let folder = at.parent().expect("files of latest lie in folders");
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))
}

/// Whole or not at all: a reader never sees half a file.
fn write(at: &Path, bytes: &[u8]) -> Result<(), String> {
    let folder = at.parent().expect("files of latest lie in folders");
    let fail = |e: std::io::Error| format!("{}: {e}", at.display());
    fs::create_dir_all(folder).map_err(fail)?;
    let mut file = crate::shared_file().tempfile_in(folder).map_err(fail)?;
    std::io::Write::write_all(&mut file, bytes).map_err(fail)?;
    file.persist(at).map_err(|e| fail(e.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_relative() {
        let path = relative(Path::new("/o/latest/p/s/frames.exr"), Path::new("/o/store/blobs/ab/cd.exr"));
        assert_eq!(path, Path::new("../../../store/blobs/ab/cd.exr"));
    }

    #[test]
    fn file_names_are_plain_short_and_distinct() {
        assert_eq!(file_name("A_rho=1,S_rho=0.5"), "A_rho=1,S_rho=0.5");
        let odd = ["a/b", "a_b", "a:b", &"n".repeat(300), &"n".repeat(301), &"\u{1F600}".repeat(90), &"ä".repeat(300)];
        let names = odd.map(file_name);
        assert!(names.iter().all(|n| n.len() < 255 && !n.contains(['/', ':'])), "{names:?}");
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), odd.len(), "{names:?}");
    }
}
