//! Edges, before and after: `cargo bench --bench edges [-- PART_OF_A_CASE] [--program PATH]`.
//!
//! Each row is a case in which the program of commit 257e6ea gave a wrong number, told nothing, or took a multiple of what it had said. `before` is
//! what that program gave for the same file (build it, and name it with `--program`, to see it again: files that use what it did not know are refused);
//! `after` is read from runs made now. Runs end after a minute or at 4 GiB, which the row then says.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use serde_json::Value;

/// What a row shows of a pipeline in `pipelines/checks`.
enum Seen {
    /// The first line of what a verb says, of those with this text in it, from there on.
    Line(&'static str, &'static str),
    /// Of each instance of a stage one figure of a layer of a port: selector, port, layer, figure.
    Layer(&'static str, &'static str, &'static str, &'static str),
    /// Of each instance the numbers of a table's column, if there is one: selector, port, column.
    Column(&'static str, &'static str, &'static str),
    /// CPU seconds and peak memory of a run.
    Cost,
}

struct Row {
    case: &'static str,
    file: &'static str,
    /// What is run and shown; all if empty.
    target: &'static [&'static str],
    set: &'static [&'static str],
    seen: Seen,
    truth: &'static str,
    before: &'static str,
}

/// A text that no error can be read from.
const NOTHING: &str = "nothing";
const MOST_SECONDS: u32 = 60;
const MOST_KIB: u32 = 4 << 20;

use Seen::{Column, Cost, Layer, Line};

const ROWS: &[Row] = &[
    Row {
        case: "lamp 1 mm above, and 200 mm beside at 2 mm, a slab of n = 1.4",
        file: "near_lamp",
        target: &[],
        set: &[],
        seen: Cost,
        truth: "as cheap as other lamps",
        before: "no end: 3 GB in 9 s, `check`: no mistakes",
    },
    Row {
        case: "light at 89 degrees",
        file: "grazing_slab",
        target: &[],
        set: &[],
        seen: Layer("down_frames", "frames", "radiance", "mean"),
        truth: "0.01745 of the next row",
        before: "no end: 8 GB",
    },
    Row {
        case: "view at 89 degrees",
        file: "grazing_slab",
        target: &[],
        set: &[],
        seen: Layer("along_frames", "frames", "radiance", "mean"),
        truth: "57.3 of the row above",
        before: "no end: 8 GB",
    },
    Row {
        case: "rough wall in a furnace: radiance",
        file: "rough_furnace",
        target: &[],
        set: &[],
        seen: Layer("rough", "frames", "radiance", "mean"),
        truth: "1",
        before: "0.7305",
    },
    Row {
        case: "share of the light that a medium with mu_a = 0 absorbs: value, error, interval at 95 %",
        file: "rough_furnace",
        target: &["balance.power"],
        set: &[],
        seen: Line("show", "absorbed in"),
        truth: "0, its error unknown, an interval",
        before: "0.269 (0.003)",
    },
    Row {
        case: "what a run says of regions",
        file: "table_end",
        target: &[],
        set: &[],
        seen: Line("run", "metrics  left"),
        truth: "bias, RMSE, what is masked",
        before: "85.00 % worst bias",
    },
    Row {
        case: "g = 0.98 in a ball that refracts: pixels with unknown errors",
        file: "peaked",
        target: &[],
        set: &[],
        seen: Layer("ball_frames", "frames", "radiance_se_unknown", "max"),
        truth: "those that 2048 paths know nothing of (1)",
        before: "none; 2 standard errors hold in 50 % of pixels at g = 0.98",
    },
    Row {
        case: "the same: what check says",
        file: "peaked",
        target: &[],
        set: &[],
        seen: Line("check", "g = 0.98"),
        truth: "what it costs",
        before: "nothing",
    },
    Row {
        case: "view and light at 0, 45, 60 degrees",
        file: "oblique",
        target: &[],
        set: &[],
        seen: Line("check", "seen at"),
        truth: "the effect on mu_a",
        before: "nothing (mu_a +17 and +37 %)",
    },
    Row {
        case: "slab of 2 mm read as a half-space",
        file: "thin_slab",
        target: &[],
        set: &[],
        seen: Line("check", "is a slab of"),
        truth: "the effect on mu_a",
        before: "nothing (mu_a +76 %)",
    },
    Row {
        case: "n = 1.4 read by a table of 1",
        file: "other_n",
        target: &[],
        set: &[],
        seen: Line("check", "is of n ="),
        truth: "the effect on mu_a",
        before: "nothing (mu_a +54 %)",
    },
    Row {
        case: "mean of a region, 72 paths per pixel: mean bias in size, noise alone, bias of mu_a",
        file: "low_samples",
        target: &[],
        set: &[],
        seen: Line("run", "summary  all     mu_a"),
        truth: "0 within its error",
        before: "+4.8 (0.9) %, 2.5 % masked",
    },
    Row {
        case: "IAD with too few quadrature points: mu_s'",
        file: "laboratory",
        target: &[],
        set: &[],
        seen: Column("points", "fit", "mu_s_prime"),
        truth: "0.005075, the mean of two rows",
        before: "0.0056, se 0, `ok`",
    },
    Row {
        case: "IAD, mu_a known, readings that disagree",
        file: "laboratory",
        target: &[],
        set: &[],
        seen: Line("show", "disagree"),
        truth: "status `disagree`",
        before: "1.357 by M_R, 4.823 by M_T, both `ok`",
    },
    Row {
        case: "seventeen bodies, and pixels of 4 mm at mu_s = 1500",
        file: "kernel_limits",
        target: &[],
        set: &[],
        seen: Line("plan", "hold"),
        truth: "the limit that is passed",
        before: "nothing: about 0.1 s of work",
    },
    Row {
        case: "pixels beyond the end of a table",
        file: "table_end",
        target: &[],
        set: &[],
        seen: Layer("metrics", "errors", "outside", "max"),
        truth: "a layer that marks them (0 where there are none)",
        before: "no such layer: drawn as data",
    },
];

