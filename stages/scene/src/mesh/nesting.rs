//! Which parts of a mesh lie in others.
//!
//! A ray from the farthest point of a part along a fixed direction leaves that part for good. What it meets first is a part that neither lies in
//! it nor lies between: around both are the same others, and the side on which it is met tells whether the one lies in it. So each part asks
//! one other that reaches farther, and with the farthest asked first each asks once, not all: n log n for n parts, whatever lies in what.

use std::cell::Cell;

use glam::{DMat3, DVec3};

use super::nearby::Nearby;

/// Along no edge that people draw, and upwards along every axis: the tree is walked upwards, so that what is near is met first.
const ALONG: DVec3 = DVec3::new(0.218_218, 0.436_436, 0.872_871);
/// What lies this part of the coordinates behind a ray's start, or behind what it met first, is there as well.
const TOUCH: f64 = 1e-12;

/// How many of the other parts hold each part; one with normals inwards (a negative volume) counts -1.
///
/// Parts are closed surfaces that do not run through each other. `parts` is that of each triangle, `volumes` that in each part.
pub fn nesting(nearby: &Nearby<'_>, parts: &[u32], volumes: &[f64]) -> Vec<i64> {
    let mut around = vec![0; volumes.len()];
    if volumes.len() == 1 {
        return around;
    }
    let along = nearby.into.transpose() * ALONG;
    let farthest = farthest(nearby, parts, volumes.len(), along);
    let mut order: Vec<usize> = (0..volumes.len()).collect();
    order.sort_by(|&a, &b| farthest[b].0.total_cmp(&farthest[a].0).then(a.cmp(&b)));
    let mut known = vec![false; volumes.len()];
    for part in order {
        let ray = Ray::new(nearby, farthest[part].1);
        let met = |meeting: &Meeting| meeting.part != part as u32;
        let first = ray.first(parts, met);
        around[part] = match held_by(&first, volumes) {
            None if first.is_empty() => 0,
            Some((other, holds)) if known[other] => around[other] + holds,
            // Several parts at one point, or an edge that is only brushed: what is behind it counts, too.
            _ => ray.all(parts, met),
        };
        known[part] = true;
    }
    around
}

/// The highest place of each part along a direction: how high, where.
fn farthest(nearby: &Nearby<'_>, parts: &[u32], count: usize, along: DVec3) -> Vec<(f64, DVec3)> {
    let mut farthest = vec![(f64::NEG_INFINITY, DVec3::ZERO); count];
    for (i, &part) in parts.iter().enumerate() {
        for corner in nearby.corners(i) {
            let (high, known) = (along.dot(corner), &mut farthest[part as usize]);
            if high > known.0 {
                *known = (high, corner);
            }
        }
    }
    farthest
}

/// The one part that is met at a place, and what it counts around a point just before that.
fn held_by(met: &[Meeting], volumes: &[f64]) -> Option<(usize, i64)> {
    let part = met.first()?.part;
    let turns: i64 = met.iter().map(|m| m.turn).sum();
    if turns.abs() != 1 || met.iter().any(|m| m.part != part) {
        return None;
    }
    // Out of what holds the point, against the normals where they point inwards.
    let outwards = volumes[part as usize] > 0.0;
    Some((part as usize, if (turns < 0) == outwards { -turns } else { 0 }))
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    t: f64,
    part: u32,
    /// +1 against its normal, -1 along it.
    turn: i64,
}

/// A ray along [`ALONG`] in the axes of the boxes.
struct Ray<'a> {
    nearby: &'a Nearby<'a>,
    into: DMat3,
    origin: DVec3,
    /// So far apart two places are one.
    touch: f64,
}

impl<'a> Ray<'a> {
    fn new(nearby: &'a Nearby<'a>, from: DVec3) -> Self {
        let origin = nearby.into * from;
        Self { nearby, into: nearby.into, origin, touch: TOUCH * nearby.reach }
    }

    /// What it meets first, and all that is met there.
    fn first(&self, parts: &[u32], counts: impl Fn(&Meeting) -> bool) -> Vec<Meeting> {
        let nearest = Cell::new(f64::INFINITY);
        let mut met = Vec::new();
        self.meetings(
            parts,
            || nearest.get() + self.touch,
            |meeting| {
                if counts(&meeting) && meeting.t <= nearest.get() + self.touch {
                    if meeting.t < nearest.get() - self.touch {
                        met.clear();
                    }
                    nearest.set(nearest.get().min(meeting.t));
                    met.push(meeting);
                }
            },
        );
        met.retain(|m| m.t <= nearest.get() + self.touch);
        met
    }

    /// By all that it meets: how many parts hold its start.
    fn all(&self, parts: &[u32], counts: impl Fn(&Meeting) -> bool) -> i64 {
        let mut around = 0;
        self.meetings(
            parts,
            || f64::INFINITY,
            |meeting| {
                around -= if counts(&meeting) { meeting.turn } else { 0 };
            },
        );
        around
    }

    fn meetings(&self, parts: &[u32], most: impl Fn() -> f64, mut met: impl FnMut(Meeting)) {
        let inverse = 1.0 / ALONG;
        let may_meet = |low: DVec3, high: DVec3| {
            let enter = ((low - self.origin - self.touch) * inverse).max_element();
            let leave = ((high - self.origin + self.touch) * inverse).min_element();
            // What the touch is for a box, a little more of it is along the ray.
            enter <= leave && leave >= -8.0 * self.touch && enter <= most()
        };
        self.nearby.visit(may_meet, |i| {
            let corners = self.nearby.corners(i);
            if let Some((t, turn)) = self.crosses(&corners)
                && t >= -self.touch
            {
                met(Meeting { t, part: parts[i], turn });
            }
        });
    }

    /// Where it crosses a triangle. Edges are judged alike for both triangles at them, by the exact sign of a determinant of the corners
    /// as they are projected, and where that is 0 as if the ray were moved a little: a closed surface is never slipped through.
    fn crosses(&self, corners: &[DVec3; 3]) -> Option<(f64, i64)> {
        let [a, b, c] = corners.map(|corner| self.project(corner));
        let sign = side(a, b);
        if sign == 0 || side(b, c) != sign || side(c, a) != sign {
            return None;
        }
        let weights = [area(b, c), area(c, a), area(a, b)];
        let sum: f64 = weights.iter().sum();
        let (low, high) = (a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z));
        let t = if sum == 0.0 { low } else { (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / sum };
        Some((t.clamp(low, high), -sign))
    }

    /// Across the ray, and how far along it.
    fn project(&self, corner: DVec3) -> DVec3 {
        let p = self.into * corner - self.origin;
        let t = p.z / ALONG.z;
        DVec3::new(p.x - ALONG.x * t, p.y - ALONG.y * t, t)
    }
}

fn area(p: DVec3, q: DVec3) -> f64 {
    p.x * q.y - p.y * q.x
}

/// The sign of [`area`] without rounding; of 0 that after a move of the ray by (e, e^2).
fn side(p: DVec3, q: DVec3) -> i64 {
    let (one, other) = (p.x * q.y, p.y * q.x);
    if one != other {
        return if one > other { 1 } else { -1 };
    }
    let lost = libm::fma(p.x, q.y, -one) - libm::fma(p.y, q.x, -other);
    sign(if lost != 0.0 {
        lost
    } else if p.y == q.y {
        q.x - p.x
    } else {
        p.y - q.y
    })
}

fn sign(x: f64) -> i64 {
    i64::from(x > 0.0) - i64::from(x < 0.0)
}
