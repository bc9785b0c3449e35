//! Phase unwrapping guided by quality: the most reliable neighbours are joined first, in any order of place.
//!
//! Source: Herraez, Burton, Lalor, Gdeisat, Appl. Opt. 41, 7437 (2002). Here with masks, with union-find instead of lists, and
//! with reliabilities sorted by one counting pass over their leading bits, ties by place: deterministic, near in memory what is alike.

use std::f32::consts::{PI, TAU};

/// Turns to add to each pixel's wrapped phase.
#[derive(Clone, Debug, PartialEq)]
pub struct Unwrapped {
    /// phi + 2 pi turns is unwrapped.
    pub turns: Vec<i32>,
    /// Index of the piece that a pixel belongs to, pieces numbered by their first pixels; `u32::MAX` where masked.
    pub piece: Vec<u32>,
    /// Pieces that no chain of good neighbours joins: between them the count of turns is unknown.
    pub pieces: usize,
}

/// Unwraps `phase` (rad, row by row, in (-pi, pi]) over the pixels that are `good`.
///
/// Each piece is shifted so that its mean number of turns is nearest to 0.
pub fn unwrap(phase: &[f32], good: &[bool], columns: usize) -> Unwrapped {
    let rows = phase.len() / columns.max(1);
    assert_eq!((phase.len(), good.len()), (rows * columns, rows * columns), "whole rows");
    let unreliable = unreliability(phase, good, rows, columns);
    let mut forest = Forest::new(phase.len());
    for edge in sorted(&unreliable, good, rows, columns) {
        let (a, b) = ends(edge, columns);
        // The turns that b needs more than a.
        let step = turns(phase[a] - phase[b]);
        forest.join(a as u32, b as u32, step);
    }
    collect(&mut forest, good)
}

/// Whole turns nearest to a difference of wrapped phases (at most one).
#[inline(always)]
fn turns(difference: f32) -> i32 {
    i32::from(difference > PI) - i32::from(difference < -PI)
}

/// A difference of wrapped phases, wrapped.
#[inline(always)]
fn wrapped(difference: f32) -> f32 {
    difference - TAU * turns(difference) as f32
}

/// Sum of the squared second differences along the row, the column and both diagonals; worst at borders and beside masked pixels.
fn unreliability(phase: &[f32], good: &[bool], rows: usize, columns: usize) -> Vec<f32> {
    let mut out = vec![f32::MAX; phase.len()];
    if rows < 3 || columns < 3 {
        return out;
    }
    for r in 1..rows - 1 {
        let line = |r: usize| &phase[r * columns..(r + 1) * columns];
        let fine = |r: usize| &good[r * columns..(r + 1) * columns];
        let (above, own, below) = (line(r - 1), line(r), line(r + 1));
        let (good_above, good_own, good_below) = (fine(r - 1), fine(r), fine(r + 1));
        let out = &mut out[r * columns..(r + 1) * columns];
        for c in 1..columns - 1 {
            let second = |a: f32, b: f32| wrapped(a - own[c]) - wrapped(own[c] - b);
            let h = second(own[c - 1], own[c + 1]);
            let v = second(above[c], below[c]);
            let d = second(above[c - 1], below[c + 1]);
            let e = second(above[c + 1], below[c - 1]);
            let mut whole = true;
            for k in 0..3 {
                whole &= good_above[c + k - 1] & good_own[c + k - 1] & good_below[c + k - 1];
            }
            out[c] = if whole { h * h + v * v + d * d + e * e } else { f32::MAX };
        }
    }
    out
}

/// An edge is twice the index of its left or upper pixel, plus 1 where it runs down.
fn ends(edge: u32, columns: usize) -> (usize, usize) {
    let a = (edge / 2) as usize;
    (a, a + if edge % 2 == 1 { columns } else { 1 })
}

/// Classes of reliability: 8 bits of exponent and 4 of mantissa, so that an edge overtakes another only if it is 6 % worse at most.
const CLASSES: usize = 1 << 12;