struct Program {
    path: PathBuf,
    space: PathBuf,
    /// Files that have been run, and what came of it.
    run: BTreeMap<String, Result<String, String>>,
}

impl Program {
    fn say(&self, verb: &[&str], row: &Row) -> (bool, String) {
        let file = format!("{}/pipelines/checks/{}.yaml", env!("CARGO_MANIFEST_DIR"), row.file);
        let outputs = self.space.join(row.file);
        let mut limited = Command::new("sh");
        limited.args(["-c", &format!("ulimit -v {MOST_KIB} && exec timeout {MOST_SECONDS} \"$0\" \"$@\"")]);
        limited.arg(&self.path).arg(verb[0]).arg(file).args(&verb[1..]).arg("--outputs").arg(outputs);
        for set in row.set {
            limited.args(["--set", set]);
        }
        let done = limited.env("NO_COLOR", "1").output().expect("sh starts");
        let text = [done.stdout, done.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        (done.status.success(), text)
    }

    /// Runs the row's file, once for all rows of it.
    fn run(&mut self, row: &Row) -> Result<String, String> {
        let name = format!("{} {:?} {:?}", row.file, row.target, row.set);
        if let Some(known) = self.run.get(&name) {
            return known.clone();
        }
        let start = Instant::now();
        let (well, text) = self.say(&[&["run"], row.target].concat(), row);
        let last = text.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or(NOTHING);
        let failed = || format!("no answer after {:.0} s: {last}", start.elapsed().as_secs_f64());
        let outcome = if well { Ok(text.clone()) } else { Err(failed()) };
        self.run.insert(name, outcome.clone());
        outcome
    }

    fn after(&mut self, row: &Row) -> String {
        let found = match row.seen {
            Line(verb, text) => {
                let said = if verb == "run" {
                    self.run(row)
                } else {
                    {
                        // What is shown is there.
                        let ran = if verb == "show" { self.run(row).map(drop) } else { Ok(()) };
                        ran.map(|()| self.say(&[&[verb], row.target].concat(), row).1)
                    }
                };
                said.map(|said| {
                    let found = said.lines().find_map(|line| line.find(text).map(|at| line[at..].to_owned()));
                    found.unwrap_or_else(|| NOTHING.to_owned())
                })
            }
            Cost => self.run(row).and_then(|_| self.cost(row)),
            Layer(selector, port, layer, figure) => self.shown(row, selector, port, &|port| {
                let layers = port["layers"].as_array().into_iter().flatten();
                layers.filter(|l| l["name"] == layer).map(|l| text(&l[figure])).collect()
            }),
            Column(selector, port, column) => self.shown(row, selector, port, &|port| {
                let columns = port["columns"].as_array().into_iter().flatten();
                columns.filter(|c| c["name"] == column).map(|c| text(&c["mean"])).collect()
            }),
        };
        found.unwrap_or_else(|why| why)
    }

    fn cost(&self, row: &Row) -> Result<String, String> {
        let instances = self.instances(row, &[])?;
        let of = |name: &str| instances.iter().filter_map(|i| i[name].as_f64()).collect::<Vec<_>>();
        let (seconds, bytes) =
            (of("cpu_seconds").iter().sum::<f64>(), of("peak_bytes").into_iter().fold(0.0, f64::max));
        Ok(format!("{seconds:.1} CPU s, {:.0} MiB", bytes / f64::from(1 << 20)))
    }

    fn instances(&self, row: &Row, selector: &[&str]) -> Result<Vec<Value>, String> {
        let (_, said) = self.say(&[&["show"], selector, &["--json"]].concat(), row);
        let shown: Value = serde_json::from_str(&said).map_err(|_| said.trim().to_owned())?;
        Ok(shown["instances"].as_array().cloned().unwrap_or_default())
    }

    fn shown(
        &mut self,
        row: &Row,
        selector: &str,
        port: &str,
        read: &dyn Fn(&Value) -> Vec<String>,
    ) -> Result<String, String> {
        self.run(row)?;
        let instances = self.instances(row, &[selector])?;
        let found: Vec<String> = instances.iter().flat_map(|instance| read(&instance["ports"][port])).collect();
        Ok(if found.is_empty() { NOTHING.to_owned() } else { found.join(" | ") })
    }
}

fn text(value: &Value) -> String {
    match value.as_f64() {
        Some(x) if x == 0.0 || (1e-2..1e4).contains(&x.abs()) => {
            format!("{:.4}", x).trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        Some(x) => format!("{x:.3e}"),
        None if value.is_null() => "unknown".to_owned(),
        None => value.to_string(),
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let named = arguments.iter().position(|a| a == "--program");
    let path = named.and_then(|at| arguments.get(at + 1)).map_or(Path::new(env!("CARGO_BIN_EXE_turbid")), Path::new);
    let part = arguments.first().filter(|a| *a != "--program").cloned().unwrap_or_default();
    let space = tempfile::tempdir().expect("a temporary folder");
    let mut program = Program { path: path.to_owned(), space: space.path().to_owned(), run: BTreeMap::new() };
    println!("| case | what is right | before | after |\n|---|---|---|---|");
    for row in ROWS.iter().filter(|row| row.case.contains(&part)) {
        println!("| {} | {} | {} | {} |", row.case, row.truth, row.before, program.after(row));
    }
}
