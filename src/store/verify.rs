//! `cache verify` and `cache stat`: what is in the store, and whether it is what it should be.

use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::digest::Digest;
use crate::store::backend::Backend;
use crate::store::error::StoreError;
use crate::store::frame::Kind;
use crate::store::record::{Blob, InstanceRecord};
use crate::store::{Store, disk, odd, remote, saved, sorted};

/// What is in the store. Bytes are those of files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stat {
    pub records: u64,
    pub packed_blobs: u64,
    pub loose_blobs: u64,
    pub loose_bytes: u64,
    /// Blobs whose bytes were given back on purpose.
    pub released_blobs: u64,
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
    /// A folder, a link to nothing, a pipe, .. in the place of a file, a file in the place of a folder, or a pack that is
    /// longer than any.
    Odd {
        path: PathBuf,
    },
    /// The operating system did not let it be read. That says nothing of what is there: it is left alone.
    Unread {
        path: PathBuf,
        error: String,
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
                write!(f, "{}: not what the store keeps under that name", path.display())
            }
            Self::Unread { path, error } => write!(f, "{}: could not be read: {error}", path.display()),
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
    /// Blobs that records name and whose bytes were given back on purpose: no finding.
    pub released: u64,
    /// Blobs that records name and that are in a store elsewhere alone: no finding.
    pub elsewhere: u64,
    pub findings: Vec<Finding>,
    /// Whether what was found has been removed from the store; a second look has found nothing any more.
    pub repaired: bool,
}

impl VerifyReport {
    pub fn is_clean(&self) -> bool {
        self.findings.is_empty()
    }
}

/// So often a repair writes the packs anew if a second look still finds something.
const REWRITINGS: usize = 3;

impl Store {
    /// Reads everything and compares it with its digests and checksums.
    ///
    /// Damaged blobs go to quarantine in any case, so that the next run computes them anew, and damaged pieces of packs
    /// are left behind when the store is closed (if no other process uses it). `repair` also forgets the records
    /// whose blobs are gone, sets aside damaged checkpoints and whatever is in the way, and rewrites the packs, so that
    /// the next `verify` is clean even before a run: it looks a second time. Where something could not be read
    /// ([`Finding::Unread`]) nothing is repaired: what is there may be right.
    ///
    /// Errors of a repair: what it could not do (a full disk; [`StoreError::Busy`] where packs are damaged and a run is at
    /// work; [`StoreError::NoLocks`]; [`StoreError::OtherMachines`]), or [`StoreError::NotRepaired`].
    pub fn verify(&self, repair: bool) -> Result<VerifyReport, StoreError> {
        let (mut report, unfit) = self.look()?;
        if !repair || self.read_only || report.is_clean() || report.unread().next().is_some() {
            return Ok(report);
        }
        self.repair(&report, &unfit, self.folder.packs.wants_gathering())?;
        let look_again = || Self::at(self.root.clone(), true, false)?.look();
        let (mut left, mut unfit) = look_again()?;
        // Older entries may have come to hold, or newer ones not to: only rewriting ends that.
        for _ in 0..REWRITINGS {
            if left.is_clean() || left.unread().next().is_some() {
                break;
            }
            self.repair(&left, &unfit, true)?;
            (left, unfit) = look_again()?;
        }
        if !left.is_clean() {
            let left = left.findings.iter().map(Finding::to_string).collect();
            return Err(StoreError::NotRepaired { path: self.root.clone(), left });
        }
        report.repaired = true;
        Ok(report)
    }

    fn repair(&self, report: &VerifyReport, unfit: &BTreeSet<Digest>, rewrite: bool) -> Result<(), StoreError> {
        for finding in &report.findings {
            if let Finding::Odd { path } | Finding::DamagedCheckpoint { path } = finding {
                odd::set_aside(&self.root, path).map_err(StoreError::io("move to quarantine", path))?;
            }
        }
        unfit.iter().try_for_each(|key| self.folder.packs.append(Kind::ForgetRecord, key, &[]))?;
        self.folder.packs.finish()?;
        if rewrite || self.folder.packs.wants_gathering() {
            self.gather_packs(unfit)?;
        }
        self.folder.packs.save_index()
    }

