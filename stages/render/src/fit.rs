//! The image of a laterally uniform scene as a smooth surface fitted to pixels that hold few paths each.
//!
//! The responses of a pixel, divided by the light that falls on its centre and freed from the carrier's phase there, vary over
//! the image as slowly as the angles of view and light do: low polynomials in pixel position, fitted by least squares.

use crate::field::Field;
use crate::fringes::Fringes;
use crate::guide::Guide;
use crate::light::{Carrier, Emission, Light};
use crate::moments::Moments;
use crate::polynomials::Polynomials;
use crate::reduced::Reduced;
use crate::rig::Rig;
use crate::tail::{brightness, expected_kurtosis, image_holds, is_peaked};
use crate::world::Chords;

/// So many times the paths of a pixel are spent on each traced pixel of a control variate's image: its few terms have then less noise than
/// most differences.
pub const FIT_PATHS: u32 = 1;

/// No more pixels than this are traced along a side: a polynomial needs no more places, only more paths.
const MOST_ALONG: usize = 64;
/// The order where nothing speaks for a higher one ...
const LEAST_ORDER: usize = 2;
/// ... and the highest that is tried.
const MOST_ORDER: usize = 6;
/// A higher order is taken if its terms are larger than their noise by this many standard deviations of the noise's square.
const SIGNIFICANT: f64 = 5.0;

/// The pixels that are traced: a lattice over the image, every pixel where it is small.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    pub columns: Vec<usize>,
    pub rows: Vec<usize>,
}

impl Lattice {
    pub fn over(columns: usize, rows: usize) -> Self {
        let every = |n: usize| {
            let step = n.div_ceil(MOST_ALONG);
            // As far from one end as from the other.
            (0..n).skip((n - 1) % step / 2).step_by(step).collect()
        };
        Self { columns: every(columns), rows: every(rows) }
    }

    /// Their numbers in an image of `columns`, row by row.
    pub fn pixels(&self, columns: usize) -> Vec<u32> {
        self.rows.iter().flat_map(|r| self.columns.iter().map(move |c| (r * columns + c) as u32)).collect()
    }
}

/// What is known of all pixels beforehand: 8 bytes for each, and 16 for each carrier.
#[derive(Clone, Debug)]
pub struct Guides {
    gains: Vec<f64>,
    /// `[pixel][carrier]`.
    phases: Vec<(f64, f64)>,
    fringes: Fringes,
}

impl Guides {
    /// What the light would be at the centres of pixels; `None` where one meets nothing.
    pub fn of(rig: &Rig, carriers: &[Carrier]) -> Option<Self> {
        let pixels = rig.camera.pixels();
        let mut guides = Self {
            gains: Vec::with_capacity(pixels),
            phases: Vec::with_capacity(pixels * carriers.len()),
            fringes: Fringes::carriers(carriers.len()),
        };
        (0..pixels).try_for_each(|pixel| guides.push(rig, carriers, pixel))?;
        Some(guides)
    }

    fn push(&mut self, rig: &Rig, carriers: &[Carrier], pixel: usize) -> Option<()> {
        let (world, camera) = (&rig.worlds[0], &rig.camera);
        let (origin, w) = camera.ray(pixel, 0.5, 0.5);
        let mut chords = Chords::default();
        let segment = world.trace(origin, w, None, &mut chords).find(|segment| segment.material != 0)?;
        let r = origin + segment.start * w;
        // Channels differ in their power, which the coefficients hold.
        let emission = match rig.lights[0].emission {
            Emission::Intensity(_) => Emission::Intensity(1.0),
            Emission::Irradiance(_) => Emission::Irradiance(1.0),
        };
        let (arrival, _) = Light { emission, ..rig.lights[0] }.arrives(r);
        self.phases.extend(carriers.iter().map(|c| c.at(arrival.on_plane)));
        self.gains.push(arrival.irradiance * arrival.towards.z.abs());
        Some(())
    }

    pub fn len(&self) -> usize {
        self.gains.len()
    }

    pub fn at(&self, pixel: usize) -> Guide<'_> {
        let count = self.fringes.phases();
        Guide { gain: self.gains[pixel], phases: &self.phases[pixel * count..][..count], fringes: &self.fringes }
    }
}