/// Positive floats order as their bits.
#[inline(always)]
fn class(a: f32, b: f32) -> usize {
    ((a.min(1e9) + b.min(1e9)).to_bits() >> 19) as usize
}

/// The edges between good pixels, most reliable class first, within it by place: neighbours in memory stay together.
fn sorted(unreliable: &[f32], good: &[bool], rows: usize, columns: usize) -> Vec<u32> {
    assert!(unreliable.len() < (u32::MAX / 2) as usize, "an edge has a number of 32 bits");
    let mut starts = vec![0_usize; CLASSES];
    each_edge(unreliable, good, rows, columns, |class, _| starts[class] += 1);
    let mut sum = 0;
    for start in &mut starts {
        sum += std::mem::replace(start, sum);
    }
    let mut edges = vec![0; sum];
    each_edge(unreliable, good, rows, columns, |class, edge| {
        edges[starts[class]] = edge;
        starts[class] += 1;
    });
    edges
}

#[inline(always)]
fn each_edge(unreliable: &[f32], good: &[bool], rows: usize, columns: usize, mut visit: impl FnMut(usize, u32)) {
    for r in 0..rows {
        for c in 0..columns {
            let a = r * columns + c;
            if !good[a] {
                continue;
            }
            if c + 1 < columns && good[a + 1] {
                visit(class(unreliable[a], unreliable[a + 1]), 2 * a as u32);
            }
            if r + 1 < rows && good[a + columns] {
                visit(class(unreliable[a], unreliable[a + columns]), 2 * a as u32 + 1);
            }
        }
    }
}

/// Trees of pixels; each node knows how many turns it needs more than its parent.
struct Forest {
    /// Parent; a root points to itself.
    nodes: Vec<(u32, i32)>,
    size: Vec<u32>,
}

impl Forest {
    fn new(n: usize) -> Self {
        Self { nodes: (0..n as u32).map(|i| (i, 0)).collect(), size: vec![1; n] }
    }

    /// The root of `i` and the turns from it to `i`; halves the way for the next one.
    #[inline(always)]
    fn root(&mut self, mut i: u32) -> (u32, i32) {
        let mut turns = 0;
        loop {
            let (parent, step) = self.nodes[i as usize];
            if parent == i {
                return (i, turns);
            }
            let (grand, further) = self.nodes[parent as usize];
            if grand == parent {
                return (parent, turns + step);
            }
            self.nodes[i as usize] = (grand, step + further);
            turns += step + further;
            i = grand;
        }
    }

    /// Joins the trees of a and b so that b has `step` turns more than a.
    #[inline(always)]
    fn join(&mut self, a: u32, b: u32, step: i32) {
        // Most edges lie inside a tree.
        if self.nodes[a as usize].0 == self.nodes[b as usize].0 {
            return;
        }
        let ((root_a, turns_a), (root_b, turns_b)) = (self.root(a), self.root(b));
        if root_a == root_b {
            return;
        }
        // Turns of root b relative to root a.
        let between = turns_a + step - turns_b;
        if self.size[root_a as usize] >= self.size[root_b as usize] {
            self.nodes[root_b as usize] = (root_a, between);
            self.size[root_a as usize] += self.size[root_b as usize];
        } else {
            self.nodes[root_a as usize] = (root_b, -between);
            self.size[root_b as usize] += self.size[root_a as usize];
        }
    }
}

