//! `README.md` of a data set: what Hugging Face shows, and what a person reads first.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::format::Format;
use super::manifest::{ColumnOf, Manifest};
use super::statistics::Row;

/// The card. `splits` has the number of samples of each; `rows` are those of `statistics.parquet`.
pub fn text(manifest: &Manifest, splits: &[(String, u64)], rows: &[Row]) -> String {
    let mut text = String::from("---\n");
    if let Some(license) = &manifest.license {
        let _ = writeln!(text, "license: {}", license.to_lowercase());
    }
    let samples: u64 = splits.iter().map(|(_, n)| n).sum();
    let _ = writeln!(text, "pretty_name: {}\ntags: [sfdi, biomedical-optics, simulation]", manifest.dataset);
    let _ = writeln!(text, "size_categories: [{}]\nconfigs:\n- config_name: default\n  data_files:", category(samples));
    for (split, _) in splits.iter().filter(|(_, n)| *n > 0) {
        let _ = writeln!(text, "  - split: {split}\n    path: data/{split}-*.{}", manifest.shard_format.extension());
    }
    let _ = writeln!(text, "---\n\n# {}\n", manifest.dataset);
    if let Some(about) = &manifest.about {
        let _ = writeln!(text, "{about}\n");
    }
    let _ = writeln!(
        text,
        "{samples} simulated samples of spatial frequency domain imaging, made by turbid {} from the pipeline `{}` (seed {}).\n",
        manifest.turbid_version, manifest.pipeline, manifest.seed
    );
    let _ = writeln!(
        text,
        "![Some samples, and how what is drawn is spread](overview.png)\n\n| split | samples |\n|---|---|"
    );
    for (split, n) in splits {
        let _ = writeln!(text, "| {split} | {n} |");
    }
    let _ = writeln!(text, "\n## Columns\n\n| column | type | unit | what it holds |\n|---|---|---|---|");
    for column in &manifest.columns {
        let _ = writeln!(text, "| `{}` | {} | {} | {} |", column.name, type_of(column), unit(column), about(column));
    }
    text += &drawn(rows);
    let _ = write!(
        text,
        "\nTensors are (channels, rows, columns). {}`index.parquet` has a row per drawn point, also of those that are left out\n\
         and why; `statistics.parquet` has mean, standard deviation and range of each column; `dataset.json` has the pipeline.\n\n\
         ```python\n{}```\n",
        members(manifest),
        python(manifest)
    );
    if !manifest.rejects.is_empty() {
        let _ = writeln!(text, "\n## Left out\n\n| reason | points |\n|---|---|");
        for (reason, n) in &manifest.rejects {
            let _ = writeln!(text, "| {reason} | {n} |");
        }
    }
    if let Some(cite) = &manifest.cite {
        let _ = writeln!(text, "\n## Citation\n\n{cite}");
    }
    text
}

/// Where the columns of a sample are.
fn members(manifest: &Manifest) -> &'static str {
    match manifest.shard_format {
        Format::Parquet => "",
        Format::WebDataset => {
            "Of each sample a shard has ID.json (id, draw, group, what is drawn)\nand ID.npz (tensors and computed numbers). "
        }
    }
}

/// How a program loads the first split.
fn python(manifest: &Manifest) -> String {
    let first = manifest.shards.first().map_or("train", |shard| shard.split.as_str());
    let shards = manifest.shards.iter().filter(|shard| shard.split == first).count();
    match manifest.shard_format {
        Format::Parquet => {
            "from datasets import load_dataset\n\ndata = load_dataset(\"PATH OF THIS FOLDER\").with_format(\"numpy\")\n"
                .to_owned()
        }
        Format::WebDataset => format!(
            "from webdataset import WebDataset\n\n\
             shards = \"PATH OF THIS FOLDER/data/{first}-{{00000..{:05}}}-of-{shards:05}.tar\"\n\
             for sample in WebDataset(shards, shardshuffle=False).decode():\n    known, arrays = sample[\"json\"], sample[\"npz\"]\n",
            shards.saturating_sub(1)
        ),
    }
}

/// Quantiles of what is drawn.
fn drawn(rows: &[Row]) -> String {
    let mut text = String::new();
    for row in rows.iter().filter(|row| row.quantiles.iter().all(Option::is_some)) {
        if text.is_empty() {
            text += "\n## Drawn quantities\n\n| split | quantity | mean | sd | min | 5 % | 25 % | 50 % | 75 % | 95 % | max |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
        }
        let of = row.moments;
        let mut numbers = vec![Some(of.mean), of.sd(), Some(of.least)];
        numbers.extend(row.quantiles);
        numbers.push(Some(of.most));
        let cells: Vec<String> = numbers
            .into_iter()
            .map(|number| number.map_or_else(|| "-".to_owned(), |number| format!("{number:.4}")))
            .collect();
        let _ = writeln!(text, "| {} | {} | {} |", row.split, row.column, cells.join(" | "));
    }
    text
}

fn type_of(column: &ColumnOf) -> String {
    match column.shape {
        Some([channels, rows, columns]) => format!("{} ({channels}, {rows}, {columns})", column.dtype),
        None => column.dtype.clone(),
    }
}

fn unit(column: &ColumnOf) -> String {
    match column.pixel_mm {
        Some([x, y]) => format!("{}; pixels of {x:.6} x {y:.6} mm", column.unit),
        None => column.unit.clone(),
    }
}

fn about(column: &ColumnOf) -> String {
    if column.channels.is_empty() {
        column.about.clone()
    } else {
        format!("{}: {}", column.about, column.channels.join("; "))
    }
}

/// What Hugging Face calls so many samples.
fn category(n: u64) -> &'static str {
    let names: BTreeMap<u64, &str> =
        [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")].into();
    names.range(n + 1..).next().map_or("1M<n<10M", |(_, name)| name)
}
