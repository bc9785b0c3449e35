//! `cache verify` and `cache stat`: what is in the store, and whether it is what it should be.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::path::PathBuf;

use serde::Serialize;

use crate::digest::Digest;
use crate::store::backend::Backend;
use crate::store::error::StoreError;
use crate::store::frame::Kind;
use crate::store::record::{Blob, InstanceRecord};
use crate::store::{Store, disk, index, odd};

/// What is in the store. Bytes are those of files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stat {
    pub records: u64,
    pub packed_blobs: u64,
    pub loose_blobs: u64,
    pub loose_bytes: u64,
    pub packs: u64,
    pub pack_bytes: u64,
    pub checkpoints: u64,
    pub checkpoint_bytes: u64,
    pub quarantined: u64,
    pub quarantine_bytes: u64,
    /// Files that are being written, or that a killed process was writing: those the next run removes.
    pub temporary: u64,
    pub temporary_bytes: u64,
    pub bytes: u64,
}

/// Something that is not as it should be; the next run heals all of it by computing what is missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Finding {
    /// The bytes of a blob have another digest.
    DamagedBlob {
        digest: Digest,
    },
    /// A record whose checksum is wrong.
    DamagedRecord {
        key: Digest,
    },
    /// A record names a blob that is not there in full length.
    MissingBlob {
        digest: Digest,
        stage: String,
        port: String,
    },
    DamagedCheckpoint {
        path: PathBuf,
    },
    /// Bytes between the frames of a pack: an entry whose header is damaged, or a write that was cut short.
    DamagedPack {
        name: String,
        bytes: u64,
    },
    /// The index named entries that no pack holds any more.
    LostEntries {
        entries: u64,
    },
    DamagedIndex,
    /// A folder, a link to nothing, a pipe, .. in the place of a file, a file in the place of a folder, or a pack that cannot
    /// be opened or read.
    Odd {
        path: PathBuf,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DamagedBlob { digest } => write!(f, "blob {}: its bytes have another digest", digest.short()),
            Self::DamagedRecord { key } => write!(f, "record {}: wrong checksum", key.short()),
            Self::MissingBlob { digest, stage, port } => {
                write!(f, "blob {} of {stage}.{port} is missing or too short", digest.short())
            }
            Self::DamagedCheckpoint { path } => write!(f, "checkpoint {}: wrong checksum", path.display()),
            Self::DamagedPack { name, bytes } => write!(f, "pack {name}: {bytes} bytes belong to no entry"),
            Self::LostEntries { entries } => write!(f, "{entries} entries of the index are in no pack"),
            Self::DamagedIndex => f.write_str("the index is damaged (it is only a cache)"),
            Self::Odd { path } => {
                write!(f, "{}: not what the store keeps under that name, or it cannot be read", path.display())
            }
        }
    }
}

/// What `verify` read, and what it found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct VerifyReport {
    pub records: u64,
    pub blobs: u64,
    pub checkpoints: u64,
    /// Bytes of the blobs.
    pub bytes: u64,
    pub findings: Vec<Finding>,
    /// Whether what was found has been removed from the store; a second look has found nothing any more.
    pub repaired: bool,
}

impl VerifyReport {
    pub fn is_clean(&self) -> bool {
        self.findings.is_empty()
    }
}

impl Store {
    /// Reads everything and compares it with its digests and checksums.
    ///
    /// Damaged blobs go to quarantine in any case, so that the next run computes them anew, and damaged pieces of packs
    /// are left behind when the store is closed (if no other process uses it). `repair` also forgets the records
    /// whose blobs are gone, sets aside damaged checkpoints and whatever is in the way, and rewrites the packs, so that
    /// the next `verify` is clean even before a run: it looks a second time.
    ///
    /// Errors of a repair: what it could not do (a full disk; [`StoreError::Busy`] where packs are damaged and a run is at
    /// work; [`StoreError::NoLocks`]), or [`StoreError::NotRepaired`].
    pub fn verify(&self, repair: bool) -> Result<VerifyReport, StoreError> {
        let (mut report, unfit) = self.look()?;
        if repair && !self.read_only && !report.is_clean() {
            self.repair(&report, &unfit)?;
            let left = Self::at(self.root.clone(), true)?.look()?.0.findings;
            if !left.is_empty() {
                let left = left.iter().map(Finding::to_string).collect();
                return Err(StoreError::NotRepaired { path: self.root.clone(), left });
            }
            report.repaired = true;
        }
        Ok(report)
    }

    fn repair(&self, report: &VerifyReport, unfit: &BTreeSet<Digest>) -> Result<(), StoreError> {
        for finding in &report.findings {
            if let Finding::Odd { path } | Finding::DamagedCheckpoint { path } = finding {
                odd::set_aside(&self.root, path).map_err(StoreError::io("move to quarantine", path))?;
            }
        }
        unfit.iter().try_for_each(|key| self.folder.packs.append(Kind::ForgetRecord, key, &[]))?;
        self.folder.packs.finish()?;
        if self.folder.packs.wants_gathering() {
            self.gather_packs()?;
        }
        self.folder.packs.save_index()
    }

