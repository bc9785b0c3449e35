//! What is wrong, before its place is known: kind, message, way out.

/// What kind of thing is wrong. Whoever has to decide something asks for this, never for the words of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The text is not YAML, or not what a pipeline file is made of.
    Syntax,
    /// A key that a map does not have.
    UnknownKey,
    /// A name that nothing has: of a stage, a port, a var, an axis, a choice.
    UnknownName,
    /// Something needed is not there.
    Missing,
    /// A text where a number is wanted, a number where a list is.
    WrongType,
    /// It breaks a rule.
    WrongValue,
    /// An unknown unit, or one of another dimension.
    WrongUnit,
    /// Stages that do not go together.
    Graph,
    /// More instances, axes or values than can be.
    TooMany,
    /// A file that cannot be read.
    File,
    /// More memory than there is.
    Memory,
    /// Legal, but probably not meant.
    Suspect,
    /// On the command line, or of the folder that it names.
    Usage,
    /// A result that was asked for and that no run has made yet.
    NotRun,
    /// Nothing of what the user wrote: it failed while it was done.
    Failed,
}

impl Kind {
    /// The word for it in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Syntax => "syntax",
            Self::UnknownKey => "unknown_key",
            Self::UnknownName => "unknown_name",
            Self::Missing => "missing",
            Self::WrongType => "wrong_type",
            Self::WrongValue => "wrong_value",
            Self::WrongUnit => "wrong_unit",
            Self::Graph => "graph",
            Self::TooMany => "too_many",
            Self::File => "file",
            Self::Memory => "memory",
            Self::Suspect => "suspect",
            Self::Usage => "usage",
            Self::NotRun => "not_run",
            Self::Failed => "failed",
        }
    }

    /// How a command ends that it ends: 1 where something failed or is not there yet, 2 where the user's input is wrong.
    pub fn exit_code(self) -> u8 {
        if matches!(self, Self::Failed | Self::NotRun) { 1 } else { 2 }
    }
}

/// One mistake without its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    pub kind: Kind,
    /// What stands there, with value and unit, and the rule.
    pub message: String,
    /// The way out.
    pub hint: Option<String>,
}

impl Mistake {
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), hint: None }
    }

    #[must_use]
    pub fn hint(self, hint: impl Into<Option<String>>) -> Self {
        Self { hint: hint.into(), ..self }
    }

    /// With this way out, unless that is `None`.
    #[must_use]
    pub fn and_hint(self, hint: Option<String>) -> Self {
        Self { hint: hint.or(self.hint), ..self }
    }
}

/// A rule that is broken, in words.
impl From<String> for Mistake {
    fn from(message: String) -> Self {
        Self::new(Kind::WrongValue, message)
    }
}

impl From<&str> for Mistake {
    fn from(message: &str) -> Self {
        message.to_owned().into()
    }
}
