//! What a list of media says about one quantity: estimate against truth, with the errors that the estimate states.

use crate::score::{Score, p95};

/// One medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    pub estimate: f64,
    /// Standard error that the estimate states; `None` where it states none.
    pub se: Option<f64>,
    pub truth: f64,
    /// Whether there is an estimate.
    pub good: bool,
}

/// The figures of one quantity over one medium or several. What is not known is `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MediaScore {
    /// As for the pixels of a region; what is relative to the truth leaves media out whose truth is 0.
    pub score: Score,
    /// (estimate - truth) / standard error; of several media the root mean square over those with a standard error.
    pub z: Option<f64>,
    /// Root mean square of ln(estimate / truth) over media where both are > 0.
    pub rms_log: Option<f64>,
}

/// Scores media; their errors count as independent. `None` without any.
pub fn score(pairs: &[Pair]) -> Option<MediaScore> {
    if pairs.is_empty() {
        return None;
    }
    let good: Vec<&Pair> = pairs.iter().filter(|p| p.good).collect();
    let n = good.len();
    let mean = |f: &dyn Fn(&Pair) -> f64| mean_of(good.iter().map(|p| f(p)));
    let (estimate, truth) = (mean(&|p| p.estimate), mean(&|p| p.truth));
    let relative: Vec<f64> = good.iter().filter(|p| p.truth != 0.0).map(|p| p.estimate / p.truth - 1.0).collect();
    let both = |p: &&&Pair| p.estimate > 0.0 && p.truth > 0.0;
    let logs = good.iter().filter(both).map(|p| libm::log(p.estimate / p.truth));
    let scaled: Vec<f64> =
        good.iter().filter_map(|p| Some((p.estimate - p.truth) / p.se.filter(|se| *se > 0.0)?)).collect();
    let errors: Vec<f64> = good.iter().map(|p| (p.estimate - p.truth).abs()).collect();
    let squares: Option<f64> = good.iter().map(|p| p.se.map(|se| se * se)).sum();
    let score = Score {
        n: n as u64,
        n_unknown: good.iter().filter(|p| p.se.is_none()).count() as u64,
        n_left_out: (pairs.len() - n) as u64,
        mean: estimate,
        mean_se: squares.filter(|_| n > 0).map(|squares| squares.sqrt() / n as f64),
        truth,
        bias: estimate.zip(truth).map(|(estimate, truth)| estimate - truth),
        rmse: root_mean_square(errors.iter().copied()),
        p95: p95(errors),
        bias_percent: estimate.zip(truth.filter(|t| *t != 0.0)).map(|(e, t)| 100.0 * (e / t - 1.0)),
        rmse_percent: root_mean_square(relative.iter().copied()).map(|rms| 100.0 * rms),
        masked_percent: 100.0 * (pairs.len() - n) as f64 / pairs.len() as f64,
        ..Score::default()
    };
    let z = match scaled.as_slice() {
        [only] => Some(*only),
        many => root_mean_square(many.iter().copied()),
    };
    Some(MediaScore { score, z, rms_log: root_mean_square(logs) })
}

/// `None` without values.
fn mean_of(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0_u64), |(sum, n), x| (sum + x, n + 1));
    (n > 0).then(|| sum / n as f64)
}

/// `None` without values.
pub fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    mean_of(values.map(|x| x * x)).map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn pair(estimate: f64, se: f64, truth: f64, good: bool) -> Pair {
        Pair { estimate, se: Some(se), truth, good }
    }

    /// Worked out by hand: errors 0.5 and -1, z 2 and -1, ratios 1.5 and 0.75.
    #[test]
    fn two_media_and_one_without_a_fit() {
        let media = [pair(1.5, 0.25, 1.0, true), pair(3.0, 1.0, 4.0, true), pair(0.0, 0.0, 2.0, false)];
        let got = score(&media).unwrap();
        let s = got.score;
        let some = |a: f64, b: f64| (Some(a), Some(b));
        assert_eq!((s.n, (s.mean, s.truth), (s.bias, s.p95)), (2, some(2.25, 2.5), some(-0.25, 1.0)));
        let close = |found: Option<f64>, want: f64| assert!((found.unwrap() - want).abs() < 1e-12, "{found:?} {want}");
        close(s.mean_se, 1.0625_f64.sqrt() / 2.0);
        close(s.rmse, 0.625_f64.sqrt());
        close(s.bias_percent, -10.0);
        close(s.rmse_percent, 100.0 * (0.3125_f64 / 2.0).sqrt());
        close(Some(s.masked_percent), 100.0 / 3.0);
        close(got.z, 2.5_f64.sqrt());
        let (up, down) = (1.5_f64.ln(), 0.75_f64.ln());
        close(got.rms_log, ((up * up + down * down) / 2.0).sqrt());
        let one = score(&media[1..2]).unwrap();
        assert_eq!((one.z, one.score.mean_se, one.score.bias_percent), (Some(-1.0), Some(1.0), Some(-25.0)));
        let silent = Pair { se: None, ..media[0] };
        let both = score(&[silent, media[1]]).unwrap();
        assert_eq!((both.score.n_unknown, both.score.mean_se, both.z), (1, None, Some(-1.0)));
    }

    /// No medium, no fit, no standard error, a truth of 0: unknown, neither 0 nor NaN.
    #[test]
    fn nothing_to_be_relative_to() {
        assert_eq!(score(&[]), None);
        let without = score(&[pair(0.0, 0.0, 1.0, false)]).unwrap();
        let s = without.score;
        assert_eq!((s.n, s.masked_percent, without.z, without.rms_log), (0, 100.0, None, None));
        assert_eq!((s.mean, s.mean_se, s.bias, s.rmse, s.p95, s.rmse_percent), (None, None, None, None, None, None));
        let clear = score(&[Pair { se: None, ..pair(0.001, 0.0, 0.0, true) }]).unwrap();
        let s = clear.score;
        assert_eq!((s.bias, s.bias_percent, s.rmse_percent), (Some(0.001), None, None));
        assert_eq!((clear.z, clear.rms_log), (None, None));
        assert_eq!(score(&[pair(0.0, 0.1, 0.1, true)]).unwrap().rms_log, None, "a limit has no logarithm");
    }
}
