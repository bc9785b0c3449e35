//! The pages of the documentation, taken apart: fenced blocks, prose, links, headings.

use std::fs;
use std::path::{Path, PathBuf};

/// Columns of a line of prose.
pub const WIDTH: usize = 120;

/// A page of Markdown.
pub struct Page {
    /// From the root of the repository: `docs/theory/scene.md`.
    pub name: String,
    pub path: PathBuf,
    pub text: String,
}

/// A fenced block: "```sh long" has the language `sh` and the word `long`.
pub struct Block {
    /// Of the fence, counted from 1.
    pub line: usize,
    pub language: String,
    pub words: Vec<String>,
    pub text: String,
}

/// What a line of a page is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Blank,
    Prose,
    Heading,
    Table,
    Picture,
    /// Fenced or indented.
    Code,
}

/// The README and all pages below `docs`, sorted.
pub fn pages() -> Vec<Page> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = vec![root.join("README.md")];
    let mut open = vec![root.join("docs")];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    let page = |path: PathBuf| Page {
        name: path.strip_prefix(root).expect("it is below the root").display().to_string(),
        text: fs::read_to_string(&path).expect("it is text"),
        path,
    };
    found.into_iter().map(page).collect()
}

/// Each line of a page with what it is.
pub fn lines(text: &str) -> Vec<(Kind, &str)> {
    let (mut fenced, mut list) = (false, false);
    let mut before = Kind::Blank;
    let mut found = Vec::new();
    for line in text.lines() {
        let trimmed = line.trim_start();
        let fence = trimmed.starts_with("```");
        let kind = match trimmed {
            _ if fenced || fence => Kind::Code,
            "" => Kind::Blank,
            _ if line.starts_with('#') => Kind::Heading,
            _ if trimmed.starts_with('|') => Kind::Table,
            _ if trimmed.starts_with("![") => Kind::Picture,
            _ if line.starts_with("    ") && !list && before != Kind::Prose => Kind::Code,
            _ => Kind::Prose,
        };
        fenced ^= fence;
        // What follows an item of a list and is indented belongs to it.
        list = match kind {
            Kind::Prose => list && line.starts_with(' ') || marker(trimmed).is_some(),
            Kind::Blank => list,
            _ => list && line.starts_with(' '),
        };
        before = kind;
        found.push((kind, line));
    }
    found
}

/// The mark of an item of a list, with its blank: `- `, `12. `.
pub fn marker(line: &str) -> Option<&str> {
    let digits = line.len() - line.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let end = match line.get(digits..)? {
        rest if digits > 0 && (rest.starts_with(". ") || rest.starts_with(") ")) => digits + 2,
        _ if ["- ", "* ", "+ "].iter().any(|mark| line.starts_with(mark)) => 2,
        _ => return None,
    };
    line.get(..end)
}

impl Page {
    /// Fenced blocks, without the indentation of their fence.
    pub fn blocks(&self) -> Vec<Block> {
        let mut found: Vec<Block> = Vec::new();
        let mut indent = None;
        for (at, line) in self.text.lines().enumerate() {
            let trimmed = line.trim_start();
            match (indent, trimmed.strip_prefix("```")) {
                (None, Some(info)) => {
                    let mut words = info.split_whitespace().map(str::to_owned);
                    let language = words.next().unwrap_or_default();
                    found.push(Block { line: at + 1, language, words: words.collect(), text: String::new() });
                    indent = Some(line.len() - trimmed.len());
                }
                (Some(_), Some(_)) => indent = None,
                (Some(width), None) => {
                    let block = found.last_mut().expect("it was opened");
                    block.text.push_str(line.get(width..).unwrap_or(trimmed));
                    block.text.push('\n');
                }
                (None, None) => {}
            }
        }
        assert_eq!(indent, None, "{}: a fence is not closed", self.name);
        found
    }

    /// All text outside of fences and indented code, lines joined by blanks.
    pub fn prose(&self) -> String {
        let kept = lines(&self.text).into_iter().filter(|(kind, _)| *kind != Kind::Code);
        kept.map(|(_, line)| line.trim()).collect::<Vec<_>>().join(" ")
    }

