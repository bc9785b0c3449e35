//! YAML text to [`Node`]s. Works on the parser's events, without recursion, so that every key and value has its
//! exact place, every repeated key is found at once, and no input can exhaust the stack or the memory.

use std::collections::{HashMap, HashSet};

use serde_yaml::granit_parser::{
    ErrorKind, Event, Marker, Options, Parser, ScalarStyle, ScanError, Span as Marks, StructureStyle, Tag,
};

use super::diagnostic::Diagnostic;
use super::mistake::{Kind as Wrong, Mistake};
use super::node::{Data, Entry, Node};
use super::report::Report;
use super::scalar::{Plain, plain};
use super::source::{SourceFile, Span};
use super::substitute;

/// Deeper nesting is no pipeline; it also bounds every recursive walk over a [`Node`].
pub const MAX_DEPTH: usize = 64;
/// Values in one file, copies made by aliases included.
pub const MAX_NODES: usize = 500_000;
/// A file with more mistakes than this is something else than a pipeline.
const MAX_MISTAKES: usize = 40;

/// Parses `sources[file]`; `None` if no tree could be made of it. Mistakes go to `report`.
pub fn parse(sources: &[SourceFile], file: usize, report: &mut Report) -> Option<Node> {
    let mut builder = Builder::new(file as u32);
    let root = match builder.read(&sources[file].text) {
        // A file without any value, or with comments only, is an empty document.
        Ok(()) => builder.root.take().or(Some(Node::new(Span { file: file as u32, ..Span::default() }, Data::Null))),
        Err(fatal) => {
            builder.mistakes.push(fatal);
            None
        }
    };
    for m in builder.mistakes {
        report.push(Diagnostic::at(sources, m.span, m.path, m.mistake));
    }
    root
}

/// A mistake with its place in the file that is read.
struct Placed {
    span: Span,
    path: String,
    mistake: Mistake,
}

/// A list or map whose end has not come yet.
struct Open {
    span: Span,
    flow: bool,
    anchor: usize,
    kind: Kind,
}

enum Kind {
    List(Vec<Node>),
    Map { entries: Vec<Entry>, seen: Seen, key: Option<(String, Span)>, merges: Vec<Node> },
}

/// Places of the keys of a map; empty while the map is small enough to be walked along.
#[derive(Default)]
struct Seen(HashMap<String, usize>);

impl Seen {
    fn find(&mut self, entries: &[Entry], key: &str) -> Option<usize> {
        const SMALL: usize = 12;
        if entries.len() < SMALL {
            return entries.iter().position(|e| e.key == key);
        }
        for (i, entry) in entries.iter().enumerate().skip(self.0.len()) {
            self.0.insert(entry.key.clone(), i);
        }
        self.0.get(key).copied()
    }
}

struct Builder {
    file: u32,
    open: Vec<Open>,
    root: Option<Node>,
    anchors: HashMap<usize, Node>,
    unfinished: HashSet<usize>,
    nodes: usize,
    documents: usize,
    /// Place of a key that is none: it is left out with its value.
    dropped: Option<Span>,
    mistakes: Vec<Placed>,
}

impl Builder {
    fn new(file: u32) -> Self {
        Self {
            file,
            open: Vec::new(),
            root: None,
            anchors: HashMap::new(),
            unfinished: HashSet::new(),
            nodes: 0,
            documents: 0,
            dropped: None,
            mistakes: Vec::new(),
        }
    }

    fn read(&mut self, text: &str) -> Result<(), Placed> {
        let mut options = Options::default();
        options.set_emit_comments(false);
        options.flow_nesting_limit = MAX_DEPTH;
        options.block_nesting_limit = MAX_DEPTH;
        for event in Parser::new_from_str_with_options(text, options) {
            let (event, marks) = event.map_err(|error| self.syntax_error(&error, text))?;
            self.take(event, marks)?;
            if self.mistakes.len() >= MAX_MISTAKES {
                let span = self.span(&marks);
                return Err(self.mistake(span, "too many mistakes; the rest of the file is not read", None));
            }
        }
        Ok(())
    }

