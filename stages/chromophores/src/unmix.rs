//! Concentrations of one pixel from its mu_a: weighted least squares, with concentrations that are not negative where that is asked, in closed form.
//!
//! Non-negative least squares is a choice of which concentrations are held at 0. With at most 8 unknowns all choices are tried where the free solution
//! has a negative one: the least sum of squares among those without a negative concentration is the solution, exactly and without iteration (the
//! problem is convex, and its solution is the free one of its own choice; Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23).

pub mod lanes;

use crate::least_squares::{Factors, MOST, Noise, Square, Weights, factorise, turned, unit};

/// What each unit of each chromophore absorbs, at the wavelengths.
#[derive(Clone, Debug)]
pub struct Mixture {
    rows: usize,
    count: usize,
    /// Column by column, each divided by its norm: concentrations in uM and shares of a volume differ by orders of magnitude.
    columns: Vec<f64>,
    norm: [f64; MOST],
}

/// What a pixel is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Unmixed {
    pub amounts: [f64; MOST],
    /// Of the amounts, those that are held at 0 taken for known; `None` where the noise is not known.
    pub covariance: Option<Square>,
    /// Sum of the squared residuals over their noise; `None` where rows could not be weighted by it.
    pub chi2: Option<f64>,
    /// Root mean square of the residuals, mm^-1.
    pub residual: f64,
    /// How many concentrations are held at 0.
    pub held: u32,
}

/// Memory that is used again for each pixel.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    weights: Weights,
    columns: Vec<f64>,
}

impl Mixture {
    /// `columns[k][i]`: mm^-1 for one unit of chromophore k at wavelength i. At most [`MOST`] columns, none of them 0 everywhere.
    pub fn new(columns: &[Vec<f64>]) -> Self {
        let (rows, count) = (columns[0].len(), columns.len());
        assert!(count <= MOST, "{count} chromophores, at most {MOST} are taken");
        let mut norm = [1.0; MOST];
        for (norm, column) in norm.iter_mut().zip(columns) {
            *norm = column.iter().map(|v| v * v).sum::<f64>().sqrt();
        }
        let scaled = columns.iter().zip(norm).flat_map(|(column, norm)| column.iter().map(move |v| v / norm)).collect();
        Self { rows, count, columns: scaled, norm }
    }

    /// The amounts that explain `mu_a` (mm^-1) best. `None` where the wavelengths that count do not tell them apart.
    pub fn unmix(&self, mu_a: &[f64], noise: Noise<'_>, non_negative: bool, scratch: &mut Scratch) -> Option<Unmixed> {
        let Self { rows, count, .. } = *self;
        let Scratch { weights, columns } = scratch;
        weights.set(rows, noise);
        columns.clear();
        columns.extend_from_slice(&self.columns);
        columns.extend_from_slice(mu_a);
        columns.chunks_exact_mut(rows).for_each(|column| weights.whiten(column));
        let factors = factorise(columns, rows, count)?;
        let of_rhs = if weights.are_equal() { turned(columns, rows, count, noise) } else { Some(unit(count)) };
        let free = factors.solution();
        let all = (1 << count) - 1;
        let negative = non_negative && free[..count].iter().any(|&x| x < 0.0);
        let chosen =
            if negative { self.least(&factors, &free)? } else { Choice { kept: all, amounts: free, rest: 0.0 } };
        let mut covariance = match of_rhs {
            Some(t) if chosen.kept == all => Some(factors.covariance(&t)),
            Some(t) => chosen.covariance(&factors, count, &t),
            None => None,
        };
        if let Some(covariance) = &mut covariance {
            for (i, row) in covariance.iter_mut().enumerate() {
                row.iter_mut().enumerate().for_each(|(k, v)| *v /= self.norm[i] * self.norm[k]);
            }
        }
        let scaled = chosen.amounts;
        let residual = |i: usize| mu_a[i] - (0..count).map(|k| self.columns[k * rows + i] * scaled[k]).sum::<f64>();
        let squares: f64 = (0..rows).map(|i| residual(i) * residual(i)).sum();
        Some(Unmixed {
            amounts: std::array::from_fn(|k| if k < count { scaled[k] / self.norm[k] } else { 0.0 }),
            covariance,
            chi2: (!weights.are_equal()).then_some(factors.rest + chosen.rest),
            residual: (squares / rows as f64).sqrt(),
            held: count as u32 - chosen.kept.count_ones(),
        })
    }