/// A fitted image of one channel: response = gain x (carrier) x sum over k of coefficient_k p_k(pixel).
pub struct Fitted {
    columns: usize,
    guides: Guides,
    /// p_0 .. of every column and row of the image.
    along_x: Vec<Vec<f64>>,
    along_y: Vec<Vec<f64>>,
    /// Degrees in x and y of each term, total degree ascending.
    terms: Vec<(usize, usize)>,
    /// Reduced responses: 1, then re, im of each carrier.
    q: usize,
    /// `[term][response]`.
    coefficients: Vec<f64>,
    /// `[response][response][term][term]`.
    covariances: Vec<f64>,
    /// Of the polynomials.
    pub order: usize,
    /// Whether the highest order that was tried would still have been worth it.
    pub rough: bool,
    /// Whether the paths hold what is rare and bright; if not, no error is known.
    held: bool,
}

impl Fitted {
    /// From the sums of the lattice's pixels after `n` >= 2 paths each. Every pixel must look at something.
    pub fn new(rig: &Rig, carriers: &[Carrier], lattice: &Lattice, moments: &Moments, n: u32) -> Option<Self> {
        let (columns, rows, q) = (rig.camera.columns, rig.camera.rows, 1 + 2 * carriers.len());
        let guides = Guides::of(rig, carriers)?;
        let polynomials = |places: &[usize]| {
            let places: Vec<f64> = places.iter().map(|&p| p as f64).collect();
            Polynomials::new(&places, MOST_ORDER)
        };
        let (x, y) = (polynomials(&lattice.columns), polynomials(&lattice.rows));
        let along_x: Vec<Vec<f64>> = (0..columns).map(|c| x.at(c as f64)).collect();
        let along_y: Vec<Vec<f64>> = (0..rows).map(|r| y.at(r as f64)).collect();
        let mut terms: Vec<(usize, usize)> =
            (0..=x.degree()).flat_map(|i| (0..=y.degree()).map(move |j| (i, j))).collect();
        terms.retain(|(i, j)| i + j <= MOST_ORDER);
        terms.sort_by_key(|&(i, j)| (i + j, i));
        let pixels = lattice.pixels(columns);
        let traced = pixels.iter().enumerate().map(|(place, &pixel)| (place, n, guides.at(pixel as usize)));
        let reduced = Reduced::of(&guides.fringes, moments, traced);
        // A term's place at each traced pixel; orthonormal, so that a coefficient is a plain sum.
        let basis: Vec<Vec<f64>> = terms
            .iter()
            .map(|&(i, j)| {
                let at = |&p: &u32| along_x[p as usize % columns][i] * along_y[p as usize / columns][j];
                pixels.iter().map(at).collect()
            })
            .collect();
        let coefficients: Vec<f64> = basis
            .iter()
            .flat_map(|p| (0..q).map(|a| p.iter().enumerate().map(|(i, p)| p * reduced.value(i, a)).sum()))
            .collect();
        let (order, rough) = order(&terms, &basis, &coefficients, &reduced);
        terms.retain(|(i, j)| i + j <= order);
        let m = terms.len();
        let mut covariances = vec![0.0; q * q * m * m];
        for (k, l) in (0..m).flat_map(|k| (k..m).map(move |l| (k, l))) {
            let mut sums = vec![0.0; q * q];
            for (i, (pk, pl)) in basis[k].iter().zip(&basis[l]).enumerate() {
                let weight = pk * pl;
                sums.iter_mut().zip(reduced.covariances(i)).for_each(|(s, c)| *s += weight * c);
            }
            for (ab, sum) in sums.into_iter().enumerate() {
                covariances[(ab * m + k) * m + l] = sum;
                covariances[(ab * m + l) * m + k] = sum;
            }
        }
        let coefficients = coefficients[..m * q].to_vec();
        let (seen, expected) = (brightness(moments, &vec![n; pixels.len()]), expected_kurtosis(rig));
        let held = !is_peaked(expected) || image_holds(&seen, expected);
        Some(Self { columns, guides, along_x, along_y, terms, q, coefficients, covariances, order, rough, held })
    }

    /// How many times the variance of the mean of M_DC exceeds that of independent pixels.
    pub fn design_effect(&self) -> f64 {
        let terms = [(0, 1.0)];
        let total: f64 = (0..self.pixels()).map(|p| self.variance(p, &terms)).sum();
        let n = self.pixels() as f64;
        if total > 0.0 { (self.variance_of_mean(&terms, total) * n * n / total).max(1.0) } else { 1.0 }
    }

