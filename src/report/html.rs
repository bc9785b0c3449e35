//! A [`Page`] as one HTML file that asks nobody for anything: style, script and pictures are in it, and its Content-Security-Policy allows no other.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

use super::diff::Comparison;
use super::graph;
use super::page::{Block, Cell, Figure, Grid, Image, Page, Shown, Study};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("sort.js");

/// The file. The same page gives the same bytes.
pub fn html(page: &Page) -> String {
    let title = format!("{}: report", page.pipeline);
    let graph = graph::svg(&page.nodes, &page.edges);
    let body = html! {
                header {
                    h1 { (page.pipeline) }
                    @if let Some(about) = &page.about { p { (about) } }
                    p { (page.state) }
                    @if let Some(hint) = &page.hint { p.warn { (hint) } }
                    (contents(page))
                }
                main {
                    @if !page.question.is_empty() {
                        section id="question" aria-labelledby="question-head" {
                            h2 id="question-head" { "Question" }
                            @for block in &page.question {
                                @match block {
                                    Block::Paragraph(text) => p { (text) },
                                    Block::Lines(text) => pre { (text) },
                                }
                            }
                        }
                    }
                    @if !page.figures.is_empty() || !page.figure_notes.is_empty() {
                        section id="metrics" aria-labelledby="metrics-head" {
                            h2 id="metrics-head" { "Metrics" }
                            p.quiet { "In brackets the standard error of a value." }
                            @for grid in &page.figures { (table(grid)) }
                            @for note in &page.figure_notes { p.quiet { (note) } }
                        }
                    }
                    @if !page.warnings.is_empty() {
                        section id="warnings" aria-labelledby="warnings-head" {
                            h2 id="warnings-head" { "Warnings" }
                            ul { @for warning in &page.warnings { li.warn { (warning) } } }
                        }
                    }
                    @if !page.studies.is_empty() {
                        section id="studies" aria-labelledby="studies-head" {
                            h2 id="studies-head" { "Studies: error against run time" }
                            @for found in &page.studies { (study(found)) }
                        }
                    }
                    section id="stages" aria-labelledby="stages-head" {
                        h2 id="stages-head" { "Stages" }
                        @if let Some(svg) = &graph { figure { div.wide tabindex="0" role="group" aria-label="graph of the stages" { (PreEscaped(svg)) } } }
                        (table(&page.stages))
                    }
                    section id="cost" aria-labelledby="cost-head" {
                        h2 id="cost-head" { "Error and time" }
                        (table(&page.costs))
                        @for note in &page.cost_notes { p { (cell(note)) } }
                        @if let Some(grid) = &page.measures { (folded("What the stages measured", grid)) }
                    }
                    @if !page.shown.is_empty() || !page.picture_notes.is_empty() {
                        section id="figures" aria-labelledby="figures-head" {
                            h2 id="figures-head" { "Figures" }
                            @for shown in &page.shown { (stage(shown)) }
                            @for note in &page.picture_notes { p.quiet { (note) } }
                        }
                    }
                    @if !page.left_out.is_empty() {
                        section id="left-out" aria-labelledby="left-out-head" {
                            h2 id="left-out-head" { "What was left out" }
                            p.quiet { "What a scene does not need is neither computed nor paid for." }
                            dl {
                                @for (stage, items) in &page.left_out { dt { strong { (stage) } } dd { (items.join("; ")) } }
                            }
                        }
                    }
                    section id="params" aria-labelledby="params-head" {
                        h2 id="params-head" { "Parameters" }
                        @for (stage, grid) in &page.params { (folded(stage, grid)) }
                    }
                    section id="provenance" aria-labelledby="provenance-head" {
                        h2 id="provenance-head" { "Provenance" }
                        (table(&page.provenance))
                        (folded("Instances and their keys", &page.instances))
                    }
                }
    };
    file(&title, &body)
}

/// Two results beside each other, as a file of the same kind.
pub fn diff_html(found: &Comparison) -> String {
    let [a, b] = &found.names;
    let body = html! {
        header {
            h1 { "A and B" }
            @for (letter, (name, about)) in ["A", "B"].iter().zip(found.names.iter().zip(&found.about)) {
                p { strong { (letter) ": " } (name) @for line in about { br; (line) } }
            }
            @for line in &found.summary { p { (line) } }
        }
        main {
            @for one in &found.instances {
                section {
                    h2 { (one.label) }
                    @for note in &one.notes { p.quiet { (note) } }
                    (table(&one.origin))
                    (table(&one.costs))
                    @for grid in &one.numbers { (table(grid)) }
                    @for row in &one.figures { div.beside { @for one in row { (figure(one)) } } }
                }
            }
        }
    };
    file(&format!("{a} and {b}: differences"), &body)
}

/// A file around a body.
fn file(title: &str, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy());
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="generator" content=(concat!("turbid ", env!("CARGO_PKG_VERSION")));
                meta name="referrer" content="no-referrer";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                (body)
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
    .into_string()
}

