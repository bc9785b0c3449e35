//! Radiative transport: reflectance of a half-space or a slab under a normally incident, spatially modulated plane wave.
//!
//! Method (`docs/theory/rte.md`): Galerkin in depth with orthonormal exponentials (half-space) or upwind Legendre cells
//! (slab), rays in quadrature directions with Fresnel's surfaces, sources as delta-M moments, GMRES over the orders
//! of scattering, the last collision towards the camera with the exact phase function.

mod acceleration;
mod angles;
mod depth;
mod gmres;
mod line;
mod orders;
mod spectrum;
mod transport;

pub use orders::Orders;

use std::f64::consts::{PI, TAU};

use acceleration::Acceleration;
use angles::{Azimuths, Cosines};
use depth::{Depth, Rays, Sweeper};
use line::Line;
use transport::Transport;

use crate::diffusion::{a_robin, check_f_x};
use crate::fresnel::normal_reflectance;
use crate::{Error, Medium, PhaseFunction, Reflectance};

/// What a half-space or a slab in vacuum does with the light that falls on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    pub reflectance: Reflectance,
    /// Power that leaves at the far side / power incident, unscattered light included; 0 for a half-space.
    pub transmittance: f64,
}

/// Reflectance of a half-space (`thickness` `None`) or of a slab with the same outside on both sides, `thickness` in mm.
///
/// `f_x_per_mm` >= 0 is the spatial frequency of the incident plane wave. Absolute error below 1e-5 for |g| <= 0.9 in
/// about a millisecond; for |g| up to 0.99 some 1e-5 (the camera's up to 1e-4) in a tenth of a second, beyond slower still. A slab's hemispherical values hold the unscattered light that its far side reflects, `camera` does not
/// (it is a collimated beam, not a radiance).
///
/// Errors: a property out of range; iterations that do not converge.
pub fn reflectance(medium: &Medium, thickness: Option<f64>, f_x_per_mm: f64) -> Result<Reflectance, Error> {
    Ok(respond(medium, thickness, f_x_per_mm)?.reflectance)
}

/// As [`reflectance`], with the transmittance.
pub fn respond(medium: &Medium, thickness: Option<f64>, f_x_per_mm: f64) -> Result<Response, Error> {
    medium.check()?;
    check_f_x(f_x_per_mm)?;
    if let Some(d) = thickness {
        Error::unless(d > 0.0 && d.is_finite(), "thickness", d, "mm", "be a finite number > 0")?;
    }
    if medium.mu_s_prime == 0.0 {
        return Ok(clear(medium, thickness));
    }
    solvable(&medium.phase, medium.n)?;
    if thickness.is_none() {
        // To first order in its depth, light that is spread by a coarse pattern is as good as absorbed:
        // mu_eff^2 = 3 mu_a mu_s' + (2 pi f_x)^2.
        let q = TAU * (f_x_per_mm / medium.mu_s_prime);
        let loss = medium.mu_a / medium.mu_s_prime + q * q / 3.0;
        if loss < NEARLY_CONSERVATIVE {
            return nearly_conservative(medium, loss);
        }
    }
    if let Some(d) = thickness
        && medium.mu_t() * d < THIN
    {
        return thin(medium, d, f_x_per_mm);
    }
    let optical = Optical::new(medium, thickness, f_x_per_mm, Orders::degree(&medium.phase, medium.n));
    let orders = Orders::new(&medium.phase, medium.n, optical.kappa);
    solve(&optical, &orders)
}