    /// The choice of the least sum of squares among those that have no negative amount. `free`: the solution with none held.
    fn least(&self, factors: &Factors, free: &[f64; MOST]) -> Option<Choice> {
        let count = self.count;
        // Mostly those that are negative are those to hold: where that meets the conditions of Karush, Kuhn and Tucker, no other choice is better.
        let guess = (0..count).filter(|&k| free[k] >= 0.0).fold(0, |kept, k| kept | 1 << k);
        if let Some(choice) = Choice::of(guess, factors, count).filter(|choice| choice.is_optimal(factors, count)) {
            return Some(choice);
        }
        let choices = (0..(1_u32 << count) - 1).filter_map(|kept| Choice::of(kept, factors, count));
        choices.reduce(|best, next| if next.rest < best.rest { next } else { best })
    }
}

/// A solution with some amounts held at 0.
struct Choice {
    /// Bit k: amount k is free.
    kept: u32,
    amounts: [f64; MOST],
    /// By how much the sum of squares exceeds that of the free solution.
    rest: f64,
}

impl Choice {
    /// `None` where one of the free amounts is negative.
    fn of(kept: u32, factors: &Factors, count: usize) -> Option<Self> {
        let (mut columns, free) = Self::columns(kept, factors, count);
        let part = factorise(&mut columns[..(free + 1) * count], count, free)?;
        let solved = part.solution();
        if solved[..free].iter().any(|&x| x < 0.0) {
            return None;
        }
        let mut amounts = [0.0; MOST];
        places(kept, count).zip(solved).for_each(|(k, x)| amounts[k] = x);
        Some(Self { kept, amounts, rest: part.rest })
    }

    /// Whether to let go of any amount that is held would only take it below 0.
    fn is_optimal(&self, factors: &Factors, count: usize) -> bool {
        let mut rest = factors.rhs;
        for k in places(self.kept, count) {
            rest.iter_mut().zip(factors.column(k)).for_each(|(v, r)| *v -= r * self.amounts[k]);
        }
        let slope = |k: usize| factors.column(k).iter().zip(rest).map(|(r, v)| r * v).sum::<f64>();
        places(!self.kept, count).all(|k| slope(k) <= 0.0)
    }

    /// Covariance of all amounts, of that of the right-hand side; those that are held have none.
    fn covariance(&self, factors: &Factors, count: usize, of_rhs: &Square) -> Option<Square> {
        let (mut columns, free) = Self::columns(self.kept, factors, count);
        let part = factorise(&mut columns[..(free + 1) * count], count, free)?;
        let flat: Vec<f64> = of_rhs[..count].iter().flat_map(|row| row[..count].iter().copied()).collect();
        let small = part.covariance(&turned(&columns, count, free, Noise::Full(&flat))?);
        let mut made = [[0.0; MOST]; MOST];
        for (i, a) in places(self.kept, count).enumerate() {
            places(self.kept, count).enumerate().for_each(|(k, b)| made[a][b] = small[i][k]);
        }
        Some(made)
    }

    /// Columns of R that are kept with the right-hand side behind them, and how many are kept.
    fn columns(kept: u32, factors: &Factors, count: usize) -> ([f64; MOST * (MOST + 1)], usize) {
        let mut columns = [0.0; MOST * (MOST + 1)];
        let mut free = 0;
        for k in places(kept, count) {
            columns[free * count..(free + 1) * count].copy_from_slice(&factors.column(k)[..count]);
            free += 1;
        }
        columns[free * count..(free + 1) * count].copy_from_slice(&factors.rhs[..count]);
        (columns, free)
    }
}

/// The places of the bits that are set.
fn places(bits: u32, count: usize) -> impl Iterator<Item = usize> {
    (0..count).filter(move |k| bits >> k & 1 == 1)
}
