//! Tables of `compare`, read as a user would: exported.

use crate::space::Space;

/// A row of a table of metrics, as exported.
pub struct Row {
    pub region: String,
    pub quantity: String,
    pub n: f64,
    pub mean: f64,
    pub se: f64,
    pub truth: f64,
    /// Share of the region, %.
    pub masked: f64,
}

/// The metrics of a stage, one row for each region or medium and quantity, without the row of all.
pub fn metrics(space: &Space, file: &str, stage: &str, settings: &[&str]) -> Vec<Row> {
    let csv = space.path().join(format!("{stage}.csv"));
    let port = format!("{stage}.metrics");
    let mut arguments = vec!["export", file, &port, "--to", csv.to_str().expect("a temporary folder of UTF-8")];
    arguments.extend(settings);
    space.turbid(&arguments).ok();
    let text = std::fs::read_to_string(&csv).expect("the export");
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let rows = lines.map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |name: &str| {
            let at = header.iter().position(|h| h.split(['[', ' ']).next() == Some(name));
            cells[at.unwrap_or_else(|| panic!("{name}: {text}"))]
        };
        let number = |name: &str| cell(name).parse().unwrap_or_else(|e| panic!("{name}: {e}\n{text}"));
        Row {
            region: cell("region").to_owned(),
            quantity: cell("quantity").to_owned(),
            n: number("n"),
            mean: number("mean"),
            se: number("mean_se"),
            truth: number("truth"),
            masked: number("masked_percent"),
        }
    });
    rows.filter(|row| row.region != "all").collect()
}
