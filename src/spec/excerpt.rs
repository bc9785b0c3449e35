//! Lines of source files with carets, drawn by annotate-snippets, which serde-saphyr brings along: it knows the width of characters, shows tabs as
//! blanks and control characters as pictures, and cuts long lines around the mark.
//!
//! Ours are the first line of a mistake (`file:line:column: error: path: message`, which editors and scripts read) and two things that the
//! library leaves to others: a mark beyond the end of a line is an error there, and of a line of megabytes only what stands around the mark is
//! given to it. Characters that turn the direction of writing, and the control characters above ASCII, become U+FFFD before.

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use crate::terminal::commands;

/// Characters on each side of a mark that are kept of a line; more than the library shows.
const KEPT: usize = 400;

/// A marked part of a line, with as much of the line as is ever shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Marked {
    line: u32,
    text: String,
    /// What is marked, in bytes of `text`.
    start: usize,
    end: usize,
    /// Whether the line begins where `text` does.
    whole: bool,
}

impl Marked {
    /// `column` from 1 and `len` in characters; what is beyond the end of the line is left out.
    pub fn new(source: &str, line: u32, column: u32, len: u32) -> Self {
        let at = column.saturating_sub(1) as usize;
        // Bytes are at least as many as characters, so short lines need no counting.
        let skipped = if source.len() <= KEPT { 0 } else { at.saturating_sub(KEPT) };
        let kept = source.chars().skip(skipped).take(2 * KEPT);
        let text: String = kept.map(|c| if commands(c) && !c.is_ascii() { '\u{fffd}' } else { c }).collect();
        let byte = |place: usize| text.char_indices().nth(place).map_or(text.len(), |(byte, _)| byte);
        let start = byte(at - skipped);
        let end = byte((at - skipped).saturating_add(len.max(1) as usize));
        Self { line, text, start, end, whole: skipped == 0 }
    }

    fn snippet(
        &self,
        kind: AnnotationKind,
        label: Option<&'static str>,
    ) -> Snippet<'_, annotate_snippets::Annotation<'_>> {
        let mark = kind.span(self.start..self.end).label(label);
        Snippet::source(self.text.as_str()).line_start(self.line as usize).fold(false).annotation(mark)
    }
}

/// Another place that has to do with a mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Also {
    /// `file:line:column` is put before the line by the library.
    pub file: String,
    pub label: &'static str,
    pub marked: Marked,
}

/// The lines below a mistake: the marked one, the other place, the way out.
pub(super) fn draw(
    marked: Option<&Marked>,
    also: Option<&Also>,
    hint: Option<&str>,
    error: bool,
    colour: bool,
) -> String {
    let mut group = Group::with_level(if error { Level::ERROR } else { Level::WARNING });
    if let Some(marked) = marked {
        group = group.element(marked.snippet(AnnotationKind::Primary, None));
    }
    // The library counts the column that it tells; of a line that begins elsewhere it would be another.
    let also = also.filter(|also| also.marked.whole);
    if let Some(also) = also {
        group = group.element(also.marked.snippet(AnnotationKind::Context, Some(also.label)).path(also.file.as_str()));
    }
    if let Some(hint) = hint {
        group = group.element(Level::HELP.message(hint));
    }
    if marked.is_none() && also.is_none() && hint.is_none() {
        return String::new();
    }
    let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
    let drawn = renderer.render(&[group]);
    drawn.lines().flat_map(|line| [line.trim_end(), "\n"]).collect()
}
