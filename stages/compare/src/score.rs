//! What one region says about one quantity.

use turbid_contract::sharing::Sharing;

/// The figures of one region and quantity. What is not known is `None`, never 0: no figure of no pixels, no percentage of a position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Pixels that count: in the region and not masked.
    pub n: u64,
    /// Those of them whose standard error is not known.
    pub n_unknown: u64,
    /// Pixels of the region that are masked for what was measured there, and not for geometry: leaving them out selects.
    pub n_left_out: u64,
    /// Mean of the estimate over the pixels that count.
    pub mean: Option<f64>,
    /// Its standard error.
    pub mean_se: Option<f64>,
    /// Mean of the truth over the same pixels.
    pub truth: Option<f64>,
    /// mean - truth, and of the pixels: root mean square of estimate - truth, and what 95 % of its magnitudes do not exceed; in the
    /// quantity's unit.
    pub bias: Option<f64>,
    pub rmse: Option<f64>,
    pub p95: Option<f64>,
    /// 100 (mean / truth - 1).
    pub bias_percent: Option<f64>,
    /// 100 sqrt(mean((estimate / truth - 1)^2)).
    pub rmse_percent: Option<f64>,
    /// 100 (pixels of the region that are masked) / (pixels of the region).
    pub masked_percent: f64,
    /// By how much the mean may have moved because `n_left_out` pixels are missing, in the quantity's unit and relative to the truth.
    pub possible_shift: Option<f64>,
    pub possible_shift_percent: Option<f64>,
}

/// Whether a pixel's estimate counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    Counts,
    /// Masked by geometry.
    Absent,
    /// Masked for what was measured there.
    LeftOut,
}

/// The pixels to score.
#[derive(Clone, Copy)]
pub struct Pixels<'a> {
    pub estimate: &'a [f32],
    /// Standard error of each pixel, where known.
    pub se: Option<&'a [f32]>,
    /// Not 0 where a pixel's `se` is a lower bound of an error that is not known.
    pub se_unknown: Option<&'a [f32]>,
    /// How the errors of pixels are common.
    pub sharing: &'a Sharing,
    pub truth: &'a [f32],
    /// A position has no natural 0: it is scored in its unit only, also where it is 0.
    pub position: bool,
    pub standing: &'a [Standing],
}

/// The largest share of pixels without a known error that the scatter of all of them may stand for.
const MOST_UNKNOWN: f64 = 0.5;

