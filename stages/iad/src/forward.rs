//! Reflectance and transmittance of a scattering slab.

use crate::Error;
use crate::angles::Directions;
use crate::coupling::Coupling;
use crate::incidence::Incidence;
use crate::modes::{Depths, Light, Modes, Sides};
use crate::slab::{Slab, Surface, unscattered, unscattered_slope};
use crate::tangent::Tangent;

/// Where the light that falls on the top of a slab goes, as fractions; specular reflection included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// Total reflectance and transmittance for the light of the plan, by default a beam along the normal.
    pub ur1: f64,
    pub ut1: f64,
    /// Total reflectance and transmittance for diffuse (Lambertian) light.
    pub uru: f64,
    pub utu: f64,
    /// The part of `ur1` and of `ut1` that was never scattered.
    pub ur1_unscattered: f64,
    pub ut1_unscattered: f64,
    /// Absorbed in the slab (not in slides), of the plan's and of diffuse light; relative accuracy kept however small.
    pub absorbed: f64,
    pub absorbed_diffuse: f64,
}

/// The forward model with N quadrature points (4 to 64): all that depends on the slab but not on its coefficients.
pub struct Plan<const N: usize> {
    slab: Slab,
    light: Incidence,
    pub(crate) directions: Directions<N>,
    coupling: Coupling<N>,
    pub(crate) sides: Sides<N>,
    /// Share of diffuse light, and of the plan's, that the top reflects before it enters.
    diffuse_outside: f64,
    outside: f64,
}

/// A slab of n > 1 thinner than this is interpolated.
const THIN: f64 = 1e-9;

/// What becomes of the plan's light.
pub(crate) struct Beam {
    /// R, T, absorbed.
    pub read: [f64; 3],
    /// Their derivatives by ln mu_a and by ln mu_s'.
    pub by_logarithms: [[f64; 3]; 2],
}

impl<const N: usize> Plan<N> {
    const CHECKED: () = assert!(N >= 4 && N <= 64, "4 to 64 quadrature points");

    /// For a beam along the normal. Fails on a slab that cannot be: n < 1, |g| >= 1, a thickness that is not above 0.
    pub fn new(slab: &Slab) -> Result<Self, Error> {
        Self::lit(slab, Incidence::Normal)
    }

    /// For this light; also fails on an angle out of range.
    pub fn lit(slab: &Slab, light: Incidence) -> Result<Self, Error> {
        const { Self::CHECKED };
        slab.check()?;
        let light = light.checked()?;
        let directions = Directions::<N>::new(slab.n, light);
        let coupling = Coupling::new(&directions, &slab.phase);
        if !coupling.is_resolved(&directions) {
            return Err(Error::Unresolved { points: N });
        }
        let sides = Sides::new(&directions, slab.top, slab.bottom);
        let diffuse_outside = (0..N)
            .filter(|&i| sides.top[i].through > 0.0 && directions.counted[i] > 0.0)
            .map(|i| 2.0 * slab.n * slab.n * directions.cosines[i] * directions.weights[i] * sides.top[i].outside)
            .fold(0.0, |sum, x| sum + x);
        let outside = directions.over_incident(|i| sides.top[i].outside);
        Ok(Self { slab: *slab, light, directions, coupling, sides, diffuse_outside, outside })
    }

    pub fn slab(&self) -> &Slab {
        &self.slab
    }

    pub fn incidence(&self) -> Incidence {
        self.light
    }

    /// The response at the coefficients mu_a and mu_s' = mu_s (1 - g), mm^-1, both >= 0.
    pub fn forward(&self, mu_a: f64, mu_s_prime: f64) -> Result<Response, Error> {
        check_coefficients(mu_a, mu_s_prime)?;
        self.respond(self.depths(mu_a, mu_s_prime)).ok_or(Error::Unresolved { points: N })
    }

