//! Depth: bases in which d/dz + k is a triangular matrix, so that a ray is followed exactly at the cost of a sweep.
//!
//! A function of depth is a row of coefficients in an orthonormal basis that comes in cells of `size` functions.
//! The Galerkin form of g' + k g = f, g(0) = u is, cell after cell,
//! (K + k) x = y + r u, then u <- pass u + o . x, and the equation upwards, -g' + k g = f, is its transpose.

/// One cell of a depth basis.
struct Cell {
    /// The matrix K, `size` x `size`, row by row.
    matrix: Vec<f64>,
    /// r: values of the basis functions where a downward ray enters the cell.
    inflow: Vec<f64>,
    /// o: what the basis functions add to the downward ray that leaves the cell.
    outflow: Vec<f64>,
    /// What a ray keeps of its strength when it passes the cell by: 1 for exponentials, 0 for slab cells.
    pass: f64,
    /// Optical thickness; infinite for exponentials.
    width: f64,
}

/// A depth basis on a half-space or on a slab.
pub struct Depth {
    size: usize,
    cells: Vec<Cell>,
}

impl Depth {
    /// The exponentials exp(-s z), s in `rates`, orthonormalised on [0, inf).
    ///
    /// That basis (Takenaka and Malmquist's) is the cascade of all-pass filters x_i' = -s_i x_i + r_i u_i,
    /// u_{i+1} = u_i - r_i x_i with r_i = sqrt(2 s_i): well-conditioned even where rates coincide, and d/dz is triangular.
    pub fn half_space(rates: &[f64]) -> Self {
        let cells = rates
            .iter()
            .map(|&s| {
                let r = (2.0 * s).sqrt();
                Cell { matrix: vec![s], inflow: vec![r], outflow: vec![-r], pass: 1.0, width: f64::INFINITY }
            })
            .collect();
        Self { size: 1, cells }
    }

    /// Legendre polynomials of degree below `size` on each cell of the given widths, joined upwind
    /// (discontinuous Galerkin: exp(-k z) is met by its Padé approximant of order 2 `size` - 1, for k z -> inf too).
    pub fn slab(widths: &[f64], size: usize) -> Self {
        let cells = widths
            .iter()
            .map(|&width| {
                let scale: Vec<f64> = (0..size).map(|i| ((2 * i + 1) as f64 / width).sqrt()).collect();
                let alternate = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
                // K_ij = phi_i(out) phi_j(out) - int phi_i' phi_j
                let entry = |i: usize, j: usize| scale[i] * scale[j] * if j < i { alternate(i + j) } else { 1.0 };
                Cell {
                    matrix: (0..size * size).map(|ij| entry(ij / size, ij % size)).collect(),
                    inflow: (0..size).map(|i| alternate(i) * scale[i]).collect(),
                    outflow: scale,
                    pass: 0.0,
                    width,
                }
            })
            .collect();
        Self { size, cells }
    }