    fn take(&mut self, event: Event<'_>, marks: Marks) -> Result<(), Placed> {
        match event {
            Event::DocumentStart(..) => {
                self.documents += 1;
                if self.documents > 1 {
                    let hint = "a pipeline file is one document: take out the line `---`, or make two files";
                    let span = self.span(&marks);
                    return Err(self.mistake(span, "a second YAML document begins here", Some(hint.to_owned())));
                }
                Ok(())
            }
            Event::Scalar(text, style, anchor, tag) => self.scalar(&text, style, anchor, tag.as_deref(), &marks),
            Event::SequenceStart(style, anchor, tag) => {
                self.begin(Kind::List(Vec::new()), style, anchor, tag.as_deref(), &marks)
            }
            Event::MappingStart(style, anchor, tag) => {
                let kind = Kind::Map { entries: Vec::new(), seen: Seen::default(), key: None, merges: Vec::new() };
                self.begin(kind, style, anchor, tag.as_deref(), &marks)
            }
            Event::SequenceEnd | Event::MappingEnd => self.end(&marks),
            Event::Alias(id) => self.alias(id, &marks),
            _ => Ok(()),
        }
    }

    fn scalar(
        &mut self,
        text: &str,
        style: ScalarStyle,
        anchor: usize,
        tag: Option<&Tag>,
        marks: &Marks,
    ) -> Result<(), Placed> {
        let span = self.span(marks);
        self.check_tag(tag, span)?;
        if self.wants_key() {
            return self.take_key(text, style, span);
        }
        if style == ScalarStyle::Plain && text.len() > 1 && text.starts_with('0') && self.after_comma(text, span) {
            return Ok(());
        }
        let as_text = style != ScalarStyle::Plain || tag.and_then(Tag::core_suffix) == Some("str");
        let data = if as_text {
            Data::Text { text: text.to_owned(), plain: false }
        } else {
            match plain(text) {
                Plain::Null => Data::Null,
                Plain::Bool(b) => Data::Bool(b),
                Plain::Number(n) => Data::Number(n),
                Plain::Text => Data::Text { text: text.to_owned(), plain: true },
                Plain::NotFinite => {
                    let message = format!("`{}` is not a finite number", shortened(text));
                    let mistake = self.mistake(span, message, None);
                    self.mistakes.push(mistake);
                    Data::Broken
                }
            }
        };
        self.finish(Node::new(span, data), anchor)
    }

    fn begin(
        &mut self,
        kind: Kind,
        style: StructureStyle,
        anchor: usize,
        tag: Option<&Tag>,
        marks: &Marks,
    ) -> Result<(), Placed> {
        let span = self.span(marks);
        self.check_tag(tag, span)?;
        if self.wants_key() {
            return Err(self.mistake(span, "a key must be a single word or text, not a list or a map", None));
        }
        if self.open.len() >= MAX_DEPTH {
            return Err(self.mistake(span, format!("lists and maps are nested more than {MAX_DEPTH} deep"), None));
        }
        if anchor > 0 {
            self.unfinished.insert(anchor);
        }
        self.open.push(Open { span, flow: style == StructureStyle::Flow, anchor, kind });
        Ok(())
    }

    fn end(&mut self, marks: &Marks) -> Result<(), Placed> {
        let open = self.open.pop().expect("the parser closes only what it opened");
        let end = self.marker(&marks.end);
        let len = match open.flow {
            true if end.line == open.span.line => end.column.saturating_sub(open.span.column),
            // Its first line: the excerpt ends the mark where the line ends.
            true => u32::MAX,
            false => 0,
        };
        let span = Span { len, ..open.span };
        let data = match open.kind {
            Kind::List(items) => Data::List(items),
            Kind::Map { mut entries, mut seen, merges, .. } => {
                for merged in merges.iter().flat_map(Node::entries) {
                    if seen.find(&entries, &merged.key).is_none() {
                        entries.push(merged.clone());
                    }
                }
                Data::Map(entries)
            }
        };
        self.unfinished.remove(&open.anchor);
        self.finish(Node::new(span, data), open.anchor)
    }

    fn alias(&mut self, id: usize, marks: &Marks) -> Result<(), Placed> {
        let span = self.span(marks);
        if self.wants_key() {
            return Err(self.mistake(span, "an alias cannot be a key", None));
        }
        if self.unfinished.contains(&id) {
            return Err(self.mistake(span, "this alias stands inside the value that it names", None));
        }
        let Some(node) = self.anchors.get(&id) else {
            return Err(self.mistake(span, "this alias names no anchor", None));
        };
        let weight = node.weight();
        self.count(weight, span)?;
        let node = self.anchors[&id].clone();
        if self.open.len() + depth(&node) > MAX_DEPTH {
            return Err(self.mistake(span, format!("aliases nest lists and maps more than {MAX_DEPTH} deep"), None));
        }
        self.finish(node, 0)
    }

