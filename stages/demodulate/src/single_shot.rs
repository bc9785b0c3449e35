//! One frame instead of three: the mean and the fringe of each line are parted by filters around 0 and around the carrier.
//!
//! Source: Vervandier, Gioux, Biomed. Opt. Express 4, 2938 (2013). The Gaussian filters work on the line itself (a kernel of
//! 0.64 periods), the rectangles on its Fourier transform. Lines are mirrored at their ends.

use std::f64::consts::PI;

use turbid_optics::elementary::sin_cos_turns;

use crate::fourier::{Complex, product, transform};

/// How mean and fringe are parted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Gaussians of sigma f_c / 4 around 0 and f_c.
    Gaussian,
    /// |f| < f_c / 2 and f_c / 2 .. 3 f_c / 2.
    Rectangle,
}

/// What a line says: M_DC, and the fringe with its carrier, M_AC e^{i (2 pi f_c k + phase)}.
pub struct Line {
    pub dc: Vec<f64>,
    pub fringe: Vec<Complex>,
}

/// Sum of squares of the filter's kernel: var M_DC = this times the variance of a pixel, var M_AC twice that.
pub fn noise_gain(filter: Filter, carrier: f64) -> f64 {
    match filter {
        Filter::Gaussian => kernel(carrier).iter().map(|h| h * h).sum(),
        Filter::Rectangle => carrier.abs(),
    }
}

/// Parts a line with `carrier` in (0, 1/2) cycles per pixel.
pub fn part(line: &[f64], carrier: f64, filter: Filter) -> Line {
    match filter {
        Filter::Gaussian => gaussian(line, carrier),
        Filter::Rectangle => rectangle(line, carrier),
    }
}

/// Index of a pixel beyond the ends of a line of `n`, which are mirrors.
fn mirrored(i: isize, n: usize) -> usize {
    let period = 2 * n as isize;
    let i = i.rem_euclid(period);
    if i < n as isize { i as usize } else { (period - 1 - i) as usize }
}

/// Gaussian of sigma = 1 / (2 pi f_c / 4) pixels, cut at 5 sigma, of sum 1.
fn kernel(carrier: f64) -> Vec<f64> {
    let sigma = 2.0 / (PI * carrier);
    let reach = libm::ceil(5.0 * sigma) as isize;
    let plain: Vec<f64> = (-reach..=reach).map(|j| libm::exp(-0.5 * (j as f64 / sigma) * (j as f64 / sigma))).collect();
    let sum: f64 = plain.iter().sum();
    plain.iter().map(|h| h / sum).collect()
}

fn gaussian(line: &[f64], carrier: f64) -> Line {
    let h = kernel(carrier);
    let (n, reach) = (line.len(), (h.len() / 2) as isize);
    let smooth = |of: &dyn Fn(usize) -> f64, k: usize| -> f64 {
        h.iter().enumerate().map(|(j, h)| h * of(mirrored(k as isize + j as isize - reach, n))).sum()
    };
    let dc: Vec<f64> = (0..n).map(|k| smooth(&|i| line[i], k)).collect();
    // e^-8 of the mean would pass the filter of the fringe: it is taken off first.
    let rest: Vec<f64> = line.iter().zip(&dc).map(|(i, dc)| i - dc).collect();
    let fringe = |k: usize| {
        let mut sum = [0.0; 2];
        for (j, h) in h.iter().enumerate() {
            let away = j as isize - reach;
            let (sin, cos) = sin_cos_turns(carrier * away as f64);
            let value = 2.0 * h * rest[mirrored(k as isize + away, n)];
            // The carrier's turn from k to there is taken back: what is left stands still.
            sum = [sum[0] + value * cos, sum[1] - value * sin];
        }
        sum
    };
    Line { dc, fringe: (0..n).map(fringe).collect() }
}

