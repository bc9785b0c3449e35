//! Refraction of rays: at one smooth wall, and from a point to a point through parallel planes.

use glam::DVec3;

/// What becomes of a ray at a smooth wall between two media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refraction {
    pub reflected: DVec3,
    /// Unit vector on the far side; `None` under total reflection.
    pub refracted: Option<DVec3>,
    /// Fraction of unpolarised light that is reflected.
    pub reflectance: f64,
}

/// A ray along the unit vector `w` out of index `n_from` meets a wall to `n_to`; `normal` (unit) on either side.
pub fn refract(w: DVec3, normal: DVec3, n_from: f64, n_to: f64) -> Refraction {
    let against = if w.dot(normal) > 0.0 { -normal } else { normal };
    let cos = -w.dot(against);
    let reflected = (w + 2.0 * cos * against).normalize();
    let eta = n_from / n_to;
    // (w + cos against) is the part along the wall: its square loses no digits at normal incidence.
    let along = w + cos * against;
    let cos2 = 1.0 - eta * eta * along.length_squared();
    if cos2 <= 0.0 {
        return Refraction { reflected, refracted: None, reflectance: 1.0 };
    }
    let cos_to = cos2.sqrt();
    let refracted = (eta * along - cos_to * against).normalize();
    Refraction { reflected, refracted: Some(refracted), reflectance: reflectance(n_from, cos, n_to, cos_to) }
}

/// Fresnel's reflectance for unpolarised light from both cosines (>= 0), which a caller may know to more digits than one
/// gives the other.
#[inline]
pub fn reflectance(n_from: f64, cos_from: f64, n_to: f64, cos_to: f64) -> f64 {
    let s = (n_from * cos_from - n_to * cos_to) / (n_from * cos_from + n_to * cos_to);
    let p = (n_to * cos_from - n_from * cos_to) / (n_to * cos_from + n_from * cos_to);
    0.5 * (s * s + p * p)
}

/// A layer that a ray crosses between two planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    pub n: f64,
    /// Distance of its planes, mm, >= 0.
    pub depth: f64,
}

/// The ray that crosses a stack of layers with a given sideways advance.
///
/// All layers share the transverse slowness n sin(theta). It is written by the tangent t in the layer of least index, where
/// m = n / n_least: then cos = sqrt(m^2 + (m^2 - 1) t^2) / (m sqrt(1 + t^2)) holds all digits even at grazing angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    t: f64,
    n_least: f64,
    /// Advance / t, mm.
    reach: f64,
    /// d advance / d t, mm.
    slope: f64,
}

impl Crossing {
    /// `advance` >= 0, mm. `None` where no ray gets that far (all layers empty, or beyond the range of numbers).
    ///
    /// The advance grows with t and is concave, so Newton's method from the left, from the tangent of small angles, climbs to the only root.
    pub fn new(legs: impl Iterator<Item = Leg> + Clone, advance: f64) -> Option<Self> {
        let n_least = legs.clone().map(|leg| leg.n).fold(f64::INFINITY, f64::min);
        let at = |t: f64| {
            let (mut reach, mut slope) = (0.0, 0.0);
            for leg in legs.clone() {
                let m2 = (leg.n / n_least) * (leg.n / n_least);
                let q = m2 + (m2 - 1.0) * t * t;
                let one = leg.depth / q.sqrt();
                reach += one;
                slope += one * m2 / q;
            }
            (reach, slope)
        };
        let mut t = advance / at(0.0).0;
        for _ in 0..200 {
            let (reach, slope) = at(t);
            let step = (advance - t * reach) / slope;
            if !t.is_finite() || !step.is_finite() {
                return None;
            }
            if step <= 4.0 * f64::EPSILON * t {
                return Some(Self { t, n_least, reach, slope });
            }
            t += step;
        }
        None
    }

    /// The ray whose tangent is `tan` in a layer of index `n`. `None` where a layer is beyond total reflection.
    pub fn at_slope(legs: impl Iterator<Item = Leg> + Clone, n: f64, tan: f64) -> Option<Self> {
        let n_least = legs.map(|leg| leg.n).fold(f64::INFINITY, f64::min);
        let m = n / n_least;
        // tan = t / sqrt(m^2 + (m^2 - 1) t^2), solved for t.
        let left = 1.0 - (m * m - 1.0) * tan * tan;
        let t = m * tan / left.sqrt();
        (left > 0.0 && t.is_finite()).then_some(Self { t, n_least, reach: f64::NAN, slope: f64::NAN })
    }

    #[inline]
    fn root(&self, n: f64) -> (f64, f64) {
        let m = n / self.n_least;
        (m, (m * m + (m * m - 1.0) * self.t * self.t).max(0.0).sqrt())
    }

    /// Of the angle to the planes' normal, in a layer of index `n`; 0 where the ray would be totally reflected.
    pub fn cos(&self, n: f64) -> f64 {
        let (m, root) = self.root(n);
        root / (m * (1.0 + self.t * self.t).sqrt())
    }

    pub fn sin(&self, n: f64) -> f64 {
        self.t * self.n_least / (n * (1.0 + self.t * self.t).sqrt())
    }

    pub fn tan(&self, n: f64) -> f64 {
        self.t / self.root(n).1
    }

    /// Reflectance of the plane between layers of these indices.
    pub fn reflectance(&self, n_from: f64, n_to: f64) -> f64 {
        let (cos_from, cos_to) = (self.cos(n_from), self.cos(n_to));
        if cos_to > 0.0 { reflectance(n_from, cos_from, n_to, cos_to) } else { 1.0 }
    }

