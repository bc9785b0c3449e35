//! What the shipped pipelines stated when they were last run (`docs/figures`), and the rows of `docs/validation.md` that hold it.

use std::fs;
use std::path::{Path, PathBuf};

use turbid::plan::Plan;
use turbid::recipe::recipe;
use turbid::registry::Registry;
use turbid::spec;

/// The recorded end of a run.
pub struct Record {
    /// Of the pipeline that ran.
    pub recipe: String,
    /// Of all its results.
    pub cpu_s: f64,
    /// The figures: cells of each line, the first three being stage, region and quantity.
    pub lines: Vec<Vec<String>>,
}

/// A row of the table of shipped pipelines.
pub struct Row {
    /// Its place among the page's lines.
    pub at: usize,
    /// As written: `quickstart.yaml`; empty below the first row of a pipeline.
    pub named: String,
    /// Without `.yaml`; of the first row above that names one.
    pub pipeline: String,
    pub run_time: String,
    /// Stage, region and, where it stands there, quantity.
    pub line: Vec<String>,
    pub figures: [String; 2],
    cells: Vec<String>,
}

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub fn pipeline_file(name: &str) -> PathBuf {
    root().join("pipelines").join(format!("{name}.yaml"))
}

fn record_file(name: &str) -> PathBuf {
    root().join("docs/figures").join(format!("{name}.txt"))
}

/// The recipe of a pipeline as it is now.
pub fn recipe_now(name: &str) -> String {
    let (spec, report) = spec::read(&pipeline_file(name), &[]);
    let spec = spec.unwrap_or_else(|| panic!("{name}: {}", report.render(false)));
    let plan = Plan::build(spec, report, &Registry::builtin(), &[]);
    let plan = plan.unwrap_or_else(|report| panic!("{name}: {}", report.render(false)));
    recipe(&plan).unwrap_or_else(|message| panic!("{name}: {message}")).to_string()
}

/// What a run printed, from its figures on: the text of a record.
pub fn of_output(recipe: &str, out: &str) -> String {
    let blocks = out.split("\n\n").filter(|b| b.starts_with("figures") || b.starts_with("these results took"));
    let kept: Vec<&str> =
        blocks.map(|block| block.split("\nresults and pictures").next().unwrap_or(block).trim()).collect();
    format!("recipe {recipe}\n\n{}\n", kept.join("\n\n"))
}

impl Record {
    pub fn parse(text: &str) -> Option<Self> {
        let recipe = text.lines().next()?.strip_prefix("recipe ")?.to_owned();
        let cost = text.lines().find_map(|line| line.strip_prefix("these results took "))?;
        let cpu_s = cost.split(' ').next()?.parse().ok()?;
        let cells = |line: &str| line.split("  ").map(str::trim).filter(|c| !c.is_empty()).map(str::to_owned).collect();
        let figures = text.split("\n\n").filter(|block| block.starts_with("figures"));
        let lines = figures.flat_map(|block| block.lines().skip(1)).map(cells).filter(|cells: &Vec<_>| cells.len() > 3);
        Some(Self { recipe, cpu_s, lines: lines.collect() })
    }

    /// The one that is checked in.
    pub fn read(name: &str) -> Result<Self, String> {
        let path = record_file(name);
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Self::parse(&text).ok_or_else(|| format!("{}: not a record", path.display()))
    }

    /// CPU seconds as the pages write them: two digits that count.
    pub fn run_time(&self) -> String {
        let step = 10_f64.powi((self.cpu_s.log10().floor() as i32 - 1).max(if self.cpu_s < 1.0 { -1 } else { 0 }));
        let rounded = (self.cpu_s / step).round() * step;
        if step < 1.0 { format!("{rounded:.1} s") } else { format!("{rounded:.0} s") }
    }

    /// What the page states in the two columns of a row: of mu_a and mu_s', or of what the row names. Error: there is no such line.
    pub fn figures(&self, wanted: &[String]) -> Result<[String; 2], String> {
        let [stage, region, quantity @ ..] = wanted else { return Err(format!("{wanted:?} is no line")) };
        let found: Vec<&Vec<String>> = self.lines.iter().filter(|l| &l[0] == stage && &l[1] == region).collect();
        let of = |quantity: &str| found.iter().find(|l| l[2] == quantity).map(|line| stated(line));
        let missing = || format!("the run has no line {}", wanted.join(" "));
        match (quantity, found.as_slice()) {
            ([quantity], _) => Ok([of(quantity).ok_or_else(missing)?, String::new()]),
            (_, [only]) => Ok([stated(only), String::new()]),
            _ => Ok([of("mu_a").ok_or_else(missing)?, of("mu_s_prime").ok_or_else(missing)?]),
        }
    }
}

/// Of regions bias and RMSE, of fits z too, of sums the mean size, of levels value and unit.
fn stated(line: &[String]) -> String {
    let cells: Vec<&str> = line.iter().map(String::as_str).collect();
    match cells[3..] {
        [size, _, _, _, _, _] => size.to_owned(),
        [bias, rmse, _, z, _] => format!("{bias}, {rmse}, z {z}"),
        [bias, rmse, _, _] => format!("{bias}, {rmse}"),
        [mean, unit, _] => format!("{mean} {unit}"),
        _ => cells[3..].join(", "),
    }
}

/// The page with the table of shipped pipelines.
pub fn page_file() -> PathBuf {
    root().join("docs/validation.md")
}

pub fn page() -> String {
    fs::read_to_string(page_file()).expect("the page is there")
}

/// The rows of the table whose head begins with `pipeline`.
pub fn rows(page: &str) -> Vec<Row> {
    let mut found: Vec<Row> = Vec::new();
    let table = page.lines().enumerate().skip_while(|(_, l)| !l.starts_with("| pipeline |")).skip(2);
    for (at, line) in table.take_while(|(_, line)| line.starts_with('|')) {
        let cells: Vec<String> = line.trim_matches('|').split('|').map(|c| c.trim().to_owned()).collect();
        let [name, _, run_time, line, a, s] = cells.as_slice() else { panic!("six columns: {line}") };
        let named = name.trim_matches('`').to_owned();
        let pipeline = match (named.strip_suffix(".yaml"), found.last()) {
            (Some(name), _) => name.to_owned(),
            (None, Some(above)) => above.pipeline.clone(),
            (None, None) => panic!("the first row names no pipeline"),
        };
        let line = line.replace('`', "").split_whitespace().map(str::to_owned).collect();
        let (run_time, figures) = (run_time.clone(), [a.clone(), s.clone()]);
        found.push(Row { at, named, pipeline, run_time, line, figures, cells });
    }
    found
}

impl Row {
    /// The row as the page should have it.
    pub fn renewed(&self, record: &Record) -> Result<String, String> {
        let mut cells = self.cells.clone();
        if !self.named.is_empty() {
            cells[2] = record.run_time();
        }
        if !self.line.is_empty() {
            [cells[4], cells[5]] = record.figures(&self.line)?;
        }
        let text: String =
            cells.iter().map(|c| if c.is_empty() { " |".to_owned() } else { format!(" {c} |") }).collect();
        Ok(format!("|{text}"))
    }
}

/// Writes the record of a run. Error: what the disk says.
pub fn write(name: &str, text: &str) -> Result<(), String> {
    let path = record_file(name);
    fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))
}
