//! `turbid cache`: how big the store is, whether it is sound, what it holds, making room, and stores elsewhere.

mod ship;

use clap::{Args, Subcommand};

use crate::registry::Registry;
use crate::run::log::roots;
use crate::store::{Stat, Store};

use super::{Done, Failure, OutputsDir, print, print_json};
use ship::{Ship, Way};

#[derive(Args)]
pub struct Cache {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    outputs: OutputsDir,
}

#[derive(Subcommand)]
enum Command {
    /// How many results the store holds and how big it is
    Stat {
        #[arg(long)]
        json: bool,
    },
    /// Read everything and compare it with its digest
    Verify {
        /// Move damaged pieces to quarantine, so that the next run makes them again
        #[arg(long)]
        repair: bool,
        /// No other machine uses the store: a repair may rewrite packs on a network file system too
        #[arg(long, requires = "repair")]
        exclusive: bool,
        #[arg(long)]
        json: bool,
    },
    /// Print the sorted digests of all blobs
    Digests,
    /// Remove the least recently used results until the store is small enough
    Gc {
        /// For example 500MB or 20GB
        #[arg(long, value_name = "SIZE", value_parser = parse_size)]
        max_size: u64,
        /// No other machine uses the store: make room on a network file system too
        #[arg(long)]
        exclusive: bool,
        #[arg(long)]
        json: bool,
    },
    /// Send to a store elsewhere what it lacks
    Push(Ship),
    /// Bring from a store elsewhere what is missing here
    Pull(Ship),
    /// Pull, then push
    Sync(Ship),
}

impl Cache {
    pub fn run(&self, registry: &Registry) -> Done {
        let outputs = self.outputs.path();
        let fail = |e: crate::store::StoreError| Failure::Failed(e.to_string());
        match &self.command {
            Command::Stat { json } => {
                let stat = self.outputs.store_to_read()?.stat().map_err(fail)?;
                if *json {
                    print_json(&to_json(&stat));
                } else {
                    print(&stat_text(&stat));
                }
            }
            Command::Verify { repair, exclusive, json } => {
                let store = if *repair { self.store_to_write(*exclusive)? } else { self.outputs.store_to_read()? };
                let report = store.verify(*repair).map_err(fail)?;
                if *json {
                    print_json(&to_json(&report));
                } else if report.is_clean() {
                    let more = released_text(report.released) + &elsewhere_text(report.elsewhere);
                    print(&format!("{} records and {} blobs read, all sound{more}", report.records, report.blobs));
                } else {
                    report.findings.iter().for_each(|finding| print(&finding.to_string()));
                    print(if report.repaired {
                        "repaired; the next run makes again what is missing"
                    } else if report.unread().next().is_some() {
                        "what could not be read was left as it is; try again, and if it stays so, remove these files: the next run \
                         makes again what was in them"
                    } else {
                        "`turbid cache verify --repair` cleans up; the next run makes again what is missing"
                    });
                }
                if !report.is_clean() && !report.repaired {
                    return Err(Failure::Said);
                }
            }
            Command::Push(ship) => ship.run(Way::Push, &self.outputs, registry)?,
            Command::Pull(ship) => ship.run(Way::Pull, &self.outputs, registry)?,
            Command::Sync(ship) => ship.run(Way::Both, &self.outputs, registry)?,
            Command::Digests => {
                let store = self.outputs.store_to_read()?;
                let digests = store.digests();
                if let Some(error) = store.unread() {
                    return Err(Failure::Failed(error));
                }
                print(&digests.iter().map(|d| format!("{d}\n")).collect::<String>());
            }
            Command::Gc { max_size, exclusive, json } => {
                let store = self.store_to_write(*exclusive)?;
                let roots = roots(outputs).map_err(Failure::Failed)?;
                let report = store.gc(*max_size, &roots).map_err(fail)?;
                if *json {
                    print_json(&to_json(&report));
                } else {
                    print(&format!(
                        "removed {} results, freed {}, {} left",
                        report.records_removed,
                        size_text(report.bytes_before.saturating_sub(report.bytes_after)),
                        size_text(report.bytes_after)
                    ));
                }
            }
        }
        Ok(())
    }

    fn store_to_write(&self, exclusive: bool) -> Result<Store, Failure> {
        let store = Store::open(self.outputs.path()).map_err(|e| Failure::Input(e.to_string()))?;
        Ok(if exclusive { store.without_other_machines() } else { store })
    }
}

fn to_json(report: &impl serde::Serialize) -> String {
    serde_json::to_string(report).expect("reports are plain data")
}

fn stat_text(stat: &Stat) -> String {
    let blobs = stat.packed_blobs + stat.loose_blobs;
    let mut text = format!("{} results, {blobs} blobs, {}", stat.records, size_text(stat.bytes));
    text.push_str(&released_text(stat.released_blobs));
    if stat.temporary > 0 {
        text.push_str(&format!(
            "\nof these {} in {} temporary files: those of runs at work, and of killed ones, which the next run removes",
            size_text(stat.temporary_bytes),
            stat.temporary
        ));
    }
    text
}

/// `; 12 more are released: ..`, or nothing.
fn released_text(released: u64) -> String {
    match released {
        0 => String::new(),
        n => format!("; {n} more are released: a data set holds what they held, and who needs them makes them again"),
    }
}

/// `; 12 more are elsewhere: ..`, or nothing.
fn elsewhere_text(elsewhere: u64) -> String {
    match elsewhere {
        0 => String::new(),
        n => format!(
            "; {n} more are in a store elsewhere: `--store` brings them when they are read, `cache pull` at once"
        ),
    }
}

pub(super) fn size_text(bytes: u64) -> String {
    let units = [("GB", 1e9), ("MB", 1e6), ("kB", 1e3)];
    match units.iter().find(|(_, size)| bytes as f64 >= *size) {
        Some((unit, size)) => format!("{:.1} {unit}", bytes as f64 / size),
        None => format!("{bytes} bytes"),
    }
}

/// `500MB`, `20 GB`, `1GiB`, or plain bytes.
pub(super) fn parse_size(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let number: f64 = text[..split].parse().map_err(|_| format!("`{text}` is not a size; write for example 500MB"))?;
    let factor = match text[split..].trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "kb" | "k" => 1e3,
        "mb" | "m" => 1e6,
        "gb" | "g" => 1e9,
        "tb" | "t" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        unit => return Err(format!("unit `{unit}` is not known; write kB, MB, GB or TB")),
    };
    Ok((number * factor) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temporary_files_are_told() {
        let stat = Stat { records: 2, packed_blobs: 3, bytes: 5000, ..Stat::default() };
        assert_eq!(stat_text(&stat), "2 results, 3 blobs, 5.0 kB");
        let text = stat_text(&Stat { temporary: 4, temporary_bytes: 1000, ..stat });
        assert!(text.contains("\nof these 1.0 kB in 4 temporary files"), "{text}");
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(parse_size("500MB"), Ok(500_000_000));
        assert_eq!(parse_size("1.5 kB"), Ok(1500));
        assert_eq!(parse_size("1GiB"), Ok(1 << 30));
        assert_eq!(parse_size("0"), Ok(0));
        assert!(parse_size("ten").is_err() && parse_size("5 furlongs").is_err());
    }
}