    /// Puts a finished value where it belongs.
    fn finish(&mut self, node: Node, anchor: usize) -> Result<(), Placed> {
        self.count(1, node.span)?;
        if anchor > 0 {
            self.count(node.weight(), node.span)?;
            self.anchors.insert(anchor, node.clone());
        }
        match self.open.last_mut().map(|o| &mut o.kind) {
            None => self.root = Some(node),
            Some(Kind::List(items)) => items.push(node),
            Some(Kind::Map { entries, seen, key, .. }) => {
                let (name, at) = key.take().expect("a value follows its key");
                if self.dropped.take_if(|dropped| *dropped == at).is_some() {
                    return Ok(());
                }
                if name == "<<" {
                    return self.merge(node, at);
                }
                match seen.find(entries, &name).map(|at| entries[at].at.line) {
                    Some(line) => {
                        let message = format!("the key `{}` stands twice in this map", shortened(&name));
                        let mut mistake = self.mistake(at, message, Some(format!("it is first in line {line}")));
                        mistake.path = join(&mistake.path, &name);
                        self.mistakes.push(mistake);
                    }
                    None => entries.push(Entry { key: name, at, value: node }),
                }
            }
        }
        Ok(())
    }

    /// `<<: *base` and `<<: [*one, *two]`: keys written in the map win, then the earlier of the merged maps.
    fn merge(&mut self, node: Node, at: Span) -> Result<(), Placed> {
        let maps = match node.data {
            Data::Map(_) => vec![node],
            Data::List(items) => items,
            _ => vec![node],
        };
        if maps.iter().any(|m| !matches!(m.data, Data::Map(_))) {
            return Err(self.mistake(at, "`<<` merges a map or a list of maps", None));
        }
        if let Some(Open { kind: Kind::Map { merges, .. }, .. }) = self.open.last_mut() {
            merges.extend(maps);
        }
        Ok(())
    }

    fn wants_key(&self) -> bool {
        matches!(self.open.last(), Some(Open { kind: Kind::Map { key: None, .. }, .. }))
    }

    fn take_key(&mut self, text: &str, style: ScalarStyle, span: Span) -> Result<(), Placed> {
        if style == ScalarStyle::Plain && plain(text) == Plain::Null {
            return Err(self.mistake(span, "a key is missing, or is null", None));
        }
        if style == ScalarStyle::Plain && self.after_comma(text, span) {
            self.dropped = Some(span);
        }
        if let Some(Open { kind: Kind::Map { key, .. }, .. }) = self.open.last_mut() {
            *key = Some((text.to_owned(), span));
        }
        Ok(())
    }