    /// What is there and what is wrong with it, and the records that no run can use.
    fn look(&self) -> Result<(VerifyReport, BTreeSet<Digest>), StoreError> {
        let mut report = VerifyReport::default();
        if !self.read_only {
            self.begin_use(&|| false)?;
        }
        report.findings.extend(odd::all(&self.root).into_iter().map(|path| Finding::Odd { path }));
        let is_damaged = |bytes: Vec<u8>| index::decode(&bytes).is_none() && !index::is_of_another_format(&bytes);
        if disk::read_regular(&self.root.join("index")).is_ok_and(is_damaged) {
            report.findings.push(Finding::DamagedIndex);
        }
        match self.folder.packs.lost() {
            0 => {}
            entries => report.findings.push(Finding::LostEntries { entries }),
        }
        for (name, garbage) in self.folder.packs.garbage() {
            report.findings.push(match garbage {
                Some(bytes) => {
                    self.folder.packs.note_damage();
                    Finding::DamagedPack { name, bytes }
                }
                None => Finding::Odd { path: self.root.join("packs").join(name) },
            });
        }

        let mut records = Vec::new();
        let mut unfit = BTreeSet::new();
        for (key, _) in self.folder.packs.records() {
            match self.folder.record(&key).and_then(|bytes| InstanceRecord::decode(&key, &bytes)) {
                Some((record, _)) => records.push(record),
                None => {
                    report.findings.push(Finding::DamagedRecord { key });
                    unfit.insert(key);
                }
            }
        }
        report.records = records.len() as u64;
        self.verify_blobs(&records, &mut report)?;
        for record in &records {
            for (port, held) in &record.ports {
                if !self.folder.holds(&held.blob) || report.found_damaged(&held.blob.digest) {
                    let (stage, port) = (record.provenance.stage.clone(), port.clone());
                    report.findings.push(Finding::MissingBlob { digest: held.blob.digest, stage, port });
                    unfit.insert(record.key);
                }
            }
        }
        for checkpoint in self.checkpoints.all() {
            report.checkpoints += 1;
            if !checkpoint.is_whole() {
                report.findings.push(Finding::DamagedCheckpoint { path: checkpoint.path });
            }
        }
        Ok((report, unfit))
    }

    /// Reads every blob, packed or loose; sets the damaged ones aside.
    fn verify_blobs(&self, records: &[InstanceRecord], report: &mut VerifyReport) -> Result<(), StoreError> {
        let named: BTreeMap<Digest, Blob> =
            records.iter().flat_map(InstanceRecord::blobs).map(|blob| (blob.digest, *blob)).collect();
        let packs = &self.folder.packs;
        for (digest, place) in packs.blobs() {
            report.blobs += 1;
            report.bytes += place.length;
            if packs.blob(&digest).is_none_or(|bytes| Digest::of(&bytes) != digest) {
                report.findings.push(Finding::DamagedBlob { digest });
                if !self.read_only {
                    // A blob that no record names has no kind; it is only forgotten.
                    match named.get(&digest) {
                        Some(blob) => self.folder.quarantine(blob)?,
                        None => packs.append(Kind::ForgetBlob, &digest, &[])?,
                    }
                }
            }
        }
        for (digest, path, bytes) in self.folder.loose() {
            report.blobs += 1;
            report.bytes += bytes;
            if hash_file(&path).ok() != Some(digest) {
                report.findings.push(Finding::DamagedBlob { digest });
                if !self.read_only {
                    self.folder.set_aside(&path)?;
                }
            }
        }
        Ok(())
    }

    /// Counts what is in the store.
    pub fn stat(&self) -> Stat {
        let loose = self.folder.loose();
        let checkpoints = self.checkpoints.all();
        let quarantine: Vec<u64> = fs::read_dir(self.root.join("quarantine"))
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.metadata().map_or(0, |m| m.len()))
            .collect();
        let temporary: Vec<u64> = fs::read_dir(self.root.join("tmp"))
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.metadata().map_or(0, |m| m.len()))
            .collect();
        let (packs, pack_bytes) = self.folder.packs.size();
        let mut stat = Stat {
            records: self.folder.packs.records().len() as u64,
            packed_blobs: self.folder.packs.blobs().len() as u64,
            loose_blobs: loose.len() as u64,
            loose_bytes: loose.iter().map(|(_, _, bytes)| bytes).sum(),
            packs: packs as u64,
            pack_bytes,
            checkpoints: checkpoints.len() as u64,
            checkpoint_bytes: checkpoints.iter().map(|c| c.bytes).sum(),
            quarantined: quarantine.len() as u64,
            quarantine_bytes: quarantine.iter().sum(),
            temporary: temporary.len() as u64,
            temporary_bytes: temporary.iter().sum(),
            bytes: 0,
        };
        let index = fs::metadata(self.root.join("index")).map_or(0, |m| m.len());
        stat.bytes = stat.loose_bytes
            + stat.pack_bytes
            + stat.checkpoint_bytes
            + stat.quarantine_bytes
            + stat.temporary_bytes
            + index;
        stat
    }
}

impl VerifyReport {
    fn found_damaged(&self, wanted: &Digest) -> bool {
        self.findings.iter().any(|f| matches!(f, Finding::DamagedBlob { digest } if digest == wanted))
    }
}

/// Digest of a file without holding it in memory.
fn hash_file(path: &std::path::Path) -> std::io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(disk::open_regular(path)?)?;
    Ok(Digest(*hasher.finalize().as_bytes()))
}