/// As [`reflectance`], for light at the cosine `light` and a camera at the cosine `view` to the normal, both outside and in (0, 1].
///
/// Averaged over the azimuth between the two, and over that of the fringes: exact along the normal; elsewhere the displacement of the fringe with depth
/// (a shift of its phase, and of second order in its modulus) is left out. Meant for what an oblique line changes, see `docs/theory/conditions.md`.
///
/// Errors: as [`reflectance`]; a cosine out of range.
pub fn oblique(
    medium: &Medium,
    thickness: Option<f64>,
    f_x_per_mm: f64,
    [light, view]: [f64; 2],
) -> Result<Reflectance, Error> {
    for (name, cos) in [("cosine of the light", light), ("cosine of the view", view)] {
        Error::unless(cos > 0.0 && cos <= 1.0, name, cos, "", "lie in (0, 1]")?;
    }
    if light == 1.0 && view == 1.0 || medium.mu_s_prime == 0.0 {
        return reflectance(medium, thickness, f_x_per_mm);
    }
    medium.check()?;
    check_f_x(f_x_per_mm)?;
    solvable(&medium.phase, medium.n)?;
    // A medium that loses next to nothing is taken to lose a little: R changes by the square root of it, 3e-5.
    let medium = Medium { mu_a: medium.mu_a.max(NEARLY_CONSERVATIVE * medium.mu_s_prime), ..*medium };
    let optical = Optical::new(&medium, thickness, f_x_per_mm, Orders::degree(&medium.phase, medium.n));
    let lines = [light, view].map(|cos| Line::new(medium.n, optical.beta.len() - 1, cos));
    Ok(solve_along(&optical, &Orders::new(&medium.phase, medium.n, optical.kappa), &lines)?.reflectance)
}

/// Below this optical thickness a slab's response is linear in it to double precision.
const THIN: f64 = 1e-9;

/// A slab so thin that its cells would underflow: the straight line from no slab to one of optical thickness [`THIN`].
fn thin(medium: &Medium, thickness: f64, f_x_per_mm: f64) -> Result<Response, Error> {
    let share = medium.mu_t() * thickness / THIN;
    // The same slab of 1 mm, so that a medium of 1e-300 mm^-1 has a solvable twin.
    let dense = THIN / medium.mu_t();
    let twin = Medium { mu_a: medium.mu_a * dense, mu_s_prime: medium.mu_s_prime * dense, ..*medium };
    let end = respond_with(&twin, Some(1.0), f_x_per_mm * thickness / share, |kappa| {
        Orders::new(&medium.phase, medium.n, kappa)
    })?;
    let start = clear(&Medium { mu_a: 0.0, ..*medium }, Some(thickness));
    let between = |a: f64, b: f64| a + share * (b - a);
    let (a, b) = (start.reflectance, end.reflectance);
    Ok(Response {
        reflectance: Reflectance {
            camera: between(a.camera, b.camera),
            hemispherical_incident: between(a.hemispherical_incident, b.hemispherical_incident),
            hemispherical_entered: between(a.hemispherical_entered, b.hemispherical_entered),
        },
        transmittance: between(start.transmittance, end.transmittance),
    })
}

/// Beyond this kappa the pattern is finer than the mean free path and the source has a boundary layer.
const FINE: f64 = 2.0;

/// Below this loss, mu_eff^2 / (3 mu_s'^2), a half-space is extrapolated: its light goes deeper than 1e4 / mu_s'.
const NEARLY_CONSERVATIVE: f64 = 1e-9;

/// A half-space that loses next to nothing to absorption and to the pattern.
///
/// Its response is analytic in x = sqrt(loss): a parabola through three solvable x, x^3 being below 1e-11. Without
/// any loss all that entered comes back.
fn nearly_conservative(medium: &Medium, loss: f64) -> Result<Response, Error> {
    let x = loss.sqrt();
    let nodes = [1.0, 2.0, 3.0].map(|factor| factor * NEARLY_CONSERVATIVE.sqrt());
    let (mut camera, mut entered) = (0.0, 0.0);
    for (i, node) in nodes.iter().enumerate() {
        let weight: f64 =
            nodes.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, other)| (x - other) / (node - other)).product();
        let at_node = reflectance(&Medium { mu_a: node * node * medium.mu_s_prime, ..*medium }, None, 0.0)?;
        camera += weight * at_node.camera;
        entered += weight * at_node.hemispherical_entered;
    }
    if loss == 0.0 {
        entered = 1.0;
    }
    let hemispherical_incident = (1.0 - normal_reflectance(medium.n)) * entered;
    let reflectance = Reflectance { camera, hemispherical_incident, hemispherical_entered: entered };
    Ok(Response { reflectance, transmittance: 0.0 })
}

