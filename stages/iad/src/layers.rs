//! Layers stacked between two surfaces: what each does to light, joined by adding.
//!
//! Every layer is a matched slab in closed form ([`crate::modes`]) with symmetric matrices R and T in scaled radiance. From
//! the bottom upwards, with B what all below a layer reflects,
//!
//! ```text
//! P = (1 - R B)^-1 T    (light that reaches the layer's bottom),    B' = R + T B P.
//! ```
//! What a layer absorbs is a sum of its own over the light that enters it from either side, not a difference of fluxes.

use turbid_optics::PhaseFunction;

use crate::Error;
use crate::coupling::Coupling;
use crate::forward::{Plan, Response, check_coefficients};
use crate::incidence::Incidence;
use crate::matrix::{Matrix, dot, solve_rows, times, transposed, zeros};
use crate::modes::{Depths, Light, Modes, Sides};
use crate::slab::{Slab, Slide};

/// A homogeneous layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Absorption and reduced scattering coefficient, mm^-1, >= 0.
    pub mu_a_per_mm: f64,
    pub mu_s_prime_per_mm: f64,
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    pub g: f64,
    /// Thickness, mm, > 0; infinity for a half-space.
    pub thickness_mm: f64,
}

/// Where the light goes that falls on a stack.
#[derive(Clone, Debug, PartialEq)]
pub struct Layered {
    /// Of the whole stack.
    pub response: Response,
    /// What each layer absorbs, from the top down, of the stack's light and of diffuse light.
    pub absorbed: Vec<f64>,
    pub absorbed_diffuse: Vec<f64>,
}

/// The forward model of layers of one refractive index, with N quadrature points (4 to 64).
///
/// ```
/// use turbid_iad::{Incidence, Layer, Slide, Stack};
///
/// let stack = Stack::<16>::new(1.4, Slide::NONE, Slide::NONE, Incidence::Normal)?;
/// let epidermis = Layer { mu_a_per_mm: 0.3, mu_s_prime_per_mm: 2.0, g: 0.8, thickness_mm: 0.1 };
/// let dermis = Layer { mu_a_per_mm: 0.02, mu_s_prime_per_mm: 1.5, g: 0.8, thickness_mm: f64::INFINITY };
/// let light = stack.forward(&[epidermis, dermis])?;
/// assert!((light.response.ur1 + light.absorbed[0] + light.absorbed[1] - 1.0).abs() < 1e-12);
/// # Ok::<(), turbid_iad::Error>(())
/// ```
pub struct Stack<const N: usize> {
    /// Of the same directions and surfaces.
    plan: Plan<N>,
}

/// A stack of n > 1 thinner than this is interpolated from the empty one: a straight line is off by the square of it, and the
/// light that is trapped between the surfaces is known to rounding over it.
const THIN: f64 = 1e-7;

/// What one layer does to scaled radiance that enters it on either side.
struct Operators<const N: usize> {
    reflect: Matrix<N>,
    transmit: Matrix<N>,
    absorb: [f64; N],
}

impl<const N: usize> Operators<N> {
    fn new(plan: &Plan<N>, coupling: &Coupling<N>, depths: &Depths) -> Option<Self> {
        if depths.total == 0.0 {
            return Some(Self { reflect: zeros(), transmit: one_less(&zeros()), absorb: [0.0; N] });
        }
        let open = Sides::open();
        let modes = Modes::new(&plan.directions, coupling, &open, depths)?;
        let d = modes.d();
        let (mut reflect, mut transmit, mut absorb) = (zeros(), zeros(), [0.0; N]);
        for i in 0..N {
            let mut unit = [0.0; N];
            unit[i] = 1.0;
            let light = modes.amplitudes(&open, &unit);
            // (s - d) / 2 at the top, the condition of the open bottom put in: odd s less even d.
            let mut up = modes.radiance(&light.odd);
            for j in 0..N {
                let slope = modes.even[j] * light.even[j];
                for (up, d) in up.iter_mut().zip(&d[j]) {
                    *up -= slope * d;
                }
            }
            reflect[i] = up;
            transmit[i] = modes.radiance(&light.far);
            absorb[i] = dot(&modes.absorbed, &light.even);
        }
        Some(Self { reflect, transmit, absorb })
    }
}

/// A layer in its place: light at its bottom from light at its top, and what all below reflects.
struct Placed<const N: usize> {
    absorb: [f64; N],
    onward: Matrix<N>,
    below: Matrix<N>,
}

impl<const N: usize> Stack<N> {
    /// Of refractive index `n` between these slides, under this light. Fails on an index below 1 and an angle out of range.
    pub fn new(n: f64, top: Slide, bottom: Slide, light: Incidence) -> Result<Self, Error> {
        Ok(Self { plan: Plan::lit(&Slab { top, bottom, ..Slab::bare(n, 0.0, 1.0) }, light)? })
    }

    /// The response of these layers, the first one on top. Fails on a layer that cannot be.
    pub fn forward(&self, layers: &[Layer]) -> Result<Layered, Error> {
        for layer in layers {
            check_coefficients(layer.mu_a_per_mm, layer.mu_s_prime_per_mm)?;
            Slab::bare(1.0, layer.g, layer.thickness_mm).check()?;
        }
        self.respond(layers).ok_or(Error::Unresolved { points: N })
    }

