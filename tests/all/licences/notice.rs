//! The text of `THIRD-PARTY.md`: every crate with the licence that it is taken under, and what these licences want to be passed on.

use std::collections::BTreeMap;
use std::fs;

use super::{Package, expression};

/// What a licence file may be called.
const FILES: [&str; 6] = ["LICENSE", "LICENCE", "COPYING", "UNLICENSE", "COPYRIGHT", "NOTICE"];

pub fn write(packages: &[Package], allowed: &[String]) -> String {
    let mut page = HEAD.to_owned();
    page += "| crate | version | licence | taken under |\n|---|---|---|---|\n";
    // By text, then by what differs: the lines of copyright.
    let mut texts: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for package in packages {
        let Package { name, version, licence, .. } = package;
        let taken = expression::chosen(licence, allowed).unwrap_or_default();
        let taken: Vec<&str> = taken.iter().map(String::as_str).collect();
        page += &format!("| {name} | {version} | {licence} | {} |\n", taken.join(", "));
        let files = files(package);
        for licence in &taken {
            let file = files.iter().find(|(name, text)| is_of(licence, name, text)).map(|(_, text)| text.as_str());
            let (holders, body) = split(file.unwrap_or_default());
            let body = if body.trim().is_empty() { String::new() } else { body };
            let holders = if holders.is_empty() { authors(package) } else { holders };
            // The Apache licence stands in full in LICENSE-APACHE and wants no line of copyright but those of a NOTICE.
            let (holders, body) =
                if *licence == "Apache-2.0" { (String::new(), String::new()) } else { (holders, body) };
            texts.entry(((*licence).to_owned(), body)).or_default().push(format!("{name} {version}{holders}"));
        }
        for (file, text) in files.iter().filter(|(file, _)| file.starts_with("NOTICE")) {
            texts.entry((file.clone(), text.clone())).or_default().push(format!("{name} {version}"));
        }
    }
    page += BUNDLED;
    // A package without the file of its licence has the text of another of that licence.
    let known: BTreeMap<String, String> =
        texts.keys().filter(|(_, body)| !body.is_empty()).map(|(l, body)| (l.clone(), body.clone())).collect();
    let mut grouped: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for ((licence, body), crates) in texts {
        let body = if body.is_empty() { known.get(&licence).cloned().unwrap_or_default() } else { body };
        grouped.entry((licence, body)).or_default().extend(crates);
    }
    for ((licence, body), mut crates) in grouped {
        crates.sort();
        page += &format!("\n## {licence}\n\n{}\n", crates.iter().map(|c| format!("- {c}\n")).collect::<String>());
        page += &match licence.as_str() {
            "Apache-2.0" => "The text is that of [LICENSE-APACHE](LICENSE-APACHE).\n".to_owned(),
            _ => format!("```text\n{}\n```\n", body.trim()),
        };
    }
    page
}

const HEAD: &str = "\
# Third-party licences

The program `turbid` (x86_64 Linux) is built from these crates. Each is used under the licence of the last column, the first that its own
expression offers; the texts below have to go with every copy of the program. Written by `TURBID_RENEW=1 cargo test --test all licences` from the
sources of the crates; a test compares it with the dependencies. Fonts: `src/preview/glyphs/LICENSE`.

";

const BUNDLED: &str = "\n`zstd-sys` holds the C library zstd (Copyright (c) Meta Platforms, Inc. and affiliates), used under the BSD-3-Clause licence below.\n";

/// The files of a package that are about its licence, by name.
fn files(package: &Package) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    let mut folders = vec![package.folder.clone()];
    if package.name == "zstd-sys" {
        folders.push(package.folder.join("zstd"));
    }
    for entry in folders.iter().flat_map(fs::read_dir).flatten().flatten() {
        let name = entry.file_name().to_string_lossy().to_uppercase();
        if FILES.iter().any(|known| name.starts_with(known))
            && let Ok(bytes) = fs::read(entry.path())
        {
            found.push((name, String::from_utf8_lossy(&bytes).replace('\r', "")));
        }
    }
    found.sort();
    found
}

/// Whether a file holds the text of a licence: by words that only this one has.
fn is_of(licence: &str, name: &str, text: &str) -> bool {
    let words = match licence {
        "MIT" => "Permission is hereby granted, free of charge",
        "BSD-3-Clause" => "Neither the name of",
        "Zlib" => "This software is provided 'as-is'",
        "Unicode-3.0" => "UNICODE LICENSE V3",
        "CC0-1.0" => "CC0 1.0 Universal",
        "ISC" => "Permission to use, copy, modify, and/or distribute this software",
        "CDLA-Permissive-2.0" => "Community Data License Agreement",
        _ => return false,
    };
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    // A file of several licences is taken as a whole, unless another file is of this one alone.
    text.contains(words) && !name.contains("APACHE")
}

/// The lines of copyright, one below the other, and the text behind them.
fn split(text: &str) -> (String, String) {
    let heading = |line: &str| {
        let line = line.trim_matches(['#', ' ', '*', '=']).to_lowercase();
        line.is_empty()
            || ["the mit license (mit)", "mit license", "the mit license", "bsd 3-clause license"]
                .contains(&line.as_str())
    };
    let of_copyright = |line: &str| {
        let line = line.trim().to_lowercase();
        line.starts_with("copyright") || line.starts_with("copyirhgt") || line.starts_with("(c)")
    };
    let mut lines = text.lines().peekable();
    let mut holders = String::new();
    while let Some(line) = lines.next_if(|line| heading(line) || of_copyright(line)) {
        if of_copyright(line) {
            holders += &format!("\n  {}", line.trim());
            // A list of names may take several lines.
            while line.trim_end().ends_with(',')
                && let Some(more) = lines.next_if(|line| !line.trim().is_empty())
            {
                holders += &format!(" {}", more.trim());
            }
        }
    }
    // Other line breaks are no other text.
    let rest: Vec<&str> = lines.collect();
    let paragraphs: Vec<String> = rest.split(|l| l.trim().is_empty()).map(joined).filter(|p| !p.is_empty()).collect();
    (holders, paragraphs.join("\n\n"))
}

fn joined(lines: &[&str]) -> String {
    lines.iter().flat_map(|l| l.split_whitespace()).collect::<Vec<_>>().join(" ")
}

/// For a package whose files name no holder.
fn authors(package: &Package) -> String {
    match package.authors.as_slice() {
        [] => "\n  (its package names no holder of the copyright)".to_owned(),
        authors => format!("\n  authors: {}", authors.join(", ")),
    }
}
