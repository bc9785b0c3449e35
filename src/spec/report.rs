//! All mistakes of a file, and of what is done with it.

use std::fmt::{self, Write as _};

use serde_json::Value;

use super::diagnostic::{Diagnostic, Severity};

/// More mistakes than this are counted, not shown.
const MAX_SHOWN: usize = 50;
/// More mistakes than this are not even looked at.
const MAX_FOUND: usize = 200;

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

    /// How a command ends that these end: 1 where something failed, 2 where the user's input is wrong.
    pub fn exit_code(&self) -> u8 {
        let errors = self.found.iter().filter(|d| d.severity == Severity::Error);
        errors.map(|d| d.kind.exit_code()).min().unwrap_or(2)
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

impl std::error::Error for Report {}