fn rectangle(line: &[f64], carrier: f64) -> Line {
    let n = line.len();
    // At least 4 periods of mirror image on each side.
    let pad = libm::ceil(4.0 / carrier) as usize;
    let length = (n + 2 * pad).next_power_of_two();
    let before = ((length - n) / 2) as isize;
    let mut spectrum: Vec<Complex> = (0..length as isize).map(|i| [line[mirrored(i - before, n)], 0.0]).collect();
    transform(&mut spectrum, false);
    let band = |keep: &dyn Fn(f64) -> f64| {
        let mut line = spectrum.clone();
        for (k, value) in line.iter_mut().enumerate() {
            let turns = k as f64 / length as f64;
            let f = if turns < 0.5 { turns } else { turns - 1.0 };
            *value = product(*value, [keep(f) / length as f64, 0.0]);
        }
        transform(&mut line, true);
        line[before as usize..before as usize + n].to_vec()
    };
    let dc = band(&|f| f64::from(u8::from(f.abs() < 0.5 * carrier)));
    let fringe = band(&|f| 2.0 * f64::from(u8::from(f >= 0.5 * carrier && f < 1.5 * carrier)));
    Line { dc: dc.iter().map(|z| z[0]).collect(), fringe }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn m_ac(z: Complex) -> f64 {
        (z[0] * z[0] + z[1] * z[1]).sqrt()
    }

    /// Even fringes come back away from the ends, M_AC << M_DC too: to 2e-5 by Gaussians (what they pass of the other's peak,
    /// e^-8 of M_AC into M_DC), and by rectangles to what the mirrors leave.
    #[test]
    fn even_fringes_come_back() {
        for (filter, tolerance) in [(Filter::Gaussian, 4e-4), (Filter::Rectangle, 2e-2)] {
            for carrier in [0.1, 0.0737] {
                for (dc, ac) in [(1.0, 0.5), (1.0, 1e-3)] {
                    let line: Vec<f64> =
                        (0..400).map(|k| dc + ac * libm::cos(2.0 * PI * carrier * f64::from(k) + 0.8)).collect();
                    let found = part(&line, carrier, filter);
                    for k in 100..300 {
                        assert!((found.dc[k] - dc).abs() < tolerance * ac, "{filter:?} dc {} at {k}", found.dc[k]);
                        let (sin, cos) = sin_cos_turns(carrier * k as f64);
                        let want = [libm::cos(0.8), libm::sin(0.8)];
                        let [re, im] = product(found.fringe[k], [cos, -sin]);
                        assert!(
                            (re / ac - want[0]).abs() < tolerance && (im / ac - want[1]).abs() < tolerance,
                            "{filter:?} {re} {im}"
                        );
                    }
                }
            }
        }
    }

    /// A step of 30 % in both: within 2 periods of it Gaussians are off by some 5 % in the mean, further in by less than 0.2 %.
    #[test]
    fn edges_blur_over_two_periods() {
        let carrier = 0.1;
        let truth = |k: i32| if k < 256 { (1.0, 0.5) } else { (1.3, 0.65) };
        let line: Vec<f64> =
            (0..512).map(|k| truth(k).0 + truth(k).1 * libm::cos(2.0 * PI * carrier * f64::from(k))).collect();
        let found = part(&line, carrier, Filter::Gaussian);
        let error = |k: i32| (m_ac(found.fringe[k as usize]) / truth(k).1 - 1.0).abs();
        let mean = |of: &dyn Fn(i32) -> bool| {
            let chosen: Vec<f64> = (40..472).filter(|&k| of(k)).map(error).collect();
            chosen.iter().sum::<f64>() / chosen.len() as f64
        };
        let (near, far) = (mean(&|k| (k - 256).abs() <= 20), mean(&|k| (k - 256).abs() > 40));
        assert!((0.01..0.08).contains(&near) && far < 0.002, "near {near}, far {far}");
    }

    /// White noise: the spread of 2000 lines is what `noise_gain` says, to 5 sigma of a sampled spread (4 %).
    #[test]
    fn noise_gains_are_the_spread() {
        use turbid_optics::philox::{key, philox4x32, unit};
        for filter in [Filter::Gaussian, Filter::Rectangle] {
            let carrier = 0.11;
            let (mut dc, mut re, n) = (0.0, 0.0, 2000);
            for seed in 0..n {
                let noise = |k: u32| 12.0_f64.sqrt() * (unit(philox4x32([k, 0, 0, 0], key(seed))[0]) - 0.5);
                let line: Vec<f64> = (0..128).map(noise).collect();
                let found = part(&line, carrier, filter);
                dc += found.dc[64] * found.dc[64] / n as f64;
                re += found.fringe[64][0] * found.fringe[64][0] / n as f64;
            }
            let gain = noise_gain(filter, carrier);
            // A sampled variance of n normal numbers has the relative error sqrt(2 / n); rectangles end between bins.
            let tolerance = 5.0 * (2.0 / n as f64).sqrt() + if filter == Filter::Rectangle { 0.1 } else { 0.0 };
            assert!((dc / gain - 1.0).abs() < tolerance, "{filter:?}: dc {dc}, gain {gain}");
            assert!((re / (2.0 * gain) - 1.0).abs() < tolerance, "{filter:?}: re {re}, gain {gain}");
        }
    }
}