    /// The response and the derivatives of each of its fields by mu_a and by mu_s', mm.
    ///
    /// Exact derivatives of what [`Self::forward`] computes: by the logarithm of either coefficient to 1e-12 and 1e-9 of the
    /// larger of the two; those of what is absorbed are the balance of the others. d ln(R) / d mu_a is the mean path of the reflected light, with its sign.
    pub fn forward_jac(&self, mu_a: f64, mu_s_prime: f64) -> Result<(Response, [Response; 2]), Error> {
        check_coefficients(mu_a, mu_s_prime)?;
        self.respond_with_slopes_per_mm(mu_a, mu_s_prime).ok_or(Error::Unresolved { points: N })
    }

    /// The response at albedo mu_s / (mu_a + mu_s) in [0, 1] and optical thickness `tau` in [0, infinity], whatever the
    /// slab's thickness in mm.
    pub fn forward_optical(&self, albedo: f64, tau: f64) -> Result<Response, Error> {
        if !(0.0..=1.0).contains(&albedo) {
            return Err(Error::Range { name: "albedo", value: albedo, must: "lie in [0, 1]" });
        }
        if tau < 0.0 || tau.is_nan() {
            return Err(Error::Range { name: "tau", value: tau, must: "be >= 0" });
        }
        let scatter = albedo * self.coupling.rest;
        let sum = (1.0 - albedo) + scatter;
        let total = if tau == 0.0 { 0.0 } else { tau * sum };
        self.respond(Depths { absorb: (1.0 - albedo) / sum, scatter: scatter / sum, total, tau })
            .ok_or(Error::Unresolved { points: N })
    }

    pub(crate) fn depths(&self, mu_a: f64, mu_s_prime: f64) -> Depths {
        let d = self.slab.thickness_mm;
        Depths::new(mu_a, mu_s_prime, self.slab.phase.g(), self.coupling.rest, d)
    }

    /// A half-space with mu_a / mu_s' = `ratio`.
    pub(crate) fn half_space(&self, ratio: f64) -> Depths {
        Depths { total: f64::INFINITY, tau: f64::INFINITY, ..self.depths(ratio, 1.0) }
    }

    /// `None` where the quadrature fails, as for all that follows from it.
    pub(crate) fn respond(&self, depths: Depths) -> Option<Response> {
        let [light, diffuse] = self.light(&depths, [self.incident(), self.diffuse()])?;
        Some(self.response(depths.tau, light, diffuse))
    }

    /// Of an optical thickness `tau` in all.
    pub(crate) fn response(&self, tau: f64, light: Light, diffuse: Light) -> Response {
        let (ur1_unscattered, ut1_unscattered) = self.unscattered(tau);
        Response {
            ur1: self.outside + light.reflected,
            ut1: light.transmitted,
            uru: self.diffuse_outside + diffuse.reflected,
            utu: diffuse.transmitted,
            ur1_unscattered,
            ut1_unscattered,
            absorbed: light.absorbed,
            absorbed_diffuse: diffuse.absorbed,
        }
    }

    /// (share, cosine, top, bottom) of each direction that the plan's light has in the slab.
    pub(crate) fn beams(&self) -> impl Iterator<Item = (f64, f64, Surface, Surface)> {
        let Directions { incident, cosines, .. } = &self.directions;
        let lit = (0..N).filter(|&i| incident[i] > 0.0);
        lit.map(|i| (incident[i], cosines[i], self.sides.top[i], self.sides.bottom[i]))
    }

    /// (reflected, transmitted) fractions of the plan's light that is never scattered.
    pub(crate) fn unscattered(&self, tau: f64) -> (f64, f64) {
        let at = |i: usize| unscattered(&self.slab, self.directions.cosines[i], tau);
        (self.directions.over_incident(|i| at(i).0), self.directions.over_incident(|i| at(i).1))
    }

    /// Their derivatives by tau.
    pub(crate) fn unscattered_slope(&self, tau: f64) -> (f64, f64) {
        let at = |i: usize| unscattered_slope(&self.slab, self.directions.cosines[i], tau);
        (self.directions.over_incident(|i| at(i).0), self.directions.over_incident(|i| at(i).1))
    }

    /// [UR1, UT1, absorbed].
    pub(crate) fn respond_to_beam(&self, depths: Depths) -> Option<[f64; 3]> {
        let [light] = self.light(&depths, [self.incident()])?;
        Some([self.outside + light.reflected, light.transmitted, light.absorbed])
    }

