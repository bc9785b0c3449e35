//! What to say of a file that is not there.

use std::path::Path;

/// What there is in place of a missing file: names in its folder that begin as it does, or else any.
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
    let alike = names.iter().take_while(|name| 3 * shared(name) >= wanted.chars().count()).count();
    if alike > 0 {
        names.truncate(alike);
    }
    let more = if names.len() > NAMED { ", …" } else { "" };
    names.truncate(NAMED);
    (!names.is_empty()).then(|| format!("its folder has {}{more}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_begin_alike_come_alone() {
        let folder = tempfile::tempdir().expect("a folder for the test");
        let named = |wanted: &str| neighbours(&folder.path().join(wanted));
        assert_eq!(named("a.tif"), None);
        for name in ["sample_120deg.tif", "sample_0deg.tif", "notes.txt", "dark.tif"] {
            std::fs::write(folder.path().join(name), "").expect("it can be written");
        }
        let both = "its folder has sample_120deg.tif, sample_0deg.tif";
        assert_eq!(named("sample_1deg.tif").as_deref(), Some(both));
        let all = "its folder has dark.tif, notes.txt, sample_0deg.tif, sample_120deg.tif";
        assert_eq!(named("flat.tif").as_deref(), Some(all));
        assert!(named("nowhere/flat.tif").is_some_and(|hint| hint.contains("there is no folder")));
    }
}
