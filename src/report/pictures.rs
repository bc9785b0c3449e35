//! The pictures of a report: those of `outputs/latest` where they are current, drawn anew where not, as many as a page carries.

use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use turbid_contract::payload::is_pictured;
use turbid_contract::{Artifact, ArtifactKind};

use crate::input_file;
use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan, StageId};
use crate::preview;
use crate::preview::chart::{Chart, charts};
use crate::run::latest::Files;
use crate::statistics::{self, Layer, label, masked, shown_unit, significant};
use crate::store::{InstanceRecord, Store};

use super::page::{Cell, Figure, Grid, Image, Shown};

/// Bytes of all pictures of a page: in base64 with the rest of it below 2 MB.
const MOST_BYTES: usize = 1_100_000;
/// Bytes of all outputs that are read for the numbers behind pictures; of what is larger `turbid show` tells.
const MOST_READ: u64 = 4_000_000;
/// Instances of a stage whose pictures are shown.
const SHOWN: usize = 4;

/// What is left of the page's budget.
pub struct Pictures<'a> {
    plan: &'a Plan,
    store: &'a Store,
    files: Files<'a>,
    /// The folder of the page, from which it links.
    folder: PathBuf,
    bytes: usize,
    read: u64,
    pub left_out: usize,
    charts: usize,
}

impl<'a> Pictures<'a> {
    pub fn of(plan: &'a Plan, store: &'a Store, outputs: &Path, folder: &Path) -> Self {
        let files = Files::of(plan, outputs);
        Self {
            plan,
            store,
            files,
            folder: folder.to_owned(),
            bytes: MOST_BYTES,
            read: MOST_READ,
            left_out: 0,
            charts: 0,
        }
    }

    /// The figures of a stage whose instances have these records; `None` where there is nothing to see.
    pub fn stage(&mut self, stage: StageId, records: &[(InstanceId, Arc<InstanceRecord>)]) -> Option<Shown> {
        let mut shown =
            Shown { stage: self.plan.spec.stages[stage].name.clone(), figures: Vec::new(), notes: Vec::new() };
        if records.len() > PREVIEW_INSTANCES {
            let name = &shown.stage;
            shown.notes.push(format!(
                "{} instances: outputs/latest has their list (instances.parquet), and `use: summarize` behind {name} says what they have in common",
                records.len()
            ));
            return Some(shown);
        }
        for (id, record) in records.iter().take(SHOWN) {
            let id = *id;
            for port in self.plan.outputs(stage) {
                let Some(described) = record.ports.get(port.name) else { continue };
                if described.blob.kind == ArtifactKind::Record || !is_pictured(&described.payload) {
                    continue;
                }
                if self.store.is_released(&described.blob) {
                    shown.notes.push(format!("{}.{}: its bytes were given back", self.plan.label(id), port.name));
                    continue;
                }
                match self.output(id, record, port.name) {
                    Ok(figures) => shown.figures.extend(figures),
                    Err(error) => shown.notes.push(format!(
                        "{}.{}: {error}; the next run makes it again",
                        self.plan.label(id),
                        port.name
                    )),
                }
            }
        }
        if records.len() > SHOWN && !shown.figures.is_empty() {
            let more = records.len() - SHOWN;
            shown.notes.push(format!("and {more} more instances: outputs/latest has the pictures of all"));
        }
        (!shown.figures.is_empty() || !shown.notes.is_empty()).then_some(shown)
    }

    fn chart(&mut self, chart: &Chart, of: &str, file: Option<String>) -> Option<Figure> {
        let svg = chart.svg(&format!("chart{}", self.charts))?;
        self.charts += 1;
        // Pictures make room for it: it stands in the page as it is, they in base64.
        self.bytes = self.bytes.saturating_sub(svg.len() * 3 / 4);
        let image = Image::Svg(svg);
        let (head, rows) = chart.table();
        let more = (!chart.notes.is_empty()).then(|| chart.notes.join("; "));
        let rows = rows.into_iter().map(|row| row.into_iter().map(Cell::Text).collect()).collect();
        let title = format!("{of}: {}", chart.title());
        Some(Figure {
            alt: title.clone(),
            title,
            image,
            file,
            behind: Some(Grid { head, rows, more, ..Grid::default() }),
        })
    }

    /// A link to the file of an output, where there is a current one.
    pub fn link(&self, id: InstanceId, record: &InstanceRecord, port: &str) -> Option<String> {
        href(&self.folder, &self.files.output(id, port, &record.ports[port].blob)?)
    }

