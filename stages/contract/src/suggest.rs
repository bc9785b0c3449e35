//! "Did you mean": the known name that is nearest to an unknown one.

use strsim::osa_distance;

/// The candidate within a third of the letters of `wrong` (edit distance, optimal string alignment: swapped neighbours count once).
pub fn nearest<'a>(wrong: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Names longer than this are not typing slips, and the distance costs their product.
    const MAX_LEN: usize = 64;
    // Names that a machine wrote; each costs a microsecond, for every mistake that is shown.
    const MANY: usize = 1000;
    let lower = wrong.to_lowercase();
    if lower.chars().count() > MAX_LEN {
        return None;
    }
    candidates
        .into_iter()
        .take(MANY)
        .filter(|c| c.len() <= MAX_LEN)
        .map(|c| (osa_distance(&lower, &c.to_lowercase()), c))
        .filter(|(d, c)| *d <= (c.chars().count().max(lower.chars().count()) / 3).max(1) && *d < c.chars().count())
        .min()
        .map(|(_, c)| c)
}

/// `did you mean X?`, or else the list of what is known.
pub fn hint<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> Option<String> {
    if let Some(name) = nearest(wrong, known.clone()) {
        return Some(format!("did you mean `{name}`?"));
    }
    let mut names: Vec<&str> = known.into_iter().take(41).collect();
    match names.len() {
        0 => None,
        41.. => {
            names.truncate(40);
            Some(format!("known are {}, and more", listed(&names)))
        }
        _ => Some(format!("known: {}", listed(&names))),
    }
}

fn listed(names: &[&str]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_of_the_keyboard_are_recognised_and_strangers_are_not() {
        let known = ["samples", "f_x", "phases", "method"];
        assert_eq!(nearest("sampels", known), Some("samples"));
        assert_eq!(nearest("Samples", known), Some("samples"));
        assert_eq!(nearest("fx", known), Some("f_x"));
        assert_eq!(nearest("wavelength", known), None);
        assert_eq!(nearest("", known), None);
        assert_eq!(nearest("a", ["b"]), None);
    }

    /// Two letters that changed places are one slip, not two: the name is still the nearest of those that are near.
    #[test]
    fn swapped_neighbours_are_one_slip() {
        assert_eq!(nearest("hpase", ["phases", "phase", "chase"]), Some("phase"));
        assert_eq!(nearest("mu_a_", ["mu_s", "mu_a"]), Some("mu_a"));
    }
}