    /// The Galerkin matrix of -d phi'' + removal phi with `robin` phi = d dphi/dz at each surface, row by row, and
    /// how far from its diagonal it reaches.
    ///
    /// Between cells: symmetric interior penalty, never below the 1/4 that transport itself would give (Wang and
    /// Ragusa, Nucl. Sci. Eng. 166, 145 (2010)).
    pub fn diffusion(&self, d: f64, removal: f64, robin: f64) -> (Vec<f64>, usize) {
        let (n, size) = (self.len(), self.size);
        let mut k = vec![0.0; n * n];
        (0..n).for_each(|i| k[i * n + i] = removal);
        if self.cells[0].pass != 0.0 {
            // Exponentials: phi' = -A^T x with A_ij = r_i r_j below the diagonal, s_i on it; phi(0) = r . x.
            let r = |i: usize| self.cells[i].inflow[0];
            let a = |i: usize, l: usize| if l < i { r(i) * r(l) } else { self.cells[i].matrix[0] };
            for i in 0..n {
                for j in 0..n {
                    let slopes: f64 = (0..=i.min(j)).map(|l| a(i, l) * a(j, l)).sum();
                    k[i * n + j] += d * slopes + robin * r(i) * r(j);
                }
            }
            return (k, n);
        }
        for (c, cell) in self.cells.iter().enumerate() {
            for i in 0..size {
                for j in (i % 2..size).step_by(2) {
                    let least = i.min(j);
                    let slopes = 2.0 / cell.width * cell.outflow[i] * cell.outflow[j] * (least * (least + 1)) as f64;
                    k[(c * size + i) * n + c * size + j] += d * slopes;
                }
            }
        }
        let mut add = |at: usize, u: &[f64], v: &[f64], factor: f64| {
            for (i, u) in u.iter().enumerate() {
                for (j, v) in v.iter().enumerate() {
                    k[(at + i) * n + at + j] += factor * u * v;
                }
            }
        };
        let last = self.cells.len() - 1;
        add(0, &self.cells[0].inflow, &self.cells[0].inflow, robin);
        add(last * size, &self.cells[last].outflow, &self.cells[last].outflow, robin);
        for (c, pair) in self.cells.windows(2).enumerate() {
            let order = (size * (size - 1)) as f64;
            let penalty = (d * order * (1.0 / pair[0].width + 1.0 / pair[1].width)).max(0.25);
            let slope = |i: usize, cell: &Cell, end: &[f64]| end[i] * (i * (i + 1)) as f64 / cell.width;
            let jump: Vec<f64> = pair[0].outflow.iter().copied().chain(pair[1].inflow.iter().map(|x| -x)).collect();
            let mean: Vec<f64> = (0..size)
                .map(|i| 0.5 * d * slope(i, &pair[0], &pair[0].outflow))
                .chain((0..size).map(|i| -0.5 * d * slope(i, &pair[1], &pair[1].inflow)))
                .collect();
            add(c * size, &jump, &mean, -1.0);
            add(c * size, &mean, &jump, -1.0);
            add(c * size, &jump, &jump, penalty);
        }
        (k, 2 * size)
    }

    /// Where coefficient `z` goes, and with which sign, when a symmetric slab is turned upside down.
    pub fn mirrored(&self, z: usize) -> (usize, f64) {
        let (cell, i) = (z / self.size, z % self.size);
        ((self.cells.len() - 1 - cell) * self.size + i, if i % 2 == 0 { 1.0 } else { -1.0 })
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        self.size * self.cells.len()
    }
}

/// A complex number per ray, parts apart; `im` is empty where all rays have real rates.
#[derive(Clone, Default)]
pub struct Rays {
    pub re: Vec<f64>,
    pub im: Vec<f64>,
}

impl Rays {
    pub fn zero(len: usize, complex: bool) -> Self {
        Self { re: vec![0.0; len], im: vec![0.0; if complex { len } else { 0 }] }
    }

    pub fn at(&self, i: usize) -> (f64, f64) {
        (self.re[i], self.im.get(i).copied().unwrap_or(0.0))
    }

    pub fn set(&mut self, i: usize, (re, im): (f64, f64)) {
        self.re[i] = re;
        if let Some(part) = self.im.get_mut(i) {
            *part = im;
        }
    }

    pub fn add(&mut self, i: usize, (re, im): (f64, f64)) {
        self.re[i] += re;
        if let Some(part) = self.im.get_mut(i) {
            *part += im;
        }
    }
}

/// Follows many rays at once, each with its own rate k = k_re + i k_im per optical depth.
pub struct Sweeper<'a> {
    depth: &'a Depth,
    rays: usize,
    complex: bool,
    /// (K + k)^-1: `[cell][i][j][ray]`.
    inverse: Rays,
}

impl<'a> Sweeper<'a> {
    pub fn new(depth: &'a Depth, rate: &Rays) -> Self {
        let (rays, complex, size) = (rate.re.len(), !rate.im.is_empty(), depth.size);
        let mut inverse = Rays::zero(depth.cells.len() * size * size * rays, complex);
        for (c, cell) in depth.cells.iter().enumerate() {
            for ray in 0..rays {
                let k = (rate.re[ray], if complex { rate.im[ray] } else { 0.0 });
                for (ij, (re, im)) in shifted_inverse(&cell.matrix, size, k).into_iter().enumerate() {
                    let at = (c * size * size + ij) * rays + ray;
                    inverse.re[at] = re;
                    if complex {
                        inverse.im[at] = im;
                    }
                }
            }
        }
        Self { depth, rays, complex, inverse }
    }

