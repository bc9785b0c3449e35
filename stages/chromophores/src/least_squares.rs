//! Small weighted least squares: rows whitened by their noise, an orthogonal factorisation, what its solution's errors are.

/// The most unknowns of a problem.
pub const MOST: usize = 8;

/// A square matrix of unknowns, row by row; what lies beyond their count is 0.
pub type Square = [[f64; MOST]; MOST];

/// What is known of the noise of values.
#[derive(Clone, Copy, Debug)]
pub enum Noise<'a> {
    Unknown,
    /// Standard error of each, independent of each other.
    Independent(&'a [f64]),
    /// Their covariance, row by row.
    Full(&'a [f64]),
}

/// How rows are weighted: by their noise where that is known and above 0 in every direction, else all alike.
#[derive(Clone, Debug, Default)]
pub struct Weights {
    rows: usize,
    kind: Kind,
    /// 1 / standard error, or the lower Cholesky factor of the covariance.
    factor: Vec<f64>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Kind {
    #[default]
    Equal,
    Diagonal,
    Cholesky,
}

impl Weights {
    pub fn set(&mut self, rows: usize, noise: Noise<'_>) {
        (self.rows, self.kind) = (rows, Kind::Equal);
        self.factor.clear();
        match noise {
            Noise::Unknown => {}
            Noise::Independent(se) => {
                if se.iter().all(|&se| se > 0.0) {
                    self.factor.extend(se.iter().map(|se| 1.0 / se));
                    self.kind = Kind::Diagonal;
                }
            }
            Noise::Full(covariance) => {
                self.factor.extend_from_slice(covariance);
                if cholesky(&mut self.factor, rows) {
                    self.kind = Kind::Cholesky;
                }
            }
        }
    }

    /// Whether all rows count alike, whatever their noise.
    pub fn are_equal(&self) -> bool {
        self.kind == Kind::Equal
    }

    /// Brings a column to rows of noise 1 that are independent.
    pub fn whiten(&self, column: &mut [f64]) {
        match self.kind {
            Kind::Equal => {}
            Kind::Diagonal => column.iter_mut().zip(&self.factor).for_each(|(v, w)| *v *= w),
            Kind::Cholesky => {
                for i in 0..self.rows {
                    let row = &self.factor[i * self.rows..];
                    let before: f64 = column[..i].iter().zip(row).map(|(v, l)| v * l).sum();
                    column[i] = (column[i] - before) / row[i];
                }
            }
        }
    }
}

/// The lower factor in place; `false` where the matrix is not positive definite.
fn cholesky(matrix: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        for j in 0..=i {
            let before: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - before;
            if i > j {
                matrix[i * n + j] = rest / matrix[j * n + j];
            } else if rest > 1e-12 * matrix[i * n + i] {
                matrix[i * n + i] = rest.sqrt();
            } else {
                return false;
            }
        }
    }
    true
}

/// Columns as Q R, and the right-hand side in Q's directions.
#[derive(Clone, Debug)]
pub struct Factors {
    count: usize,
    r: Square,
    pub rhs: [f64; MOST],
    /// Squared norm of what no column explains.
    pub rest: f64,
}

/// Factorises `count` columns of `rows` numbers; the right-hand side stands behind them. Q is left in the place of the columns.
///
/// Modified Gram-Schmidt, the right-hand side taken along: as good as Householder's (Bjorck, BIT 7, 1 (1967)). `None` where a column lies in the span
/// of those before it.
pub fn factorise(columns: &mut [f64], rows: usize, count: usize) -> Option<Factors> {
    let mut made = Factors { count, r: [[0.0; MOST]; MOST], rhs: [0.0; MOST], rest: 0.0 };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for j in 0..count {
        let (q, behind) = columns[j * rows..].split_at_mut(rows);
        let before: f64 = (0..j).map(|i| made.r[i][j] * made.r[i][j]).sum();
        let norm = dot(q, q);
        if !(norm > 1e-24 * (before + norm) && norm.is_finite()) {
            return None;
        }
        made.r[j][j] = norm.sqrt();
        let per = 1.0 / made.r[j][j];
        q.iter_mut().for_each(|v| *v *= per);
        for (k, column) in (j + 1..=count).zip(behind.chunks_exact_mut(rows)) {
            let along = dot(q, column);
            column.iter_mut().zip(&*q).for_each(|(v, q)| *v -= along * q);
            if k < count {
                made.r[j][k] = along;
            } else {
                made.rhs[j] = along;
            }
        }
    }
    let rest = &columns[count * rows..(count + 1) * rows];
    made.rest = dot(rest, rest);
    Some(made)
}

impl Factors {
    pub fn solution(&self) -> [f64; MOST] {
        self.backwards(self.rhs)
    }

    /// R column by column, each of `count` numbers.
    pub fn column(&self, k: usize) -> [f64; MOST] {
        std::array::from_fn(|i| self.r[i][k])
    }

    /// Covariance of the solution, of that of the right-hand side in Q's directions: R^-1 T R^-T.
    pub fn covariance(&self, of_rhs: &Square) -> Square {
        // R^-1 T, column by column, then the same of its transpose.
        let left = |matrix: &Square| -> Square {
            let mut solved = [[0.0; MOST]; MOST];
            for (k, row) in solved.iter_mut().enumerate().take(self.count) {
                *row = self.backwards(std::array::from_fn(|i| matrix[i][k]));
            }
            solved
        };
        left(&left(of_rhs))
    }

    fn backwards(&self, mut x: [f64; MOST]) -> [f64; MOST] {
        for i in (0..self.count).rev() {
            let behind: f64 = (i + 1..self.count).map(|k| self.r[i][k] * x[k]).sum();
            x[i] = (x[i] - behind) / self.r[i][i];
        }
        x
    }
}

/// Covariance of Q^T v, of v's noise: `q` as [`factorise`] left it, of rows that were not weighted. `None` where the noise is not known.
pub fn turned(q: &[f64], rows: usize, count: usize, noise: Noise<'_>) -> Option<Square> {
    let mut made = [[0.0; MOST]; MOST];
    for i in 0..count {
        for k in 0..=i {
            let (a, b) = (&q[i * rows..(i + 1) * rows], &q[k * rows..(k + 1) * rows]);
            let value: f64 = match noise {
                Noise::Unknown => return None,
                Noise::Independent(se) => (0..rows).map(|r| a[r] * b[r] * se[r] * se[r]).sum(),
                Noise::Full(c) => {
                    (0..rows).map(|r| a[r] * (0..rows).map(|s| c[r * rows + s] * b[s]).sum::<f64>()).sum()
                }
            };
            (made[i][k], made[k][i]) = (value, value);
        }
    }
    Some(made)
}

/// The unit matrix of the first `count` unknowns.
pub fn unit(count: usize) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|k| f64::from(i == k && i < count)))
}
