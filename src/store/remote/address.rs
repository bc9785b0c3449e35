//! Where a store elsewhere is: `s3://BUCKET/PREFIX`, or `file:///FOLDER` for a folder that several machines see.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// The address of a store elsewhere. Holds no secret: it may be shown and logged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Objects in a bucket, below a prefix without slashes at its ends (empty: the bucket as a whole).
    S3 { bucket: String, prefix: String },
    /// The same objects as files in a folder.
    Folder(PathBuf),
}

/// What an address must look like.
const RULE: &str = "a store is named s3://BUCKET/PREFIX, or file:///FOLDER for a folder that several machines see";

impl FromStr for Address {
    type Err = String;

    /// Error: what is wrong, and how it must look. What may be a password is not repeated.
    fn from_str(text: &str) -> Result<Self, String> {
        let Some((scheme, rest)) = text.split_once("://") else {
            return Err(format!("`{}` is no address of a store: {RULE}", without_secrets(text)));
        };
        match scheme {
            "s3" => s3(rest),
            "file" if rest.starts_with('/') && rest.len() > 1 => Ok(Self::Folder(PathBuf::from(rest))),
            _ => Err(format!("`{}` is no address of a store: {RULE}", without_secrets(text))),
        }
    }
}

fn s3(rest: &str) -> Result<Address, String> {
    let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
    if bucket.contains(':') || rest.contains('@') {
        return Err("an address of a store holds no keys and no passwords: set AWS_ACCESS_KEY_ID and \
                    AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, and write s3://BUCKET/PREFIX"
            .to_owned());
    }
    let good = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    if !(3..=255).contains(&bucket.len()) || !bucket.chars().all(good) || bucket.starts_with('.') {
        return Err(format!("the bucket `{bucket}` must have 3 to 63 letters, digits, dots and hyphens: {RULE}"));
    }
    let prefix = prefix.trim_matches('/');
    let bad = |part: &str| part.is_empty() || part == "." || part == "..";
    if !prefix.is_empty() && (prefix.split('/').any(bad) || prefix.contains(['?', '#', '\\']))
        || prefix.chars().any(char::is_control)
    {
        return Err(format!("the prefix `{prefix}` must be names with slashes between them: {RULE}"));
    }
    if prefix.len() > 512 {
        return Err(format!(
            "the prefix has {} bytes, and at most 512 leave room for the names below it",
            prefix.len()
        ));
    }
    Ok(Address::S3 { bucket: bucket.to_owned(), prefix: prefix.to_owned() })
}

/// What stands before an `@` may be a password.
fn without_secrets(text: &str) -> String {
    match text.rsplit_once('@') {
        Some((_, rest)) => format!("…@{rest}"),
        None => text.to_owned(),
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::S3 { bucket, prefix } if prefix.is_empty() => write!(f, "s3://{bucket}"),
            Self::S3 { bucket, prefix } => write!(f, "s3://{bucket}/{prefix}"),
            Self::Folder(path) => write!(f, "file://{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written() {
        for (text, again) in [
            ("s3://bucket/a/b", "s3://bucket/a/b"),
            ("s3://my-bucket.of/a/", "s3://my-bucket.of/a"),
            ("s3://bucket", "s3://bucket"),
            ("s3://bucket/", "s3://bucket"),
            ("file:///mnt/shared", "file:///mnt/shared"),
        ] {
            assert_eq!(text.parse::<Address>().map(|a| a.to_string()), Ok(again.to_owned()), "{text}");
        }
        for wrong in ["", "bucket", "s3://", "s3://ab", "s3://b cket/x", "s3://bucket/a//b", "s3://bucket/../x"] {
            assert!(wrong.parse::<Address>().is_err_and(|e| e.contains("s3://BUCKET/PREFIX")), "{wrong}");
        }
        for wrong in ["http://host/x", "file://relative", "file:///", "s3://bucket/a?b", "s3://bucket/a\nb"] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_password_in_an_address_is_not_repeated() {
        for text in [
            "s3://AKIAKEY:hidden@bucket/x",
            "s3://AKIAKEY/hidden@bucket/x",
            "https://user:hidden@host/x",
            "user:hidden@host",
        ] {
            let error = text.parse::<Address>().expect_err("it is no address");
            assert!(!error.contains("hidden") && !error.contains("AKIAKEY"), "{error}");
        }
    }
}
