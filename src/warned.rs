//! Warnings of a sweep, told once.

use std::collections::HashMap;

use crate::spec::Diagnostic;

/// Warnings that the instances of a sweep have in common but for their numbers: the worst is told, with how many there are.
#[derive(Default)]
pub struct Warned {
    kinds: HashMap<Kind, Worst>,
}

/// Path, line, column and words.
type Kind = (String, u32, u32, String);

/// Of a kind: where the worst stands among the problems, its size, and how many there are.
type Worst = (usize, f64, usize);

impl Warned {
    pub fn add(&mut self, problems: &mut Vec<Diagnostic>, warning: Diagnostic, size: f64) {
        // Warnings without a size are of one kind only if they are equal.
        let words = if size > 0.0 {
            warning.message.chars().filter(|c| !(c.is_ascii_digit() || ".+-e".contains(*c))).collect()
        } else {
            warning.message.clone()
        };
        let key = (warning.path.clone(), warning.line, warning.column, words);
        match self.kinds.get_mut(&key) {
            Some((at, largest, count)) => {
                *count += 1;
                if size > *largest {
                    (problems[*at], *largest) = (warning, size);
                }
            }
            None => {
                self.kinds.insert(key, (problems.len(), size, 1));
                problems.push(warning);
            }
        }
    }

    pub fn told(self, problems: &mut [Diagnostic]) {
        for (at, size, count) in self.kinds.into_values() {
            if count > 1 && size > 0.0 {
                problems[at].message += &format!(" (the largest of {count} instances)");
            }
        }
    }
}
