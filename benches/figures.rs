//! Runs the shipped pipelines and renews what is stated of them: `cargo bench --bench figures [-- NAME…] [-- --outputs DIR]`.
//!
//! The end of each run goes to `docs/figures/NAME.txt`, with the recipe of what ran, and its figures into the table of
//! `docs/validation.md`. A test compares the three. All pipelines take some 800 CPU seconds; what is stored in DIR (`outputs` where nothing is said) is not run again.

#[path = "../tests/all/record.rs"]
#[allow(dead_code, reason = "the test needs the rest")]
mod record;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use record::{Record, of_output, page, page_file, pipeline_file, recipe_now, root, rows, write};

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    let (mut names, mut outputs) = (BTreeSet::new(), root().join("outputs"));
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--outputs" => outputs = arguments.next().map_or(outputs, PathBuf::from),
            name => drop(names.insert(name.trim_end_matches(".yaml").to_owned())),
        }
    }
    let known: BTreeSet<String> = rows(&page()).into_iter().map(|row| row.pipeline).collect();
    let names = if names.is_empty() { known } else { names };
    let mut failed = false;
    for name in &names {
        match renew(name, &outputs) {
            Ok(text) => print!("{name}: {text}"),
            Err(message) => {
                eprintln!("{name}: {message}");
                failed = true;
            }
        }
    }
    ExitCode::from(u8::from(failed))
}

fn renew(name: &str, outputs: &std::path::Path) -> Result<String, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
    let done = command.arg("run").arg(pipeline_file(name)).arg("--outputs").arg(outputs).output();
    let done = done.map_err(|e| e.to_string())?;
    if !done.status.success() {
        return Err(String::from_utf8_lossy(&done.stderr).into_owned());
    }
    let text = of_output(&recipe_now(name), &String::from_utf8_lossy(&done.stdout));
    let record = Record::parse(&text).ok_or("the run ended without its cost")?;
    write(name, &text)?;
    let page = page();
    let mut lines: Vec<String> = page.lines().map(str::to_owned).collect();
    for row in rows(&page).iter().filter(|row| row.pipeline == name) {
        lines[row.at] = row.renewed(&record)?;
    }
    std::fs::write(page_file(), lines.join("\n") + "\n").map_err(|e| e.to_string())?;
    Ok(text)
}
