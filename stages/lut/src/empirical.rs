//! A table from phantoms: where it may reach, and how it reads between them.

use turbid_contract::{At, Error, Problem};

use crate::nodes::Nodes;
use crate::phantoms::Phantom;
use crate::surface::Surface;
use crate::table::Recipe;

/// Nodes of an axis where the user names none.
pub const NODES: usize = 25;
/// Of the paper's first step.
const PAPER_NODES: usize = 100;

/// Reflectances in table order with their standard errors, and how they came about.
pub struct Table {
    pub recipe: Recipe,
    pub r_d: Vec<f64>,
    pub se: Vec<f64>,
    /// Degrees of the surface in ln mu_a and ln mu_s'; none for the paper's linear step.
    pub degrees: Option<[usize; 2]>,
    /// Most that an error of one phantom's ln R grows by.
    pub gain: f64,
}

/// ln of what a model reflects at one f_x at each place; it guides the interpolation between phantoms.
pub type Guide<'a> = &'a dyn Fn(f64, &[[f64; 2]]) -> Result<Vec<f64>, Error>;

pub(crate) fn degenerate() -> Error {
    Error::failed_with_hint(
        "the phantoms' properties lie on a line or nearly so: they span no table",
        "vary mu_a and mu_s' apart, as on a grid",
    )
}

/// The rectangle of (mu_a, mu_s') in which no value is extrapolated: the largest (in logarithms) that lies in the phantoms' convex hull.
/// One phantom that was measured off its place costs its own side, not all four.
pub fn rectangle(phantoms: &[Phantom]) -> Option<[[f64; 2]; 2]> {
    let points: Vec<[f64; 2]> = phantoms.iter().map(|p| p.properties.map(libm::log)).collect();
    let [left, right] =
        points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[0]), high.max(p[0])]);
    let hull = hull(&points);
    if hull.len() < 3 {
        return None;
    }
    let bounds = |x: [f64; 2]| {
        let [a, b] = x.map(|x| crossing(&hull, x));
        [a[0].max(b[0]), a[1].min(b[1])]
    };
    // Width times height is log-concave in both sides, and so is its maximum over one of them: no other peak can hold the search.
    let area = |x: [f64; 2]| {
        let [low, high] = bounds(x);
        let (width, height) = (x[1] - x[0], high - low);
        if width > 0.0 && height > 0.0 { width * height } else { width.min(height) }
    };
    let second = |first: f64| peak([first, right], |second| area([first, second]));
    let first = peak([left, right], |first| area([first, second(first)]));
    let x = [first, second(first)];
    let y = bounds(x);
    let usable = |[low, high]: [f64; 2]| high - low > 1e-3;
    (usable(x) && usable(y)).then(|| [x, y].map(|ends| ends.map(libm::exp)))
}

/// Where a function with one peak is largest. A peak at an end, as that of a full grid of phantoms, is found exactly.
fn peak([mut low, mut high]: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
    let ends = [low, high];
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        if f(low + third) < f(high - third) { low += third } else { high -= third }
    }
    let middle = 0.5 * (low + high);
    ends.into_iter().fold(middle, |best, end| if f(end) >= f(best) { end } else { best })
}

/// Lowest and highest y of a convex polygon at `x`, which must be one of its own.
fn crossing(hull: &[[f64; 2]], x: f64) -> [f64; 2] {
    let mut found = [f64::NEG_INFINITY, f64::INFINITY];
    for (i, a) in hull.iter().enumerate() {
        let b = hull[(i + 1) % hull.len()];
        let run = b[0] - a[0];
        let y = a[1] + (b[1] - a[1]) * ((x - a[0]) / run);
        // Counter-clockwise: edges to the right are the lower ones.
        if run > 0.0 {
            found[0] = f64::max(found[0], y);
        } else if run < 0.0 {
            found[1] = f64::min(found[1], y);
        }
    }
    found
}

