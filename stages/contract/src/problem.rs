//! Mistakes in a pipeline file, each with the field it is about; collected, so that all are reported at once.

use std::fmt;

/// Below which key of a stage a mistake stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum At {
    #[default]
    With,
    /// What is connected: the path is the name of the port.
    In,
}

/// One mistake: which field, what stands there, the rule, and the way out.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    pub at: At,
    /// Field path below `with`, keys and list indices joined by dots: `objects.polyp.spheroid.diameters.0`.
    pub path: String,
    /// What is wrong, with value and unit: `mu_a = -3 mm^-1 must be >= 0`.
    pub message: String,
    /// The way out, where there is one to name.
    pub hint: Option<String>,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.at {
            At::With => write!(f, "{}: {}", self.path, self.message)?,
            At::In => write!(f, "in.{}: {}", self.path, self.message)?,
        }
        if let Some(hint) = &self.hint {
            write!(f, " ({hint})")?;
        }
        Ok(())
    }
}

/// The mistakes and warnings found so far in one stage.
#[derive(Clone, Debug, Default)]
pub struct Problems {
    pub(crate) found: Vec<Problem>,
    warnings: Vec<Problem>,
    ranked: Vec<(Problem, f64)>,
}

impl Problems {
    /// Reports a mistake at `path`.
    pub fn push(&mut self, path: impl Into<String>, message: impl Into<String>) {
        self.found.push(Problem { at: At::With, path: path.into(), message: message.into(), hint: None });
    }

    /// Reports a mistake at `path` together with a way out.
    pub fn push_with_hint(&mut self, path: impl Into<String>, message: impl Into<String>, hint: impl Into<String>) {
        self.found.push(Problem { at: At::With, path: path.into(), message: message.into(), hint: Some(hint.into()) });
    }

    /// Reports that what is connected to `port` does not fit, with a way out.
    pub fn at_input(&mut self, port: impl Into<String>, message: impl Into<String>, hint: impl Into<String>) {
        let (path, message, hint) = (port.into(), message.into(), Some(hint.into()));
        self.found.push(Problem { at: At::In, path, message, hint });
    }

    /// Reports something legal that the user probably did not mean; never stops a run.
    pub fn warn(&mut self, path: impl Into<String>, message: impl Into<String>) {
        self.warnings.push(Problem { at: At::With, path: path.into(), message: message.into(), hint: None });
    }

    /// Reports that what is connected to `port` can be read, but is probably not what the user meant, with a way out.
    pub fn warn_at_input(&mut self, port: impl Into<String>, message: impl Into<String>, hint: impl Into<String>) {
        let (path, message, hint) = (port.into(), message.into(), Some(hint.into()));
        self.warnings.push(Problem { at: At::In, path, message, hint });
    }

    /// Reports something legal that instances of a sweep have more or less of: of warnings that differ in numbers only, the one of
    /// the largest `size` is shown.
    pub fn warn_ranked(
        &mut self,
        size: f64,
        path: impl Into<String>,
        message: impl Into<String>,
        hint: impl Into<String>,
    ) {
        let problem = Problem { at: At::With, path: path.into(), message: message.into(), hint: Some(hint.into()) };
        self.ranked.push((problem, size));
    }

    /// Takes out the warnings that have a size.
    pub fn take_ranked(&mut self) -> Vec<(Problem, f64)> {
        std::mem::take(&mut self.ranked)
    }

    /// Reports `name = value unit must RULE` unless `holds`; written so that NaN never holds.
    pub fn require(&mut self, holds: bool, path: impl Into<String>, value: f64, unit: &str, rule: &str) {
        if !holds {
            let path = path.into();
            let name = path.rsplit('.').find(|part| part.parse::<usize>().is_err()).unwrap_or(&path).to_owned();
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            self.push(path, format!("{name} = {value}{unit} must {rule}"));
        }
    }

    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// Takes the mistakes and the warnings out; those that have a size come last.
    pub fn into_parts(mut self) -> (Vec<Problem>, Vec<Problem>) {
        self.warnings.extend(self.ranked.into_iter().map(|(problem, _)| problem));
        (self.found, self.warnings)
    }
}
