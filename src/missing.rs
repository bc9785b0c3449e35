//! What to say of a file that is not there.

use std::path::Path;

/// What there is in place of a missing file: the names in its folder, those first that begin as it does.
pub fn neighbours(path: &Path) -> Option<String> {
    const NAMED: usize = 5;
    let wanted = path.file_name()?.to_string_lossy().into_owned();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Some(format!(
            "there is no folder {}; paths are relative to the file that names them",
            folder.display()
        ));
    };
    let mut names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let shared = |name: &String| name.chars().zip(wanted.chars()).take_while(|(a, b)| a == b).count();
    names.sort();
    names.sort_by_key(|name| std::cmp::Reverse(shared(name)));
    let more = if names.len() > NAMED { ", …" } else { "" };
    names.truncate(NAMED);
    (!names.is_empty()).then(|| format!("its folder has {}{more}", names.join(", ")))
}
