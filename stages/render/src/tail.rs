//! What the paths of an image know of the rare bright ones among them. Where those make the variance, most pixels have seen none.
//!
//! `docs/theory/render.md`, "Errors".

use turbid_optics::PhaseFunction;

use crate::bsdf::Bsdf;
use crate::moments::{Brightness, Moments};
use crate::rig::Rig;
use crate::strata::Bending;
use crate::weight_window::most_peaked;
use crate::world::{Material, World};

/// The fourth central moment of a path's brightness over the square of its variance, where nothing speaks for more: 13 to 26 in half-spaces
/// and domes at g = 0.8.
const USUAL: f64 = 20.0;
/// The same under a lobe of g is this over (1 - g)^2. Measured at mu_a = 0.02, mu_s' = 1 mm^-1: 59, 251, 1620 and 34,000 at g = 0.9,
/// 0.95, 0.98 and 0.995, which are 0.59, 0.63, 0.65 and 0.84. (A connection along the lobe sees 1 / (1 - g)^2 of the mean, one in as many
/// is along it.)
const OF_LOBE: f64 = 0.6;
/// The most under a lobe with weight windows (`weight_window.rs`). Measured: 12, 25, 83, 74 and 87 at g = 0.9, 0.95, 0.98, 0.99 and 0.995.
const IN_WINDOWS: f64 = 100.0;
/// The same of light that comes out through facets of roughness alpha is this over (alpha (n - 1))^2, the solid angle into which they refract. Measured with
/// mu_s' = 1 mm^-1: 2.5 at n = 1.4, mu_a = 0.02; 3 to 5 at n = 1.1 and 1.4, mu_a = 0.1. (9 at n = 2, and 17 at mu_a = 0.5: there the sample has to show it.)
const OF_FACETS: f64 = 5.0;
/// As many paths of the expected kurtosis stand beside those of the image: fewer know nothing of theirs.
const EXPECTED_PATHS: f64 = 1024.0;
/// A sample holds the tail if its variance is made of so many paths as bright as the brightest or more: their number is then known to 35 %, and the
/// standard error to 18 %.
const HELD: f64 = 8.0;

/// The kurtosis of a path that is expected of the scene.
pub fn expected_kurtosis(rig: &Rig) -> f64 {
    // Light from all sides is found by paths, whatever the lobe.
    if !rig.shines() {
        return USUAL;
    }
    let of_facets = |m: &Material| match m.bsdf {
        Bsdf::Rough(alpha) if m.n != 1.0 => kurtosis_of_facets(alpha, m.n),
        _ => USUAL,
    };
    let of = |world: &World| {
        let windows = most_peaked(world, &Bending::of(world)).is_some();
        let scatterers = world.materials.iter().filter(|m| m.mu_s > 0.0);
        let lobes = scatterers.map(|m| kurtosis_under(&m.phase, windows));
        lobes.chain(world.materials.iter().map(of_facets)).fold(USUAL, f64::max)
    };
    rig.worlds.iter().map(of).fold(USUAL, f64::max)
}

/// The same of a medium, where paths have weight windows towards the light or have none: the largest of its lobes.
pub fn kurtosis_under(phase: &PhaseFunction, windows: bool) -> f64 {
    let of = |(_, g): (f64, f64)| {
        let alone = kurtosis_of_lobe(g);
        if windows && g > 0.0 { alone.min(IN_WINDOWS) } else { alone }
    };
    phase.terms().into_iter().map(of).fold(USUAL, f64::max)
}

/// The same of a medium; a lobe that turns light back is as narrow.
pub fn kurtosis_of_lobe(g: f64) -> f64 {
    let width = 1.0 - g.abs();
    (OF_LOBE / (width * width)).max(USUAL)
}

/// The same of light that comes out of a medium of index `n` through facets of roughness `alpha`.
pub fn kurtosis_of_facets(alpha: f64, n: f64) -> f64 {
    let width = alpha * (n - 1.0);
    (OF_FACETS / (width * width)).max(USUAL)
}

/// Whether light is seen by so few paths that lobes have to be thought of.
pub fn is_peaked(kurtosis: f64) -> bool {
    kurtosis > USUAL
}

/// Paths that hold the tail of a sample of this kurtosis.
pub fn paths_to_hold(kurtosis: f64) -> f64 {
    HELD * kurtosis
}

/// Whether these paths, whose sum has the `variance` and the fourth moments that add up to `fourth`, hold the tail; `expected`: the kurtosis
/// that the scene says, below which no sample is taken at its word: one that has missed the tail does not show it.
pub fn is_held(paths: f64, variance: f64, fourth: f64, expected: f64) -> bool {
    let expected = if is_peaked(expected) { expected } else { 0.0 };
    variance * variance >= HELD * fourth && paths >= HELD * expected
}

