//! The live picture: what a running instance has so far, drawn beside the place of the picture that it will leave.
//!
//! A service to whoever looks on: nothing depends on it, and what cannot be written is left out without a word.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use turbid_contract::Artifact;

use crate::digest::Digest;
use crate::leftover;
use crate::panics::lock;
use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan};
use crate::preview;
use crate::stamp::Stamp;
use crate::whole_file::{self, Synced};

use super::caption;
use super::name::{file_name, place};

/// What the file of a port ends in; no output is called so.
const ENDING: &str = ".partial.png";
/// What a file that is being written begins with.
const PREFIX: &str = ".partial-";
/// Who waits shorter than this needs no picture meanwhile.
const FIRST: Duration = Duration::from_secs(2);
/// Of the time since the last picture, which the next one may take as long as that one did: 1 / 50.
const SHARE: u32 = 50;

/// The pictures of one running instance; they are gone when it is.
pub struct Partial<'a> {
    plan: &'a Plan,
    id: InstanceId,
    key: Digest,
    folder: PathBuf,
    drawn: Mutex<Drawn>,
}

struct Drawn {
    /// When the last picture was there, and how long it took; at first, when the instance began.
    at: Instant,
    took: Duration,
    /// What lies there. Its lock, which an open file holds, tells other runs that this one lives.
    file: Option<(PathBuf, File)>,
}

impl<'a> Partial<'a> {
    /// Below `outputs`, whose owner wants pictures; none of one of many instances. What a killed run left of it goes.
    pub fn of(plan: &'a Plan, id: InstanceId, key: Digest, outputs: &Path) -> Option<Self> {
        if plan.instances_of(plan.stage_of(id)).len() > PREVIEW_INSTANCES {
            return None;
        }
        let pipeline = outputs.join("latest").join(file_name(&plan.spec.pipeline));
        let folder = pipeline.join(place(plan.stage_name(id), &plan.axes_text(id)));
        leftover::sweep_those(&folder, &|name| name.starts_with(PREFIX) || name.ends_with(ENDING));
        let drawn = Mutex::new(Drawn { at: Instant::now(), took: Duration::ZERO, file: None });
        Some(Self { plan, id, key, folder, drawn })
    }

    /// Draws what there is `so_far` of an output, `done` of `total` units of work, unless that would slow the run down.
    pub fn offer(
        &self,
        port: &str,
        (done, total, unit): (f64, Option<f64>, &str),
        so_far: &dyn Fn() -> Option<Artifact>,
    ) {
        let mut drawn = lock(&self.drawn);
        let since = drawn.at.elapsed();
        if since < FIRST || since < SHARE * drawn.took {
            return;
        }
        let began = Instant::now();
        let of = total.map_or_else(String::new, |total| format!(" of {total}"));
        let set = caption::overrides(self.plan).remove(&self.plan.stage_of(self.id)).unwrap_or_default();
        let caption = caption::so_far(self.plan, self.id, &self.key, port, &set, &format!("{done}{of} {unit}"));
        let png = so_far().and_then(|artifact| preview::picture(&artifact, &caption));
        if let Some(written) = png.and_then(|png| self.write(port, &png).ok()) {
            drawn.file = Some(written);
        }
        // Where nothing came of it, too: it took its time.
        (drawn.at, drawn.took) = (Instant::now(), began.elapsed());
    }

    fn write(&self, port: &str, png: &[u8]) -> io::Result<(PathBuf, File)> {
        fs::create_dir_all(&self.folder)?;
        let at = self.folder.join(format!("{port}{ENDING}"));
        let mut file = whole_file::begin(&self.folder, PREFIX)?;
        file.write_all(png)?;
        let held = file.as_file().try_clone()?;
        whole_file::place(file, &at, Synced::No)?;
        Ok((at, held))
    }
}

impl Drop for Partial<'_> {
    fn drop(&mut self) {
        if let Some((at, held)) = lock(&self.drawn).file.take() {
            // That of another run of this pipeline may stand in its place by now.
            let inode = |meta: io::Result<fs::Metadata>| meta.map(|meta| Stamp::of(&meta).inode).ok();
            if inode(held.metadata()).is_some_and(|own| inode(fs::symlink_metadata(&at)) == Some(own)) {
                drop(fs::remove_file(&at));
            }
        }
    }
}

/// Removes the picture that a killed run left of an output, in the folder of its instance.
pub fn sweep(folder: &Path, port: &str) {
    let name = format!("{port}{ENDING}");
    if folder.join(&name).symlink_metadata().is_ok() {
        leftover::sweep_those(folder, &|found| found == name);
    }
}
