//! Mistakes as a user sees them: `file:line:column`, path, the rule, the line with a caret, the way out.

use std::fmt;

use serde_json::{Value, json};

use super::excerpt::{Also, Marked, draw};
use super::mistake::{Kind, Mistake};
use super::source::{SourceFile, Span};
use crate::terminal::{plain, plain_line};

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
    pub kind: Kind,
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
    marked: Marked,
    also: Option<Box<Also>>,
    /// Follows from a mistake that is reported at the same place already.
    pub(super) follow_up: bool,
}

impl Diagnostic {
    /// An error that belongs to no place in a file: of the command line.
    pub fn error(message: impl Into<String>, hint: Option<String>) -> Self {
        Self::nowhere(Mistake::new(Kind::Usage, message).hint(hint))
    }

    /// A mistake that belongs to no place in a file.
    pub fn nowhere(Mistake { kind, message, hint }: Mistake) -> Self {
        Self {
            severity: Severity::Error,
            kind,
            file: String::new(),
            line: 0,
            column: 0,
            len: 0,
            path: String::new(),
            message,
            hint,
            marked: Marked::default(),
            also: None,
            follow_up: false,
        }
    }

    /// An error at `span` of one of `sources`.
    pub(super) fn at(sources: &[SourceFile], span: Span, path: impl Into<String>, mistake: impl Into<Mistake>) -> Self {
        let file = sources.get(span.file as usize);
        Self {
            file: file.map(|f| f.name.clone()).unwrap_or_default(),
            line: span.line,
            column: span.column,
            len: span.len,
            path: path.into(),
            marked: marked(sources, span),
            ..Self::nowhere(mistake.into())
        }
    }

    /// The same mistake, shown in another spelling of its line.
    #[must_use]
    pub(super) fn shown_in(self, line: &str) -> Self {
        Self { marked: Marked::new(line, self.line, self.column, self.len), ..self }
    }

    /// Shows a second place, with what it has to do with the mistake.
    #[must_use]
    pub(super) fn also(mut self, sources: &[SourceFile], span: Span, label: &'static str) -> Self {
        let file = sources.get(span.file as usize).map(|f| plain_line(&f.name).into_owned()).unwrap_or_default();
        self.also = Some(Box::new(Also { file, label, marked: marked(sources, span) }));
        self
    }

    #[must_use]
    pub(super) fn hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into().or(self.hint);
        self
    }

    #[must_use]
    pub fn warning(mut self) -> Self {
        self.severity = Severity::Warning;
        if self.kind == Kind::WrongValue {
            self.kind = Kind::Suspect;
        }
        self
    }

    /// Message and way out in one line.
    pub fn in_short(&self) -> String {
        match &self.hint {
            Some(hint) => format!("{} ({hint})", self.message),
            None => self.message.clone(),
        }
    }

    pub fn to_json(&self) -> Value {
        json!({
            "severity": if self.severity == Severity::Error { "error" } else { "warning" },
            "kind": self.kind.name(), "file": self.file, "line": self.line, "column": self.column,
            "path": self.path, "message": self.message, "hint": self.hint,
        })
    }

    pub(super) fn write(&self, f: &mut impl fmt::Write, colour: bool) -> fmt::Result {
        let paint = |code: &'static str| if colour { code } else { "" };
        let error = self.severity == Severity::Error;
        let (bold, reset) = (paint("\x1b[1m"), paint("\x1b[0m"));
        let mark = paint(if error { "\x1b[1;31m" } else { "\x1b[1;33m" });
        if !self.file.is_empty() {
            write!(f, "{bold}{}", plain_line(&self.file))?;
            if self.line > 0 {
                write!(f, ":{}:{}", self.line, self.column)?;
            }
            write!(f, "{reset}: ")?;
        }
        write!(f, "{mark}{}{reset}: ", if error { "error" } else { "warning" })?;
        if !self.path.is_empty() {
            write!(f, "{}: ", plain_line(&self.path))?;
        }
        writeln!(f, "{}", plain(&self.message))?;
        let hint = self.hint.as_deref().map(plain);
        let marked = (self.line > 0).then_some(&self.marked);
        f.write_str(&draw(marked, self.also.as_deref(), hint.as_deref(), error, colour))
    }
}

