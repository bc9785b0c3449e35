//! Mistakes as a user sees them: `file:line:column`, path, the line with a caret, the rule, the way out.

use std::fmt::{self, Write as _};

use serde_json::{Value, json};

use super::source::{SourceFile, Span};
use crate::terminal::{commands, plain, plain_line};

/// Characters of a source line that are shown; longer lines are cut around the caret.
const SHOWN: usize = 110;
/// More mistakes than this are counted, not shown.
const MAX_SHOWN: usize = 50;
/// More mistakes than this are not even looked at.
const MAX_FOUND: usize = 200;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    Error,
    /// Legal, but probably not meant; never stops a run.
    Warning,
}

/// One mistake, with everything that is needed to show it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    pub severity: Severity,
    /// Name of the file; empty if the mistake is in none.
    pub file: String,
    /// From 1; 0 means the file as a whole.
    pub line: u32,
    /// From 1, in characters.
    pub column: u32,
    /// Length of what is marked, in characters.
    pub len: u32,
    /// `stages.frames.with.samples`; empty for the file as a whole.
    pub path: String,
    /// What stands there, with value and unit, and the rule.
    pub message: String,
    /// The way out.
    pub hint: Option<String>,
    /// The source line, without its line break; of a long line, what stands around `column`.
    pub source: String,
    /// Characters of the line that are left out before `source`.
    skipped: u32,
    /// Follows from a mistake that is reported at the same place already.
    pub(super) follow_up: bool,
}

impl Diagnostic {
    /// An error that belongs to no place in a file.
    pub fn error(message: impl Into<String>, hint: Option<String>) -> Self {
        Self {
            severity: Severity::Error,
            file: String::new(),
            line: 0,
            column: 0,
            len: 0,
            path: String::new(),
            message: message.into(),
            hint,
            source: String::new(),
            skipped: 0,
            follow_up: false,
        }
    }

    /// An error at `span` of one of `sources`.
    pub(super) fn at(sources: &[SourceFile], span: Span, path: impl Into<String>, message: impl Into<String>) -> Self {
        let file = sources.get(span.file as usize);
        let line = file.and_then(|f| f.line(span.line)).unwrap_or_default();
        let (source, skipped) = around(line, span.column);
        Self {
            file: file.map(|f| f.name.clone()).unwrap_or_default(),
            line: span.line,
            column: span.column,
            len: span.len,
            path: path.into(),
            source,
            skipped,
            ..Self::error(message, None)
        }
    }

    /// The same mistake, shown in another spelling of its line.
    #[must_use]
    pub(super) fn shown_in(self, line: &str) -> Self {
        let (source, skipped) = around(line, self.column);
        Self { source, skipped, ..self }
    }

    #[must_use]
    pub(super) fn hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into();
        self
    }

    #[must_use]
    pub fn warning(mut self) -> Self {
        self.severity = Severity::Warning;
        self
    }

    pub fn to_json(&self) -> Value {
        json!({
            "severity": if self.severity == Severity::Error { "error" } else { "warning" },
            "file": self.file, "line": self.line, "column": self.column,
            "path": self.path, "message": self.message, "hint": self.hint,
        })
    }

    fn write(&self, f: &mut impl fmt::Write, colour: bool) -> fmt::Result {
        let paint = |code: &'static str| if colour { code } else { "" };
        let (bold, mark, cyan, reset) = (
            paint("\x1b[1m"),
            paint(if self.severity == Severity::Error { "\x1b[1;31m" } else { "\x1b[1;33m" }),
            paint("\x1b[36m"),
            paint("\x1b[0m"),
        );
        if !self.file.is_empty() {
            write!(f, "{bold}{}", plain_line(&self.file))?;
            if self.line > 0 {
                write!(f, ":{}:{}", self.line, self.column)?;
            }
            write!(f, "{reset}: ")?;
        }
        let word = if self.severity == Severity::Error { "error" } else { "warning" };
        write!(f, "{mark}{word}{reset}: ")?;
        if !self.path.is_empty() {
            write!(f, "{}: ", plain_line(&self.path))?;
        }
        writeln!(f, "{}", plain(&self.message))?;
        if self.line > 0 {
            // One character for one, so that the carets stand where they should.
            let source: String = self.source.chars().map(|c| if commands(c) { ' ' } else { c }).collect();
            let (text, caret) = excerpt(&source, self.skipped, self.column, self.len);
            let number = self.line.to_string();
            writeln!(f, " {cyan}{number:>4} |{reset} {text}")?;
            writeln!(f, " {:>4} {cyan}|{reset} {mark}{caret}{reset}", "")?;
        }
        if let Some(hint) = &self.hint {
            writeln!(f, "      {cyan}={reset} {}", plain(hint))?;
        }
        Ok(())
    }
}

/// What is shown of a line, and how many characters are left out before it.
fn around(line: &str, column: u32) -> (String, u32) {
    let at = column.saturating_sub(1) as usize;
    // Bytes are at least as many as characters, so short lines need no counting.
    let skipped = if line.len() <= SHOWN { 0 } else { at.saturating_sub(SHOWN / 2) };
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    let mut shown: String = line.chars().skip(skipped).take(SHOWN + 1).map(plain).collect();
    if shown.chars().count() > SHOWN {
        shown.pop();
        shown.push_str(" ...");
    }
    (shown, skipped as u32)
}