    pub fn complex(&self) -> bool {
        self.complex
    }

    /// Downward: `x` holds the source on entry and the field on return (`[coefficient][ray]`), `flow` the field at
    /// the top on entry and what leaves at the bottom on return.
    pub fn down(&self, x: &mut Rays, flow: &mut Rays) {
        let mut scratch = Rays::zero(self.depth.size * self.rays, self.complex);
        for (c, cell) in self.depth.cells.iter().enumerate() {
            self.step(c, false, x, flow, [&cell.inflow, &cell.outflow], &mut scratch);
        }
    }

    /// Upward: the same from the bottom to the top.
    pub fn up(&self, x: &mut Rays, flow: &mut Rays) {
        let mut scratch = Rays::zero(self.depth.size * self.rays, self.complex);
        for (c, cell) in self.depth.cells.iter().enumerate().rev() {
            self.step(c, true, x, flow, [&cell.outflow, &cell.inflow], &mut scratch);
        }
    }

    fn step(&self, c: usize, up: bool, x: &mut Rays, flow: &mut Rays, ends: [&[f64]; 2], source: &mut Rays) {
        let (n, size) = (self.rays, self.depth.size);
        let range = c * size * n..(c + 1) * size * n;
        let x_re = &mut x.re[range.clone()];
        let x_im = if self.complex { &mut x.im[range] } else { &mut [][..] };
        for i in 0..size {
            axpy(ends[0][i], &flow.re, &mut x_re[i * n..(i + 1) * n]);
            if self.complex {
                axpy(ends[0][i], &flow.im, &mut x_im[i * n..(i + 1) * n]);
            }
        }
        let pass = self.depth.cells[c].pass;
        flow.re.iter_mut().chain(&mut flow.im).for_each(|f| *f *= pass);
        if self.complex {
            source.re.copy_from_slice(x_re);
            source.im.copy_from_slice(x_im);
            x_re.fill(0.0);
            x_im.fill(0.0);
        } else {
            source.re.copy_from_slice(x_re);
            x_re.fill(0.0);
        }
        for i in 0..size {
            for j in 0..size {
                let ij = if up { j * size + i } else { i * size + j };
                let g = (c * size * size + ij) * n..(c * size * size + ij + 1) * n;
                let (out, from) = (i * n..(i + 1) * n, j * n..(j + 1) * n);
                if self.complex {
                    multiply_add(
                        [&self.inverse.re[g.clone()], &self.inverse.im[g]],
                        [&source.re[from.clone()], &source.im[from]],
                        [&mut x_re[out.clone()], &mut x_im[out]],
                    );
                } else {
                    let (g, y) = (&self.inverse.re[g], &source.re[from]);
                    x_re[out].iter_mut().zip(g).zip(y).for_each(|((x, g), y)| *x += g * y);
                }
            }
            axpy(ends[1][i], &x_re[i * n..(i + 1) * n], &mut flow.re);
            if self.complex {
                axpy(ends[1][i], &x_im[i * n..(i + 1) * n], &mut flow.im);
            }
        }
    }
}

/// y += a x
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// y += sum over k of a_k x_k, with the x_k one after the other in `rows`; four at a time, to load y a quarter as often.
pub fn accumulate(a: &[f64], rows: &[f64], y: &mut [f64]) {
    let n = y.len();
    let (fours, row_fours) = (a.chunks_exact(4), rows.chunks_exact(4 * n));
    for (&x, row) in fours.remainder().iter().zip(row_fours.remainder().chunks_exact(n)) {
        axpy(x, row, y);
    }
    for (a, rows) in fours.zip(row_fours) {
        let (r0, r1, r2, r3) = (&rows[..n], &rows[n..2 * n], &rows[2 * n..3 * n], &rows[3 * n..]);
        for i in 0..n {
            y[i] += (a[0] * r0[i] + a[1] * r1[i]) + (a[2] * r2[i] + a[3] * r3[i]);
        }
    }
}

