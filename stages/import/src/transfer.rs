//! Photon transfer: the gain and the read noise of a camera from frames of a scene that does not change.
//!
//! Source: Janesick, "Photon Transfer" (SPIE Press, 2007), chapters 5 and 6; EMVA Standard 1288, section 6. The variance of a number over frames is
//! sigma_r^2 + 1/12 + level / K, with the level above black, K electrons per number, sigma_r the read noise in numbers and 1/12 of rounding.

/// Levels into which the pixels of a burst are sorted.
const LEVELS: usize = 24;
/// Pixels of a level that tell nothing: their variance is known to more than 14 %.
const FEWEST: usize = 100;
/// Variance of rounding, in squares of a number.
pub const ROUNDING: f64 = 1.0 / 12.0;

/// One level of a burst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Of which burst; of the dark ones none.
    pub burst: Option<usize>,
    /// Numbers above black.
    pub level: f64,
    /// Squares of a number.
    pub variance: f64,
    pub pixels: usize,
    /// What the variance is a mean of, less what was spent on means.
    pub degrees: f64,
}

/// Frames of one scene under one light, in the numbers of the file, `NaN` where a pixel is not to be used.
pub struct Burst {
    pub frames: Vec<Vec<f64>>,
}

impl Burst {
    /// Of all pixels that can be used; `None` without any.
    pub fn mean(&self) -> Option<f64> {
        let good = || self.frames.iter().flatten().filter(|v| v.is_finite());
        let n = good().count();
        (n > 0).then(|| good().sum::<f64>() / n as f64)
    }

    /// Means and variances of pixels of like level. Lamps flicker: each frame is first brought to the mean of all, above `black`.
    pub fn points(&self, burst: Option<usize>, black: f64) -> Vec<Point> {
        let n = self.frames.len();
        let pixels = self.frames.first().map_or(0, Vec::len);
        let good: Vec<usize> = (0..pixels).filter(|&i| self.frames.iter().all(|f| f[i].is_finite())).collect();
        if n < 2 || good.is_empty() {
            return Vec::new();
        }
        let mean = |frame: &[f64]| good.iter().map(|&i| frame[i] - black).sum::<f64>() / good.len() as f64;
        let means: Vec<f64> = self.frames.iter().map(|frame| mean(frame)).collect();
        let all = means.iter().sum::<f64>() / n as f64;
        // Without light there is nothing that flickers: an offset that moves is taken off.
        let steady = |f: usize, i: usize| {
            let above = self.frames[f][i] - black;
            if burst.is_some() && means[f] > 0.0 { above * all / means[f] } else { above - means[f] + all }
        };
        let levels: Vec<f64> = good.iter().map(|&i| (0..n).map(|f| steady(f, i)).sum::<f64>() / n as f64).collect();
        let (low, high) = levels.iter().fold((f64::MAX, f64::MIN), |(low, high), &v| (low.min(v), high.max(v)));
        let bins = if burst.is_some() { (good.len() / FEWEST).clamp(1, LEVELS) } else { 1 };
        let mut sums = vec![(0_usize, 0.0, 0.0); bins];
        for (&i, level) in good.iter().zip(&levels) {
            let bin = if high > low { ((level - low) / (high - low) * bins as f64) as usize } else { 0 };
            let squares: f64 = (0..n).map(|f| (steady(f, i) - level).powi(2)).sum();
            let sum = &mut sums[bin.min(bins - 1)];
            *sum = (sum.0 + 1, sum.1 + level, sum.2 + squares / (n as f64 - 1.0));
        }
        let fewest = FEWEST.min(good.len());
        let point = |&(pixels, level, variance): &(usize, f64, f64)| Point {
            burst,
            level: level / pixels as f64,
            variance: variance / pixels as f64,
            pixels,
            degrees: pixels as f64 * (n as f64 - 1.0),
        };
        sums.iter().filter(|sum| sum.0 >= fewest).map(point).collect()
    }
}

/// The straight line through the points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Variance by level: numbers per electron.
    pub slope: f64,
    /// Variance without light, rounding included.
    pub dark: f64,
    pub slope_se: f64,
    pub dark_se: f64,
    /// Mean square of (variance - line) / standard error; 1 where a straight line is all there is to it.
    pub chi2: f64,
}

impl Line {
    pub fn at(&self, level: f64) -> f64 {
        self.dark + self.slope * level
    }

    /// Least squares, each point with its standard error sqrt(2 / degrees) times the line itself: as measured variances would favour what came out low.
    /// None: fewer than two levels, or a line that does not rise by three of its standard errors.
    pub fn through(points: &[Point]) -> Option<Self> {
        let mut line: Option<Self> = None;
        for _ in 0..20 {
            let se = |p: &Point| {
                let expected = line.map_or(p.variance, |line| line.at(p.level)).max(ROUNDING);
                expected * (2.0 / p.degrees).sqrt()
            };
            let mut sums = [0.0; 5];
            for p in points {
                let w = se(p).powi(-2);
                let terms = [w, w * p.level, w * p.level * p.level, w * p.variance, w * p.level * p.variance];
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
            let [w, x, xx, y, xy] = sums;
            let determinant = w * xx - x * x;
            if points.len() < 2 || determinant <= 1e-12 * w * xx {
                return None;
            }
            let (slope, dark) = ((w * xy - x * y) / determinant, (xx * y - x * xy) / determinant);
            let freedom = (points.len() as f64 - 2.0).max(1.0);
            let found =
                Self { slope, dark, slope_se: (w / determinant).sqrt(), dark_se: (xx / determinant).sqrt(), chi2: 0.0 };
            let chi2 = points.iter().map(|p| ((p.variance - found.at(p.level)) / se(p)).powi(2)).sum::<f64>() / freedom;
            line = Some(Self { chi2, ..found });
        }
        line.filter(|line| line.slope > 3.0 * line.slope_se)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(level: f64, variance: f64) -> Point {
        Point { burst: Some(0), level, variance, pixels: 1000, degrees: 1000.0 }
    }

    #[test]
    fn points_on_a_line_are_the_line() {
        let points: Vec<Point> = (0..10).map(|k| f64::from(k) * 100.0).map(|x| point(x, 3.0 + 0.25 * x)).collect();
        let line = Line::through(&points).unwrap();
        assert!((line.slope - 0.25).abs() < 1e-12 && (line.dark - 3.0).abs() < 1e-9 && line.chi2 < 1e-12, "{line:?}");
        assert_eq!(Line::through(&points[..1]), None);
        assert_eq!(Line::through(&[point(5.0, 1.0), point(5.0, 2.0)]), None);
        let falling: Vec<Point> = (0..10).map(|k| f64::from(k) * 100.0).map(|x| point(x, 300.0 - 0.1 * x)).collect();
        assert_eq!(Line::through(&falling), None);
    }

    #[test]
    fn flicker_is_no_noise() {
        let scene: Vec<f64> = (0..3000).map(|i| 100.0 + f64::from(i)).collect();
        let frames = [1.0, 1.05, 0.97].map(|light| scene.iter().map(|v| 20.0 + v * light).collect()).to_vec();
        let points = Burst { frames }.points(Some(0), 20.0);
        assert!(!points.is_empty() && points.iter().all(|p| p.variance < 1e-18), "{points:?}");
    }
}