fn marked(sources: &[SourceFile], span: Span) -> Marked {
    let line = sources.get(span.file as usize).and_then(|f| f.line(span.line)).unwrap_or_default();
    Marked::new(line, span.line, span.column, span.len)
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::Report;
    use crate::terminal::commands;

    fn at(line: u32, column: u32, len: u32, text: &str) -> Diagnostic {
        let sources = [SourceFile::new("p.yaml", "", text)];
        Diagnostic::at(&sources, Span { file: 0, line, column, len }, "seed", "wrong")
    }

    #[test]
    fn a_mistake_shows_place_line_caret_and_way_out() {
        let shown = at(2, 7, 3, "a: 1\nseed: abc\n").hint(Some("write a number".to_owned())).to_string();
        assert_eq!(
            shown,
            "p.yaml:2:7: error: seed: wrong\n  |\n2 | seed: abc\n  |       ^^^\n  |\n  = help: write a number\n"
        );
    }

    #[test]
    fn a_second_place_is_shown_below_the_first() {
        let sources = [SourceFile::new("p.yaml", "", "vars: {n: 1}\na: 1\nseed: abc\n")];
        let first = Diagnostic::at(&sources, Span { file: 0, line: 1, column: 11, len: 1 }, "vars.n", "wrong");
        let shown = first.also(&sources, Span { file: 0, line: 3, column: 7, len: 3 }, "used here").to_string();
        let expected = "  |\n1 | vars: {n: 1}\n  |           ^\n  |\n ::: p.yaml:3:7\n  |\n3 | seed: abc\n  |       --- used here\n";
        assert_eq!(shown, format!("p.yaml:1:11: error: vars.n: wrong\n{expected}"));
    }

    #[test]
    fn long_lines_are_cut_around_the_caret() {
        for (before, after) in [(5000, 5000), (0, 5000), (5000, 0), (100, 100)] {
            let line = format!("{}X{}", "a".repeat(before), "b".repeat(after));
            let shown = at(1, before as u32 + 1, 1, &line).to_string();
            let rows: Vec<&str> = shown.lines().collect();
            assert!(rows.iter().all(|row| row.chars().count() < 160), "{shown}");
            assert_eq!(rows[2].find('X'), rows[3].find('^'), "{shown}");
        }
    }

    /// Marks stand below what they mark where characters take two columns, and a tab is shown as blanks.
    #[test]
    fn wide_characters_and_tabs_keep_the_mark_in_its_place() {
        let rows = |text: &str, column, len| {
            at(1, column, len, text).to_string().lines().map(str::to_owned).collect::<Vec<_>>()
        };
        assert_eq!(rows("漢字: µm x", 8, 1)[2..4], ["1 | 漢字: µm x", "  |          ^"].map(str::to_owned));
        assert_eq!(rows("\tx: y", 5, 1)[2..4], ["1 |     x: y", "  |        ^"].map(str::to_owned));
    }

    #[test]
    fn a_report_is_sorted_and_says_nothing_twice() {
        let text = "aaaa\nbbbb\n";
        let report = Report::from(vec![at(2, 1, 1, text), at(1, 3, 1, text), at(2, 1, 1, text)]);
        let places: Vec<_> = report.diagnostics().iter().map(|d| (d.line, d.column)).collect();
        assert_eq!(places, [(1, 3), (2, 1)]);
        assert!(!report.to_string().contains('\x1b') && report.render(true).contains('\x1b'));
    }

    /// Input that is wrong ends with 2, what failed with 1; a warning decides nothing.
    #[test]
    fn exit_codes_are_those_of_the_kinds() {
        let of = |kinds: &[Kind]| {
            let found = kinds.iter().map(|&kind| Diagnostic::nowhere(Mistake::new(kind, "wrong")));
            Report::from(found.collect::<Vec<_>>()).exit_code()
        };
        assert_eq!([of(&[Kind::Syntax]), of(&[Kind::Usage, Kind::File]), of(&[Kind::Failed])], [2, 2, 1]);
        let warning = Diagnostic::nowhere(Mistake::new(Kind::Failed, "odd")).warning();
        assert_eq!(Report::from(vec![warning, at(1, 1, 1, "a")]).exit_code(), 2);
    }

    /// Marks beyond the end of a line, in an empty line or among wide and control characters never panic.
    #[test]
    fn any_place_can_be_shown() {
        let wide = "漢 ".repeat(700) + "\t\u{1b}\u{85}\u{300}".repeat(300).as_str();
        for line in ["", "\t\tx", "µm é 漢字", "a\u{1b}[31m", "\u{202e}a\u{85}", wide.as_str()] {
            for column in [0, 1, 3, 200, 401, 802, 1399, 2600, u32::MAX] {
                for len in [0, 1, 50, 9999, u32::MAX] {
                    let wrong = Diagnostic { file: line.into(), message: line.into(), ..at(1, column, len, line) };
                    let sources = [SourceFile::new(line, "", line)];
                    let wrong = wrong.also(&sources, Span { file: 0, line: 1, column, len }, "used here");
                    let shown = Report::from(wrong.hint(Some(line.to_owned()))).to_string();
                    assert!(!shown.contains(commands), "{shown:?}");
                }
            }
        }
    }
}