    fn output(&mut self, id: InstanceId, record: &InstanceRecord, port: &str) -> Result<Vec<Figure>, String> {
        let blob = &record.ports[port].blob;
        let (caption, file) = self.files.picture(id, &record.key, port, blob);
        let small = blob.bytes <= self.read || blob.kind == ArtifactKind::Table;
        let artifact = match small {
            true => Some(self.store.get(blob).map_err(|error| error.to_string())?),
            false => None,
        };
        if artifact.is_some() {
            self.read = self.read.saturating_sub(blob.bytes);
        }
        let title = format!("{}.{port}", self.plan.label(id));
        if let Some(Artifact::Table(table)) = &artifact {
            let charts = charts(table);
            if !charts.is_empty() {
                let file = self.link(id, record, port);
                return Ok(charts.iter().filter_map(|chart| self.chart(chart, &title, file.clone())).collect());
            }
        }
        let stored = file.and_then(|file| input_file::read(&file, MOST_BYTES as u64).ok()).map(|bytes| bytes.to_vec());
        let Some(bytes) = stored.or_else(|| preview::picture(artifact.as_ref()?, &caption)) else {
            self.left_out += usize::from(!small);
            return Ok(Vec::new());
        };
        let Some((width, height)) = size(&bytes) else { return Ok(Vec::new()) };
        if bytes.len() > self.bytes {
            self.left_out += 1;
            return Ok(Vec::new());
        }
        self.bytes -= bytes.len();
        let behind = artifact.as_ref().and_then(behind);
        let names: Vec<String> = behind.iter().flat_map(|grid| &grid.rows).filter_map(|row| name(row)).collect();
        let alt = if names.is_empty() { title.clone() } else { format!("{title}: {}", names.join(", ")) };
        let image = Image::Png { bytes, width, height };
        Ok(vec![Figure { title, alt, image, file: self.link(id, record, port), behind }])
    }
}

fn name(row: &[Cell]) -> Option<String> {
    match row.first() {
        Some(Cell::Text(text)) => Some(text.clone()),
        _ => None,
    }
}

/// Width and height of a PNG file.
pub fn size(bytes: &[u8]) -> Option<(u32, u32)> {
    let number = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let is_png = bytes.starts_with(b"\x89PNG\r\n\x1a\n");
    is_png.then_some(())?;
    Some((number(16)?, number(20)?))
}

/// The numbers of an artifact: of layers or columns what they range over.
pub fn behind(artifact: &Artifact) -> Option<Grid> {
    let number = |value: Option<f64>| Cell::text(value.map_or_else(|| "-".to_owned(), significant));
    let (caption, head, rows) = match artifact {
        Artifact::Images(stack) => {
            let layers = statistics::layers(stack);
            let row = |layer: &Layer| {
                let name = Cell::text(label(layer, &layers, &stack.attributes));
                let [min, mean, max] = [layer.min, layer.mean, layer.max].map(number);
                let pixels = match &layer.masked {
                    Some(reasons) => Cell::text(masked(reasons)),
                    None => Cell::text(layer.pixels.to_string()),
                };
                vec![name, min, mean, number(layer.mean_se), max, Cell::text(shown_unit(&layer.unit)), pixels]
            };
            let caption = format!("{} x {} pixels; numbers of good ones", stack.columns(), stack.rows());
            let head = &["layer", "min", "mean", "its standard error", "max", "unit", "good pixels"][..];
            (caption, head, layers.iter().map(row).collect::<Vec<_>>())
        }
        Artifact::Table(table) => {
            let columns = statistics::columns(table);
            let row = |column: &statistics::Column| {
                let [min, mean, max] = [column.min, column.mean, column.max].map(number);
                let values = column.values.as_ref().map_or_else(String::new, |values| values.join(", "));
                vec![Cell::text(&column.name), min, mean, max, Cell::text(shown_unit(&column.unit)), Cell::text(values)]
            };
            let head = &["column", "min", "mean", "max", "unit", "values"][..];
            (format!("{} rows", table.rows()), head, columns.iter().map(row).collect())
        }
        Artifact::Record(_) => return None,
    };
    Some(Grid { caption, head: head.iter().map(|head| (*head).to_owned()).collect(), rows, more: None })
}

/// The way from a folder to a file as a relative link, percent-encoded.
pub fn href(folder: &Path, file: &Path) -> Option<String> {
    let (from, to) = (std::path::absolute(folder).ok()?, std::path::absolute(file).ok()?);
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = from[common..].iter().map(|_| "..".to_owned());
    let down = to[common..].iter().map(|part| encoded(&part.as_os_str().to_string_lossy()));
    Some(up.chain(down).collect::<Vec<_>>().join("/"))
}

/// A part of a path, with everything but plain characters percent-encoded.
fn encoded(text: &str) -> String {
    let mut out = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push_str(&format!("%{byte:02X}"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_relative_and_encoded() {
        let link = |from: &str, to: &str| href(Path::new(from), Path::new(to)).unwrap();
        assert_eq!(link("/a/b", "/a/b/c.exr"), "c.exr");
        assert_eq!(link("/a/b", "/a/x/f[A=1].exr"), "../x/f%5BA%3D1%5D.exr");
        assert_eq!(link("/a", "/a/b\"<é>"), "b%22%3C%C3%A9%3E");
        // A part that looks like a scheme is none behind its encoding.
        assert_eq!(link("/a", "/a/javascript:x"), "javascript%3Ax");
    }
}
