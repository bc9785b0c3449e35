//! What one region says about one quantity.

/// The figures of one region and quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Pixels that count: in the region and not masked.
    pub n: u64,
    /// Mean of the estimate over these pixels; 0 without any.
    pub mean: f64,
    /// Its standard error.
    pub mean_se: f64,
    /// Mean of the truth over the same pixels.
    pub truth: f64,
    /// mean - truth, and of the pixels: root mean square of estimate - truth, and what 95 % of its magnitudes do not exceed; in the
    /// quantity's unit.
    pub bias: f64,
    pub rmse: f64,
    pub p95: f64,
    /// 100 (mean / truth - 1); 0 for a position.
    pub bias_percent: f64,
    /// 100 sqrt(mean((estimate / truth - 1)^2)); 0 for a position.
    pub rmse_percent: f64,
    /// 100 (pixels of the region that are masked) / (pixels of the region).
    pub masked_percent: f64,
}

/// The pixels to score.
#[derive(Clone, Copy)]
pub struct Pixels<'a> {
    pub estimate: &'a [f32],
    /// Standard error of each pixel, where known.
    pub se: Option<&'a [f32]>,
    /// How many times the variance of a mean exceeds that of independent pixels.
    pub sharing: f64,
    pub truth: &'a [f32],
    /// A position has no natural 0: it is scored in its unit only, also where it is 0.
    pub position: bool,
    /// Whether a pixel's estimate counts.
    pub good: &'a [bool],
}

/// Scores the `selected` pixels. Those with a truth of 0 are left out (but for a position), for no error is relative to 0; `None` where no
/// pixel is left.
///
/// Where no standard errors are known, `mean_se` is that of the scatter of the pixels, which holds true structure too.
pub fn score(pixels: &Pixels<'_>, selected: &[bool]) -> Option<Score> {
    let chosen = || (0..selected.len()).filter(|&i| selected[i] && (pixels.position || pixels.truth[i] != 0.0));
    let all = chosen().count() as u64;
    let (mut n, mut sum, mut truth, mut variances, mut squares) = (0_u64, 0.0, 0.0, 0.0, 0.0);
    let mut errors: Vec<f64> = Vec::new();
    for i in chosen().filter(|&i| pixels.good[i]) {
        let (e, t) = (f64::from(pixels.estimate[i]), f64::from(pixels.truth[i]));
        n += 1;
        sum += e;
        truth += t;
        variances += pixels.se.map_or(0.0, |se| f64::from(se[i]) * f64::from(se[i]));
        if !pixels.position {
            squares += (e / t - 1.0) * (e / t - 1.0);
        }
        errors.push((e - t).abs());
    }
    if all == 0 {
        return None;
    }
    let masked_percent = 100.0 * (all - n) as f64 / all as f64;
    if n == 0 {
        // As in the images: what is masked holds 0, and the share of it says so.
        let zero = Score {
            n,
            mean: 0.0,
            mean_se: 0.0,
            truth,
            bias: 0.0,
            rmse: 0.0,
            p95: 0.0,
            bias_percent: 0.0,
            rmse_percent: 0.0,
            masked_percent,
        };
        return Some(zero);
    }
    let count = n as f64;
    let (mean, truth) = (sum / count, truth / count);
    if pixels.se.is_none() {
        let good = chosen().filter(|&i| pixels.good[i]);
        let scatter: f64 = good.map(|i| f64::from(pixels.estimate[i]) - mean).map(|d| d * d).sum();
        variances = scatter * count / (count - 1.0).max(1.0);
    }
    Some(Score {
        n,
        mean,
        // Errors common to all pixels have the sharing of their count; a region has no more.
        mean_se: (variances * pixels.sharing.min(count)).sqrt() / count,
        truth,
        bias: mean - truth,
        rmse: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        p95: p95(errors),
        bias_percent: if pixels.position { 0.0 } else { 100.0 * (mean / truth - 1.0) },
        rmse_percent: 100.0 * (squares / count).sqrt(),
        masked_percent,
    })
}

/// The smallest magnitude that at least 95 % do not exceed.
pub fn p95(mut errors: Vec<f64>) -> f64 {
    let rank = (errors.len() * 95).div_ceil(100) - 1;
    *errors.select_nth_unstable_by(rank, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figures of four pixels, worked out by hand.
    #[test]
    fn four_pixels() {
        let pixels = Pixels {
            estimate: &[1.5, 3.0, 0.0, 99.0],
            se: Some(&[0.25, 0.5, 0.0, 1.0]),
            sharing: 4.0,
            truth: &[1.0, 4.0, 2.0, 1.0],
            position: false,
            good: &[true, true, false, true],
        };
        let got = score(&pixels, &[true, true, true, false]).unwrap();
        assert_eq!((got.n, got.mean, got.truth), (2, 2.25, 2.5));
        assert!((got.mean_se - (2.0 * 0.3125_f64).sqrt() / 2.0).abs() < 1e-15, "two pixels share no more than two");
        let apart = score(&Pixels { sharing: 1.5, ..pixels }, &[true, true, true, false]).unwrap();
        assert!((apart.mean_se - (1.5 * 0.3125_f64).sqrt() / 2.0).abs() < 1e-15);
        assert!((got.bias_percent + 10.0).abs() < 1e-12);
        assert!((got.rmse_percent - 100.0 * ((0.25 + 0.0625) / 2.0_f64).sqrt()).abs() < 1e-12);
        assert!((got.masked_percent - 100.0 / 3.0).abs() < 1e-12);
        assert_eq!((got.bias, got.p95), (-0.25, 1.0));
        assert!((got.rmse - 0.625_f64.sqrt()).abs() < 1e-15);
        let spread = score(&Pixels { se: None, sharing: 1.0, ..pixels }, &[true, true, false, false]).unwrap();
        assert!((spread.mean_se - 0.75).abs() < 1e-15, "sd 1.06 / sqrt 2");
    }

    /// No pixel, no truth to be relative to, nothing but masked pixels: never a NaN.
    #[test]
    fn nothing_to_score() {
        let one = |truth: &'static [f32], good: &'static [bool]| Pixels {
            estimate: &[1.0],
            se: None,
            sharing: 1.0,
            truth,
            position: false,
            good,
        };
        assert_eq!(score(&one(&[1.0], &[true]), &[false]), None);
        assert_eq!(score(&one(&[0.0], &[true]), &[true]), None);
        let place = score(&Pixels { position: true, ..one(&[0.0], &[true]) }, &[true]).unwrap();
        assert_eq!((place.n, place.bias, place.rmse, place.p95, place.rmse_percent), (1, 1.0, 1.0, 1.0, 0.0));
        let masked = score(&one(&[1.0], &[false]), &[true]).unwrap();
        assert_eq!((masked.n, masked.mean, masked.masked_percent), (0, 0.0, 100.0));
        let single = score(&one(&[1.0], &[true]), &[true]).unwrap();
        assert_eq!((single.mean, single.mean_se, single.bias_percent), (1.0, 0.0, 0.0));
    }
}
