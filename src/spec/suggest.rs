//! "Did you mean": the known name that is nearest to an unknown one.

/// The candidate within a third of the letters of `wrong` (edit distance, swapped neighbours count once).
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
        .map(|c| (distance(&lower, &c.to_lowercase()), c))
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

/// Optimal string alignment distance in characters.
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before = vec![0; b.len() + 1];
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let substituted = last[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = substituted.min(last[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(before[j - 2] + 1);
            }
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
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

    /// A metric: zero only for equal words, symmetric, one swap is one step.
    #[test]
    fn distance_is_a_metric() {
        for (a, b, d) in [("", "", 0), ("mu_a", "mu_a", 0), ("mu_a", "mu_s", 1), ("ab", "ba", 1), ("", "abc", 3)] {
            assert_eq!(distance(a, b), d, "{a} {b}");
            assert_eq!(distance(b, a), d, "{b} {a}");
        }
    }
}