fn multiply_add(g: [&[f64]; 2], y: [&[f64]; 2], x: [&mut [f64]; 2]) {
    let [x_re, x_im] = x;
    let n = x_re.len();
    let (g_re, g_im, y_re, y_im, x_im) = (&g[0][..n], &g[1][..n], &y[0][..n], &y[1][..n], &mut x_im[..n]);
    for i in 0..n {
        x_re[i] += g_re[i] * y_re[i] - g_im[i] * y_im[i];
        x_im[i] += g_re[i] * y_im[i] + g_im[i] * y_re[i];
    }
}

/// (K + k)^-1 for complex k with a positive real part, row by row; Gauss-Jordan without pivoting, safe because the
/// symmetric part of K + k is positive definite.
fn shifted_inverse(matrix: &[f64], size: usize, k: (f64, f64)) -> Vec<(f64, f64)> {
    let mul = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let mut a: Vec<(f64, f64)> = matrix.iter().map(|&re| (re, 0.0)).collect();
    for i in 0..size {
        a[i * size + i].0 += k.0;
        a[i * size + i].1 += k.1;
    }
    for p in 0..size {
        let (re, im) = a[p * size + p];
        let square = re * re + im * im;
        let pivot = (re / square, -im / square);
        a[p * size + p] = (1.0, 0.0);
        for j in 0..size {
            a[p * size + j] = mul(a[p * size + j], pivot);
        }
        for i in (0..size).filter(|&i| i != p) {
            let factor = a[i * size + p];
            a[i * size + p] = (0.0, 0.0);
            for j in 0..size {
                let (re, im) = mul(factor, a[p * size + j]);
                a[i * size + j].0 -= re;
                a[i * size + j].1 -= im;
            }
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(k: f64) -> Rays {
        Rays { re: vec![k], im: vec![] }
    }

    /// A ray of rate s that enters a half-space is the basis function itself: its square integral is 1 / (2 s).
    #[test]
    fn exponentials_are_orthonormal() {
        let rates = [1.0, 1.0, 0.01, 7.0];
        let depth = Depth::half_space(&rates);
        for s in rates {
            let mut x = Rays::zero(depth.len(), false);
            Sweeper::new(&depth, &ray(s)).down(&mut x, &mut ray(1.0));
            let square: f64 = x.re.iter().map(|x| x * x).sum();
            assert!((square * 2.0 * s - 1.0).abs() < 1e-13, "s = {s}: {square}");
        }
    }

    /// Beer's law through a slab, thin and thick, and down = up for the mirrored source.
    #[test]
    fn slabs_attenuate() {
        for thickness in [1e-6, 0.3, 2.0] {
            let depth = Depth::slab(&[thickness * 0.25, thickness * 0.75], 6);
            let sweeper = Sweeper::new(&depth, &ray(1.5));
            for up in [false, true] {
                let (mut x, mut flow) = (Rays::zero(depth.len(), false), ray(1.0));
                if up {
                    sweeper.up(&mut x, &mut flow)
                } else {
                    sweeper.down(&mut x, &mut flow)
                }
                let beer = libm::exp(-1.5 * thickness);
                // Error of the Padé approximant of exp(-y): y^12 5! 6! / (11! 12!), here of the wider cell.
                let tolerance = 5e-12 * libm::pow(1.5 * 0.75 * thickness, 12.0) + 1e-14;
                assert!((flow.re[0] / beer - 1.0).abs() < tolerance, "{thickness} mm: {} {beer}", flow.re[0]);
            }
        }
    }

    /// (K + k)^-1 (K + k) = 1.
    #[test]
    fn inverse_is_the_inverse() {
        let depth = Depth::slab(&[0.7], 5);
        let k = (0.3, -2.0);
        let inverse = shifted_inverse(&depth.cells[0].matrix, 5, k);
        for i in 0..5 {
            for j in 0..5 {
                let mut sum = (0.0, 0.0);
                for l in 0..5 {
                    let (re, im) = inverse[i * 5 + l];
                    let b = depth.cells[0].matrix[l * 5 + j];
                    let (b_re, b_im) = if l == j { (b + k.0, k.1) } else { (b, 0.0) };
                    sum = (sum.0 + re * b_re - im * b_im, sum.1 + re * b_im + im * b_re);
                }
                let wanted = f64::from(u8::from(i == j));
                assert!((sum.0 - wanted).abs() < 1e-12 && sum.1.abs() < 1e-12, "{i} {j}: {sum:?}");
            }
        }
    }
}