/// The same for the triangles of a grid of phantoms, whose border may be dented: between the innermost phantoms of opposite sides.
fn inner_rectangle(phantoms: &[Phantom], [rows, columns]: [usize; 2]) -> Option<[[f64; 2]; 2]> {
    let row = |i: usize| (0..columns).map(|j| phantoms[i * columns + j].properties).collect::<Vec<_>>();
    let column = |j: usize| (0..rows).map(|i| phantoms[i * columns + j].properties).collect::<Vec<_>>();
    let sides = [row(0), row(rows - 1), column(0), column(columns - 1)];
    let bounds = [0, 1].map(|k| {
        let mean = |side: &&Vec<[f64; 2]>| side.iter().map(|p| p[k]).sum::<f64>() / side.len() as f64;
        let [low, high] = [0, 1].map(|end| {
            let mut sorted: Vec<&Vec<[f64; 2]>> = sides.iter().collect();
            sorted.sort_by(|a, b| mean(a).total_cmp(&mean(b)));
            sorted[3 * end]
        });
        [low.iter().map(|p| p[k]).fold(0.0, f64::max), high.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min)]
    });
    bounds.iter().all(|[low, high]| high / low > 1.001).then_some(bounds)
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
pub(crate) fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while chain.len() > 1 && turn(chain[chain.len() - 2], chain[chain.len() - 1], p) <= 0.0 {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter().copied());
    hull.extend(chain(&mut sorted.iter().rev().copied()));
    hull
}

/// Whether a point lies in a convex polygon, to 1e-9: its corners are in it.
pub(crate) fn contains(hull: &[[f64; 2]], p: [f64; 2]) -> bool {
    (0..hull.len()).all(|i| {
        let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
        turn(a, b, p) >= -1e-9 * libm::hypot(b[0] - a[0], b[1] - a[1])
    })
}

fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// How a table reads between its phantoms.
pub enum Between<'a> {
    /// ln R over (ln mu_a, ln mu_s') is a polynomial.
    Smooth,
    /// ln (R / R_model) is.
    Guided(Guide<'a>),
    /// The paper's first step; phantoms on a grid of so many rows and columns.
    Linear([usize; 2]),
}

/// The table. `recipe.mu_a` and `recipe.mu_s_prime` may be empty: then 25 nodes (100 of the paper's) span what the phantoms do.
/// `reference` is the reflectance of the reference at each f_x, 1 in the relative convention.
///
/// Errors: fewer than four phantoms, or on a line; axes that reach beyond them.
pub fn table(
    phantoms: &[Phantom],
    mut recipe: Recipe,
    reference: &[f64],
    between: &Between<'_>,
) -> Result<Table, Error> {
    if phantoms.len() < 4 {
        return Err(Error::failed_with_hint(
            format!("{} phantoms are too few: the plainest surface takes four", phantoms.len()),
            "give `phantoms` two values of mu_a and of mu_s' at least; three of each is what the paper has",
        ));
    }
    let reach = match between {
        Between::Linear(shape) => inner_rectangle(phantoms, *shape),
        _ => rectangle(phantoms),
    };
    let reach = reach.ok_or_else(degenerate)?;
    let default = |[low, high]: [f64; 2]| match between {
        Between::Linear(_) => Nodes::linspace(low, high, PAPER_NODES).0,
        _ => Nodes::logspace(low, high, NODES).0,
    };
    let axes = [("mu_a", &mut recipe.mu_a, reach[0]), ("mu_s_prime", &mut recipe.mu_s_prime, reach[1])];
    for (axis, nodes, [low, high]) in axes {
        if nodes.is_empty() {
            *nodes = default([low, high]);
        }
        let [first, last] = [nodes[0], nodes[nodes.len() - 1]];
        if first < low * (1.0 - 1e-9) || last > high * (1.0 + 1e-9) {
            let what =
                format!("{axis} from {first} to {last} mm^-1 reaches beyond the phantoms ({low:.4} to {high:.4})");
            return Err(Error::Invalid(Problem {
                at: At::With,
                path: axis.into(),
                message: what,
                hint: Some("a table is not extrapolated: narrow the axis, leave it out, or add phantoms".into()),
            }));
        }
    }
    let places: Vec<[f64; 2]> =
        recipe.mu_a.iter().flat_map(|&a| recipe.mu_s_prime.iter().map(move |&s| [a, s])).collect();
    match between {
        Between::Smooth => smooth(phantoms, recipe, reference, &places, &|_, places| Ok(vec![0.0; places.len()])),
        Between::Guided(guide) => smooth(phantoms, recipe, reference, &places, guide),
        Between::Linear(shape) => linear(phantoms, *shape, recipe, reference, &places),
    }
}

