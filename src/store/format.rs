//! `format`: the number of the store's format, in the first line of a text for people.

use std::io;
use std::path::Path;

use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::odd;

/// Raised when an older turbid would misread the folder. The text has to change in more than the number then: see [`is_ours`].
const FORMAT: u64 = 1;

/// What stands in the file.
const TEXT: &str = "1\n\
     The number above is the format of this turbid store. The files here are a cache: `turbid cache gc` makes it smaller,\n\
     and the whole folder may be deleted when no run is at work; results are then computed anew. docs/store.md of turbid\n\
     describes the files.\n";

/// Writes the file, or writes it anew.
pub(super) fn write(root: &Path) -> io::Result<()> {
    disk::publish(root, &root.join("format"), TEXT.as_bytes(), true, false)
}

/// Whether a store of a known format is there, and says so undamaged; otherwise the file is to be written (anew).
///
/// Error: a newer format, or a file that cannot be read.
pub(super) fn check(root: &Path) -> Result<bool, StoreError> {
    let path = root.join("format");
    match disk::read_regular(&path) {
        Ok(bytes) if is_ours(&bytes) => Ok(bytes == TEXT.as_bytes()),
        Ok(bytes) => {
            let text = String::from_utf8_lossy(&bytes);
            match text.lines().next().and_then(|line| line.trim().parse::<u64>().ok()) {
                Some(found) if found > FORMAT => {
                    Err(StoreError::NewerFormat { path: root.to_owned(), found, known: FORMAT })
                }
                // Another text behind the number is as good; a line that is no number, or 0, is damage.
                found => Ok(found == Some(FORMAT)),
            }
        }
        // Nothing, or something that is no file.
        Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(false),
        Err(_) if odd::is_no_file(&path) => Ok(false),
        Err(e) => Err(StoreError::io("open the store", &path)(e)),
    }
}

/// Whether this is the text of this format, but for one flipped bit at most.
///
/// A flipped bit makes 3, 5 or 9 of the number 1. The text that follows is its check: a newer format has another one.
fn is_ours(bytes: &[u8]) -> bool {
    let flipped: u32 = bytes.iter().zip(TEXT.bytes()).map(|(a, b)| (a ^ b).count_ones()).sum();
    bytes.len() == TEXT.len() && flipped <= 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No flipped bit refuses the store, whichever it is; two numbers that differ in more are told apart.
    #[test]
    fn a_flipped_bit_is_damage_and_a_newer_number_is_not() {
        let outputs = tempfile::tempdir().unwrap();
        let (root, path) = (outputs.path(), outputs.path().join("format"));
        for bit in 0..8 * TEXT.len() {
            let mut bytes = TEXT.as_bytes().to_vec();
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&path, bytes).unwrap();
            assert!(matches!(check(root), Ok(false)), "bit {bit}");
        }
        for (newer, number) in [("2", 2), ("3\n", 3), ("9\nanother text\n", 9), (&TEXT.replacen('1', "2", 1), 2)] {
            std::fs::write(&path, newer).unwrap();
            assert!(matches!(check(root), Err(StoreError::NewerFormat { found, .. }) if found == number), "{newer}");
        }
        for cut in 0..=TEXT.len() {
            std::fs::write(&path, &TEXT[..cut]).unwrap();
            assert!(check(root).is_ok(), "cut at {cut}");
        }
        assert!(matches!(check(root), Ok(true)));
    }
}
