//! `turbid export --all`: what all instances hold, in one call: stacked in one file, or as files of a folder.

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use turbid_contract::{Artifact, ArtifactKind, Axes, Cells, Table};

use crate::cli::{Failure, print};
use crate::export::{ExportError, Gathered, Images, Stacks, export, export_bytes};
use crate::plan::{InstanceId, Plan};
use crate::run::latest::file_name;
use crate::store::{Blob, Store, encode, extension};
use crate::whole_file::{self, Synced};

/// So many are read side by side, and are in memory together.
const TOGETHER: usize = 256;
/// The list of the files in a folder.
const LIST: &str = "instances.parquet";

/// The output of all instances that were selected.
pub struct Together<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub port: &'a str,
    pub found: Vec<(InstanceId, Blob)>,
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Self {
        Self::Input(error.to_string())
    }
}

impl Together<'_> {
    /// Writes them to a file, or where `to` is a folder or ends with a separator to files of their own.
    pub fn write(&self, to: &Path) -> Result<(), Failure> {
        if to.is_dir() || to.as_os_str().as_encoded_bytes().last().is_some_and(|&b| std::path::is_separator(b.into())) {
            return self.files(to);
        }
        let kind = self.found.first().expect("a selector names an instance at least").1.kind;
        let written = if kind == ArtifactKind::Images { self.stack(to)? } else { vec![self.gather(to)?] };
        written.iter().for_each(|file| print(&format!("wrote {}", file.display())));
        Ok(())
    }

    /// All artifacts in order, read by all threads, so many at a time.
    fn artifacts(&self) -> impl Iterator<Item = Result<(String, Axes, Artifact), Failure>> + '_ {
        let read = |(id, blob): &(InstanceId, Blob)| {
            let label = self.plan.label(*id);
            let artifact = self.store.get(blob).map_err(|e| Failure::Failed(format!("{label}.{}: {e}", self.port)))?;
            Ok((label, self.plan.values(*id), artifact))
        };
        self.found.chunks(TOGETHER).flat_map(move |some| some.par_iter().map(read).collect::<Vec<_>>())
    }

    fn stack(&self, to: &Path) -> Result<Vec<PathBuf>, Failure> {
        let stacks = self.artifacts().map(|read| match read? {
            (label, values, Artifact::Images(stack)) => Ok(Images { label, values, stack }),
            (label, ..) => unreachable!("{label}: a port holds one kind"),
        });
        Stacks { count: self.found.len(), stacks }.export(to)
    }

    fn gather(&self, to: &Path) -> Result<PathBuf, Failure> {
        let mut all = Gathered::default();
        for read in self.artifacts() {
            let (label, values, artifact) = read?;
            all.add(&label, values, artifact)?;
        }
        let mut table = all.finish();
        if to.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(extension(ArtifactKind::Table))) {
            // Readers that see no metadata of fields see those of the file.
            let units = table.columns.iter().map(|c| (c.name.clone(), c.unit.clone().into())).collect();
            table.attributes.insert("units".to_owned(), serde_json::Value::Object(units));
            export_bytes(&encode(&Artifact::Table(table)).map_err(|e| Failure::Failed(e.to_string()))?, to)?;
        } else {
            export(&Artifact::Table(table), to)?;
        }
        Ok(to.to_owned())
    }

    /// A file of the bytes that the store has for each, and a list that says which is which.
    fn files(&self, folder: &Path) -> Result<(), Failure> {
        let failed = |at: &Path, e: std::io::Error| Failure::Input(format!("{}: cannot be written: {e}", at.display()));
        fs::create_dir_all(folder).map_err(|e| failed(folder, e))?;
        let name = |(id, blob): &(InstanceId, Blob)| {
            let axes = self.plan.axes_text(*id);
            let stem = if axes.is_empty() { self.port.to_owned() } else { file_name(&axes) };
            format!("{stem}.{}", extension(blob.kind))
        };
        let write = |one: &(InstanceId, Blob)| {
            let at = folder.join(name(one));
            let bytes = self.store.bytes(&one.1).map_err(|e| Failure::Failed(e.to_string()))?;
            whole_file::write(&at, ".turbid-export-", &bytes, Synced::No).map_err(|e| failed(&at, e))
        };
        self.found.par_iter().map(write).collect::<Result<Vec<()>, Failure>>()?;
        let mut list = Gathered::default();
        for one in &self.found {
            let mut file = Table::default();
            file.push("file", "", Cells::Text(vec![name(one)]));
            list.add(&self.plan.label(one.0), self.plan.values(one.0), Artifact::Table(file))?;
        }
        let bytes = encode(&Artifact::Table(list.finish())).map_err(|e| Failure::Failed(e.to_string()))?;
        export_bytes(&bytes, &folder.join(LIST))?;
        whole_file::sync_folder(folder).map_err(|e| failed(folder, e))?;
        print(&format!("wrote {} files and {LIST} to {}", self.found.len(), folder.display()));
        Ok(())
    }
}