    /// Reports `{mu_a: 0,05}` and `[0,05]`: digits right behind the comma that ended a number. To YAML these are two entries, of which the
    /// first would be taken for the whole. `[1,2]` stays a list.
    fn after_comma(&mut self, text: &str, span: Span) -> bool {
        let Some(Open { flow: true, kind, .. }) = self.open.last() else { return false };
        let before = match kind {
            Kind::Map { entries, .. } => entries.last().map(|entry| &entry.value),
            Kind::List(items) => items.last(),
        };
        let Some(Node { data: Data::Number(number), span: start }) = before else { return false };
        let start = *start;
        let adjacent =
            start.line == span.line && start.column.saturating_add(start.len).saturating_add(1) == span.column;
        let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit());
        if !adjacent || digits.is_empty() || !digits.chars().all(|c| c.is_ascii_digit()) || number.as_i64().is_none() {
            return false;
        }
        let message = format!("`{number},{}` is no number: the comma ends the first", shortened(text));
        let hint = format!("write `{number}.{}`, or a blank behind the comma of a list", shortened(text));
        // The path is that of the value before.
        let above = self.path();
        let (before, path) = match self.open.last_mut().map(|open| &mut open.kind) {
            Some(Kind::Map { entries, .. }) => {
                let entry = entries.last_mut().expect("its value is a number");
                (&mut entry.value, join(&above, &entry.key))
            }
            Some(Kind::List(items)) => {
                let (last, list) = (items.len() - 1, above.rsplit_once('.').map_or("", |(list, _)| list));
                (&mut items[last], join(list, &last.to_string()))
            }
            None => unreachable!("a list or map is open"),
        };
        before.data = Data::Broken;
        let span = Span { len: start.len.saturating_add(1).saturating_add(span.len), ..start };
        self.mistakes.push(Placed { span, path, mistake: Mistake::new(Wrong::Syntax, message).hint(hint) });
        true
    }

    fn check_tag(&self, tag: Option<&Tag>, span: Span) -> Result<(), Placed> {
        match tag {
            Some(tag) if tag.core_suffix().is_none() => {
                let message = format!("the tag `{}` means nothing in a pipeline file", shortened(&tag.original()));
                Err(self.mistake(span, message, Some("quote a text that begins with `!`".to_owned())))
            }
            _ => Ok(()),
        }
    }

    fn count(&mut self, nodes: usize, span: Span) -> Result<(), Placed> {
        self.nodes += nodes;
        if self.nodes <= MAX_NODES {
            return Ok(());
        }
        let message = format!("the file holds more than {MAX_NODES} values, copies made by aliases included");
        Err(self.mistake(span, message, None))
    }

    fn mistake(&self, span: Span, message: impl Into<String>, hint: Option<String>) -> Placed {
        Placed { span, path: self.path(), mistake: Mistake::new(Wrong::Syntax, message).hint(hint) }
    }

    /// The keys and indices that lead to where the parser is.
    fn path(&self) -> String {
        self.open.iter().fold(String::new(), |path, open| match &open.kind {
            Kind::List(items) => join(&path, &items.len().to_string()),
            Kind::Map { key: Some((key, _)), .. } => join(&path, key),
            Kind::Map { key: None, .. } => path,
        })
    }

    fn span(&self, marks: &Marks) -> Span {
        let (start, end) = (self.marker(&marks.start), self.marker(&marks.end));
        let len = if end.line == start.line { end.column.saturating_sub(start.column) } else { u32::MAX };
        Span { len, ..start }
    }

    fn marker(&self, marker: &Marker) -> Span {
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Span { file: self.file, line: small(marker.line()), column: small(marker.col() + 1), len: 0 }
    }

    fn syntax_error(&self, error: &ScanError, text: &str) -> Placed {
        let at = *error.marker();
        let mut span = self.marker(&at);
        if *error.kind() == ErrorKind::RecursionLimitExceeded {
            return self.mistake(span, format!("lists and maps are nested more than {MAX_DEPTH} deep"), None);
        }
        let line = text.lines().nth(at.line().saturating_sub(1)).unwrap_or_default();
        let is_tabbed = |line: &str| line.trim_start_matches(' ').starts_with('\t');
        let way_out = if is_tabbed(line) || is_about_tabs(error.kind()) {
            // A scalar that runs on into a tabbed line is reported at its own start; the tab is what must go.
            let below = text.lines().enumerate().skip(at.line().saturating_sub(1));
            if let Some((i, line)) = below.take(3).find(|(_, line)| is_tabbed(line)) {
                let column = line.find('\t').unwrap_or(0) + 1;
                span = Span { line: i as u32 + 1, column: column as u32, ..span };
            }
            "indent with spaces: YAML allows no tabs there".to_owned()
        } else {
            match error.kind() {
                ErrorKind::MappingValueNotAllowed => {
                    "a text that holds `: ` needs quotes; keys of one map stand in one column".to_owned()
                }
                ErrorKind::UnknownAnchor | ErrorKind::MissingAnchorOrAliasName => {
                    "a text that begins with `*` or `&` needs quotes".to_owned()
                }
                _ => match substitute::unquoted(text, at.line()) {
                    Some(name) => format!("inside {{ }} and [ ] a var needs quotes: \"{name}\""),
                    None if line.trim_start().starts_with('%') || line.contains(": @") || line.contains(": `") => {
                        "a text that begins with `%`, `@` or a backquote needs quotes".to_owned()
                    }
                    None => "check brackets, quotes and indentation here and in the lines above".to_owned(),
                },
            }
        };
        let mistake = Mistake::new(Wrong::Syntax, format!("this is not YAML: {}", error.info())).hint(way_out);
        Placed { span, path: String::new(), mistake }
    }
}

fn is_about_tabs(kind: &ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::TabNotAllowed
            | ErrorKind::TabInBlockIndentation
            | ErrorKind::TabInIndentation
            | ErrorKind::TabInPlainScalar
    )
}

pub fn depth(node: &Node) -> usize {
    match &node.data {
        Data::List(items) => 1 + items.iter().map(depth).max().unwrap_or(0),
        Data::Map(entries) => 1 + entries.iter().map(|e| depth(&e.value)).max().unwrap_or(0),
        _ => 0,
    }
}

/// `path.step`, or `step` alone at the top.
pub fn join(path: &str, step: &str) -> String {
    if path.is_empty() { shortened(step) } else { format!("{path}.{}", shortened(step)) }
}

pub fn shortened(text: &str) -> String {
    const MAX: usize = 60;
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    match text.chars().count() {
        0..=MAX => text.chars().map(clean).collect(),
        _ => text.chars().take(MAX).map(clean).chain("...".chars()).collect(),
    }
}

#[cfg(test)]
mod tests;
