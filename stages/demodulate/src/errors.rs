//! Noise of a chunk of pixels in vector lanes: the sums of [`Block::covariance`], in its order, for many pixels at a time.

use fearless_simd::{Level, Simd, dispatch};

use crate::noise::{Block, Element};

/// A direction in the (dc, re, im) of one fringe, pixel by pixel.
#[derive(Clone, Copy)]
pub enum Toward<'a> {
    /// M_DC.
    Mean,
    /// Weights of re and im.
    Phasor(&'a [f64], &'a [f64]),
}

impl<'a> Toward<'a> {
    fn parts(self) -> impl Iterator<Item = (usize, Option<&'a [f64]>)> + Clone {
        let [a, b] = match self {
            Self::Mean => [Some((0, None)), None],
            Self::Phasor(re, im) => [Some((1, Some(re))), Some((2, Some(im)))],
        };
        a.into_iter().chain(b)
    }
}

/// |Z| and the unit vectors along and across Z = (re, im) of each pixel; 0 where Z is.
#[derive(Default)]
pub struct Phasors {
    pub m_ac: Vec<f64>,
    pub cos: Vec<f64>,
    pub sin: Vec<f64>,
    minus_sin: Vec<f64>,
}

impl Phasors {
    pub fn set(&mut self, level: Level, re: &[f64], im: &[f64]) {
        let n = re.len();
        let Self { m_ac, cos, sin, minus_sin } = self;
        let all = [m_ac, cos, sin, minus_sin].map(|v| {
            v.resize(n, 0.0);
            v.as_mut_slice()
        });
        let [m_ac, cos, sin, minus_sin] = all;
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for i in 0..n {
                let length = (re[i] * re[i] + im[i] * im[i]).sqrt();
                let lit = length > 0.0;
                m_ac[i] = length;
                cos[i] = if lit { re[i] / length } else { 0.0 };
                sin[i] = if lit { im[i] / length } else { 0.0 };
                minus_sin[i] = -sin[i];
            }
        }));
    }

    pub fn along(&self) -> Toward<'_> {
        Toward::Phasor(&self.cos, &self.sin)
    }

    pub fn across(&self) -> Toward<'_> {
        Toward::Phasor(&self.minus_sin, &self.cos)
    }
}

/// The elements of one block over a chunk, in f64.
#[derive(Default)]
pub struct Elements([[Vec<f64>; 3]; 3]);

impl Elements {
    /// Reads the pixels from `first` on; `[a, b]`: whether the block's two fringes have a phasor, and not only a mean.
    pub fn read(&mut self, level: Level, block: &Block<'_>, first: usize, n: usize, [a, b]: [bool; 2]) {
        let parts = |fringed: bool| if fringed { 3 } else { 1 };
        for (row, out) in block.0.iter().zip(&mut self.0).take(parts(a)) {
            for (element, out) in row.iter().zip(out).take(parts(b)) {
                out.clear();
                out.resize(n, 0.0);
                read(level, element, first, out);
            }
        }
    }

    /// Covariance of what lies toward `a` in one fringe and toward `b` in the other, into `out`.
    pub fn covariance(&self, level: Level, a: Toward<'_>, b: Toward<'_>, out: &mut [f64]) {
        let n = out.len();
        out.fill(0.0);
        for (p, row_weight) in a.parts() {
            for (q, column_weight) in b.parts() {
                let element = &self.0[p][q][..n];
                // An element of weight 0 has no say, whatever it is.
                let mut add = |weight: &dyn Weight| weight.add(level, element, out);
                match (row_weight, column_weight) {
                    (None, None) => add(&One),
                    (Some(weight), None) | (None, Some(weight)) => add(&weight),
                    (Some(row), Some(column)) => add(&(row, column)),
                }
            }
        }
    }

    /// The same of one with itself; a covariance matrix that was rounded to f32 may be negative by a rounding error, that is 0.
    pub fn variance(&self, level: Level, a: Toward<'_>, out: &mut [f64]) {
        self.covariance(level, a, a, out);
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for out in out.iter_mut() {
                *out = if *out < 0.0 { 0.0 } else { *out };
            }
        }));
    }
}

/// Adds weight x element to a sum, pixel by pixel.
trait Weight {
    fn add(&self, level: Level, element: &[f64], out: &mut [f64]);
}

