//! `outputs/latest`: for people, the newest outputs by name, with pictures.

mod export_line;
mod links;
mod list;
mod staged;

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use turbid_contract::payload::is_pictured;
use turbid_contract::{ArtifactKind, OutPort};

use crate::brief::Brief;
use crate::digest::Digest;
use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan, StageId};
use crate::preview::{self, Caption};
use crate::spec::SourceFile;
use crate::store::{Blob, Store, StoreError, extension};

use super::Summary;
use super::caption::{self, caption, fingerprint};
pub use super::name::file_name;
use super::name::place;
use super::partial;
pub use export_line::Command;
use links::{Entry, LINKS, Links, current, read_small};
use list::List;
use staged::Staged;

/// Which pipeline file the folder was last filled from.
const SOURCE: &str = ".source";
/// Bytes of a path, and of a pipeline file that is compared with another.
const LONGEST_PATH: u64 = 1 << 16;
const LONGEST_PIPELINE: u64 = 8 << 20;

/// Another pipeline file that fills the same folder, because it has the same `pipeline:` name; noted for the next run.
pub fn rival(plan: &Plan, outputs: &Path) -> Option<PathBuf> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
    let main = plan.spec.sources.first()?;
    let own = std::path::absolute(&main.name).ok()?;
    let before = read_small(&folder.join(SOURCE), LONGEST_PATH).map(PathBuf::from);
    if before.as_ref() != Some(&own) {
        // A service: what cannot be noted is not warned of.
        let _ = own.to_str().map(|own| staged::write(&folder.join(SOURCE), own.as_bytes()));
    }
    // A copy of the same file makes the same outputs, and one that is gone makes none.
    let text = |path: &PathBuf| SourceFile::read(path, "a pipeline", LONGEST_PIPELINE);
    let other = |path: &PathBuf| *path != own && text(path).is_ok_and(|file| file.text != main.text);
    before.filter(other)
}

/// What `latest/<pipeline>` was brought to.
pub struct Published {
    pub folder: PathBuf,
    /// Whether a blob turned out damaged or gone; its files are left out.
    pub lost: bool,
}

/// Brings `latest/<pipeline>` in line with what the run left: what is there and was not touched since it was written stays.
///
/// Error: a file that cannot be written; the others stay as they were.
pub fn publish(plan: &Plan, store: &Store, summary: &Summary, outputs: &Path) -> Result<Published, String> {
    let pipeline = &plan.spec.pipeline;
    let folder = outputs.join("latest").join(file_name(pipeline));
    let before = links::read(&folder, pipeline);
    let kept = kept(plan);
    let keeps = |path: &str| kept.contains(path.split('/').next().unwrap_or_default());
    let now = before.iter().filter(|(path, _)| keeps(path)).map(|(p, e)| (p.clone(), e.clone())).collect();
    let mut filling =
        Filling { store, before: &before, now, staged: Staged::new(&folder), folder: &folder, lost: false };
    let overrides = caption::overrides(plan);
    let command = Command::of(plan, outputs);
    for &stage in &plan.needed {
        let set = overrides.get(&stage).map_or(&[][..], Vec::as_slice);
        let made: Vec<(InstanceId, &Arc<Brief>)> =
            plan.instances_of(stage).filter_map(|id| summary.brief(id).map(|brief| (id, brief))).collect();
        let name = file_name(&plan.spec.stages[stage].name);
        if made.len() > PREVIEW_INSTANCES {
            let path = format!("{name}/instances.parquet");
            let list = List { plan, store, made: &made, command: &command };
            let content = list.fingerprint();
            if !filling.keep(&path, &content, None) {
                filling.staged.file(&path, &content, &list.encode()?, false)?;
            }
            continue;
        }
        for (id, brief) in made {
            let place = place(&plan.spec.stages[stage].name, &plan.axes_text(id));
            for port in plan.outputs(stage) {
                let Some(blob) = brief.outputs.get(port.name) else { continue };
                partial::sweep(&folder.join(&place), port.name);
                filling.port(&place, port, blob, &caption(plan, id, &brief.key, port.name, blob, set))?;
            }
        }
    }
    let Filling { mut now, staged, lost, .. } = filling;
    let written = !staged.is_empty();
    staged.commit(&mut now)?;
    if now != before {
        for path in before.keys().filter(|path| !now.contains_key(*path)) {
            let _ = fs::remove_file(folder.join(path));
            // A folder that still holds something stays.
            let _ = folder.join(path).parent().map(fs::remove_dir);
        }
        let same = !written && now.len() == before.len();
        // Last: a list that is there tells of files that are there.
        let noted = staged::write(&folder.join(LINKS), links::text(&now, pipeline).as_bytes());
        // Where only times differ, as in a copy of the folder, nobody misses it.
        noted.or_else(|error| if same { Ok(()) } else { Err(error) })?;
    }
    Ok(Published { folder, lost })
}

/// `latest/<pipeline>` while it is filled.
struct Filling<'a> {
    store: &'a Store,
    folder: &'a Path,
    before: &'a Links,
    now: Links,
    staged: Staged,
    lost: bool,
}

