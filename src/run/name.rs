//! Names of files that every file system takes.

use std::path::Path;

use crate::digest::Digest;

/// Bytes of the text that are kept; the longest name is 9 longer.
const MOST: usize = 200;
/// A longer ending is none of a format.
const LONGEST_ENDING: usize = 8;

/// A name that every file system takes: other characters replaced, the end cut off; then a digest keeps it distinct.
pub fn file_name(text: &str) -> String {
    let plain: String =
        text.chars().map(|c| if c.is_alphanumeric() || "-_=,.+ ".contains(c) { c } else { '_' }).collect();
    if plain == text && text.len() <= MOST {
        return plain;
    }
    let end = (0..=MOST.min(plain.len())).rev().find(|&i| plain.is_char_boundary(i)).unwrap_or(0);
    format!("{}-{}", &plain[..end], &Digest::of(text.as_bytes()).to_string()[..8])
}

/// The same for the name of a file, which keeps its ending.
pub fn file_name_of(path: &Path) -> String {
    let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, ending) = (text(path.file_stem()), text(path.extension()));
    if ending.is_empty() || ending.len() > LONGEST_ENDING || file_name(&ending) != ending {
        return file_name(&text(path.file_name()));
    }
    format!("{}.{ending}", file_name(&stem))
}

/// Where files of an instance lie in the folder of its pipeline: `stage`, or `stage/axes` by the text of its axes.
pub fn place(stage: &str, axes: &str) -> String {
    if axes.is_empty() { file_name(stage) } else { format!("{}/{}", file_name(stage), file_name(axes)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_are_plain_short_and_distinct() {
        assert_eq!(file_name("A_rho=1,S_rho=0.5"), "A_rho=1,S_rho=0.5");
        let odd = ["a/b", "a_b", "a:b", &"n".repeat(300), &"n".repeat(301), &"\u{1F600}".repeat(90), &"ä".repeat(300)];
        let names = odd.map(file_name);
        assert!(names.iter().all(|n| n.len() < 255 && !n.contains(['/', ':'])), "{names:?}");
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), odd.len(), "{names:?}");
    }

    /// Names of pipeline files at the limit of file systems, or with control characters, and ordinary ones.
    #[test]
    fn names_of_files_keep_their_ending() {
        assert_eq!(file_name_of(Path::new("in/p.yaml")), "p.yaml");
        let long = "n".repeat(250) + ".yaml";
        for odd in
            [&long[..], "a\nb.yaml", "a\u{1b}[2K.yaml", &("e.".to_owned() + &"n".repeat(250)), ".yaml", "\u{202e}"]
        {
            let name = file_name_of(Path::new(odd));
            assert!(name.len() < 240 && !name.contains(char::is_control) && !name.is_empty(), "{odd:?}: {name:?}");
            assert_eq!(name.ends_with(".yaml"), odd.ends_with(".yaml"), "{odd:?}: {name:?}");
        }
    }
}