    fn respond(&self, layers: &[Layer]) -> Option<Layered> {
        let plan = &self.plan;
        let mut couplings: Vec<Coupling<N>> = Vec::new();
        let mut coupled = Vec::new();
        for (i, layer) in layers.iter().enumerate() {
            let known = layers[..i].iter().position(|earlier| earlier.g == layer.g);
            coupled.push(known.map_or(couplings.len(), |earlier| coupled[earlier]));
            if known.is_none() {
                let coupling = Coupling::new(&plan.directions, &PhaseFunction::henyey_greenstein(layer.g));
                coupling.is_resolved(&plan.directions).then_some(())?;
                couplings.push(coupling);
            }
        }
        let mut depths: Vec<Depths> = layers
            .iter()
            .zip(&coupled)
            .map(|(l, &c)| Depths::new(l.mu_a_per_mm, l.mu_s_prime_per_mm, l.g, couplings[c].rest, l.thickness_mm))
            .collect();
        let tau = depths.iter().fold(0.0, |sum, d| sum + d.tau);
        let total = depths.iter().fold(0.0, |sum, d| sum + d.total);
        // As in one slab: trapped light makes the system singular, so a thin stack is interpolated from the empty one.
        let thin = plan.slab().n > 1.0 && total < THIN;
        if thin {
            depths.iter_mut().for_each(|d| d.total *= if total > 0.0 { THIN / total } else { 0.0 });
        }
        let incident = [plan.incident(), plan.diffuse()];
        let empty = incident.map(|x| Light::through_empty(&plan.directions, &plan.sides, &x));
        let mut absorbed = vec![[0.0; 2]; layers.len()];
        let mut found = empty;
        if total > 0.0 {
            let operators: Option<Vec<_>> =
                depths.iter().zip(&coupled).map(|(d, &c)| Operators::new(plan, &couplings[c], d)).collect();
            let (placed, above) = self.place(&operators?)?;
            for (k, incident) in incident.iter().enumerate() {
                found[k] = self.send(&placed, &above, incident, |layer, x| absorbed[layer][k] = x)?;
            }
        }
        if thin {
            let share = total / THIN;
            for k in 0..2 {
                found[k] = empty[k].towards(&found[k], share);
                absorbed.iter_mut().for_each(|x| x[k] *= share);
            }
        }
        let all = |k: usize| absorbed.iter().fold(0.0, |sum, x| sum + x[k]);
        let [light, diffuse] = [0, 1].map(|k| Light { absorbed: all(k), ..found[k] });
        Some(Layered {
            response: plan.response(tau, light, diffuse),
            absorbed: absorbed.iter().map(|x| x[0]).collect(),
            absorbed_diffuse: absorbed.iter().map(|x| x[1]).collect(),
        })
    }

    /// The layers in their places, and what they reflect together.
    fn place(&self, layers: &[Operators<N>]) -> Option<(Vec<Placed<N>>, Matrix<N>)> {
        let mut below: Matrix<N> = zeros();
        for (i, surface) in self.plan.sides.bottom.iter().enumerate() {
            below[i][i] = surface.inside;
        }
        let mut placed = Vec::new();
        for layer in layers.iter().rev() {
            // Rows of P^T: T is symmetric, so its rows are the columns to solve for.
            let onward_rows = solve_rows(one_less(&times(&layer.reflect, &below)), layer.transmit)?;
            let onward = transposed(&onward_rows);
            let back = times(&layer.transmit, &times(&below, &onward));
            placed.push(Placed { absorb: layer.absorb, onward, below });
            below = std::array::from_fn(|i| std::array::from_fn(|j| layer.reflect[i][j] + back[i][j]));
        }
        placed.reverse();
        Some((placed, below))
    }

    fn send(
        &self,
        placed: &[Placed<N>],
        stack: &Matrix<N>,
        incident: &[f64; N],
        mut absorbed: impl FnMut(usize, f64),
    ) -> Option<Light> {
        let sides = &self.plan.sides;
        let echo: Matrix<N> = std::array::from_fn(|i| std::array::from_fn(|j| sides.top[i].inside * stack[i][j]));
        let mut rows = zeros();
        rows[0] = *incident;
        let mut down = solve_rows(one_less(&echo), rows)?[0];
        let up = apply(stack, &down);
        let root = &self.plan.directions.flux_root;
        let flux =
            |x: &[f64; N], through: &dyn Fn(usize) -> f64| (0..N).fold(0.0, |sum, i| sum + root[i] * through(i) * x[i]);
        let reflected = flux(&up, &|i| sides.top[i].through);
        for (i, layer) in placed.iter().enumerate() {
            let bottom = apply(&layer.onward, &down);
            let back = apply(&layer.below, &bottom);
            absorbed(i, dot(&layer.absorb, &down) + dot(&layer.absorb, &back));
            down = bottom;
        }
        Some(Light { reflected, transmitted: flux(&down, &|i| sides.bottom[i].through), absorbed: 0.0 })
    }
}

fn one_less<const N: usize>(a: &Matrix<N>) -> Matrix<N> {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)) - a[i][j]))
}

fn apply<const N: usize>(a: &Matrix<N>, x: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| dot(&a[i], x))
}