impl Filling<'_> {
    /// Whether the file at `path` is there, stands for `content` and is what was written; a link leads to a file of `length`.
    fn keep(&mut self, path: &str, content: &str, length: Option<u64>) -> bool {
        let entry = self.before.get(path).filter(|entry| entry.content == content);
        let entry = entry.and_then(|entry| current(entry, &self.folder.join(path), length));
        let kept = entry.is_some();
        self.now.extend(entry.map(|entry| (path.to_owned(), entry)));
        kept
    }

    /// The file of a port, and its picture.
    fn port(&mut self, place: &str, port: &OutPort, blob: &Blob, caption: &Caption) -> Result<(), String> {
        let content = blob.digest.to_string();
        let path = format!("{place}/{}.{}", port.name, extension(blob.kind));
        let picture = format!("{place}/{}.png", port.name);
        let look = fingerprint(caption);
        if self.store.is_released(blob) {
            // What is there stays; people's links alone are no reason to make again what was released.
            self.keep(&path, &content, Some(blob.bytes));
            self.keep(&picture, &look, None);
            return Ok(());
        }
        if !self.keep(&path, &content, Some(blob.bytes)) {
            self.file(&path, &content, blob)?;
        }
        if !self.keep(&picture, &look, None) {
            let stood_for = |path: &str| self.before.get(path).is_some_and(|entry| entry.content == content);
            let fresh = drawn(port, blob) && !stood_for(&path);
            if fresh || self.before.contains_key(&picture) {
                self.draw(&picture, &look, blob, caption)?;
            }
        }
        Ok(())
    }

    /// A link to the blob's file, or a copy where the blob lives in a pack or links are not to be had.
    fn file(&mut self, path: &str, content: &str, blob: &Blob) -> Result<(), String> {
        // Where it cannot be had, reading it says why.
        let _ = self.store.bring(blob);
        if let Some(file) = self.store.file_of(blob)
            && self.staged.link(path, content, &file)?
        {
            return Ok(());
        }
        match self.store.bytes(blob) {
            Ok(bytes) => self.staged.file(path, content, &bytes, true),
            Err(error) => self.failed(path, &error),
        }
    }

    fn draw(&mut self, path: &str, look: &str, blob: &Blob, caption: &Caption) -> Result<(), String> {
        let drawn = match blob.kind {
            // Of a large stack one layer after the other.
            ArtifactKind::Images => self
                .store
                .open_images(blob)
                .and_then(|images| preview::picture_of_parts(images.head(), &|wanted| images.part(wanted), caption)),
            _ => self.store.get(blob).map(|artifact| preview::picture(&artifact, caption)),
        };
        match drawn {
            Ok(Some(png)) => self.staged.file(path, look, &png, false),
            Ok(None) => Ok(()),
            Err(error) => {
                self.now.insert(path.to_owned(), Entry::missing());
                self.failed(path, &error)
            }
        }
    }

    fn failed(&mut self, path: &str, error: &StoreError) -> Result<(), String> {
        if error.is_lost_blob() {
            self.lost = true;
            return Ok(());
        }
        Err(format!("{}: {error}", self.folder.join(path).display()))
    }
}

/// The files that a run compares with its list, and the list; `None` where one of them could not be made, so that the next run tries again.
pub fn watched(plan: &Plan, outputs: &Path) -> Option<Vec<PathBuf>> {
    let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
    let links = links::read(&folder, &plan.spec.pipeline);
    let whole = links.values().all(|entry| !entry.is_missing());
    let names = [LINKS, SOURCE].into_iter().chain(links.keys().map(String::as_str));
    whole.then(|| names.map(|name| folder.join(name)).collect())
}

/// Whether somebody would look at a picture of it.
fn drawn(port: &OutPort, blob: &Blob) -> bool {
    blob.kind != ArtifactKind::Record && is_pictured(port.payload)
}

/// Folders of stages that are still in the pipeline but were not asked for this time.
fn kept(plan: &Plan) -> HashSet<String> {
    let stages = plan.spec.stages.iter_ids().filter(|(stage, _)| !plan.needs(*stage));
    stages.map(|(_, stage)| file_name(&stage.name)).collect()
}

/// The file of `latest/<pipeline>` that holds a copy of this blob of an instance, if it is there and up to date.
pub fn copy_of(plan: &Plan, id: InstanceId, port: &str, blob: &Blob, outputs: &Path) -> Option<PathBuf> {
    Files::of(plan, outputs).output(id, port, blob)
}

/// The files of `latest/<pipeline>`, for those who show them elsewhere.
pub struct Files<'a> {
    plan: &'a Plan,
    folder: PathBuf,
    links: Links,
    overrides: BTreeMap<StageId, Vec<String>>,
}

impl<'a> Files<'a> {
    pub fn of(plan: &'a Plan, outputs: &Path) -> Self {
        let folder = outputs.join("latest").join(file_name(&plan.spec.pipeline));
        let links = links::read(&folder, &plan.spec.pipeline);
        Self { plan, folder, links, overrides: caption::overrides(plan) }
    }

    /// The file that holds an output of an instance, if it is there and up to date.
    pub fn output(&self, id: InstanceId, port: &str, blob: &Blob) -> Option<PathBuf> {
        let path = format!("{}/{port}.{}", self.place(id), extension(blob.kind));
        self.current(path, &blob.digest.to_string(), Some(blob.bytes))
    }

    /// What the picture of an output is to say, and the picture where there is one that says so.
    pub fn picture(&self, id: InstanceId, key: &Digest, port: &str, blob: &Blob) -> (Caption, Option<PathBuf>) {
        let set = self.overrides.get(&self.plan.stage_of(id)).map_or(&[][..], Vec::as_slice);
        let caption = caption(self.plan, id, key, port, blob, set);
        let path = format!("{}/{port}.png", self.place(id));
        let picture = self.current(path, &fingerprint(&caption), None);
        (caption, picture)
    }

    fn place(&self, id: InstanceId) -> String {
        place(self.plan.stage_name(id), &self.plan.axes_text(id))
    }

    fn current(&self, path: String, content: &str, length: Option<u64>) -> Option<PathBuf> {
        let entry = self.links.get(&path).filter(|entry| entry.content == content)?;
        let path = self.folder.join(path);
        current(entry, &path, length).map(|_| path)
    }
}