    /// What is there and what is wrong with it, and the records that no run can use.
    fn look(&self) -> Result<(VerifyReport, BTreeSet<Digest>), StoreError> {
        let mut report = VerifyReport::default();
        if !self.read_only {
            self.begin_use(&|| false)?;
        }
        self.verify_names(&mut report);
        self.verify_packs(&mut report);
        let (records, mut unfit) = self.verify_records(&mut report);
        self.verify_blobs(&records, &mut report)?;
        // Where the index was found damaged meanwhile.
        self.verify_all_was_read(&mut report);
        // Where something could not be read, what is missing may be there.
        if report.unread().next().is_none() {
            unfit.extend(self.find_missing(&records, &mut report)?);
        }
        for checkpoint in self.checkpoints.all()? {
            report.checkpoints += 1;
            match checkpoint.is_whole() {
                Ok(true) => {}
                Ok(false) => report.findings.push(Finding::DamagedCheckpoint { path: checkpoint.path }),
                Err(error) => report.found_unread(checkpoint.path, &error),
            }
        }
        Ok((report, unfit))
    }

    /// Looks at the names in the folder, and at the index.
    fn verify_names(&self, report: &mut VerifyReport) {
        let found = odd::all(&self.root);
        report.findings.extend(found.odd.into_iter().map(|path| Finding::Odd { path }));
        found.unread.into_iter().for_each(|(path, error)| report.found_unread(path, &error));
        for path in saved::paths(&self.root).unwrap_or_default() {
            match sorted::is_sound(&path) {
                Ok(true) => {}
                Ok(false) if report.findings.contains(&Finding::DamagedIndex) => {}
                Ok(false) => report.findings.push(Finding::DamagedIndex),
                Err(error) if !disk::is_absent(&error) && error.kind() != io::ErrorKind::InvalidInput => {
                    report.found_unread(path, &error);
                }
                Err(_) => {}
            }
        }
    }

    /// Says what of the packs could not be read so far.
    fn verify_all_was_read(&self, report: &mut VerifyReport) {
        let unread = self.folder.packs.unread().into_iter().map(|(path, error)| Finding::Unread { path, error });
        let fresh: Vec<Finding> = unread.filter(|finding| !report.findings.contains(finding)).collect();
        report.findings.extend(fresh);
    }

    /// Reads every pack from end to end.
    fn verify_packs(&self, report: &mut VerifyReport) {
        let packs = &self.folder.packs;
        match packs.lost() {
            0 => {}
            entries => report.findings.push(Finding::LostEntries { entries }),
        }
        self.verify_all_was_read(report);
        for (path, garbage) in packs.garbage() {
            match garbage {
                Ok(bytes) => {
                    packs.note_damage();
                    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    report.findings.push(Finding::DamagedPack { name, bytes });
                }
                Err(error) if error.kind() == io::ErrorKind::FileTooLarge => {
                    report.findings.push(Finding::Odd { path })
                }
                Err(error) => report.found_unread(path, &error),
            }
        }
    }

    /// All records, and the keys of the damaged ones.
    fn verify_records(&self, report: &mut VerifyReport) -> (Vec<InstanceRecord>, BTreeSet<Digest>) {
        let (mut records, mut damaged) = (Vec::new(), BTreeSet::new());
        for (key, _) in self.folder.packs.records() {
            match self.folder.packs.record(&key) {
                Err(error) => report.found_unread(self.root.join("packs"), &error),
                Ok(bytes) => match bytes.and_then(|bytes| InstanceRecord::decode(&key, &bytes)) {
                    Some((record, _)) => records.push(record),
                    None => {
                        report.findings.push(Finding::DamagedRecord { key });
                        damaged.insert(key);
                    }
                },
            }
        }
        report.records = records.len() as u64;
        (records, damaged)
    }