struct One;

impl Weight for One {
    fn add(&self, level: Level, element: &[f64], out: &mut [f64]) {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (out, element) in out.iter_mut().zip(element) {
                *out += element;
            }
        }));
    }
}

impl Weight for &[f64] {
    fn add(&self, level: Level, element: &[f64], out: &mut [f64]) {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for ((out, element), &weight) in out.iter_mut().zip(element).zip(*self) {
                *out += if weight == 0.0 { 0.0 } else { weight * element };
            }
        }));
    }
}

impl Weight for (&[f64], &[f64]) {
    fn add(&self, level: Level, element: &[f64], out: &mut [f64]) {
        let (row, column) = *self;
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for ((out, element), (row, column)) in out.iter_mut().zip(element).zip(row.iter().zip(column)) {
                let weight = row * column;
                *out += if weight == 0.0 { 0.0 } else { weight * element };
            }
        }));
    }
}

fn read(level: Level, element: &Element<'_>, first: usize, out: &mut [f64]) {
    let n = out.len();
    match element {
        Element::Zero => {}
        Element::Given(plane) => {
            let plane = &plane[first..first + n];
            out.iter_mut().zip(plane).for_each(|(out, &v)| *out = f64::from(v));
        }
        Element::Frames(terms) => {
            for &(weight, se) in terms {
                let se = &se[first..first + n];
                dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
                    for (out, &se) in out.iter_mut().zip(se) {
                        *out += weight * f64::from(se) * f64::from(se);
                    }
                }));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::named;
    use crate::noise::{OF_M_DC, along_and_across};
    use crate::phase_shift::Weights;

    /// Every level of vector instructions gives the bits of `Block::covariance`: independent frames and a given matrix, pixels
    /// without a phasor, with one along an axis, and with noise that is no number.
    #[test]
    fn lanes_compute_what_the_reference_does() {
        let n = 61;
        let (re, im): (Vec<f64>, Vec<f64>) = (0..n)
            .map(|i| match i % 7 {
                0 => (0.0, 0.0),
                1 => (0.3, 0.0),
                2 => (0.0, -0.2),
                _ => (libm::cos(i as f64), 0.7 * libm::sin(2.3 * i as f64)),
            })
            .unzip();
        let plane = |k: usize| -> Vec<f32> {
            (0..n + 3).map(|i| if i == 20 { f32::NAN } else { libm::sin((i + 17 * k) as f64) as f32 }).collect()
        };
        let planes: Vec<Vec<f32>> = (0..9).map(plane).collect();
        let weights = Weights::least_squares(&[0.0, 1.9, 4.0]).unwrap().weights;
        let se: Vec<&[f32]> = planes[..3].iter().map(Vec::as_slice).collect();
        let of_frames = |p: usize, q: usize| Element::of_frames(&weights[p], &weights[q], &se);
        let frames = Block([0, 1, 2].map(|p| [0, 1, 2].map(|q| of_frames(p, q))));
        let given = |p: usize, q: usize| if p == q { Element::Zero } else { Element::Given(&planes[3 * p + q]) };
        let given = Block([0, 1, 2].map(|p| [0, 1, 2].map(|q| given(p, q))));
        let first = 2;
        for block in [&frames, &given] {
            for level in ["baseline", "v3", ""].map(named) {
                let (mut phasors, mut elements, mut out) = (Phasors::default(), Elements::default(), vec![0.0; n]);
                phasors.set(level, &re, &im);
                elements.read(level, block, first, n, [true; 2]);
                let ways = [Toward::Mean, phasors.along(), phasors.across()];
                for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
                    elements.covariance(level, ways[a], ways[b], &mut out);
                    for i in 0..n {
                        let [along, across] = along_and_across(re[i], im[i]);
                        let gradients = [OF_M_DC, along, across];
                        let want = block.covariance(&gradients[a], &gradients[b], first + i);
                        assert!(out[i] == want || (out[i].is_nan() && want.is_nan()), "{a} {b} {i}: {} {want}", out[i]);
                    }
                }
                elements.variance(level, phasors.across(), &mut out);
                let want = block.variance(&along_and_across(re[5], im[5])[1], first + 5);
                assert_eq!(out[5], want);
            }
        }
    }
}
