//! Names of variables and files that are legal and differ from each other.

use std::collections::BTreeSet;

/// MATLAB's longest name.
const LONGEST: usize = 63;

/// The names that are taken in one file or structure.
#[derive(Default)]
pub struct Names {
    taken: BTreeSet<String>,
}

impl Names {
    /// A name for a file in an archive: no separators of paths; `_` behind it where it is taken.
    pub fn file(&mut self, name: &str) -> String {
        self.unique(name.replace(['/', '\\', '\0'], "_"), usize::MAX)
    }

    /// A name for a MATLAB variable or field: letters, digits and `_`, a letter first, at most 63.
    pub fn matlab(&mut self, name: &str) -> String {
        let legal = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut name: String = name.chars().map(legal).collect();
        if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
            name.insert_str(0, "x_");
        }
        self.unique(name, LONGEST)
    }

    fn unique(&mut self, name: String, longest: usize) -> String {
        let mut wanted: String = name.chars().take(longest).collect();
        let mut count = 1;
        while self.taken.contains(&wanted) {
            count += 1;
            let ending = format!("_{count}");
            wanted = name.chars().take(longest - ending.len()).collect::<String>() + &ending;
        }
        self.taken.insert(wanted.clone());
        wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_legal_and_differ() {
        let mut names = Names::default();
        let long = "a".repeat(100);
        let given = ["mu_a", "mu a", "mu_a", "2 pi", "", &long, &long, "µ", "x_"];
        let made: Vec<String> = given.iter().map(|n| names.matlab(n)).collect();
        for name in &made {
            assert!(name.len() <= 63 && name.starts_with(|c: char| c.is_ascii_alphabetic()), "{name}");
            assert!(name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'), "{name}");
        }
        assert_eq!(made.iter().collect::<BTreeSet<_>>().len(), made.len(), "{made:?}");
        assert_eq!(made[0], "mu_a");
    }
}
