//! NumPy's `.npz`: an archive of `.npy`, packed (`savez_compressed`) or not.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use super::can_hold;

/// The highest ratio of deflate.
const DEFLATE: u64 = 1032;

/// The `.npy` of this name, or the only one.
///
/// Error: what is wrong with the archive, or which arrays it holds.
pub fn entry(bytes: &[u8], variable: Option<&str>) -> Result<Vec<u8>, String> {
    let damaged = |error: &dyn std::fmt::Display| format!("it is a damaged archive ({error})");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
    let arrays: Vec<String> =
        archive.file_names().filter_map(|name| name.strip_suffix(".npy").map(str::to_owned)).collect();
    let name = match variable {
        Some(name) if arrays.iter().any(|array| array == name) => name.to_owned(),
        Some(name) => return Err(format!("it holds no array `{name}`; it holds {}", listed(&arrays))),
        None => match &arrays[..] {
            [one] => one.clone(),
            [] => return Err("it is an archive without an array (.npy)".to_owned()),
            several => return Err(format!("it holds several arrays: say which by `variable`: {}", listed(several))),
        },
    };
    let mut file = archive.by_name(&format!("{name}.npy")).map_err(|error| damaged(&error))?;
    can_hold(bytes.len(), file.size(), DEFLATE)?;
    let (size, mut array) = (file.size(), Vec::new());
    // Read as it comes: no memory is asked for that the archive does not fill; its check sum is tested at the end.
    file.by_ref().take(size).read_to_end(&mut array).map_err(|error| damaged(&error))?;
    let mut rest = [0; 1];
    match file.read(&mut rest) {
        Ok(0) if array.len() as u64 == size => Ok(array),
        Ok(_) => Err(format!("`{name}` ends after {} of {size} bytes", array.len())),
        Err(error) => Err(damaged(&error)),
    }
}

/// Names for a message: the first of many.
fn listed(names: &[String]) -> String {
    const MOST: usize = 12;
    let shown = names.iter().take(MOST).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > MOST { format!("{shown} and {} more", names.len() - MOST) } else { shown }
}