fn collect(forest: &mut Forest, good: &[bool]) -> Unwrapped {
    let n = good.len();
    let (mut turns, mut piece) = (vec![0; n], vec![u32::MAX; n]);
    let mut of_root = vec![u32::MAX; n];
    // Sum of turns and pixels of each piece.
    let mut sums: Vec<(i64, i64)> = Vec::new();
    for i in (0..n).filter(|&i| good[i]) {
        let (root, own) = forest.root(i as u32);
        let number = &mut of_root[root as usize];
        if *number == u32::MAX {
            *number = sums.len() as u32;
            sums.push((0, 0));
        }
        let sum = &mut sums[*number as usize];
        *sum = (sum.0 + i64::from(own), sum.1 + 1);
        (turns[i], piece[i]) = (own, *number);
    }
    let shift: Vec<i32> = sums.iter().map(|&(sum, n)| (2 * sum + n).div_euclid(2 * n) as i32).collect();
    for i in (0..n).filter(|&i| good[i]) {
        turns[i] -= shift[piece[i] as usize];
    }
    Unwrapped { turns, piece, pieces: sums.len() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI as PI64, TAU as TAU64};

    fn wrap(phase: f64) -> f32 {
        (phase - TAU64 * (phase / TAU64).round()) as f32
    }

    /// A surface of many turns comes back to rounding, up to whole turns, at any size down to one pixel.
    #[test]
    fn smooth_phase_comes_back() {
        for (rows, columns) in [(1, 1), (1, 50), (2, 3), (64, 80)] {
            let truth = |r: usize, c: usize| 0.9 * c as f64 - 0.02 * (r as f64 - 30.0).powi(2) + 0.5 * r as f64;
            let all: Vec<f64> = (0..rows * columns).map(|i| truth(i / columns, i % columns)).collect();
            let phase: Vec<f32> = all.iter().map(|&p| wrap(p)).collect();
            let found = unwrap(&phase, &vec![true; phase.len()], columns);
            assert_eq!(found.pieces, 1);
            let off = |i: usize| f64::from(phase[i]) + TAU64 * f64::from(found.turns[i]) - all[i];
            let turns = (off(0) / TAU64).round();
            for i in 0..phase.len() {
                assert!((off(i) - TAU64 * turns).abs() < 1e-5, "{rows} x {columns}, pixel {i}: {}", off(i));
            }
        }
    }

    /// Masked pixels part the image; each piece is right by itself, its mean number of turns within 1/2 of 0.
    #[test]
    fn pieces_are_counted_and_centred() {
        let (rows, columns) = (20, 31);
        let all: Vec<f64> = (0..rows * columns).map(|i| 40.0 + 0.7 * (i % columns) as f64).collect();
        let phase: Vec<f32> = all.iter().map(|&p| wrap(p)).collect();
        let good: Vec<bool> = (0..rows * columns).map(|i| i % columns != 15).collect();
        let found = unwrap(&phase, &good, columns);
        assert_eq!(found.pieces, 2);
        for side in [0, 1] {
            let own: Vec<usize> = (0..phase.len()).filter(|&i| found.piece[i] == side).collect();
            assert_eq!(own.len(), rows * 15);
            let mean: f64 = own.iter().map(|&i| f64::from(found.turns[i])).sum::<f64>() / own.len() as f64;
            assert!(mean.abs() <= 0.5, "{mean}");
            let off = |i: usize| f64::from(phase[i]) + TAU64 * f64::from(found.turns[i]) - all[i];
            assert!(own.iter().all(|&i| (off(i) - off(own[0])).abs() < 1e-4));
        }
        assert!((0..phase.len()).all(|i| good[i] || (found.piece[i] == u32::MAX && found.turns[i] == 0)));
        let nothing = unwrap(&phase, &vec![false; phase.len()], columns);
        assert_eq!(nothing.pieces, 0);
    }

    /// A field of noise that is wrong along one line only: the way goes around it, where a row by row sum carries the error on.
    #[test]
    fn bad_pixels_are_joined_last() {
        let (rows, columns) = (40, 40);
        let truth = |i: usize| 0.5 * (i % columns) as f64;
        let bad = |i: usize| i % columns == 20 && (5..35).contains(&(i / columns));
        let phase: Vec<f32> = (0..rows * columns)
            .map(|i| wrap(truth(i) + if bad(i) { PI64 * (i / columns) as f64 * 0.77 } else { 0.0 }))
            .collect();
        let found = unwrap(&phase, &vec![true; phase.len()], columns);
        let off = |i: usize| ((f64::from(phase[i]) - truth(i)) / TAU64).round() + f64::from(found.turns[i]);
        for i in (0..phase.len()).filter(|&i| !bad(i)) {
            assert_eq!(off(i), off(0), "pixel {i}");
        }
    }
}
