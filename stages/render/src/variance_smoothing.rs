//! Errors of pixels by their own paths where few of those see what is bright: variances are pooled over the pixels around.
//!
//! `docs/theory/render.md`, "Errors".

use crate::field::{Field, Sampled, Watched};
use crate::moments::{Brightness, Moments};
use crate::neighbours::{around, within};
use crate::rig::Rig;
use crate::tail::{brightness, expected_kurtosis, image_holds, is_heavy, is_held, is_peaked, kurtosis, of_pixels};
use crate::truth::first_hit;
use crate::world::Chords;

/// Half the sides of the windows over which variances are pooled, in turn, until one holds the tail; then all that looks at the same body.
const REACHES: [usize; 2] = [2, 6];
/// A window is large enough if its variance is made of so many times the paths that hold the tail at all.
const AMPLE: f64 = 4.0;

/// Images of all channels by these paths; pooled where the scene has hollow bodies, whose light comes by way of their other interfaces, and where a lobe is so
/// narrow that few paths see what is bright.
pub fn by_paths<'a>(
    rig: &Rig,
    watched: &Watched,
    channels: &'a [Moments],
    paths: &'a [u32],
) -> Vec<Box<dyn Field + 'a>> {
    let (world, columns) = (&rig.worlds[0], rig.camera.columns);
    let expected = expected_kurtosis(rig);
    let mut chords = Chords::default();
    let mut seen: Option<Vec<Option<usize>>> = None;
    let mut body = || -> Vec<Option<usize>> {
        let hit = |pixel: usize| first_hit(world, &rig.camera, pixel, &mut chords).map(|hit| hit.body);
        seen.get_or_insert_with(|| (0..paths.len()).map(hit).collect()).clone()
    };
    let mean_paths = paths.iter().map(|&n| f64::from(n)).sum::<f64>() / paths.len() as f64;
    let of = |moments: &'a Moments| -> Box<dyn Field + 'a> {
        let sampled = |spread| Sampled { moments, paths, spread };
        let kurtosis = kurtosis(of_pixels(moments, paths), expected);
        // Rare paths between interfaces are bright in few pixels: only what a lobe does is alike in all that look at a body.
        if is_peaked(expected) && is_heavy(kurtosis.max(expected), mean_paths) {
            let scatters = |body: usize| world.materials[world.bodies[body].material].mu_s > 0.0;
            let views: Vec<PixelView> =
                body().into_iter().map(|b| PixelView { body: b, scatters: b.is_some_and(scatters) }).collect();
            let pixels = brightness(moments, paths);
            Box::new(Smoothed::by_windows(sampled(kurtosis - 1.0), &pixels, &views, columns, expected))
        } else if world.is_hollow() {
            Box::new(Smoothed::around(sampled(kurtosis - 1.0), watched, &body(), columns))
        } else {
            Box::new(sampled(kurtosis - 1.0))
        }
    };
    channels.iter().map(of).collect()
}

/// At which body a pixel views, and whether that scatters light within.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelView {
    pub body: Option<usize>,
    pub scatters: bool,
}

/// A field whose covariances are scaled, pixel by pixel, so that the variance of M_DC is that of the pixels around that look at the
/// same body.
pub struct Smoothed<'a> {
    sampled: Sampled<'a>,
    /// Pooled over own variance.
    scale: Vec<f64>,
    /// Pixels for which no window holds the tail.
    unknown: Vec<bool>,
    /// Whether the image does not hold it.
    mean_unknown: bool,
    /// By which the error of the mean is inflated, as [`Sampled::spread`].
    spread: f64,
}

impl<'a> Smoothed<'a> {
    /// The mean of the variances of the 5 x 5 pixels around. `seen`: at which body each pixel views; pixels without noise have no say and keep it.
    pub fn around(sampled: Sampled<'a>, watched: &Watched, seen: &[Option<usize>], columns: usize) -> Self {
        let (spread, sampled) = sampled.apart();
        // Of one path: some pixels may have more of them.
        let of_path = |pixel: usize| f64::from(sampled.paths[pixel]) * sampled.variance(pixel, &watched.dc);
        let own: Vec<f64> = (0..seen.len()).map(of_path).collect();
        let scale = |pixel: usize| {
            if own[pixel] == 0.0 {
                return 1.0;
            }
            let alike = around(pixel, columns, seen.len()).filter(|&p| seen[p] == seen[pixel] && own[p] > 0.0);
            let (sum, count) = alike.fold((0.0, 0), |(sum, count), p| (sum + own[p], count + 1));
            sum / f64::from(count) / own[pixel]
        };
        let scale = (0..seen.len()).map(scale).collect();
        Self { scale, sampled, unknown: vec![false; seen.len()], mean_unknown: false, spread }
    }