/// Error: the phase function's peak is so narrow that its moments are too many to solve for.
pub fn solvable(phase: &PhaseFunction, n: f64) -> Result<(), Error> {
    let rule =
        "lie within +-0.999 for the transport solver (+-0.99 if negative): a narrower peak takes too many moments";
    phase.check()?;
    let [(_, forward), (_, backward)] = phase.terms();
    let names = match phase {
        PhaseFunction::HenyeyGreenstein { .. } => ["g", "g"],
        PhaseFunction::TwoTermHenyeyGreenstein { .. } => ["g_forward", "g_backward"],
    };
    for (name, g) in names.into_iter().zip([forward, backward]) {
        Error::unless(Orders::degree(&PhaseFunction::henyey_greenstein(g), n) <= 1000, name, g, "", rule)?;
    }
    Ok(())
}

/// The phase function over that of isotropic scattering.
fn over_isotropic(phase: &PhaseFunction, cos: f64) -> f64 {
    let [forward, backward] = phase.terms().map(|(share, g)| {
        let base = 1.0 + g * g - 2.0 * g * cos;
        share * ((1.0 - g * g) / (base * base.sqrt()))
    });
    forward + backward
}

/// As [`respond`], with orders of one's own as a function of kappa = 2 pi f_x per optical depth: what
/// `benches/rte.rs --orders` compares. The degree is that at kappa = 0.
pub fn respond_with(
    medium: &Medium,
    thickness: Option<f64>,
    f_x_per_mm: f64,
    orders: impl Fn(f64) -> Orders,
) -> Result<Response, Error> {
    medium.check()?;
    check_f_x(f_x_per_mm)?;
    let optical = Optical::new(medium, thickness, f_x_per_mm, orders(0.0).degree);
    solve(&optical, &orders(optical.kappa))
}

/// A medium in units of its delta-M scaled optical depth.
struct Optical {
    albedo: f64,
    /// Legendre moments of the scaled phase function.
    beta: Vec<f64>,
    /// Exact less truncated phase function, times the albedo, forward and backward: what the last collision adds.
    excess: [f64; 2],
    /// The exact phase function, and the share of it that counts as no deflection.
    phase: PhaseFunction,
    peak: f64,
    /// 2 pi f_x.
    kappa: f64,
    thickness: Option<f64>,
    n: f64,
}

impl Optical {
    fn new(medium: &Medium, thickness: Option<f64>, f_x: f64, degree: usize) -> Self {
        let Medium { phase, n, .. } = *medium;
        let albedo = medium.albedo();
        // delta-M: the part g^(L + 1) of the scattering is taken as no deflection at all. A backward peak (g < 0) must
        // not be moved forward: there the moments are cut.
        let forward = |(share, g): (f64, f64)| if g > 0.0 { share * libm::pow(g, (degree + 1) as f64) } else { 0.0 };
        let peak = phase.terms().into_iter().map(forward).fold(0.0, |sum, x| sum + x);
        let scale = 1.0 - albedo * peak;
        let beta: Vec<f64> = (0..=degree).map(|l| (phase.moment(l) - peak) / (1.0 - peak)).collect();
        let scaled_albedo = albedo * (1.0 - peak) / scale;
        let excess = [1.0, -1.0].map(|cos| {
            let truncated: f64 =
                beta.iter().enumerate().map(|(l, b)| (2 * l + 1) as f64 * b * if l % 2 == 0 { 1.0 } else { cos }).sum();
            scaled_albedo * (over_isotropic(&phase, cos) / (1.0 - peak) - truncated)
        });
        let per_mm = medium.mu_t() * scale;
        Self {
            albedo: scaled_albedo,
            beta,
            excess,
            phase,
            peak,
            // A yet finer pattern changes no convention by more than 1e-9: what the camera sees is at its limit, the
            // rest fades as 1 / kappa.
            kappa: (TAU * f_x / per_mm).min(1e10),
            thickness: thickness.map(|d| d * per_mm),
            n,
        }
    }

