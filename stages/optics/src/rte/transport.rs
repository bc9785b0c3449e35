//! The transport operator: from sources, as moments over angle and depth, to the fluxes that they cause.

use super::angles::{Azimuths, Cosines, legendre};
use super::depth::{Depth, Rays, Sweeper, accumulate, axpy};

/// Moments of one azimuthal mode and one mirror parity (of l - m).
struct Block {
    m: usize,
    odd: bool,
    /// l of each moment.
    degrees: Vec<usize>,
    /// Where the block begins in a moment vector; inside, `[depth][l]`.
    offset: usize,
    /// P_lm / mu, `[l][i]`: from sources to the right-hand side along rays.
    emit: Vec<f64>,
    /// P_lm x weight, `[i][l]`: from rays to moments.
    collect: Vec<f64>,
}

/// Light that reaches the two surfaces from inside, per ray, before the surface divides it.
pub struct Exits {
    pub top: Rays,
    pub bottom: Rays,
}

/// Sources to fluxes for rays in all directions, with Fresnel reflection inside the surfaces.
///
/// Fields are exp(i 2 pi f_x x) times a series in sqrt(2 - delta_m0) P_lm(mu) cos(m phi) (-i)^m with real
/// coefficients: that phase makes the equations real. psi here is 2 pi x radiance.
pub struct Transport<'a> {
    pub cosines: &'a Cosines,
    azimuths: &'a Azimuths,
    depth: &'a Depth,
    blocks: Vec<Block>,
    sweeper: Sweeper<'a>,
    /// Through a slab: what a ray of strength 1 that enters leaves in the basis, and at the other side.
    through: Option<(Rays, Rays)>,
}

impl<'a> Transport<'a> {
    /// `degree`: the largest l; `kappa` = 2 pi f_x per unit of optical depth.
    pub fn new(
        cosines: &'a Cosines,
        azimuths: &'a Azimuths,
        depth: &'a Depth,
        slab: bool,
        degree: usize,
        kappa: f64,
    ) -> Self {
        let n = cosines.mu.len();
        let complex = kappa > 0.0;
        let mut rate = Rays::zero(0, false);
        for &cos_phi in &azimuths.cos {
            for &mu in &cosines.mu {
                rate.re.push(1.0 / mu);
                if complex {
                    rate.im.push(kappa * ((1.0 - mu) * (1.0 + mu)).sqrt() * cos_phi / mu);
                }
            }
        }
        let sweeper = Sweeper::new(depth, &rate);
        let through = (slab && cosines.rho.iter().any(|&rho| rho > 0.0)).then(|| {
            let (mut inside, mut flow) =
                (Rays::zero(depth.len() * rate.re.len(), complex), Rays::zero(rate.re.len(), complex));
            flow.re.fill(1.0);
            sweeper.down(&mut inside, &mut flow);
            (inside, flow)
        });
        let mut blocks = Vec::new();
        let mut offset = 0;
        for m in 0..azimuths.mode.len() {
            let rows = legendre(degree, m, &cosines.mu);
            for odd in [false, true] {
                let degrees: Vec<usize> = (m + usize::from(odd)..=degree).step_by(2).collect();
                if degrees.is_empty() {
                    continue;
                }
                let emit = degrees.iter().flat_map(|&l| (0..n).map(move |i| (l, i)));
                let collect = (0..n).flat_map(|i| degrees.iter().map(move |&l| (l, i)));
                let block = Block {
                    m,
                    odd,
                    offset,
                    emit: emit.map(|(l, i)| rows[l - m][i] / cosines.mu[i]).collect(),
                    collect: collect.map(|(l, i)| rows[l - m][i] * cosines.weight[i]).collect(),
                    degrees,
                };
                offset += block.degrees.len() * depth.len();
                blocks.push(block);
            }
        }
        Self { cosines, azimuths, depth, blocks, sweeper, through }
    }

    /// Length of a moment vector.
    pub fn len(&self) -> usize {
        self.blocks.iter().map(|b| b.degrees.len()).sum::<usize>() * self.depth.len()
    }

