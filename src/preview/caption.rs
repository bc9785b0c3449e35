//! What a picture says of where it comes from: in words over it, and in the text chunks of its file.

/// The words of a picture. No time, host or path is among them: the same caption and artifact give the same bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Caption {
    /// The bold heading.
    pub title: String,
    /// A smaller line under it.
    pub subtitle: String,
    /// Keyword and text of each chunk; keywords are plain ASCII words.
    pub facts: Vec<(&'static str, String)>,
}