/// Nothing is fetched; of style and script exactly those of this file.
fn policy() -> String {
    let hash = |text: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text.as_bytes())));
    format!(
        "default-src 'none'; img-src data:; style-src {}; script-src {}; base-uri 'none'; form-action 'none'",
        hash(STYLE),
        hash(SCRIPT)
    )
}

fn contents(page: &Page) -> Markup {
    let sections = [
        (!page.question.is_empty(), "question", "Question"),
        (!page.figures.is_empty(), "metrics", "Metrics"),
        (!page.warnings.is_empty(), "warnings", "Warnings"),
        (!page.studies.is_empty(), "studies", "Studies"),
        (true, "stages", "Stages"),
        (true, "cost", "Error and time"),
        (!page.shown.is_empty(), "figures", "Figures"),
        (!page.left_out.is_empty(), "left-out", "Left out"),
        (true, "params", "Parameters"),
        (true, "provenance", "Provenance"),
    ];
    html! {
        nav aria-label="contents" {
            ul { @for (_, id, name) in sections.iter().filter(|(there, ..)| *there) { li { a href={ "#" (id) } { (name) } } } }
        }
    }
}

fn study(found: &Study) -> Markup {
    html! {
        h3 { (found.name) }
        @if let Some(about) = &found.about { p { (about) } }
        @if let Some(shown) = &found.figure { (figure(shown)) }
        @if let Some(points) = &found.points { (table(points)) }
        @for note in &found.notes { p { (note) } }
    }
}

fn stage(shown: &Shown) -> Markup {
    html! {
        h3 { (shown.stage) }
        @for one in &shown.figures { (figure(one)) }
        @for note in &shown.notes { p.quiet { (note) } }
    }
}

fn figure(of: &Figure) -> Markup {
    html! {
        figure {
            @match &of.image {
                Image::Png { bytes, width, height } => img alt=(of.alt) width=(width) height=(height) src={ "data:image/png;base64," (STANDARD.encode(bytes)) };,
                Image::SvgFile(bytes) => img alt=(of.alt) src={ "data:image/svg+xml;base64," (STANDARD.encode(bytes)) };,
                Image::Svg(svg) => div.wide.chart { (PreEscaped(svg)) },
            }
            figcaption {
                @match &of.file {
                    Some(file) => a href=(file) { (of.title) },
                    None => (of.title),
                }
            }
            @match &of.behind {
                Some(grid) => (folded("The numbers", grid)),
                None => p.quiet { "Its numbers: `turbid show FILE`" },
            }
        }
    }
}

fn folded(head: &str, grid: &Grid) -> Markup {
    html! { details { summary { (head) } (table(grid)) } }
}

fn table(grid: &Grid) -> Markup {
    // Of a column of numbers the digits stand below each other.
    let numbers: Vec<bool> = (0..grid.head.len()).map(|k| is_numbers(grid, k)).collect();
    let class = |k: usize| numbers.get(k).is_some_and(|numbers| *numbers).then_some("n");
    html! {
        @if !grid.rows.is_empty() {
            // A wide table scrolls by itself, by keys too.
            div.wide tabindex="0" role="group" aria-label=(if grid.caption.is_empty() { "table" } else { &grid.caption }) {
                table.sort[grid.rows.len() > 1] {
                    @if !grid.caption.is_empty() { caption { (grid.caption) } }
                    thead { tr { @for (k, head) in grid.head.iter().enumerate() { th class=[class(k)] scope="col" { (head) } } } }
                    tbody { @for row in &grid.rows { tr { @for (k, one) in row.iter().enumerate() { td class=[class(k).or(short(one))] { (cell(one)) } } } } }
                }
            }
        }
        @if let Some(more) = &grid.more { p.quiet { (more) } }
    }
}

/// Short texts stay on one line.
fn short(of: &Cell) -> Option<&'static str> {
    let (Cell::Text(text) | Cell::Run(text) | Cell::Link { text, .. }) = of;
    (text.chars().count() <= 16).then_some("s")
}

fn is_numbers(grid: &Grid, column: usize) -> bool {
    let text = |row: &Vec<Cell>| match row.get(column) {
        Some(Cell::Text(text) | Cell::Run(text)) => Some(text.clone()),
        _ => None,
    };
    let is_number = |text: &String| text.is_empty() || text == "-" || text.parse::<f64>().is_ok();
    let texts: Option<Vec<String>> = grid.rows.iter().map(text).collect();
    texts.is_some_and(|texts| texts.iter().all(is_number) && texts.iter().any(|text| text.parse::<f64>().is_ok()))
}

fn cell(of: &Cell) -> Markup {
    html! {
        @match of {
            Cell::Text(text) => (text),
            Cell::Run(text) => span.run { (text) },
            Cell::Link { text, href } => a href=(href) { (text) },
        }
    }
}