    /// Variance of the sum of weight x response over `terms`, added up over the pixels that `counts`.
    pub fn variance_of_sum(&self, terms: &[(usize, f64)], counts: &dyn Fn(usize) -> bool) -> f64 {
        let m = self.terms.len();
        // Weight of every coefficient in the sum.
        let mut weights: Vec<(usize, Vec<f64>)> = Vec::new();
        for pixel in (0..self.pixels()).filter(|&pixel| counts(pixel)) {
            for (a, w) in self.guides.at(pixel).collect(terms) {
                let place = weights.iter().position(|entry| entry.0 == a).unwrap_or_else(|| {
                    weights.push((a, vec![0.0; m]));
                    weights.len() - 1
                });
                weights[place].1.iter_mut().zip(self.basis(pixel)).for_each(|(sum, p)| *sum += w * p);
            }
        }
        let pairs = weights.iter().flat_map(|l| weights.iter().map(move |r| (l, r)));
        pairs.map(|(l, r)| self.between(l.0, r.0, &l.1, &r.1)).sum::<f64>().max(0.0)
    }

    /// p_k of a pixel for every term.
    fn basis(&self, pixel: usize) -> impl Iterator<Item = f64> + Clone + '_ {
        let (x, y) = (&self.along_x[pixel % self.columns], &self.along_y[pixel / self.columns]);
        self.terms.iter().map(move |&(i, j)| x[i] * y[j])
    }

    /// Covariance of two sums of weight x coefficient.
    fn between(&self, a: usize, b: usize, left: &[f64], right: &[f64]) -> f64 {
        let m = self.terms.len();
        let block = &self.covariances[(a * self.q + b) * m * m..][..m * m];
        let rows = block.chunks_exact(m).zip(left);
        rows.map(|(row, l)| l * row.iter().zip(right).map(|(c, r)| c * r).sum::<f64>()).sum()
    }
}

impl Field for Fitted {
    fn pixels(&self) -> usize {
        self.guides.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        let reduced = |a: usize| -> f64 {
            self.basis(pixel).enumerate().map(|(k, p)| p * self.coefficients[k * self.q + a]).sum()
        };
        self.guides.at(pixel).in_reduced(i).into_iter().map(|(a, w)| if w == 0.0 { 0.0 } else { w * reduced(a) }).sum()
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let (basis, guide): (Vec<f64>, _) = (self.basis(pixel).collect(), self.guides.at(pixel));
        let (left, right) = (guide.collect(a), guide.collect(b));
        let pairs = left.iter().flat_map(|l| right.iter().map(move |r| (l, r)));
        pairs
            .filter(|(l, r)| l.1 * r.1 != 0.0)
            .map(|(&(a, wa), &(b, wb))| wa * wb * self.between(a, b, &basis, &basis))
            .sum()
    }

    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        let basis: Vec<f64> = self.basis(pixel).collect();
        let sums = self.guides.at(pixel).collect(terms);
        let mut variance = 0.0;
        for (i, &(a, wa)) in sums.iter().enumerate() {
            for &(b, wb) in &sums[i..] {
                let twice = if a == b { 1.0 } else { 2.0 };
                if wa * wb != 0.0 {
                    variance += twice * wa * wb * self.between(a, b, &basis, &basis);
                }
            }
        }
        variance.max(0.0)
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], _: f64) -> f64 {
        let n = self.pixels() as f64;
        self.variance_of_sum(terms, &|_| true) / (n * n)
    }

    fn se_unknown(&self, _: usize) -> bool {
        !self.held
    }

    fn mean_se_unknown(&self) -> bool {
        !self.held
    }
}

/// The lowest order beyond which the terms of every further order are noise, and whether the highest is not.
///
/// For each response and order the sum of (coefficient / its standard error)^2 over the terms is compared with their number k:
/// noise gives k +- sqrt(2 k).
fn order(terms: &[(usize, usize)], basis: &[Vec<f64>], coefficients: &[f64], reduced: &Reduced) -> (usize, bool) {
    let (mut order, q) = (LEAST_ORDER, reduced.q);
    let mut rough = false;
    for degree in LEAST_ORDER + 1..=MOST_ORDER {
        let of_degree: Vec<usize> = (0..terms.len()).filter(|&k| terms[k].0 + terms[k].1 == degree).collect();
        let count = of_degree.len() as f64;
        let significant = (0..q).any(|a| {
            let squares = of_degree.iter().map(|&k| {
                let places = basis[k].iter().enumerate();
                let variance: f64 = places.map(|(i, p)| p * p * reduced.variance(i, a)).sum();
                let c = coefficients[k * q + a];
                if variance > 0.0 { c * c / variance } else { 0.0 }
            });
            squares.sum::<f64>() - count > SIGNIFICANT * (2.0 * count).sqrt()
        });
        if significant {
            (order, rough) = (degree, degree == MOST_ORDER);
        }
    }
    (order, rough)
}
