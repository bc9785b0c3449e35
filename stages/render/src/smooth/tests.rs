use turbid_contract::MemoryHost;

use super::*;
use crate::chart::Chart;

/// Draws of one sequence, the same on every machine.
struct Draws(u64);

impl Draws {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Mean 0, variance 1; skewed as sums over few paths are: (exponential - 1 of four) / 2.
    fn skewed(&mut self) -> f64 {
        (0..4).map(|_| -libm::log(self.uniform()) - 1.0).sum::<f64>() / 2.0
    }
}

/// A square of pixels with an edge on its left side.
fn square(side: usize, chart: Chart) -> Region {
    let cells: Vec<[usize; 2]> = (0..side * side).map(|p| [p % side, p / side]).collect();
    let at = |c: usize| 2.0 * (c as f64 + 0.5) / side as f64 - 1.0;
    let around = if chart == Chart::Axis { std::f64::consts::PI } else { 1.0 };
    let places = cells.iter().map(|c| [at(c[0]), around * at(c[1])]).collect();
    Region::known(chart, cells, places, 1)
}

const PATHS: u32 = 64;

/// Reduced responses `truth` + noise, whose variance doubles over the image; each pixel's own variance is known as badly as by its paths, too small where it is
/// dark.
fn noisy(region: &Region, truth: &dyn Fn([f64; 2]) -> [f64; 3], noise: f64, draws: &mut Draws) -> Reduced {
    let (mut values, mut covariances) = (Vec::new(), Vec::new());
    for &place in &region.places {
        let sd = noise * (1.0 + 0.2 * place[0]);
        for (a, value) in truth(place).into_iter().enumerate() {
            let draw = draws.skewed();
            values.push(value + sd * draw);
            // Var(x) estimated together with x: correlated as those of a skewed variable are.
            let sampled = sd * sd * (1.0 + 0.5 * draw).max(0.05);
            covariances.extend((0..3).map(|b| if a == b { sampled } else { 0.0 }));
        }
    }
    Reduced::known(3, values, covariances)
}

fn fitted(region: &Region, reduced: &Reduced) -> Option<Smooth> {
    let host = MemoryHost::new(1, &[], 2);
    Smooth::of(Ctx::new(&host), region, reduced, &vec![PATHS; region.len()], 1.0)
}

/// z scores over the pixels of `seeds` fits: mean, root mean square, and the part of pixels that are fitted.
fn scores(region: &Region, truth: &dyn Fn([f64; 2]) -> [f64; 3], noise: f64, seeds: u64) -> (f64, f64, f64) {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0_f64);
    for seed in 0..seeds {
        let mut draws = Draws(seed * 7919 + 1);
        let reduced = noisy(region, truth, noise, &mut draws);
        let Some(smooth) = fitted(region, &reduced) else { continue };
        for i in (0..region.len()).filter(|&i| smooth.fitted[i]) {
            let truth = truth(region.places[i]);
            for (a, truth) in truth.into_iter().enumerate() {
                let z = (smooth.value(i, a) - truth) / smooth.covariance(i, a, a).sqrt();
                (sum, squares, count) = (sum + z, squares + z * z, count + 1.0);
            }
        }
    }
    (sum / count, (squares / count).sqrt(), count / (seeds as f64 * 3.0 * region.len() as f64))
}

/// What is a polynomial of low order, or a sum of low harmonics, is found within its errors: z over 20 fits of 24 x 24 pixels, each with some 6 to 21 x 3
/// coefficients. Root mean square 1 but for what the bounds of misfit add (up to a fifth) and its own error, sqrt(1 / (2 20 18)) = 0.04, four times; mean 0
/// within a third.
#[test]
fn smooth_responses_are_found_within_their_errors() {
    let plane = |[u, v]: [f64; 2]| [1.0 + 0.3 * u - 0.2 * v * v, 0.5 + 0.2 * u * v, 0.1 * u * u * u];
    let around = |[u, v]: [f64; 2]| [1.0 + 0.3 * u, 0.5 + 0.2 * u * v.cos(), 0.1 * (2.0 * v).sin()];
    for (chart, truth) in [(Chart::Plane, &plane as &dyn Fn([f64; 2]) -> [f64; 3]), (Chart::Axis, &around)] {
        let (mean, rms, part) = scores(&square(24, chart), truth, 0.3, 20);
        assert!((0.65..1.16).contains(&rms), "{chart:?}: rms {rms}");
        assert!(mean.abs() < 0.33, "{chart:?}: mean {mean}");
        assert!(part > 0.95, "{chart:?}: {part} of the pixels are fitted");
    }
}

