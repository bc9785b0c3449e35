//! A table from phantoms: where it may reach, and how it reads between them.

use turbid_contract::{Error, Problem};

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

fn degenerate() -> Error {
    Error::failed_with_hint(
        "the phantoms' properties lie on a line or nearly so: they span no table",
        "vary mu_a and mu_s' apart, as on a grid",
    )
}

/// The rectangle of (mu_a, mu_s') in which no value is extrapolated: that of the phantoms, shrunk about its centre (in logarithms)
/// until its corners lie in their convex hull.
pub fn rectangle(phantoms: &[Phantom]) -> Option<[[f64; 2]; 2]> {
    let points: Vec<[f64; 2]> = phantoms.iter().map(|p| p.properties.map(libm::log)).collect();
    let ends = |k: usize| {
        let all = points.iter().map(|p| p[k]);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let bounds = [ends(0), ends(1)];
    let hull = hull(&points);
    let inside = |scale: f64| {
        let at = |k: usize, end: usize| {
            let [low, high] = bounds[k];
            0.5 * (low + high) + scale * 0.5 * (if end == 0 { low - high } else { high - low })
        };
        (0..4).all(|corner| contains(&hull, [at(0, corner / 2), at(1, corner % 2)]))
    };
    let (mut low, mut high) = (0.0, 1.0);
    if inside(1.0) {
        low = 1.0;
    } else {
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if inside(middle) { low = middle } else { high = middle }
        }
    }
    let usable = low > 1e-3 && hull.len() > 2;
    usable.then(|| {
        bounds.map(|[a, b]| {
            let (centre, half) = (0.5 * (a + b), 0.5 * (b - a) * low);
            [libm::exp(centre - half), libm::exp(centre + half)]
        })
    })
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
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

fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// To 1e-9 of a unit of ln: corners of a grid of phantoms are on the hull, and to rounding inside.
fn contains(hull: &[[f64; 2]], p: [f64; 2]) -> bool {
    (0..hull.len()).all(|i| {
        let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
        turn(a, b, p) >= -1e-9 * libm::hypot(b[0] - a[0], b[1] - a[1])
    })
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
    let reach = rectangle(phantoms).ok_or_else(degenerate)?;
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
    // Finite weights, or the corners of some triangle are one point.
    if weights.iter().any(|(_, w)| w.iter().any(|w| !w.is_finite() || *w < -0.05)) {
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