    /// That of a window that grows until its paths hold the tail. In wide windows brightness varies: there it is the variance over the square of the
    /// brightness that is pooled, and the brightness is that of the next smaller window. `expected`: the kurtosis that the scene says.
    pub fn by_windows(
        sampled: Sampled<'a>,
        pixels: &[Brightness],
        views: &[PixelView],
        columns: usize,
        expected: f64,
    ) -> Self {
        let ((spread, sampled), count) = (sampled.apart(), pixels.len());
        let window = |reach: usize, pixel: usize| -> Sum {
            let alike = within(reach, pixel, columns, count).filter(|&p| views[p] == views[pixel]);
            alike.map(|p| Sum::of(&pixels[p])).fold(Sum::default(), Sum::and)
        };
        let mut whole: Vec<(PixelView, Sum)> = Vec::new();
        for (view, pixel) in views.iter().zip(pixels) {
            match whole.iter_mut().find(|(of, _)| of == view) {
                Some((_, sum)) => *sum = sum.and(Sum::of(pixel)),
                None => whole.push((*view, Sum::of(pixel))),
            }
        }
        let all = |pixel: usize| whole.iter().find(|(of, _)| *of == views[pixel]).expect("it is one of them").1;
        let of = |pixel: usize| -> (f64, bool) {
            let expected = if views[pixel].scatters { expected } else { 0.0 };
            let smallest = window(REACHES[0], pixel);
            let (mut sum, mut bright) = (smallest, smallest);
            let mut variance = sum.variance / sum.paths;
            for wider in [&|| window(REACHES[1], pixel), &|| all(pixel) as Sum] as [&dyn Fn() -> Sum; 2] {
                if sum.is_held(expected, AMPLE) {
                    break;
                }
                let wide = wider();
                // Paths that know no brightness: as if it were even.
                variance = match wide.square > 0.0 {
                    true => wide.variance / wide.square * (bright.mean / bright.paths).powi(2),
                    false => wide.variance / wide.paths,
                };
                (bright, sum) = (wide, wide);
            }
            let own = pixels[pixel].variance;
            // A pixel without noise where others have some has not seen what makes it.
            let blind = own == 0.0 && sum.variance > 0.0;
            let scale = if own > 0.0 { variance / own } else { 1.0 };
            (scale, sum.variance > 0.0 && (blind || !sum.is_held(expected, 1.0)))
        };
        let (scale, unknown) = (0..count).map(of).unzip();
        Self { sampled, scale, unknown, mean_unknown: !image_holds(pixels, expected), spread }
    }
}

/// Of the paths of several pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    paths: f64,
    mean: f64,
    /// Of the brightness.
    square: f64,
    variance: f64,
    fourth: f64,
}

impl Sum {
    fn of(pixel: &Brightness) -> Self {
        let n = pixel.paths;
        // Noise adds its variance to the square of a mean.
        let square = pixel.mean * pixel.mean - pixel.variance / n;
        Self {
            paths: n,
            mean: n * pixel.mean,
            square: n * square,
            variance: n * pixel.variance,
            fourth: n * pixel.fourth,
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            paths: self.paths + other.paths,
            mean: self.mean + other.mean,
            square: self.square + other.square,
            variance: self.variance + other.variance,
            fourth: self.fourth + other.fourth,
        }
    }

    /// Whether they hold the tail `times` over.
    fn is_held(&self, expected: f64, times: f64) -> bool {
        is_held(self.paths / times, self.variance, times * self.fourth, expected)
    }
}

impl Field for Smoothed<'_> {
    fn pixels(&self) -> usize {
        self.sampled.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.sampled.mean(pixel, i)
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        self.scale[pixel] * self.sampled.covariance(pixel, a, b)
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        self.sampled.with_spread(self.spread).variance_of_mean(terms, total)
    }

    fn se_unknown(&self, pixel: usize) -> bool {
        self.unknown[pixel]
    }

    fn mean_se_unknown(&self) -> bool {
        self.mean_unknown
    }
}
