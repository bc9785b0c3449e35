//! What is broken: commands, and what was done before them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::program::Place;

/// What is wrong with the store before the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    None,
    /// A bit in each file that holds results; checkpoints are cut short.
    Bits,
    /// A bit in the head of the last record: a run makes it again, and rewrites the packs without the damage.
    LastRecord,
}

/// A command to break.
#[derive(Debug)]
pub struct Scenario {
    pub name: &'static str,
    /// Commands that came before and went well.
    pub before: &'static [&'static [&'static str]],
    pub damage: Damage,
    pub command: &'static [&'static str],
    /// The plain run that comes next.
    pub next: &'static [&'static str],
    /// Whether a second plain run works at the same time.
    pub beside: bool,
    /// A file beside `outputs` that the command writes.
    pub writes: Option<&'static str>,
}

/// Scene, render with checkpoints, demodulate, a table; blobs in packs and one in a file of its own. All have results of their own for other samples.
pub const PIPELINE: &str = "\
pipeline: small
seed: 7
vars: {samples: 16}
stages:
  tissue:
    use: scene
    with:
      media: {m: {A_rho: 50, S_rho: 5000, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [32, 32]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames:
    use: render
    in: {scene: tissue}
    with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\"}
  modulation:
    use: demodulate
    in: {frames: frames, covariance: frames.covariance}
    with: {method: phase_shift, low_signal: 0}
  table:
    use: build_lut
    with: {model: diffusion, f_x: [0, 0.1], mu_a: {logspace: [0.005, 0.5, 3]}, mu_s_prime: {logspace: [0.2, 3, 3]}, g: 0.8, n: 1.0, convention: camera}
";
pub const STAGES: [&str; 4] = ["tissue", "frames", "modulation", "table"];

const RUN: &[&str] = &["run", "p.yaml", "--json", "-j", "1"];
/// The cheapest stage alone.
const TABLE: &[&str] = &["run", "p.yaml", "table", "--json", "-j", "1"];
const LONGER: &[&str] = &["run", "p.yaml", "--json", "-j", "1", "--set", "vars.samples=64"];
const SHORTER: &[&str] = &["run", "p.yaml", "--json", "-j", "1", "--set", "vars.samples=8"];
pub const REPAIR: &[&str] = &["cache", "verify", "--repair"];
const PLAIN: Scenario =
    Scenario { name: "fresh", before: &[], damage: Damage::None, command: RUN, next: RUN, beside: false, writes: None };

pub const SCENARIOS: [Scenario; 10] = [
    PLAIN,
    Scenario { name: "table", command: TABLE, next: TABLE, ..PLAIN },
    Scenario { name: "continue", before: &[RUN], command: LONGER, next: LONGER, ..PLAIN },
    Scenario { name: "up-to-date", before: &[RUN], ..PLAIN },
    Scenario { name: "repair", before: &[RUN], damage: Damage::Bits, command: REPAIR, ..PLAIN },
    Scenario { name: "gather", before: &[RUN], damage: Damage::LastRecord, ..PLAIN },
    Scenario {
        name: "gc",
        before: &[SHORTER, RUN],
        command: &["cache", "gc", "--max-size", "350kB"],
        next: SHORTER,
        ..PLAIN
    },
    Scenario {
        name: "export",
        before: &[RUN, &["export", "p.yaml", "modulation.modulation", "--to", "exported.npz"]],
        command: &["export", "p.yaml", "frames.frames", "--to", "exported.npz"],
        writes: Some("exported.npz"),
        ..PLAIN
    },
    Scenario { name: "beside", beside: true, ..PLAIN },
    Scenario {
        name: "force",
        before: &[RUN],
        command: &["run", "p.yaml", "--json", "-j", "1", "--force", "frames"],
        ..PLAIN
    },
];

impl Scenario {
    /// Whether the command promises that nothing damaged is left.
    pub fn repairs(&self) -> bool {
        self.command == REPAIR
    }

    pub fn named(name: &str) -> Option<&'static Self> {
        SCENARIOS.iter().find(|scenario| scenario.name == name)
    }

    /// Makes what was there before the command.
    pub fn prepare(&self, program: &Path, place: &Place) -> io::Result<()> {
        fs::write(place.work().join("p.yaml"), PIPELINE)?;
        for arguments in self.before {
            let done = place.run(program, arguments, "before")?;
            if done.code != Some(0) {
                return Err(io::Error::other(format!("{}: {}", arguments.join(" "), done.last_words())));
            }
        }
        let store = place.outputs().join("store");
        match self.damage {
            Damage::None => Ok(()),
            Damage::Bits => flip_bits(&store),
            Damage::LastRecord => flip_last_record(&store),
        }
    }
}

/// Flips a bit two thirds into every file of the store that holds results, and cuts the checkpoints short.
fn flip_bits(store: &Path) -> io::Result<()> {
    for path in super::folder::files(store).into_iter().map(|path| store.join(path)) {
        let kind = path.strip_prefix(store).ok().and_then(|p| p.iter().next()).map(PathBuf::from).unwrap_or_default();
        let mut bytes = fs::read(&path)?;
        if bytes.is_empty() || !["blobs", "packs", "checkpoints"].iter().any(|known| kind == Path::new(known)) {
            continue;
        }
        let at = bytes.len() * 2 / 3;
        bytes[at] ^= 4;
        if kind == Path::new("checkpoints") {
            bytes.truncate(at);
        }
        overwrite(&path, &bytes)?;
    }
    Ok(())
}

/// Entries of packs begin with these bytes and their kind (1: a record); 88 bytes on is what they hold (docs/store.md).
fn flip_last_record(store: &Path) -> io::Result<()> {
    for path in super::folder::files(&store.join("packs")).into_iter().map(|path| store.join("packs").join(path)) {
        let mut bytes = fs::read(&path)?;
        if let Some(at) = bytes.windows(5).rposition(|window| window == b"TFr1\x01") {
            bytes[at + 88 + 4] ^= 1;
            overwrite(&path, &bytes)?;
        }
    }
    // What notes that all is up to date is a way around the record.
    fs::remove_dir_all(store.join("memos"))
}

fn overwrite(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let rights = fs::metadata(path)?.permissions();
    fs::remove_file(path)?;
    fs::write(path, bytes)?;
    fs::set_permissions(path, rights)
}
