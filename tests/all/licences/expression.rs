//! SPDX licence expressions: `(MIT OR Apache-2.0) AND Unicode-3.0`; `/` in old manifests means OR.

use std::collections::BTreeSet;

/// Licences that fulfil the expression, of the `allowed` ones, those first in the list preferred; `None` where none do.
pub fn chosen(expression: &str, allowed: &[String]) -> Option<BTreeSet<String>> {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ").replace(" WITH ", "+");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut reader = Reader { words: &words, allowed };
    let found = reader.any();
    if reader.words.is_empty() { found } else { None }
}

struct Reader<'a> {
    words: &'a [&'a str],
    allowed: &'a [String],
}

impl Reader<'_> {
    fn next_is(&mut self, word: &str) -> bool {
        let is = self.words.first() == Some(&word);
        if is {
            self.words = &self.words[1..];
        }
        is
    }

    fn any(&mut self) -> Option<BTreeSet<String>> {
        let mut best = self.both();
        while self.next_is("OR") {
            let other = self.both();
            best = match (best, other) {
                (Some(a), Some(b)) => Some(if self.rank(&b) < self.rank(&a) { b } else { a }),
                (a, b) => a.or(b),
            };
        }
        best
    }

    fn both(&mut self) -> Option<BTreeSet<String>> {
        let mut all = self.one();
        while self.next_is("AND") {
            let other = self.one();
            all = all.and_then(|mut all| {
                all.extend(other?);
                Some(all)
            });
        }
        all
    }

    fn one(&mut self) -> Option<BTreeSet<String>> {
        if self.next_is("(") {
            let inside = self.any();
            return inside.filter(|_| self.next_is(")"));
        }
        let (&name, rest) = self.words.split_first()?;
        self.words = rest;
        self.allowed.iter().any(|a| a == name).then(|| BTreeSet::from([name.to_owned()]))
    }

    /// The last place in the list of what is allowed.
    fn rank(&self, licences: &BTreeSet<String>) -> usize {
        licences.iter().filter_map(|l| self.allowed.iter().position(|a| a == l)).max().unwrap_or(0)
    }
}

#[test]
fn expressions_are_read() {
    let allowed = ["MIT", "Apache-2.0", "Unicode-3.0"].map(str::to_owned);
    let chosen = |text: &str| chosen(text, &allowed).map(|set| set.into_iter().collect::<Vec<_>>().join(" "));
    for (expression, licences) in [
        ("MIT", Some("MIT")),
        ("Apache-2.0 OR MIT", Some("MIT")),
        ("Apache-2.0/MIT", Some("MIT")),
        ("GPL-3.0", None),
        ("GPL-3.0 OR Apache-2.0", Some("Apache-2.0")),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", Some("MIT Unicode-3.0")),
        ("MIT AND GPL-3.0", None),
        ("Apache-2.0 WITH LLVM-exception", None),
        ("", None),
        ("MIT)", None),
    ] {
        assert_eq!(chosen(expression).as_deref(), licences, "{expression}");
    }
}
