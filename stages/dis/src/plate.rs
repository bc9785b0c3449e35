//! The sample: a plate of a turbid medium with side faces, and a photon's way through it.

use glam::DVec3;
use turbid_optics::elementary::{exp, ln};
use turbid_optics::{PhaseFunction, fresnel};

use crate::stream::Stream;

/// A plate in air; x and y from its middle, depth z from the face that the beam meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// mm^-1, >= 0.
    pub mu_a: f64,
    /// mm^-1, >= 0.
    pub mu_s: f64,
    pub phase: PhaseFunction,
    /// Refractive index, >= 1.
    pub n: f64,
    /// mm.
    pub thickness: f64,
    /// Extent along x and y, mm; may be infinite.
    pub size: [f64; 2],
    /// Index of clear slides on both faces, >= 1; 1 for none. They have no thickness: light does not travel sideways in them.
    pub slides: f64,
}

/// Where a photon is and where it goes, `u` a unit vector; `u.z > 0` leads deeper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub r: DVec3,
    pub u: DVec3,
}

/// What became of a photon that met the plate. Shares of its weight; `out`, `absorbed`, `sides` and `roulette` sum to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Passage {
    /// Left through the face z = 0 or z = thickness, on this ray.
    pub ray: Option<Ray>,
    pub out: f64,
    pub absorbed: f64,
    /// Left through the side faces.
    pub sides: f64,
    /// Ended by roulette (>= 0), or gained in it (< 0); 0 on average.
    pub roulette: f64,
    /// Leaves through the near (z = 0) and the far face of a plate that has no sides: the same way up to the first side
    /// face, then on.
    pub wide: [f64; 2],
}

/// Photons below this share of their weight play roulette, and go on with ten times their weight or end.
const FAINT: f64 = 0.01;

impl Plate {
    /// A photon meets the plate from outside at `ray`: at depth 0 with u.z > 0, or at the other face with u.z < 0.
    pub fn pass(&self, ray: Ray, random: &mut Stream) -> Passage {
        let cos_out = ray.u.z.abs();
        let cos = (1.0 - (1.0 - cos_out * cos_out) / (self.n * self.n)).sqrt();
        let reflected = self.face(cos);
        if reflected > 0.0 && random.uniform() < reflected {
            let ray = Ray { r: ray.r, u: DVec3::new(ray.u.x, ray.u.y, -ray.u.z) };
            let wide = if ray.r.z <= 0.0 { [1.0, 0.0] } else { [0.0, 1.0] };
            return Passage { ray: Some(ray), out: 1.0, wide, ..Passage::default() };
        }
        let u = DVec3::new(ray.u.x / self.n, ray.u.y / self.n, cos.copysign(ray.u.z));
        self.walk(Ray { r: ray.r, u }, 1.0, self.size, random)
    }

    /// Reflectance of a face with its slide, met at the cosine `cos` inside the medium; the same from outside.
    fn face(&self, cos: f64) -> f64 {
        let whole = fresnel::reflectance(self.n, cos);
        if self.slides == 1.0 || self.slides == self.n || whole == 1.0 {
            return whole;
        }
        // Neither surface absorbs: the echoes between them sum to this.
        let inner = fresnel::reflectance(self.n / self.slides, cos);
        let Some(cos_slide) = fresnel::refracted_cos(self.n / self.slides, cos) else { return 1.0 };
        let outer = fresnel::reflectance(self.slides, cos_slide);
        (inner + outer - 2.0 * inner * outer) / (1.0 - inner * outer)
    }

    fn walk(&self, mut ray: Ray, mut weight: f64, size: [f64; 2], random: &mut Stream) -> Passage {
        let mut done = Passage::default();
        let mut wide = None;
        let half = [0.5 * size[0], 0.5 * size[1]];
        let bounded = half[0].is_finite() || half[1].is_finite();
        let entered = weight;
        let mut free = self.free_path(random);
        loop {
            let Ray { r, u } = ray;
            let to_face = if u.z > 0.0 {
                ((self.thickness - r.z) / u.z).max(0.0)
            } else if u.z < 0.0 {
                (r.z / -u.z).max(0.0)
            } else {
                f64::INFINITY
            };
            let to_x =
                if bounded { ((half[0] - r.x * 1f64.copysign(u.x)) / u.x.abs()).max(0.0) } else { f64::INFINITY };
            let to_y =
                if bounded { ((half[1] - r.y * 1f64.copysign(u.y)) / u.y.abs()).max(0.0) } else { f64::INFINITY };
            let to_side = to_x.min(to_y);
            let step = free.min(to_face).min(to_side);
            assert!(step.is_finite(), "a photon that meets nothing: {ray:?} in {self:?}");
            ray.r += step * u;
            if self.mu_a > 0.0 {
                let left = weight * exp(-(self.mu_a * step).min(700.0));
                done.absorbed += weight - left;
                weight = left;
            }
            if step == free {
                let (a, b) = (random.uniform(), random.uniform());
                ray.u = self.phase.sample(u, a, b);
                free = self.free_path(random);
            } else if step == to_face {
                free -= step;
                // On the face to the bit, or a ray along it would find it again.
                ray.r.z = if u.z > 0.0 { self.thickness } else { 0.0 };
                let cos = u.z.abs();
                let reflected = self.face(cos);
                if reflected == 0.0 || random.uniform() >= reflected {
                    let out = if u.z > 0.0 { [0.0, weight] } else { [weight, 0.0] };
                    let cos_out = fresnel::refracted_cos(self.n, cos).unwrap_or(0.0);
                    let leaving = DVec3::new(u.x * self.n, u.y * self.n, cos_out.copysign(u.z));
                    done.ray = Some(Ray { r: ray.r, u: leaving });
                    done.out = weight;
                    done.wide = wide.unwrap_or(out);
                    return done;
                }
                ray.u.z = -u.z;
            } else {
                free -= step;
                if wide.is_none() {
                    let on = Ray { r: DVec3::new(0.0, 0.0, ray.r.z), u };
                    wide = Some(self.walk(on, weight, [f64::INFINITY; 2], random).wide);
                }
                let across_x = to_x <= to_y;
                let cos = if across_x { u.x.abs() } else { u.y.abs() };
                let reflected = fresnel::reflectance(self.n, cos);
                if reflected == 0.0 || random.uniform() >= reflected {
                    done.sides = weight;
                    done.wide = wide.unwrap_or_default();
                    return done;
                }
                if across_x {
                    ray.r.x = half[0].copysign(u.x);
                    ray.u.x = -u.x;
                } else {
                    ray.r.y = half[1].copysign(u.y);
                    ray.u.y = -u.y;
                }
            }
            if weight < FAINT * entered {
                if random.uniform() < 0.1 {
                    done.roulette -= 9.0 * weight;
                    weight *= 10.0;
                } else {
                    done.roulette += weight;
                    done.wide = wide.unwrap_or_default();
                    return done;
                }
            }
        }
    }

    fn free_path(&self, random: &mut Stream) -> f64 {
        if self.mu_s > 0.0 { -ln(random.uniform()) / self.mu_s } else { f64::INFINITY }
    }
}