    /// The basis over depth, and whether it is a slab's.
    fn depth(&self) -> (Depth, bool) {
        // Decay rates in the plane wave's frame: a mode of rate k tilts to sqrt(k^2 + kappa^2).
        let tilted = |k: f64| (k * k + self.kappa * self.kappa).sqrt();
        let slow = spectrum::slow_rates(self.albedo, &self.beta, 2);
        let slowest = tilted(slow.first().copied().unwrap_or(1.0));
        match self.thickness {
            // exp(-40): the far side is out of reach of double precision.
            Some(tau) if tau * slowest < 40.0 => (Depth::slab(&orders::cells(tau, self.kappa), 6), true),
            _ => {
                let next = tilted(slow.get(1).copied().unwrap_or(1.0));
                (Depth::half_space(&orders::rates(slowest, next, self.kappa)), false)
            }
        }
    }
}

fn solve(optical: &Optical, orders: &Orders) -> Result<Response, Error> {
    let normal = || Line::new(optical.n, optical.beta.len() - 1, 1.0);
    solve_along(optical, orders, &[normal(), normal()])
}

/// Along the lines of light and of view.
fn solve_along(optical: &Optical, orders: &Orders, [light, view]: &[Line; 2]) -> Result<Response, Error> {
    let (depth, slab) = optical.depth();
    let cosines = Cosines::new(optical.n, orders.cosines, optical.kappa > FINE);
    let degree = optical.beta.len() - 1;
    let modes = if optical.kappa == 0.0 { 1 } else { orders.modes.clamp(1, degree + 1) };
    let azimuths = Azimuths::new(modes, orders.azimuths.max(1), optical.kappa);
    let transport = Transport::new(&cosines, &azimuths, &depth, slab, degree, optical.kappa);

    let beam = Beam::new(&depth, slab, light);
    let once = transport.axial(|l, z| {
        let up = if l % 2 == 0 { beam.up[z] } else { -beam.up[z] };
        optical.albedo * optical.beta[l] * light.moments[l] * (beam.down[z] + up)
    });
    let scatter = transport.by_degree(|l| optical.albedo * optical.beta[l]);
    let mut first = vec![0.0; once.len()];
    transport.apply(&once, &mut first);
    let mut source = vec![0.0; once.len()];
    let g = optical.beta.get(1).copied().unwrap_or(0.0);
    let acceleration = Acceleration::new(&depth, optical.albedo, g, optical.kappa, a_robin(optical.n));
    let flux = gmres::solve_fixed_point(
        &first,
        |x, y| {
            source.iter_mut().zip(x).zip(&scatter).for_each(|((s, x), c)| *s = c * x);
            transport.apply(&source, y);
        },
        |x| acceleration.apply(x, |z| transport.fluence(z)),
        orders.tolerance,
        400,
    )
    .map_err(|residual| Error::NotConverged { what: "transport equation", residual, wanted: orders.tolerance })?;

    let all: Vec<f64> = once.iter().zip(&flux).zip(&scatter).map(|((q, x), c)| q + c * x).collect();
    let exits = transport.apply(&all, &mut source);
    let leaves =
        |exit: &Rays| transport.over_hemisphere(|i, ray| cosines.mu[i] * (1.0 - cosines.rho[i]) * exit.re[ray]);
    // Towards the camera the last collision sees the exact phase function (Nakajima and Tanaka's TMS correction).
    let [mut down, mut up] = transport.along(&all, &view.moments);
    let [forward, backward] = line::excess(optical, light, view).map(|excess| 0.5 * excess);
    for z in 0..depth.len() {
        down[z] += forward * beam.down[z] + backward * beam.up[z];
        up[z] += backward * beam.down[z] + forward * beam.up[z];
    }
    let radiance = leave_along(&depth, slab, view, down, up) / TAU;

    let enters = 1.0 - light.rho;
    let entered = leaves(&exits.top) + beam.back;
    Ok(Response {
        reflectance: Reflectance {
            camera: PI * enters * (1.0 - view.rho) / (optical.n * optical.n) * radiance,
            hemispherical_incident: enters * entered,
            hemispherical_entered: entered,
        },
        transmittance: if slab { enters * (leaves(&exits.bottom) + beam.through) } else { 0.0 },
    })
}

