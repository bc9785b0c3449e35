//! Texts that are never shown.

use std::fmt;

/// A secret key or a session token: neither `Debug` nor anything else prints it.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Secret(String);

impl Secret {
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }

    /// For signing alone.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("…")
    }
}

/// What a request is signed with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Keys {
    /// Not secret by itself, and not shown either.
    pub id: Secret,
    pub secret: Secret,
    pub token: Option<Secret>,
}

impl Keys {
    /// `text`, in which a service may have repeated what it was sent, without the keys.
    pub fn taken_out_of(&self, text: &str) -> String {
        let all = [Some(&self.secret), self.token.as_ref(), Some(&self.id)];
        all.into_iter()
            .flatten()
            .filter(|secret| !secret.0.is_empty())
            .fold(text.to_owned(), |text, secret| text.replace(&secret.0, "…"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_not_shown() {
        let keys = Keys { id: Secret::new("AKIA"), secret: Secret::new("hidden"), token: Some(Secret::new("session")) };
        assert_eq!(format!("{keys:?}"), "Keys { id: …, secret: …, token: Some(…) }");
        assert_eq!(keys.taken_out_of("hidden AKIA of session"), "… … of …");
        let none = Keys { id: Secret::new(""), secret: Secret::new(""), token: None };
        assert_eq!(none.taken_out_of("as it is"), "as it is");
    }
}