/// The line as shown, and the carets to stand below it.
fn excerpt(source: &str, skipped: u32, column: u32, len: u32) -> (String, String) {
    let before = if skipped > 0 { "... " } else { "" };
    let shown = source.strip_suffix(" ...").unwrap_or(source).chars().count();
    let at = (column.saturating_sub(1).saturating_sub(skipped) as usize).min(shown);
    let caret = " ".repeat(before.len() + at) + &"^".repeat((len as usize).clamp(1, (shown - at).max(1)));
    (format!("{before}{source}").trim_end().to_owned(), caret)
}

/// Mistakes and warnings, in the order of their places, each once.
#[derive(Clone, Debug, Default)]
pub struct Report {
    found: Vec<Diagnostic>,
    /// Mistakes beyond those in `found`.
    more: usize,
}

impl Report {
    pub fn push(&mut self, diagnostic: Diagnostic) {
        if !diagnostic.follow_up {
            self.found.push(diagnostic);
        }
    }

    pub fn extend(&mut self, more: impl IntoIterator<Item = Diagnostic>) {
        more.into_iter().for_each(|d| self.push(d));
    }

    /// Whether further mistakes are only counted.
    pub(super) fn is_full(&self) -> bool {
        self.found.len() >= MAX_FOUND
    }

    pub(super) fn count(&mut self) {
        self.more += 1;
    }

    pub fn into_vec(self) -> Vec<Diagnostic> {
        self.found
    }

    /// Whether something is said about exactly this path.
    pub fn mentions(&self, path: &str) -> bool {
        self.diagnostics().iter().any(|d| d.path == path)
    }

    pub fn has_errors(&self) -> bool {
        self.found.iter().any(|d| d.severity == Severity::Error)
    }

    /// Those that stop nothing.
    pub fn warnings(&self) -> Vec<Diagnostic> {
        self.found.iter().filter(|d| d.severity == Severity::Warning).cloned().collect()
    }

    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    pub fn errors(&self) -> usize {
        self.diagnostics().iter().filter(|d| d.severity == Severity::Error).count()
    }

    /// Sorted by place, each once.
    pub fn diagnostics(&self) -> Vec<&Diagnostic> {
        let key = |d: &Diagnostic| (d.file.clone(), d.line, d.column);
        let mut sorted: Vec<&Diagnostic> = self.found.iter().collect();
        sorted.sort_by_cached_key(|d| (key(d), d.severity, d.path.clone(), d.message.clone()));
        sorted.dedup_by(|b, a| (key(a), &a.message) == (key(b), &b.message));
        sorted
    }

    /// The text for people, with terminal colours if `colour`.
    pub fn render(&self, colour: bool) -> String {
        let mut text = String::new();
        let all = self.diagnostics();
        for diagnostic in all.iter().take(MAX_SHOWN) {
            diagnostic.write(&mut text, colour).expect("writing to a String cannot fail");
        }
        let more = all.len().saturating_sub(MAX_SHOWN) + self.more;
        if more > 0 {
            writeln!(text, "and {more} more").expect("writing to a String cannot fail");
        }
        text
    }

    pub fn to_json(&self) -> Value {
        self.diagnostics().into_iter().map(Diagnostic::to_json).collect()
    }
}

impl From<Vec<Diagnostic>> for Report {
    fn from(found: Vec<Diagnostic>) -> Self {
        let mut report = Self::default();
        report.extend(found);
        report
    }
}

impl From<Diagnostic> for Report {
    fn from(one: Diagnostic) -> Self {
        vec![one].into()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, false)
    }
}

impl std::error::Error for Report {}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(line: u32, column: u32, len: u32, text: &str) -> Diagnostic {
        let sources = [SourceFile::new("p.yaml", "", text)];
        Diagnostic::at(&sources, Span { file: 0, line, column, len }, "seed", "wrong")
    }

    #[test]
    fn a_mistake_shows_place_line_caret_and_way_out() {
        let shown = at(2, 7, 3, "a: 1\nseed: abc\n").hint(Some("write a number".to_owned())).to_string();
        assert_eq!(
            shown,
            "p.yaml:2:7: error: seed: wrong\n    2 | seed: abc\n      |       ^^^\n      = write a number\n"
        );
    }

    #[test]
    fn long_lines_are_cut_around_the_caret() {
        let line = format!("{}X{}", "a".repeat(5000), "b".repeat(5000));
        let shown = at(1, 5001, 1, &line).to_string();
        let rows: Vec<&str> = shown.lines().collect();
        assert!(rows[1].chars().count() < 140);
        assert_eq!(rows[1].find('X'), rows[2].find('^'));
    }

    #[test]
    fn a_report_is_sorted_and_says_nothing_twice() {
        let text = "aaaa\nbbbb\n";
        let report = Report::from(vec![at(2, 1, 1, text), at(1, 3, 1, text), at(2, 1, 1, text)]);
        let places: Vec<_> = report.diagnostics().iter().map(|d| (d.line, d.column)).collect();
        assert_eq!(places, [(1, 3), (2, 1)]);
        assert!(!report.to_string().contains('\x1b') && report.render(true).contains('\x1b'));
    }

    /// Marks beyond the end of a line, in an empty line or among wide and control characters never panic.
    #[test]
    fn any_place_can_be_shown() {
        for line in ["", "\t\tx", "µm é 漢字", "a\u{1b}[31m", "\u{202e}a"] {
            for column in [0, 1, 3, 200] {
                for len in [0, 1, 9999] {
                    let shown = Report::from(Diagnostic {
                        file: line.into(),
                        message: line.into(),
                        ..at(1, column, len, line)
                    })
                    .to_string();
                    assert!(!shown.contains(commands), "{shown:?}");
                }
            }
        }
    }
}
