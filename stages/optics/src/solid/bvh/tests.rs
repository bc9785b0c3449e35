//! Trees over boxes that are alike, flat, far apart, in rows or in each other.

use super::*;
use crate::philox::{philox4x32, unit};

type Boxes = Vec<(DVec3, DVec3)>;

/// Random numbers in (0, 1).
fn draw(i: usize) -> DVec3 {
    let [a, b, c, _] = philox4x32([i as u32, 0, 0, 0], [8, 1]);
    DVec3::new(unit(a), unit(b), unit(c))
}

fn cases() -> Vec<(&'static str, Boxes)> {
    let many = 100_000;
    let of = |n: usize, make: &dyn Fn(f64, DVec3) -> (DVec3, DVec3)| -> Boxes {
        (0..n).map(|i| make(i as f64, draw(i))).collect()
    };
    let point = |p: DVec3| (p, p);
    let row = |i: f64| (i * DVec3::X, (i + 1.0) * DVec3::X + DVec3::new(0.0, 1.0, 1.0));
    let anywhere = |size: f64| move |_: f64, u: DVec3| (size * u, size * (u + 0.01 * DVec3::new(u.y, u.z, u.x)));
    vec![
        ("one", of(1, &|_, u| (u, u + 1.0))),
        ("one point", of(1, &|_, u| point(u))),
        ("two", of(2, &|i, u| (i * DVec3::X, i * DVec3::X + u))),
        ("alike", of(many, &|_, _| (DVec3::ZERO, DVec3::ONE))),
        ("one point, often", of(many, &|_, _| point(DVec3::ONE))),
        ("points in a row", of(many, &|i, _| point(i * DVec3::Z))),
        ("a row", of(many, &|i, _| row(i))),
        ("a row, more at once than are clustered together", of(150_000, &|i, _| row(i))),
        (
            "a square",
            of(many, &|i, _| row(i % 256.0))
                .into_iter()
                .zip(0..)
                .map(|((l, h), i)| {
                    let up = f64::from(i / 256) * DVec3::Y;
                    (l + up, h + up)
                })
                .collect(),
        ),
        ("in each other", of(many, &|i, _| (DVec3::splat(-i), DVec3::splat(i)))),
        ("each half of the next", of(1000, &|i, _| (DVec3::ZERO, DVec3::splat(libm::exp2(-i))))),
        ("1e-9 mm", of(5000, &anywhere(1e-9))),
        ("1e9 mm", of(5000, &anywhere(1e9))),
        ("1e-310 mm", of(500, &anywhere(1e-310))),
        ("1e308 mm", of(500, &anywhere(1e308))),
        (
            "1 mm, 1e9 mm away",
            of(5000, &|i, u| {
                let (low, high) = anywhere(1.0)(i, u);
                (low + 1e9, high + 1e9)
            }),
        ),
        ("of all sizes", of(5000, &|_, u| (u, u + DVec3::splat(libm::exp2(-60.0 * u.x))))),
    ]
}

/// Each thing is in one leaf, each box is the least that holds what is in it, and none lies deeper than there is room on the way.
#[test]
fn boxes_hold_their_things_exactly() {
    for (name, boxes) in cases() {
        let tree = Tree::over(&boxes);
        let mut order = tree.order().to_vec();
        order.sort_unstable();
        assert!(order.iter().zip(0..).all(|(&thing, i)| thing == i) && order.len() == boxes.len(), "{name}");
        let ranges = tree.ranges();
        assert_eq!(ranges[0], 0..boxes.len(), "{name}");
        let mut depths = vec![0; tree.nodes.len()];
        for (i, node) in tree.nodes.iter().enumerate() {
            if node.count == 0 {
                let first = node.first as usize;
                assert!(first > i && ranges[first].end == ranges[first + 1].start, "{name}");
                let below = depths[i] + 1;
                depths[first..first + 2].fill(below);
            } else {
                let own = tree.order[ranges[i].clone()].iter().map(|&thing| &boxes[thing as usize]);
                assert_eq!((node.low, node.high), around(own), "{name}");
            }
            assert!(depths[i] < DEEP && node.count as usize <= LEAF, "{name}: {} deep, {}", depths[i], node.count);
        }
        let mut met = 0;
        tree.visit(|_, _| true, |places| met += places.len());
        assert_eq!(met, boxes.len(), "{name}");
    }
}

/// A line along no axis through the middle of a box meets it in the tree for lines.
#[test]
fn lines_meet_what_they_go_through() {
    for (name, boxes) in cases() {
        let (tree, wide) = Tree::with_wide(&boxes);
        assert_eq!(wide.is_none(), ["one point", "one point, often", "1e-310 mm"].contains(&name), "{name}");
        let size =
            boxes.iter().fold(0.0, |size: f64, b| size.max(b.0.abs().max_element()).max(b.1.abs().max_element()));
        let direction = DVec3::new(0.6, -0.48, 0.64);
        for place in (0..boxes.len()).step_by(boxes.len().div_ceil(100)) {
            let (low, high) = boxes[tree.order[place] as usize];
            let origin = 0.5 * low + 0.5 * high - (0.1 * size) * direction;
            let mut met = false;
            let fine = wide
                .as_ref()
                .is_none_or(|wide| wide.visit(origin, direction, 0.0, 1e-14 * size, |i| met |= i == place));
            assert_eq!(fine, name != "1 mm, 1e9 mm away", "{name}");
            assert!(met || !fine || wide.is_none(), "{name}: {place}");
        }
    }
}

/// The nearest box, as all boxes asked one by one have it.
#[test]
fn the_nearest_is_found() {
    for (name, boxes) in cases() {
        let tree = Tree::over(&boxes);
        let (low, high) = around(boxes.iter());
        for i in 0..10 {
            let p = low + (3.0 * draw(i) - 1.0) * (high - low).min(DVec3::splat(1e150));
            let square = |thing: usize| {
                let (low, high) = boxes[thing];
                (low - p).max(p - high).max(DVec3::ZERO).length_squared()
            };
            let least = (0..boxes.len()).map(square).fold(f64::INFINITY, f64::min);
            let found = tree.nearest(p, f64::INFINITY, |places| {
                tree.order[places].iter().map(|&thing| square(thing as usize)).fold(f64::INFINITY, f64::min)
            });
            assert_eq!(found, least, "{name}: {p}");
        }
    }
}