    fn light<const K: usize>(&self, depths: &Depths, incident: [[f64; N]; K]) -> Option<[Light; K]> {
        let through = |depths: &Depths| {
            let modes = Modes::new(&self.directions, &self.coupling, &self.sides, depths)?;
            let light = |x: &[f64; N]| modes.light(&self.directions, &self.sides, &modes.amplitudes(&self.sides, x));
            Some(incident.map(|x| light(&x)))
        };
        if !self.is_thin(depths) {
            return through(depths);
        }
        let mut found = through(&Depths { total: THIN, ..*depths })?;
        for (light, incident) in found.iter_mut().zip(&incident) {
            *light = self.thinned(light, incident, depths.total / THIN);
        }
        Some(found)
    }

    fn is_thin(&self, depths: &Depths) -> bool {
        self.slab.n > 1.0 && depths.total < THIN
    }

    /// Light beyond the critical angle has no way out of an empty slab, so the systems become singular: a straight line
    /// between the empty slab and a thin one, exact to the square of its depth.
    fn thinned(&self, thin: &Light, incident: &[f64; N], share: f64) -> Light {
        Light::through_empty(&self.directions, &self.sides, incident).towards(thin, share)
    }

    /// [`Self::respond_to_beam`] with its derivatives.
    pub(crate) fn beam_with_slopes(&self, depths: Depths) -> Option<Beam> {
        let ([light], slopes) = self.light_with_slopes(&depths, [self.incident()])?;
        let thinner = depths.total / depths.total.max(THIN);
        let [a, s] = [depths.absorb * thinner, depths.scatter * thinner];
        let by_logarithms = [slopes[0][0].map(|x| a * x), slopes[1][0].map(|x| s * x)];
        Some(Beam { read: [self.outside + light.reflected, light.transmitted, light.absorbed], by_logarithms })
    }

    /// [`Self::respond`] with its derivatives by mu_a d and mu_s' d.
    pub(crate) fn respond_with_slopes(&self, depths: Depths) -> Option<(Response, [Response; 2])> {
        let share = self.coupling.rest / (1.0 - self.slab.phase.g());
        let sum = depths.total.max(THIN);
        self.response_with_slopes(depths, [1.0 / sum, share / sum], 1.0)
    }

    fn respond_with_slopes_per_mm(&self, mu_a: f64, mu_s_prime: f64) -> Option<(Response, [Response; 2])> {
        let d = self.slab.thickness_mm;
        let share = self.coupling.rest / (1.0 - self.slab.phase.g());
        let sum = (mu_a + mu_s_prime * share).max(THIN / d);
        self.response_with_slopes(self.depths(mu_a, mu_s_prime), [1.0 / sum, share / sum], d)
    }

    /// `per`: the unknown's share of the depth, over the whole depth; `thickness` that of tau.
    fn response_with_slopes(&self, depths: Depths, per: [f64; 2], thickness: f64) -> Option<(Response, [Response; 2])> {
        let ([light, diffuse], slopes) = self.light_with_slopes(&depths, [self.incident(), self.diffuse()])?;
        let by_tau = self.unscattered_slope(depths.tau);
        let slopes = std::array::from_fn(|i| {
            let [light, diffuse] = slopes[i].map(|s| s.map(|x| x * per[i]));
            let tau = if i == 0 { thickness } else { thickness / (1.0 - self.slab.phase.g()) };
            // No light is left of an infinite tau: 0 times its thickness is 0.
            let unscattered = |slope: f64| if slope == 0.0 { 0.0 } else { slope * tau };
            Response {
                ur1: light[0],
                ut1: light[1],
                absorbed: light[2],
                uru: diffuse[0],
                utu: diffuse[1],
                absorbed_diffuse: diffuse[2],
                ur1_unscattered: unscattered(by_tau.0),
                ut1_unscattered: unscattered(by_tau.1),
            }
        });
        Some((self.response(depths.tau, light, diffuse), slopes))
    }