/// ln R, less what the guide says, as a polynomial of (ln mu_a, ln mu_s').
fn smooth(
    phantoms: &[Phantom],
    recipe: Recipe,
    reference: &[f64],
    places: &[[f64; 2]],
    guide: Guide<'_>,
) -> Result<Table, Error> {
    let media: Vec<[f64; 2]> = phantoms.iter().map(|p| p.properties).collect();
    let points: Vec<[f64; 2]> = media.iter().map(|p| p.map(libm::log)).collect();
    let logs: Vec<[f64; 2]> = places.iter().map(|p| p.map(libm::log)).collect();
    let surface = Surface::through(&points, &logs).ok_or_else(degenerate)?;
    let weights: Vec<Vec<f64>> = logs.iter().map(|&p| surface.weights(p)).collect();
    let (mut r_d, mut se) = (Vec::new(), Vec::new());
    for (k, &f_x) in recipe.f_x.iter().enumerate() {
        let seen: Vec<f64> = phantoms.iter().map(|p| libm::log(p.ratio[k] * reference[k])).collect();
        let values: Vec<f64> = seen.iter().zip(guide(f_x, &media)?).map(|(seen, model)| seen - model).collect();
        // A wrong mu_a puts a right R in the wrong place: the slope of ln R there makes one error of the other.
        let slopes = slopes(&surface, &values, &media, f_x, guide)?;
        let variance = |(p, slopes): (&Phantom, &[f64; 2])| {
            let moved = [0, 1].map(|i| slopes[i] * p.properties_se[i] / p.properties[i]);
            let own = p.ratio_se[k] / p.ratio[k];
            own * own + moved[0] * moved[0] + moved[1] * moved[1]
        };
        let variances: Vec<f64> = phantoms.iter().zip(&slopes).map(variance).collect();
        for (weights, model) in weights.iter().zip(guide(f_x, places)?) {
            let r = libm::exp(model + weights.iter().zip(&values).map(|(w, v)| w * v).sum::<f64>());
            r_d.push(r);
            se.push(r * weights.iter().zip(&variances).map(|(w, v)| w * w * v).sum::<f64>().sqrt());
        }
    }
    Ok(Table { recipe, r_d, se, degrees: Some(surface.degrees), gain: surface.gain })
}

/// d ln R / d (ln mu_a, ln mu_s') at each medium: of the polynomial, and of the guide by central differences.
fn slopes(
    surface: &Surface,
    values: &[f64],
    media: &[[f64; 2]],
    f_x: f64,
    guide: Guide<'_>,
) -> Result<Vec<[f64; 2]>, Error> {
    const STEP: f64 = 1e-3;
    let mut slopes: Vec<[f64; 2]> = media.iter().map(|p| surface.slopes(values, p.map(libm::log))).collect();
    for k in [0, 1] {
        let moved = |sign: f64| {
            let mut media = media.to_vec();
            media.iter_mut().for_each(|m| m[k] *= libm::exp(sign * STEP));
            guide(f_x, &media)
        };
        for (slope, (up, down)) in slopes.iter_mut().zip(moved(1.0)?.into_iter().zip(moved(-1.0)?)) {
            slope[k] += (up - down) / (2.0 * STEP);
        }
    }
    Ok(slopes)
}