/// The mean, variance and fourth central moment of a path in every pixel.
pub fn brightness(moments: &Moments, paths: &[u32]) -> Vec<Brightness> {
    of_pixels(moments, paths).collect()
}

/// The same, one after the other: 32 bytes for each pixel are more than its images take.
pub fn of_pixels(moments: &Moments, paths: &[u32]) -> impl Iterator<Item = Brightness> {
    paths.iter().enumerate().map(|(pixel, &n)| moments.brightness(pixel, n))
}

/// Kurtosis of a path, the same in all pixels; `expected` of the scene.
///
/// The fourth moments over products of the variances of neighbours: a variance's own square is too large where few paths know it.
pub fn kurtosis(pixels: impl IntoIterator<Item = Brightness>, expected: f64) -> f64 {
    let (mut paths, mut fourth, mut square, mut count) = (0.0, 0.0, 0.0, 0_u64);
    let mut last: Option<Brightness> = None;
    for pixel in pixels {
        if let Some(last) = last.filter(|last| last.variance > 0.0 && pixel.variance > 0.0) {
            fourth += 0.5 * (last.fourth + pixel.fourth);
            square += last.variance * pixel.variance;
        }
        (paths, count, last) = (paths + pixel.paths, count + 1, Some(pixel));
    }
    if let (Some(only), 1, true) = (last, count, square == 0.0) {
        (fourth, square) = (only.fourth, only.variance * only.variance);
    }
    let sampled = if square > 0.0 { fourth / square } else { expected };
    (paths * sampled + EXPECTED_PATHS * expected) / (paths + EXPECTED_PATHS)
}

/// Whether the pixels of an image, each by `paths` paths on average, know too little of their own variances: 2 paths / (kurtosis - 1)
/// degrees of freedom, fewer than 4.
pub fn is_heavy(kurtosis: f64, paths: f64) -> bool {
    kurtosis - 1.0 > 0.5 * paths.max(f64::from(crate::field::LEAST_PATHS))
}

/// Whether all paths of an image together hold the tail.
pub fn image_holds(pixels: &[Brightness], expected: f64) -> bool {
    let (mut paths, mut variance, mut fourth) = (0.0, 0.0, 0.0);
    for pixel in pixels {
        paths += pixel.paths;
        variance += pixel.paths * pixel.variance;
        fourth += pixel.paths * pixel.fourth;
    }
    is_held(paths, variance, fourth, expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Paths that see light with probability p have the kurtosis 1 / p - 3 + ..: (1 - 3 p q) / (p q). Sampled in 400 pixels of 64 it is
    /// found within 4 standard errors (some 2 / sqrt(lit paths)), and is what a sample of few paths is told.
    #[test]
    fn rare_light_has_the_kurtosis_of_a_coin() {
        let (p, n, pixels) = (0.02_f64, 64_u32, 400);
        let mut moments = Moments::new(pixels, 1);
        let (mut state, mut lit) = (7_u64, 0.0);
        for pixel in 0..pixels {
            for _ in 0..n {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let shines = ((state >> 33) as f64) < p * f64::from(1_u32 << 31);
                lit += f64::from(u8::from(shines));
                moments.add(pixel, &[if shines { 3.0 } else { 0.0 }]);
            }
        }
        let q = 1.0 - p;
        let expected = (1.0 - 3.0 * p * q) / (p * q);
        let found = kurtosis(brightness(&moments, &vec![n; pixels]), expected);
        assert!((found / expected - 1.0).abs() < 4.0 * 2.0 / f64::sqrt(lit), "{found} {expected} of {lit}");
        assert!((kurtosis(brightness(&moments, &[2]), 1e4) / 1e4 - 1.0).abs() < 3e-3);
    }

    /// A lobe of g = 0.8 is nothing special; 1024 paths of 25 pixels hold the tail at g = 0.98 and not at 0.995, those of 256 pixels do.
    #[test]
    fn narrow_lobes_take_many_paths() {
        assert!(!is_peaked(kurtosis_of_lobe(0.8)) && is_peaked(kurtosis_of_lobe(0.9)));
        let held = |g: f64, pixels: f64| pixels * 1024.0 >= paths_to_hold(kurtosis_of_lobe(g));
        assert!(held(0.98, 25.0) && !held(0.995, 25.0) && held(0.995, 256.0) && !held(0.999, 256.0));
    }
}