    /// Light with the derivatives of R, T and what is absorbed, by the depth of absorption and that of scattering outside the
    /// peak, times their sum (at least [`THIN`]).
    #[allow(clippy::type_complexity, reason = "two derivatives of K lights")]
    fn light_with_slopes<const K: usize>(
        &self,
        depths: &Depths,
        incident: [[f64; N]; K],
    ) -> Option<([Light; K], [[[f64; 3]; K]; 2])> {
        // In a thin slab all is in proportion to the depth, to the square of it, and so are differences to its rounding.
        let thin = depths.total < THIN;
        let used = match depths.total {
            0.0 => Depths { absorb: 0.5, scatter: 0.5, total: THIN, tau: THIN },
            _ if thin => Depths { total: THIN, ..*depths },
            _ => *depths,
        };
        let modes = Modes::new(&self.directions, &self.coupling, &self.sides, &used)?;
        let tangent = Tangent::new(&modes, &self.directions, &self.coupling, &used);
        // What a detector's own light would be: half of what leaves towards it.
        let (top, bottom) = (&self.sides.top, &self.sides.bottom);
        let root = &self.directions.flux_root;
        let from = |share: &dyn Fn(usize) -> f64| std::array::from_fn(|i| 0.5 * root[i] * share(i));
        let above = modes.amplitudes(&self.sides, &from(&|i| top[i].through));
        let below = modes.amplitudes_from_below(&self.sides, &from(&|i| bottom[i].through))?;
        // What slides absorb has left the slab, too.
        let clear = self.slab.top.tau == 0.0 && self.slab.bottom.tau == 0.0;
        let lost = match clear {
            true => None,
            false => Some((
                modes.amplitudes(&self.sides, &from(&|i| 1.0 - top[i].inside)),
                modes.amplitudes_from_below(&self.sides, &from(&|i| 1.0 - bottom[i].inside))?,
            )),
        };
        let mut slopes = [[[0.0; 3]; K]; 2];
        let mut lights = [Light { reflected: 0.0, transmitted: 0.0, absorbed: 0.0 }; K];
        for (k, incident) in incident.iter().enumerate() {
            let amplitudes = modes.amplitudes(&self.sides, incident);
            lights[k] = modes.light(&self.directions, &self.sides, &amplitudes);
            if self.is_thin(depths) {
                lights[k] = self.thinned(&lights[k], incident, depths.total / THIN);
            }
            let [r, t] = tangent.slopes(&amplitudes, [(&above, false), (&below, true)]);
            let out = match &lost {
                None => [r[0] + t[0], r[1] + t[1]],
                Some((above, below)) => {
                    let [up, down] = tangent.slopes(&amplitudes, [(above, false), (below, true)]);
                    [up[0] + down[0], up[1] + down[1]]
                }
            };
            for i in 0..2 {
                slopes[i][k] = [r[i], t[i], -out[i]];
            }
        }
        if thin && self.slab.n == 1.0 {
            lights = self.light(depths, incident)?;
        }
        Some((lights, slopes))
    }

    /// Scaled radiance just inside the top, for unit flux of the plan's light.
    pub(crate) fn incident(&self) -> [f64; N] {
        let Directions { incident, flux_root, .. } = &self.directions;
        std::array::from_fn(|i| {
            if incident[i] > 0.0 { incident[i] * self.sides.top[i].through / flux_root[i] } else { 0.0 }
        })
    }

    /// The same for unit Lambertian flux.
    pub(crate) fn diffuse(&self) -> [f64; N] {
        let n2 = self.slab.n * self.slab.n;
        let Directions { flux_root, counted, .. } = &self.directions;
        std::array::from_fn(|i| 2.0 * n2 * flux_root[i] * self.sides.top[i].through * counted[i])
    }
}

pub(crate) fn check_coefficients(mu_a: f64, mu_s_prime: f64) -> Result<(), Error> {
    for (name, value) in [("mu_a", mu_a), ("mu_s'", mu_s_prime)] {
        if !value.is_finite() {
            return Err(Error::NotFinite { name });
        }
        if value < 0.0 {
            return Err(Error::Range { name, value, must: "be >= 0" });
        }
    }
    Ok(())
}