/// The paper's first step: raw R over raw (mu_a, mu_s'), linear on the two triangles of each cell of the phantoms' grid.
fn linear(
    phantoms: &[Phantom],
    [rows, columns]: [usize; 2],
    recipe: Recipe,
    reference: &[f64],
    places: &[[f64; 2]],
) -> Result<Table, Error> {
    let mut triangles = Vec::new();
    for i in 0..rows - 1 {
        for j in 0..columns - 1 {
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| i * columns + j);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    // Barycentric weights in the triangle that holds the place (or, to rounding, is nearest).
    let weights = |place: [f64; 2]| -> ([usize; 3], [f64; 3]) {
        let of = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|k| phantoms[k].properties);
            let all = turn(a, b, c);
            [turn(b, c, place) / all, turn(c, a, place) / all, turn(a, b, place) / all]
        };
        let all = triangles.iter().map(|t| (*t, of(t)));
        let least = |w: &[f64; 3]| w[0].min(w[1]).min(w[2]);
        all.max_by(|a, b| least(&a.1).total_cmp(&least(&b.1))).expect("a grid of four or more has triangles")
    };
    let weights: Vec<([usize; 3], [f64; 3])> = places.iter().map(|&p| weights(p)).collect();
    // Finite weights, or the corners of some triangle are one point; below 0 by rounding alone, or the grid is turned inside out.
    if weights.iter().any(|(_, w)| w.iter().any(|w| !w.is_finite() || *w < -1e-6)) {
        return Err(degenerate());
    }
    let (mut r_d, mut se) = (Vec::new(), Vec::new());
    for (k, &reference) in reference.iter().enumerate() {
        for (corners, w) in &weights {
            let sum = |f: &dyn Fn(usize) -> f64| (0..3).map(f).sum::<f64>();
            r_d.push(reference * sum(&|c| w[c] * phantoms[corners[c]].ratio[k]));
            let variance = sum(&|c| {
                let e = w[c] * phantoms[corners[c]].ratio_se[k];
                e * e
            });
            se.push(reference * variance.sqrt());
        }
    }
    Ok(Table { recipe, r_d, se, degrees: None, gain: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phantoms(media: &[[f64; 2]]) -> Vec<Phantom> {
        let phantom =
            |&properties: &[f64; 2]| Phantom { properties, properties_se: [0.0; 2], ratio: vec![], ratio_se: vec![] };
        media.iter().map(phantom).collect()
    }

    /// A grid whose border is dented keeps what lies between its innermost phantoms, whichever property runs fastest.
    #[test]
    fn a_dented_grid_is_not_left() {
        let media = [[0.01, 1.0], [0.012, 2.5], [0.009, 4.1], [0.1, 1.1], [0.09, 2.4], [0.11, 4.0]];
        let expected = [[0.012, 0.09], [1.1, 4.0]];
        assert_eq!(inner_rectangle(&phantoms(&media), [2, 3]), Some(expected));
        let turned = [0, 3, 1, 4, 2, 5].map(|i| media[i]);
        assert_eq!(inner_rectangle(&phantoms(&turned), [3, 2]), Some(expected));
    }

    /// A full grid is its own rectangle; of skewed phantoms no rectangle in their hull, of many tried, is larger, and a phantom off its place
    /// by 9 % costs its own side alone.
    #[test]
    fn the_largest_rectangle_is_found() {
        let (a, s) = ([0.001, 0.05, 0.1], [1.0, 2.5, 4.0]);
        let mut media: Vec<[f64; 2]> = a.iter().flat_map(|&a| s.iter().map(move |&s| [a, s])).collect();
        let near = |x: f64, y: f64, by: f64| (x / y - 1.0).abs() < by;
        let [reach_a, reach_s] = rectangle(&phantoms(&media)).unwrap();
        assert!(near(reach_a[0], 0.001, 1e-12) && near(reach_a[1], 0.1, 1e-12), "{reach_a:?}");
        assert!(near(reach_s[0], 1.0, 1e-12) && near(reach_s[1], 4.0, 1e-12), "{reach_s:?}");

        media[2][0] *= 1.09;
        let [reach_a, reach_s] = rectangle(&phantoms(&media)).unwrap();
        assert!(near(reach_a[0], 0.00109, 1e-6) && near(reach_a[1], 0.1, 1e-12), "{reach_a:?}");
        assert!(near(reach_s[0], 1.0, 1e-12) && near(reach_s[1], 4.0, 1e-12), "{reach_s:?}");

        media.iter_mut().enumerate().for_each(|(i, m)| m[i % 2] *= 1.0 + 0.1 * ((i * i % 5) as f64 - 2.0));
        let reach = rectangle(&phantoms(&media)).unwrap().map(|ends| ends.map(libm::log));
        let points: Vec<[f64; 2]> = media.iter().map(|m| m.map(libm::log)).collect();
        let hull = hull(&points);
        let height = |x: [f64; 2]| {
            let [a, b] = x.map(|x| crossing(&hull, x));
            [a[0].max(b[0]), a[1].min(b[1])]
        };
        assert_eq!(
            height(reach[0]).map(|y| y as f32),
            reach[1].map(|y| y as f32),
            "it reaches up and down to the hull"
        );
        let area = |[x, y]: [[f64; 2]; 2]| (x[1] - x[0]) * (y[1] - y[0]);
        let left = points.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min);
        let right = points.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max);
        let at = |k: i32| left + (right - left) * f64::from(k) / 200.0;
        for first in 0..200 {
            for second in first + 1..=200 {
                let x = [at(first), at(second)];
                let y = height(x);
                assert!(y[0] >= y[1] || area([x, y]) <= area(reach) * (1.0 + 1e-9), "{x:?} {y:?}, {reach:?}");
            }
        }
    }
}
