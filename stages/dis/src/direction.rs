//! Directions about a normal, and points on a sphere.

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::henyey_greenstein::turn;

use crate::stream::Stream;

/// A direction by the cosine law about the unit vector `normal`.
pub fn lambertian(normal: DVec3, random: &mut Stream) -> DVec3 {
    let cos2 = random.uniform();
    let (sin_phi, cos_phi) = sin_cos_turns(random.uniform());
    turn(normal, cos2.sqrt(), (1.0 - cos2).sqrt(), sin_phi, cos_phi)
}

/// A unit vector with an angle of cosine above `least` to the unit vector `axis`, uniform over the solid angle.
pub fn in_cap(axis: DVec3, least: f64, random: &mut Stream) -> DVec3 {
    let below = (1.0 - least) * random.uniform();
    let (sin_phi, cos_phi) = sin_cos_turns(random.uniform());
    turn(axis, 1.0 - below, (below * (2.0 - below)).sqrt(), sin_phi, cos_phi)
}

/// A unit vector, uniform over the sphere.
pub fn anywhere(random: &mut Stream) -> DVec3 {
    in_cap(DVec3::Z, -1.0, random)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of the cosine: 2/3 for the cosine law, (1 + least) / 2 in a cap; variances 1/18 and (1 - least)^2 / 12; 5 sigma.
    #[test]
    fn mean_cosines() {
        let axis = DVec3::new(0.6, 0.0, -0.8);
        let n = 100_000;
        let mean = |draw: &dyn Fn(&mut Stream) -> DVec3| {
            (0..n).map(|i| draw(&mut Stream::new(5, 1, i)).dot(axis)).sum::<f64>() / n as f64
        };
        let sigma = |variance: f64| 5.0 * (variance / n as f64).sqrt();
        let cosine = mean(&|random| lambertian(axis, random));
        assert!((cosine - 2.0 / 3.0).abs() < sigma(1.0 / 18.0), "{cosine}");
        for least in [-1.0, 0.5, 0.999] {
            let cosine = mean(&|random| in_cap(axis, least, random));
            assert!((cosine - 0.5 * (1.0 + least)).abs() < sigma((1.0 - least) * (1.0 - least) / 12.0), "{cosine}");
        }
    }
}