/// A fit of 24 x 24 pixels has the error of a pixel times sqrt(terms / 576): with a cubic, 15 terms, and the bounds, a fifth.
#[test]
fn a_fit_is_better_than_its_pixels() {
    let region = square(24, Chart::Plane);
    let reduced = noisy(&region, &|[u, v]| [1.0 + u * v, 0.5, 0.5 * u], 0.3, &mut Draws(5));
    let smooth = fitted(&region, &reduced).expect("it is smooth");
    let mean: f64 = (0..region.len()).map(|i| smooth.covariance(i, 0, 0)).sum::<f64>() / region.len() as f64;
    assert!((0.1..0.25).contains(&(mean.sqrt() / 0.3)), "{}", mean.sqrt());
    assert!((smooth.chi2 - 1.0).abs() < 0.25, "{}", smooth.chi2);
    // The variance of the sum over all pixels is that of the sum of their noise, 576 x 0.09 x 1.013, whatever the functions: a constant is one of them.
    let of_sum = smooth.variance_of_sum(&region, &|_| vec![(0, 1.0)]);
    assert!((of_sum / (576.0 * 0.09) - 1.0).abs() < 0.6, "{of_sum}");
}

/// What is the same all around takes functions of the depth alone: a cubic, 4 of them, and the bounds, so the error is that of a pixel times sqrt(4 / 576) = 0.083, half again as much at the most; with
/// harmonics of each degree it would be sqrt(16 / 576). Where harmonics are, they are taken: `smooth_responses_are_found_within_their_errors`.
#[test]
fn what_is_round_takes_no_harmonics() {
    let region = square(24, Chart::Axis);
    let errors: Vec<f64> = (0..8)
        .map(|seed| {
            let reduced =
                noisy(&region, &|[u, _]| [1.0 + 0.5 * u, 0.5 - 0.2 * u, 0.3 * u], 0.3, &mut Draws(seed * 31 + 1));
            let smooth = fitted(&region, &reduced).expect("it is smooth");
            let sum: f64 = (0..region.len()).map(|i| smooth.covariance(i, 0, 0)).sum();
            (sum / region.len() as f64).sqrt() / 0.3
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / 8.0;
    assert!((0.07..0.125).contains(&mean), "{errors:?}");
}

/// Light from elsewhere has the phase of no fringe here: a third of a fringe is so, three turns and more of which no polynomial of low order follows. It is found
/// within its errors (bounds as above), by few functions: the error is that of a pixel times sqrt(terms / 576), some 20 to 50 of them with the bound of what is left out.
#[test]
fn light_from_elsewhere_is_found() {
    let region = square(24, Chart::Axis);
    let truth = |[u, v]: [f64; 2]| {
        let column = (12.0 * (u + 1.0) - 0.5).round();
        let (sin, cos) = (0.9 * column).sin_cos();
        let (x, y) = (0.15 * (1.0 - u), 0.1 * u);
        [1.0 + 0.3 * u, 0.5 + 0.2 * u * v.cos() + x * cos + y * sin, -x * sin + y * cos]
    };
    let (mean, rms, part) = scores(&region, &truth, 0.1, 20);
    assert!((0.65..1.16).contains(&rms) && mean.abs() < 0.33, "mean {mean}, rms {rms}");
    assert!(part > 0.9, "{part} of the pixels are fitted");
    let smooth = fitted(&region, &noisy(&region, &truth, 0.1, &mut Draws(5))).expect("it is smooth");
    let mean: f64 = (0..region.len()).map(|i| smooth.covariance(i, 1, 1)).sum::<f64>() / region.len() as f64;
    assert!(mean.sqrt() / 0.1 < 0.35, "{}", mean.sqrt());
}

/// A spot that no polynomial follows is left to its pixels, or is within the stated errors where noise hides it; so is a fall at the edge.
#[test]
fn what_is_not_smooth_is_left_to_pixels() {
    let region = square(24, Chart::Plane);
    let spot = |height: f64| {
        move |[u, v]: [f64; 2]| {
            let r2 = (u - 0.2) * (u - 0.2) + (v + 0.3) * (v + 0.3);
            [1.0 + height * libm::exp(-r2 / 0.02), 0.5, 0.0]
        }
    };
    let edge = |height: f64| move |[u, _]: [f64; 2]| [1.0 + height * libm::exp(-(u + 1.0) / 0.08), 0.5, 0.0];
    for height in [0.0, 0.1, 0.5, 2.0] {
        for (what, truth) in [("spot", &spot(height) as &dyn Fn([f64; 2]) -> [f64; 3]), ("edge", &edge(height))] {
            let (mean, rms, part) = scores(&region, truth, 0.1, 10);
            if part > 0.0 {
                assert!(rms < 1.3 && mean.abs() < 0.33, "{what} of {height}: mean {mean}, rms {rms}, fitted {part}");
            }
            assert!(part > 0.4 || height > 0.1, "{what} of {height}: fitted {part}");
        }
    }
    // A step across the middle is no function of any order: nothing is fitted, or only one side of it well.
    let step = |[u, _]: [f64; 2]| [if u > 0.03 { 2.0 } else { 1.0 }, 0.5, 0.0];
    let reduced = noisy(&region, &step, 0.02, &mut Draws(3));
    if let Some(smooth) = fitted(&region, &reduced) {
        let worst = (0..region.len())
            .filter(|&i| smooth.fitted[i])
            .map(|i| (smooth.value(i, 0) - step(region.places[i])[0]).abs() / smooth.covariance(i, 0, 0).sqrt());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 6.0, "{worst}");
    }
}

/// Where no tile is off by itself but a few together are more than noise, these are left out and the rest is fitted: three bumps of 4 x 4 pixels, some 3 standard
/// errors of a tile each. In every one of 40 draws most pixels are fitted, and what is fitted is so within its errors.
#[test]
fn a_region_is_not_given_up_for_its_worst_part() {
    let region = square(24, Chart::Plane);
    let bumps = |[u, v]: [f64; 2]| {
        let on = |at: f64, low: f64| (low..low + 0.34).contains(&at);
        let (first, second) = (on(u, -0.6) && on(v, -0.6), on(u, 0.2) && on(v, 0.4));
        let height = if first || second {
            0.12
        } else if on(u, 0.4) && on(v, -0.7) {
            -0.12
        } else {
            0.0
        };
        [1.0 + 0.2 * u + height, 0.5, 0.1]
    };
    let fitted = |seed: u64| fitted(&region, &noisy(&region, &bumps, 0.1, &mut Draws(seed * 7919 + 1)));
    for seed in 0..40 {
        let smooth = fitted(seed).unwrap_or_else(|| panic!("nothing is fitted in draw {seed}"));
        let count = smooth.fitted.iter().filter(|&&f| f).count();
        assert!(2 * count >= region.len(), "{count} pixels in draw {seed}");
    }
    let (mean, rms, _) = scores(&region, &bumps, 0.1, 40);
    assert!(mean.abs() < 0.33 && rms < 1.3, "mean {mean}, rms {rms}");
}

/// Too few pixels, or none that is noisy, have no fit.
#[test]
fn little_is_not_fitted() {
    let small = square(7, Chart::Plane);
    assert!(fitted(&small, &noisy(&small, &|_| [1.0; 3], 0.1, &mut Draws(1))).is_none());
    let dark = square(12, Chart::Plane);
    assert!(fitted(&dark, &noisy(&dark, &|_| [0.0; 3], 0.0, &mut Draws(1))).is_none());
}