    /// The records whose blobs are not all there.
    fn find_missing(
        &self,
        records: &[InstanceRecord],
        report: &mut VerifyReport,
    ) -> Result<BTreeSet<Digest>, StoreError> {
        let (mut unfit, mut released, mut elsewhere) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        let kept_elsewhere = OnceCell::new();
        for record in records {
            for (port, held) in &record.ports {
                if self.is_released(&held.blob) {
                    released.insert(held.blob.digest);
                } else if !self.folder.holds(&held.blob)? || report.found_damaged(&held.blob.digest) {
                    if kept_elsewhere.get_or_init(|| remote::kept_elsewhere(&self.root))(&held.blob) {
                        elsewhere.insert(held.blob.digest);
                        continue;
                    }
                    let (stage, port) = (record.provenance.stage.clone(), port.clone());
                    report.findings.push(Finding::MissingBlob { digest: held.blob.digest, stage, port });
                    unfit.insert(record.key);
                }
            }
        }
        report.released = released.len() as u64;
        report.elsewhere = elsewhere.len() as u64;
        Ok(unfit)
    }

    /// Reads every blob, packed or loose; sets aside those that were read and are damaged.
    fn verify_blobs(&self, records: &[InstanceRecord], report: &mut VerifyReport) -> Result<(), StoreError> {
        let named: BTreeMap<Digest, Blob> =
            records.iter().flat_map(InstanceRecord::blobs).map(|blob| (blob.digest, *blob)).collect();
        let packs = &self.folder.packs;
        for (digest, place) in packs.blobs() {
            report.blobs += 1;
            report.bytes += u64::from(place.length);
            match packs.blob(&digest) {
                Err(error) => report.found_unread(self.root.join("packs"), &error),
                Ok(Some(bytes)) if Digest::of(&bytes) == digest => {}
                Ok(_) => {
                    report.findings.push(Finding::DamagedBlob { digest });
                    // A blob that no record names has no kind; it is only forgotten.
                    match named.get(&digest) {
                        _ if self.read_only => {}
                        Some(blob) => self.folder.quarantine(blob)?,
                        None => packs.append(Kind::ForgetBlob, &digest, &[])?,
                    }
                }
            }
        }
        for (digest, path, bytes) in self.folder.loose()? {
            report.blobs += 1;
            report.bytes += bytes;
            match hash_file(&path) {
                Ok(found) if found == digest => {}
                Err(error) if !disk::is_absent(&error) => report.found_unread(path, &error),
                _ => {
                    report.findings.push(Finding::DamagedBlob { digest });
                    if !self.read_only {
                        self.folder.set_aside(&path)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Counts what is in the store. Error: some of it cannot be looked at.
    pub fn stat(&self) -> Result<Stat, StoreError> {
        let loose = self.folder.loose()?;
        let checkpoints = self.checkpoints.all()?;
        let quarantine = self.lengths("quarantine")?;
        let temporary = self.lengths("tmp")?;
        let (packs, pack_bytes) = self.folder.packs.size();
        let counts = self.folder.packs.counts();
        let mut stat = Stat {
            records: counts.records,
            packed_blobs: counts.blobs,
            loose_blobs: loose.len() as u64,
            loose_bytes: loose.iter().map(|(_, _, bytes)| bytes).sum(),
            released_blobs: counts.released,
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
        stat.bytes = stat.loose_bytes
            + stat.pack_bytes
            + stat.checkpoint_bytes
            + stat.quarantine_bytes
            + stat.temporary_bytes
            + saved::bytes(&self.root);
        Ok(stat)
    }

    /// The lengths of what is in a folder.
    fn lengths(&self, folder: &str) -> Result<Vec<u64>, StoreError> {
        let folder = self.root.join(folder);
        let length = |path: PathBuf| Ok(disk::look_at_link(&path)?.map_or(0, |meta| meta.len()));
        disk::list(&folder)
            .and_then(|paths| paths.into_iter().map(length).collect())
            .map_err(StoreError::io("read the store", &folder))
    }
}

impl VerifyReport {
    /// What could not be read.
    pub fn unread(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| matches!(finding, Finding::Unread { .. }))
    }

    fn found_unread(&mut self, path: PathBuf, error: &io::Error) {
        let finding = Finding::Unread { path, error: error.to_string() };
        // Once for all entries of the packs.
        if !self.findings.contains(&finding) {
            self.findings.push(finding);
        }
    }

    fn found_damaged(&self, wanted: &Digest) -> bool {
        self.findings.iter().any(|f| matches!(f, Finding::DamagedBlob { digest } if digest == wanted))
    }
}

/// Digest of a file without holding it in memory.
fn hash_file(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(disk::open_regular(path)?)?;
    Ok(Digest(*hasher.finalize().as_bytes()))
}