    /// What stands between single backticks in prose.
    pub fn code_spans(&self) -> Vec<String> {
        self.prose().split('`').skip(1).step_by(2).map(str::to_owned).collect()
    }

    /// Targets of links and pictures, outside of code.
    pub fn links(&self) -> Vec<String> {
        let prose = self.prose();
        let plain: Vec<&str> = prose.split('`').step_by(2).collect();
        let plain = plain.join("`");
        let ends = plain.match_indices("](").filter_map(|(at, _)| {
            let rest = &plain[at + 2..];
            rest.find(')').map(|end| rest[..end].to_owned())
        });
        ends.collect()
    }

    /// The anchors of its headings, as GitHub makes them.
    pub fn anchors(&self) -> Vec<String> {
        let heads = lines(&self.text).into_iter().filter(|(kind, _)| *kind == Kind::Heading);
        let anchor = |text: &str| -> String {
            let kept = text.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
            kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
        };
        heads.map(|(_, line)| anchor(line.trim_start_matches('#').trim())).collect()
    }
}

/// Prose that is longer than [`WIDTH`] columns: its line, counted from 1.
pub fn too_long(text: &str) -> Vec<usize> {
    let long = |(kind, line): &(Kind, &str)| {
        *kind == Kind::Prose && line.chars().count() > WIDTH && pieces(line.trim()).len() > 1
    };
    lines(text).iter().enumerate().filter(|(_, line)| long(line)).map(|(at, _)| at + 1).collect()
}

/// The same page with those paragraphs wrapped that have lines that are too long.
pub fn wrapped(text: &str) -> String {
    let mut out = String::new();
    let mut open: Vec<&str> = Vec::new();
    let close = |open: &mut Vec<&str>, out: &mut String| {
        let long = open.iter().any(|line| line.chars().count() > WIDTH);
        if long {
            out.push_str(&wrap(open));
        } else {
            open.iter().for_each(|line| out.push_str(&format!("{line}\n")));
        }
        open.clear();
    };
    for (kind, line) in lines(text) {
        if kind != Kind::Prose || marker(line.trim_start()).is_some() {
            close(&mut open, &mut out);
        }
        match kind {
            Kind::Prose => open.push(line),
            _ => out.push_str(&format!("{line}\n")),
        }
    }
    close(&mut open, &mut out);
    out
}

/// One paragraph, or one item of a list.
fn wrap(paragraph: &[&str]) -> String {
    let first = paragraph.first().copied().unwrap_or_default();
    let body = first.trim_start();
    let indent = first.len() - body.len();
    let mark = marker(body).unwrap_or_default();
    let hang = " ".repeat(indent + mark.len());
    let text = paragraph.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ");
    let mut rows: Vec<Vec<String>> = vec![Vec::new()];
    let width = |row: &[String]| row.iter().map(|piece| piece.chars().count() + 1).sum::<usize>() + hang.len();
    for piece in pieces(&text[mark.len()..]) {
        let row = rows.last_mut().expect("there is one");
        if row.is_empty() || width(row) + piece.chars().count() <= WIDTH {
            row.push(piece);
            continue;
        }
        // A sign that begins a line would make a list of it: it takes the word before along.
        let mut next = Vec::new();
        if starts_a_block(&piece) && row.len() > 1 {
            next.extend(row.pop());
        }
        next.push(piece);
        rows.push(next);
    }
    let begin = |at: usize| if at == 0 { format!("{}{mark}", " ".repeat(indent)) } else { hang.clone() };
    rows.iter().enumerate().map(|(at, row)| format!("{}{}\n", begin(at), row.join(" "))).collect()
}

/// Words, a code span being one.
fn pieces(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut whole = true;
    for word in text.split_whitespace() {
        match found.last_mut().filter(|_| !whole) {
            Some(last) => last.push_str(&format!(" {word}")),
            None => found.push(word.to_owned()),
        }
        whole ^= word.matches('`').count() % 2 == 1;
    }
    found
}

fn starts_a_block(word: &str) -> bool {
    let digits = word.trim_start_matches(|c: char| c.is_ascii_digit());
    matches!(word, "-" | "+" | "*" | "=")
        || word.starts_with(['#', '>', '|', '='])
        || digits.len() < word.len() && matches!(digits, "." | ")")
}
