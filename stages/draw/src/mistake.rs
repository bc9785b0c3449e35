//! What is wrong with a draw as it is written.

/// A mistake of the user, at its place below what was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Mistake {
    /// Keys and indices down to the value.
    pub path: Vec<String>,
    pub message: String,
    /// The way out.
    pub hint: Option<String>,
    /// Where the key at `path` is one that nobody knows: those that are known there.
    pub known_keys: Vec<String>,
}

/// A place below what is read, and the mistakes found so far.
pub(crate) struct At<'m> {
    pub path: Vec<String>,
    pub mistakes: &'m mut Vec<Mistake>,
}

impl At<'_> {
    /// The place of `step` below this one.
    pub fn below(&mut self, step: impl ToString) -> At<'_> {
        let path = self.path.iter().cloned().chain([step.to_string()]).collect();
        At { path, mistakes: self.mistakes }
    }

    /// Reports a mistake here; `None` for what it keeps from being read.
    pub fn wrong<T>(&mut self, message: impl Into<String>, hint: Option<&str>) -> Option<T> {
        let hint = hint.map(str::to_owned);
        let mistake = Mistake { path: self.path.clone(), message: message.into(), hint, known_keys: Vec::new() };
        self.mistakes.push(mistake);
        None
    }

    pub fn unknown_key(&mut self, key: &str, what: &str, known: &[&str]) {
        let path = self.path.iter().cloned().chain([key.to_owned()]).collect();
        let (message, hint) = (format!("{what} has no key `{key}`"), Some(format!("known: {}", known.join(", "))));
        let known_keys = known.iter().map(|&key| key.to_owned()).collect();
        self.mistakes.push(Mistake { path, message, hint, known_keys });
    }
}