/// The unscattered beam of unit power that entered, to and fro in a slab.
struct Beam {
    /// Along the beam: power over the cosine.
    down: Vec<f64>,
    up: Vec<f64>,
    /// Power that leaves at the top and at the bottom.
    back: f64,
    through: f64,
}

impl Beam {
    fn new(depth: &Depth, slab: bool, line: &Line) -> Self {
        let (mut down, mut flow, r) = (Rays::zero(depth.len(), false), real(1.0), line.rho);
        Sweeper::new(depth, &real(1.0 / line.cos)).down(&mut down, &mut flow);
        let mut beam = Self { down: down.re, up: vec![0.0; depth.len()], back: 0.0, through: 0.0 };
        if slab {
            let t = flow.re[0];
            let again = 1.0 / (1.0 - r * r * t * t);
            for z in 0..depth.len() {
                let (place, sign) = depth.mirrored(z);
                beam.up[place] = sign * again * r * t * beam.down[z];
            }
            beam.down.iter_mut().for_each(|x| *x *= again);
            beam.back = again * (1.0 - r) * r * t * t;
            beam.through = again * (1.0 - r) * t;
        }
        beam.down.iter_mut().chain(&mut beam.up).for_each(|x| *x /= line.cos);
        beam
    }
}

fn real(value: f64) -> Rays {
    Rays { re: vec![value], im: Vec::new() }
}

/// What reaches the top along the line from sources `down` and `up` over depth, reflections at the surfaces included.
fn leave_along(depth: &Depth, slab: bool, line: &Line, mut down: Vec<f64>, mut up: Vec<f64>) -> f64 {
    let (sweeper, r) = (Sweeper::new(depth, &real(1.0 / line.cos)), line.rho);
    down.iter_mut().chain(&mut up).for_each(|x| *x /= line.cos);
    let mut top = real(0.0);
    sweeper.up(&mut Rays { re: up, im: Vec::new() }, &mut top);
    if !slab {
        return top.re[0];
    }
    let mut bottom = real(r * top.re[0]);
    sweeper.down(&mut Rays { re: down, im: Vec::new() }, &mut bottom);
    let mut across = real(1.0);
    sweeper.down(&mut Rays::zero(depth.len(), false), &mut across);
    let t = across.re[0];
    top.re[0] + t * r * bottom.re[0] / (1.0 - r * r * t * t)
}

/// A medium that does not scatter.
fn clear(medium: &Medium, thickness: Option<f64>) -> Response {
    let r = normal_reflectance(medium.n);
    let (mut back, mut through) = (0.0, 0.0);
    if let Some(d) = thickness {
        let t = libm::exp(-medium.mu_a * d);
        let again = 1.0 / (1.0 - r * r * t * t);
        back = again * (1.0 - r) * r * t * t;
        through = again * (1.0 - r) * t;
    }
    Response {
        reflectance: Reflectance { camera: 0.0, hemispherical_incident: (1.0 - r) * back, hemispherical_entered: back },
        transmittance: (1.0 - r) * through,
    }
}