    /// `f(l)` for each entry of a moment vector.
    pub fn by_degree(&self, f: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.len());
        for block in &self.blocks {
            for _ in 0..self.depth.len() {
                out.extend(block.degrees.iter().map(|&l| f(l)));
            }
        }
        out
    }

    /// The axially symmetric moment vector whose l-th row over depth is `f(l, depth)`.
    pub fn axial(&self, f: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let mut out = vec![0.0; self.len()];
        for block in self.blocks.iter().filter(|b| b.m == 0) {
            for z in 0..self.depth.len() {
                for (a, &l) in block.degrees.iter().enumerate() {
                    out[block.offset + z * block.degrees.len() + a] = f(l, z);
                }
            }
        }
        out
    }

    /// Place of the fluence (l = m = 0) at depth coefficient `z` in a moment vector.
    pub fn fluence(&self, z: usize) -> usize {
        // The first block is m = 0, even, and l = 0 its first degree.
        z * self.blocks[0].degrees.len()
    }

    /// Downward and upward value along a line of the moment vector `y`, over depth (psi or source at mu = +-cos of the line), its mean over
    /// azimuth; `moments` are P_l0 of the line's cosine.
    pub fn along(&self, y: &[f64], moments: &[f64]) -> [Vec<f64>; 2] {
        let mut parts = [vec![0.0; self.depth.len()], vec![0.0; self.depth.len()]];
        for block in self.blocks.iter().filter(|b| b.m == 0) {
            for z in 0..self.depth.len() {
                for (a, &l) in block.degrees.iter().enumerate() {
                    let value = moments[l] * y[block.offset + z * block.degrees.len() + a];
                    parts[0][z] += value;
                    parts[1][z] += if block.odd { -value } else { value };
                }
            }
        }
        parts
    }

    /// Mean over azimuth of `f(i, ray)` summed over the hemisphere with the weights of the cosines.
    pub fn over_hemisphere(&self, f: impl Fn(usize, usize) -> f64) -> f64 {
        let n = self.cosines.mu.len();
        let mut sum = 0.0;
        for (p, w_phi) in self.azimuths.weight.iter().enumerate() {
            for i in 0..n {
                sum += w_phi * self.cosines.weight[i] * f(i, p * n + i);
            }
        }
        sum
    }

    /// The flux moments that the source moments `source` cause; into `flux`.
    pub fn apply(&self, source: &[f64], flux: &mut [f64]) -> Exits {
        let [mut down, mut up] = self.emit(source);
        let exits = self.follow(&mut down, &mut up);
        self.collect(&down, &up, flux);
        exits
    }

    fn emit(&self, source: &[f64]) -> [Rays; 2] {
        let (n, depths) = (self.cosines.mu.len(), self.depth.len());
        let rays = n * self.azimuths.cos.len();
        let complex = self.sweeper.complex();
        let [mut down, mut up] = [Rays::zero(depths * rays, complex), Rays::zero(depths * rays, complex)];
        let mut by_mu = vec![0.0; n];
        for block in &self.blocks {
            let width = block.degrees.len();
            let (down, up) = if block.m % 2 == 0 { (&mut down.re, &mut up.re) } else { (&mut down.im, &mut up.im) };
            for z in 0..depths {
                by_mu.fill(0.0);
                let row = &source[block.offset + z * width..][..width];
                accumulate(row, &block.emit, &mut by_mu);
                for (p, &mode) in self.azimuths.mode[block.m].iter().enumerate() {
                    let at = z * rays + p * n..z * rays + (p + 1) * n;
                    axpy(mode, &by_mu, &mut down[at.clone()]);
                    axpy(if block.odd { -mode } else { mode }, &by_mu, &mut up[at]);
                }
            }
        }
        [down, up]
    }

    /// Sources in, fields out, along every ray; Fresnel reflection joins the two hemispheres at the surfaces.
    fn follow(&self, down: &mut Rays, up: &mut Rays) -> Exits {
        let rays = self.cosines.mu.len() * self.azimuths.cos.len();
        let complex = self.sweeper.complex();
        let mut top = Rays::zero(rays, complex);
        self.sweeper.up(up, &mut top);
        let mut bottom = top.clone();
        self.reflect(&mut bottom);
        self.sweeper.down(down, &mut bottom);
        if let Some((inside, across)) = &self.through {
            // Light to and fro between the surfaces: the bottom receives 1 / (1 - rho^2 t^2) of the first arrival.
            for ray in 0..rays {
                let rho = self.cosines.rho[ray % self.cosines.mu.len()];
                let t = across.at(ray);
                let t2 = mul(t, t);
                let arrives = div(bottom.at(ray), (1.0 - rho * rho * t2.0, -rho * rho * t2.1));
                let sent_up = (rho * arrives.0, rho * arrives.1);
                let at_top = mul(t, sent_up);
                bottom.set(ray, arrives);
                top.add(ray, at_top);
                let sent_down = (rho * at_top.0, rho * at_top.1);
                for z in 0..self.depth.len() {
                    let v = inside.at(z * rays + ray);
                    down.add(z * rays + ray, mul(v, sent_down));
                    // The mirrored ray: same strength at the mirrored place.
                    let (place, sign) = self.depth.mirrored(z);
                    let strength = mul(v, sent_up);
                    up.add(place * rays + ray, (sign * strength.0, sign * strength.1));
                }
            }
        }
        Exits { top, bottom }
    }

    fn reflect(&self, flow: &mut Rays) {
        let n = self.cosines.mu.len();
        for part in [&mut flow.re, &mut flow.im] {
            for chunk in part.chunks_mut(n) {
                chunk.iter_mut().zip(&self.cosines.rho).for_each(|(f, rho)| *f *= rho);
            }
        }
    }

    fn collect(&self, down: &Rays, up: &Rays, flux: &mut [f64]) {
        let (n, depths) = (self.cosines.mu.len(), self.depth.len());
        let rays = n * self.azimuths.cos.len();
        flux.fill(0.0);
        let mut by_mu = vec![0.0; n];
        for block in &self.blocks {
            let width = block.degrees.len();
            let (down, up) = if block.m % 2 == 0 { (&down.re, &up.re) } else { (&down.im, &up.im) };
            for z in 0..depths {
                by_mu.fill(0.0);
                for (p, (&mode, &weight)) in self.azimuths.mode[block.m].iter().zip(&self.azimuths.weight).enumerate() {
                    let at = z * rays + p * n..z * rays + (p + 1) * n;
                    axpy(mode * weight, &down[at.clone()], &mut by_mu);
                    axpy(if block.odd { -mode * weight } else { mode * weight }, &up[at], &mut by_mu);
                }
                let row = &mut flux[block.offset + z * width..][..width];
                accumulate(&by_mu, &block.collect, row);
            }
        }
    }
}

fn mul(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn div(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let square = b.0 * b.0 + b.1 * b.1;
    ((a.0 * b.0 + a.1 * b.1) / square, (a.1 * b.0 - a.0 * b.1) / square)
}