/// Scores the `selected` pixels. Those with a truth of 0 are left out (but for a position), for no error is relative to 0; `None` where no
/// pixel is left.
///
/// `mean_se` is that of the pixels' standard errors. Where some of these are unknown, what they are at least is not enough: then the
/// scatter of estimate - truth over all pixels that count takes its place if it is larger, and where more than half are unknown
/// there is none. Where no standard errors are known at all it is that of the scatter of the estimate, which holds true structure too.
///
/// `possible_shift` is sd sqrt(f / (1 - f)), with f the share of pixels left out and sd the deviation of estimate - truth: the mean of a part
/// 1 - f of any distribution is no further from that of the whole (Mallows and Richter, Ann. Math. Statist. 40, 1922, 1969).
pub fn score(pixels: &Pixels<'_>, selected: &[bool]) -> Option<Score> {
    let chosen = || (0..selected.len()).filter(|&i| selected[i] && (pixels.position || pixels.truth[i] != 0.0));
    let counting = || chosen().filter(|&i| pixels.standing[i] == Standing::Counts);
    let all = chosen().count() as u64;
    if all == 0 {
        return None;
    }
    let n = counting().count() as u64;
    let unknown = |i: &usize| pixels.se_unknown.is_some_and(|flags| flags[*i] != 0.0);
    let mut found = Score {
        n,
        n_unknown: if pixels.se.is_some() { counting().filter(unknown).count() as u64 } else { n },
        n_left_out: chosen().filter(|&i| pixels.standing[i] == Standing::LeftOut).count() as u64,
        masked_percent: 100.0 * (all - n) as f64 / all as f64,
        ..Score::default()
    };
    if n == 0 {
        return Some(found);
    }
    let count = n as f64;
    let (mut sum, mut of_truth, mut variances, mut squares) = (0.0, 0.0, 0.0, 0.0);
    let mut errors: Vec<f64> = Vec::with_capacity(n as usize);
    for i in counting() {
        let (e, t) = (f64::from(pixels.estimate[i]), f64::from(pixels.truth[i]));
        sum += e;
        of_truth += t;
        variances += pixels.se.map_or(0.0, |se| f64::from(se[i]) * f64::from(se[i]));
        if !pixels.position {
            squares += (e / t - 1.0) * (e / t - 1.0);
        }
        errors.push(e - t);
    }
    let (mean, truth) = (sum / count, of_truth / count);
    // By what the pixels say, and by a sum of variances that is spread evenly over them.
    let of_pixels = |se: &[f32]| {
        let variances = counting().map(|i| (i, f64::from(se[i]) * f64::from(se[i])));
        pixels.sharing.variance_of_sum(variances, count).sqrt() / count
    };
    let of_scatter =
        |sum: f64| pixels.sharing.variance_of_sum(counting().map(|i| (i, sum / count)), count).sqrt() / count;
    let scattered = scatter(errors.iter().copied());
    found.mean_se = match pixels.se {
        None => scatter(counting().map(|i| f64::from(pixels.estimate[i]))).map(of_scatter),
        Some(se) if found.n_unknown == 0 => Some(of_pixels(se)),
        Some(_) if found.n_unknown as f64 > MOST_UNKNOWN * count => None,
        Some(se) => scattered
            .map(|scattered| of_pixels(se).max(if scattered > variances { of_scatter(scattered) } else { 0.0 })),
    };
    // Of one pixel: whatever is the larger of what it says and what its neighbours scatter by.
    let deviation = match (pixels.se, scattered) {
        (None, None) => None,
        (_, scattered) => Some((variances.max(scattered.unwrap_or(0.0)) / count).sqrt()),
    };
    // Truths of both signs may have a mean of 0.
    let relative = |x: f64| (!pixels.position && truth != 0.0).then(|| 100.0 * x / truth);
    found.mean = Some(mean);
    found.truth = Some(truth);
    found.bias = Some(mean - truth);
    found.bias_percent = relative(mean - truth);
    found.rmse = Some((errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt());
    found.rmse_percent = (!pixels.position).then(|| 100.0 * (squares / count).sqrt());
    found.possible_shift = deviation.map(|sd| sd * (found.n_left_out as f64 / count).sqrt());
    found.possible_shift_percent = found.possible_shift.and_then(relative).map(f64::abs);
    found.p95 = p95(errors.iter().map(|e| e.abs()).collect());
    Some(found)
}

/// Sum of the squares of the distances from the mean, times n / (n - 1): n times the variance. `None` below two values.
fn scatter(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let (sum, n) = values.clone().fold((0.0, 0_u64), |(sum, n), x| (sum + x, n + 1));
    let mean = sum / n as f64;
    (n > 1).then(|| values.map(|x| (x - mean) * (x - mean)).sum::<f64>() * n as f64 / (n - 1) as f64)
}

/// The smallest magnitude that at least 95 % do not exceed; `None` without any.
pub fn p95(mut errors: Vec<f64>) -> Option<f64> {
    let rank = (errors.len() * 95).div_ceil(100).checked_sub(1)?;
    Some(*errors.select_nth_unstable_by(rank, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::Standing::{Absent, Counts, LeftOut};
    use super::*;

    static NONE: Sharing = Sharing::NONE;

    /// The figures of four pixels, worked out by hand.
    #[test]
    fn four_pixels() {
        let pixels = Pixels {
            estimate: &[1.5, 3.0, 0.0, 99.0],
            se: Some(&[0.25, 0.5, 0.0, 1.0]),
            se_unknown: None,
            sharing: &Sharing::even(4.0),
            truth: &[1.0, 4.0, 2.0, 1.0],
            position: false,
            standing: &[Counts, Counts, LeftOut, Counts],
        };
        let got = score(&pixels, &[true, true, true, false]).unwrap();
        assert_eq!((got.n, got.mean, got.truth), (2, Some(2.25), Some(2.5)));
        let close = |found: Option<f64>, want: f64| assert!((found.unwrap() - want).abs() < 1e-12, "{found:?} {want}");
        // Two pixels share no more than two.
        close(got.mean_se, (2.0 * 0.3125_f64).sqrt() / 2.0);
        let apart = score(&Pixels { sharing: &Sharing::even(1.5), ..pixels }, &[true, true, true, false]).unwrap();
        close(apart.mean_se, (1.5 * 0.3125_f64).sqrt() / 2.0);
        close(got.bias_percent, -10.0);
        close(got.rmse_percent, 100.0 * ((0.25 + 0.0625) / 2.0_f64).sqrt());
        assert!((got.masked_percent - 100.0 / 3.0).abs() < 1e-12);
        assert_eq!((got.bias, got.p95), (Some(-0.25), Some(1.0)));
        close(got.rmse, 0.625_f64.sqrt());
        let spread = score(&Pixels { se: None, sharing: &NONE, ..pixels }, &[true, true, false, false]).unwrap();
        close(spread.mean_se, 0.75);
        assert_eq!(spread.n_unknown, 2, "no standard errors at all");
        // One of three is left out: sqrt(1/2) of the deviation of the errors 0.5 and -1, which is above the standard errors.
        assert_eq!((got.n_left_out, got.n_unknown), (1, 0));
        close(got.possible_shift, 0.5_f64.sqrt() * 1.125_f64.sqrt());
        close(got.possible_shift_percent, 40.0 * 0.5_f64.sqrt() * 1.125_f64.sqrt());
        let absent = Pixels { standing: &[Counts, Counts, Absent, Counts], ..pixels };
        let absent = score(&absent, &[true, true, true, false]).unwrap();
        assert_eq!((absent.n_left_out, absent.possible_shift), (0, Some(0.0)), "geometry does not select");
    }

    /// Where some standard errors are unknown the scatter of the errors stands in if it is larger; of more than half, nothing does.
    #[test]
    fn unknown_errors_do_not_pass_for_small_ones() {
        let (truth, standing) = ([1.0_f32; 4], [Counts; 4]);
        let pixels = Pixels {
            estimate: &[1.5, 0.5, 1.25, 0.75],
            se: Some(&[0.1; 4]),
            se_unknown: Some(&[0.0, 1.0, 0.0, 0.0]),
            sharing: &NONE,
            truth: &truth,
            position: false,
            standing: &standing,
        };
        let of = |flags: &[f32]| score(&Pixels { se_unknown: Some(flags), ..pixels }, &[true; 4]).unwrap();
        let one = of(&[0.0, 1.0, 0.0, 0.0]);
        // Sum of squares 0.625, n / (n - 1) = 4/3.
        assert_eq!(one.n_unknown, 1);
        assert!((one.mean_se.unwrap() - (0.625_f64 * 4.0 / 3.0).sqrt() / 4.0).abs() < 1e-12, "{one:?}");
        assert_eq!(of(&[0.0; 4]).mean_se, Some((4.0 * f64::from(0.1_f32) * f64::from(0.1_f32)).sqrt() / 4.0));
        assert_eq!((of(&[1.0, 1.0, 1.0, 0.0]).mean_se, of(&[1.0; 4]).mean), (None, Some(1.0)));
        let large = score(&Pixels { se: Some(&[9.0; 4]), ..pixels }, &[true; 4]).unwrap();
        assert!((large.mean_se.unwrap() - 4.5).abs() < 1e-12, "never below what is stated");
    }

    /// No pixel, no truth to be relative to, nothing but masked pixels: unknown, neither 0 nor NaN.
    #[test]
    fn nothing_to_score() {
        let one = |truth: &'static [f32], standing: &'static [Standing]| Pixels {
            estimate: &[1.0],
            se: None,
            se_unknown: None,
            sharing: &NONE,
            truth,
            position: false,
            standing,
        };
        assert_eq!(score(&one(&[1.0], &[Counts]), &[false]), None);
        assert_eq!(score(&one(&[0.0], &[Counts]), &[true]), None);
        let place = score(&Pixels { position: true, ..one(&[0.0], &[Counts]) }, &[true]).unwrap();
        assert_eq!((place.n, place.bias, place.rmse, place.p95), (1, Some(1.0), Some(1.0), Some(1.0)));
        assert_eq!((place.bias_percent, place.rmse_percent, place.possible_shift_percent), (None, None, None));
        let masked = score(&one(&[1.0], &[LeftOut]), &[true]).unwrap();
        assert_eq!((masked.n, masked.n_left_out, masked.masked_percent), (0, 1, 100.0));
        assert_eq!((masked.mean, masked.mean_se, masked.rmse, masked.possible_shift), (None, None, None, None));
        let signed = Pixels { estimate: &[1.0, 1.0], standing: &[Counts; 2], ..one(&[1.0, -1.0], &[]) };
        let signed = score(&signed, &[true; 2]).unwrap();
        assert_eq!((signed.bias, signed.bias_percent, signed.rmse_percent.is_some()), (Some(1.0), None, true));
        let single = score(&one(&[1.0], &[Counts]), &[true]).unwrap();
        assert_eq!((single.mean, single.mean_se, single.bias_percent), (Some(1.0), None, Some(0.0)));
        assert_eq!(p95(Vec::new()), None);
    }
}