    /// Solid angle at the source (index `n_source`) over the area across the rays that it lights at the far end (index
    /// `n_end`), mm^-2: 1 / distance^2 where all indices are equal.
    ///
    /// p dp / (n_source^2 cos_source cos_end rho drho) with p = n sin(theta) and the advance rho.
    pub fn spread(&self, n_source: f64, n_end: f64) -> f64 {
        let s = self.n_least / (n_source * (1.0 + self.t * self.t));
        s * s / (self.cos(n_source) * self.cos(n_end) * self.reach * self.slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Snell's law, unit length, the plane of incidence, and the law of reflection; 1e-15 is a few roundings of numbers <= 1.
    #[test]
    fn rays_obey_snell() {
        let normal = DVec3::new(0.36, 0.48, 0.8);
        for (n_from, n_to) in [(1.0, 1.4), (1.4, 1.0), (1.0, 2.5), (2.5, 1.0), (1.33, 1.34)] {
            for k in 0..200 {
                let (x, y) = (f64::from(k) * 0.37, f64::from(k) * 0.011);
                let w = DVec3::new(x.sin() * y.cos(), x.cos() * y.cos(), y.sin()).normalize();
                let Refraction { reflected, refracted, reflectance } = refract(w, normal, n_from, n_to);
                let slowness = n_from * w.cross(normal);
                assert!((reflected.cross(normal) * n_from - slowness).length() < 1e-14);
                assert!((reflected.dot(normal) + w.dot(normal)).abs() < 1e-15 && (0.0..=1.0).contains(&reflectance));
                match refracted {
                    Some(t) => {
                        assert!((n_to * t.cross(normal) - slowness).length() < 1e-14, "{n_from} {n_to} {w}");
                        assert!(t.dot(normal) * w.dot(normal) >= 0.0);
                        let cos = w.dot(normal).abs();
                        let direct = crate::fresnel::reflectance(n_from / n_to, cos);
                        // The reflectance from one cosine loses digits as the refracted ray grazes.
                        let grazing = t.dot(normal) * t.dot(normal);
                        assert!((reflectance - direct).abs() < 1e-14 / grazing, "{reflectance} {direct}");
                    }
                    None => assert!(slowness.length() >= n_to * (1.0 - 1e-15)),
                }
            }
        }
    }

    fn stacks() -> [Vec<Leg>; 6] {
        let leg = |n, depth| Leg { n, depth };
        [
            vec![leg(1.0, 10.0), leg(1.0, 3.0)],
            vec![leg(1.0, 500.0), leg(1.4, 1.0)],
            vec![leg(1.4, 500.0), leg(1.0, 0.01)],
            vec![leg(1.0, 1.0), leg(2.5, 1000.0)],
            vec![leg(1.0, 20.0), leg(1.5, 2.0), leg(1.33, 4.0), leg(1.5, 3.0)],
            vec![leg(1.5, 20.0), leg(1.4, 0.001), leg(1.6, 4.0)],
        ]
    }

    /// The legs' advances add up to the whole, at angles up to grazing: relative error a few roundings over the share of the
    /// advance that t governs.
    #[test]
    fn crossings_arrive() {
        for legs in stacks() {
            for advance in [0.0, 1e-9, 0.3, 7.0, 100.0, 1e4, 1e7] {
                let crossing = Crossing::new(legs.iter().copied(), advance).unwrap();
                let sum: f64 = legs.iter().map(|leg| leg.depth * crossing.tan(leg.n)).sum();
                assert!((sum - advance).abs() <= 1e-13 * advance, "{legs:?} {advance}: {sum}");
                let slowness = legs[0].n * crossing.sin(legs[0].n);
                for leg in &legs {
                    let (sin, cos) = (crossing.sin(leg.n), crossing.cos(leg.n));
                    assert!((leg.n * sin - slowness).abs() < 1e-15 * 4.0);
                    assert!((sin * sin + cos * cos - 1.0).abs() < 1e-14, "{legs:?} {advance}: {sin} {cos}");
                }
            }
        }
        assert_eq!(Crossing::new([Leg { n: 1.4, depth: 0.0 }].into_iter(), 1.0), None);
    }

    /// The solid angle that lights an area, by differences of neighbouring rays: central differences of relative step 1e-4
    /// leave 1e-7 or so, and the difference of the angles its rounding.
    #[test]
    fn spread_is_the_solid_angle_per_area() {
        for legs in stacks() {
            for advance in [0.3, 7.0, 100.0] {
                let new = |advance: f64| Crossing::new(legs.iter().copied(), advance).unwrap();
                let (n_source, n_end) = (legs[0].n, legs[legs.len() - 1].n);
                let h = 1e-4 * advance;
                let (here, less, more) = (new(advance), new(advance - h), new(advance + h));
                let theta = |c: &Crossing| c.sin(n_source).atan2(c.cos(n_source));
                // dOmega = sin dtheta dphi, dA = rho drho dphi cos_end.
                let between = theta(&more) - theta(&less);
                let solid_angle = here.sin(n_source) * between;
                let area = advance * 2.0 * h * here.cos(n_end);
                let expected = solid_angle / area;
                let spread = here.spread(n_source, n_end);
                let tolerance = 1e-6 + 4.0 * f64::EPSILON / between;
                assert!((spread / expected - 1.0).abs() < tolerance, "{legs:?} {advance}: {spread} {expected}");
                // Reciprocity: n^2 times the spread is the same from the other end.
                let back = here.spread(n_end, n_source) * n_end * n_end;
                assert!((spread * n_source * n_source / back - 1.0).abs() < 1e-12);
            }
        }
        let straight = Crossing::new([Leg { n: 1.3, depth: 4.0 }].into_iter(), 3.0).unwrap();
        assert!((straight.spread(1.3, 1.3) * 25.0 - 1.0).abs() < 1e-14);
    }
}
