//! Mutations of texts: numbers, words, lines, nesting.

use std::ops::Range;

use crate::bytes;
use crate::random::Random;

/// What numbers are replaced by.
const NUMBERS: [&str; 26] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "2",
    "3",
    "255",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9007199254740992",
    "9223372036854775808",
    "18446744073709551616",
    "1e18",
    "1e308",
    "1e309",
    "-1e308",
    "1e-308",
    "1e-320",
    "0.1e-400",
    "nan",
    "inf",
    "-inf",
    ".nan",
    ".inf",
];

/// What is put in anywhere: odd characters, brackets, and what has a meaning in one of the formats.
const ODD: [&str; 28] = [
    "\0",
    "\u{feff}",
    "\u{202e}",
    "\u{1b}[2J",
    "\r",
    "\t",
    "\u{85}",
    "𝛼",
    "\"",
    "'",
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    "- ",
    "#",
    "&a ",
    "*a",
    "<<: ",
    "${x}",
    "${",
    "!!binary ",
    "|\n",
    ">-\n",
    "---\n",
    "~",
];

/// Changes something in a text.
pub fn mutate(text: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    match random.below(12) {
        0..=2 => number(text, random),
        3 => {
            let word = words(other).get(random.below(words(other).len().max(1))).map(|w| other[w.clone()].to_vec());
            let places = words(text);
            if let (Some(word), false) = (word, places.is_empty()) {
                drop(text.splice(random.pick(&places).clone(), word));
            }
        }
        4 | 5 => lines(text, other, random),
        6 | 7 => {
            let odd = random.pick(&ODD).as_bytes();
            let at = random.below(text.len() + 1);
            drop(text.splice(at..at, odd.iter().copied()));
        }
        8 => repeat(text, random),
        _ => bytes::mutate(text, other, random),
    }
}

fn number(text: &mut Vec<u8>, random: &mut Random) {
    let numeric = |w: &Range<usize>| text[w.start].is_ascii_digit() || b"-.".contains(&text[w.start]);
    let places: Vec<_> = words(text).into_iter().filter(numeric).collect();
    if !places.is_empty() {
        drop(text.splice(random.pick(&places).clone(), random.pick(&NUMBERS).bytes()));
    }
}

/// What stands between blanks and punctuation.
fn words(text: &[u8]) -> Vec<Range<usize>> {
    let inside = |b: u8| b.is_ascii_alphanumeric() || b"_-+.".contains(&b);
    let mut found = Vec::new();
    let mut start = None;
    for (i, &b) in text.iter().chain([&b' ']).enumerate() {
        match (start, inside(b)) {
            (None, true) => start = Some(i),
            (Some(first), false) => {
                found.push(first..i);
                start = None;
            }
            _ => {}
        }
    }
    found
}

/// Lines twice, out of order, left out, or of another text.
fn lines(text: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let mut lines: Vec<Vec<u8>> = text.split_inclusive(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    let others: Vec<&[u8]> = other.split_inclusive(|&b| b == b'\n').collect();
    if lines.is_empty() || others.is_empty() {
        return;
    }
    let (i, j) = (random.below(lines.len()), random.below(lines.len()));
    match random.below(5) {
        0 => lines.swap(i, j),
        1 => drop(lines.remove(i)),
        2 => lines.insert(j, lines[i].clone()),
        3 => lines.insert(i, random.pick(&others).to_vec()),
        _ => {
            // Another depth of nesting.
            let blanks = lines[i].iter().take_while(|&&b| b == b' ').count();
            drop(lines[i].splice(..blanks, vec![b' '; random.below(12)]));
        }
    }
    *text = lines.concat();
}

/// A short piece so often that it is deep or long.
fn repeat(text: &mut Vec<u8>, random: &mut Random) {
    let piece = match random.below(4) {
        0 => random.pick(&["[", "{", "[[", "{a: ", "- ", "(", "\"", "a,"]).as_bytes().to_vec(),
        _ if text.is_empty() => return,
        _ => text[random.piece(text.len().min(200))].to_vec(),
    };
    let at = random.below(text.len() + 1);
    let times = *random.pick(&[2, 10, 70, 300, 3000]);
    drop(text.splice(at..at, piece.repeat(times)));
}
