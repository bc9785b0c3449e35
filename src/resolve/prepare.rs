//! The params of an instance, read once, and its key with everything behind it.

use std::collections::BTreeMap;

use turbid_contract::{Axes, FileUse};

use super::{AllOutputs, InputFile, Keyed, Prepared, Resolver};
use crate::key::{Dependencies, InputContent, instance_seed};
use crate::plan::InstanceId;
use crate::spec::{Diagnostic, Kind, Mistake, Section, StageId, read_params};

impl Resolver<'_> {
    /// The params of an instance, or every mistake in them.
    pub fn prepare(&self, id: InstanceId) -> Result<Prepared, Vec<Diagnostic>> {
        let stage = self.plan.stage_of(id);
        let params = self.plan.spec.params(stage, &self.plan.values(id))?;
        let (job, errors) = read_params(self.plan.row(stage), &params);
        match job {
            Some(job) if errors.is_empty() => match job.canonical() {
                Ok(canonical) => Ok(Prepared { params, job, canonical }),
                Err(message) => {
                    let path: [&str; 0] = [];
                    Err(vec![self.plan.spec.diagnostic(stage, Section::With, &path, message, None)])
                }
            },
            _ => Err(errors
                .into_iter()
                .map(|e| self.plan.spec.diagnostic(stage, Section::With, &e.path, e.mistake, None))
                .collect()),
        }
    }

    /// Key and everything behind it; the inputs must be there.
    pub fn keyed(&self, id: InstanceId, outputs: &AllOutputs) -> Result<Keyed, Vec<Diagnostic>> {
        let stage = self.plan.stage_of(id);
        let row = self.plan.row(stage);
        let Prepared { params, job, canonical } = self.prepare(id)?;
        let digest_of = |(source, port): &(InstanceId, &str)| {
            outputs[*source].as_ref().and_then(|o| o.get(port)).expect("the inputs are there").digest
        };
        let inputs: Vec<(String, InputContent)> = self
            .plan
            .wires(id)
            .iter()
            .map(|wire| {
                let axes = |id: InstanceId| if wire.many { self.plan.values(id) } else { Axes::new() };
                let content = wire.from.iter().map(|from| (axes(from.0), digest_of(from))).collect();
                (wire.port.to_owned(), content)
            })
            .collect();
        let files = self.input_files(stage, &job.files())?;
        let explicit = self.plan.spec.stages[stage].seed;
        let drawn = || instance_seed(self.plan.spec.seed, row.name, &self.plan.axes_text(id), &inputs, explicit);
        // What is not in the key reaches no stage.
        let seed = job.draws().then(drawn);
        let dependencies = Dependencies {
            use_name: row.name.to_owned(),
            version: row.version,
            params: canonical,
            inputs,
            files: files
                .iter()
                .map(|(at, file)| {
                    let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    (at.clone(), name, file.digest)
                })
                .collect(),
            seed,
        };
        let state_key = dependencies.state_key(row.stopping);
        Ok(Keyed { params, job, key: dependencies.key(), state_key, dependencies, seed: seed.unwrap_or(0), files })
    }

    pub(super) fn input_files(
        &self,
        stage: StageId,
        files: &[FileUse],
    ) -> Result<BTreeMap<String, InputFile>, Vec<Diagnostic>> {
        let read = |file: &FileUse| {
            let input = self.file(stage, file).map_err(|d| vec![*d])?;
            Ok((file.at.clone(), input))
        };
        files.iter().map(read).collect()
    }

    /// Hashes an input file once; one that is missing, none or too large is the user's mistake.
    fn file(&self, stage: StageId, file: &FileUse) -> Result<InputFile, Box<Diagnostic>> {
        let path = self.plan.spec.input_file_base(stage, &file.at).join(&file.path);
        match self.files.digest(&path, file.most) {
            Ok(digest) => Ok(InputFile { path, digest, most: file.most }),
            Err((message, hint)) => {
                let at: Vec<&str> = file.at.split('.').collect();
                let mistake = Mistake::new(Kind::File, message);
                Err(Box::new(self.plan.spec.diagnostic(stage, Section::With, &at, mistake, hint)))
            }
        }
    }
}
