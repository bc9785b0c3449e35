//! What a table reads of a medium that was lit and looked at in another way than the table takes it to have been.

use crate::{Error, Medium, PhaseFunction, rte};

/// How a medium was seen, or how a model takes it to have been.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    pub phase: PhaseFunction,
    pub n: f64,
    /// mm; `None` for a half-space.
    pub thickness: Option<f64>,
    /// To the normal of the surface, degrees in [0, 90).
    pub view_deg: f64,
    pub incidence_deg: f64,
}

/// One side of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// mu_a and mu_s', mm^-1.
    pub mu: [f64; 2],
    pub seen: Setting,
}

/// What was seen, what it was divided by, and what both are taken for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    pub sample: Side,
    /// The phantom as it was seen, and as the calibration takes it to be; `None` where nothing is divided by.
    pub reference: Option<(Side, Side)>,
    /// How the table takes the sample to have been seen.
    pub table: Setting,
    /// The low and the high spatial frequency, mm^-1.
    pub f_x: [f64; 2],
    /// Whether light that falls slantwise is told from less light: by a correction for the shape.
    pub slopes_corrected: bool,
}

/// Oblique lines are taken as this (degrees) at most: beyond, next to no light crosses the surface.
const STEEPEST_DEG: f64 = 88.0;
/// Steps of Newton's method with one Jacobian, and where they end.
const STEPS: usize = 12;
const CLOSE: f64 = 1e-3;
/// The longest step, in ln mu.
const LONGEST: f64 = 0.7;

/// What the table reads over what is there, less 1, of mu_a and of mu_s'.
///
/// Both sides by radiative transport ([`rte::oblique`]), so that it says what the difference of the settings does and nothing of the model of the table.
/// Error: a medium that the solver does not solve.
pub fn misreading(reading: &Reading) -> Result<[f64; 2], Error> {
    let Reading { sample, reference, table, f_x, .. } = reading;
    let mut target = [0.0; 2];
    for (target, &f) in target.iter_mut().zip(f_x) {
        *target = ln_reflectance(sample.mu, &sample.seen, f)?;
        if let Some((seen, taken)) = reference {
            *target += ln_reflectance(taken.mu, &taken.seen, f)? - ln_reflectance(seen.mu, &seen.seen, f)?;
            if !reading.slopes_corrected {
                *target += libm::log(cos(sample.seen.incidence_deg) / cos(seen.seen.incidence_deg));
            }
        }
    }
    let model = |p: [f64; 2]| -> Result<[f64; 2], Error> {
        let mu = p.map(libm::exp);
        Ok([ln_reflectance(mu, table, f_x[0])?, ln_reflectance(mu, table, f_x[1])?])
    };
    let start = sample.mu.map(|mu| libm::log(mu.max(1e-6)));
    let (mut p, mut at) = (start, model(start)?);
    const H: f64 = 0.05;
    let [a, s] = [model([p[0] + H, p[1]])?, model([p[0], p[1] + H])?].map(|r| [(r[0] - at[0]) / H, (r[1] - at[1]) / H]);
    let determinant = a[0] * s[1] - a[1] * s[0];
    for _ in 0..STEPS {
        let r = [target[0] - at[0], target[1] - at[1]];
        let step = [(r[0] * s[1] - r[1] * s[0]) / determinant, (a[0] * r[1] - a[1] * r[0]) / determinant];
        if !step.iter().all(|x| x.is_finite()) || step.iter().all(|x| x.abs() < CLOSE) {
            break;
        }
        p = [0, 1].map(|k| p[k] + step[k].clamp(-LONGEST, LONGEST));
        at = model(p)?;
    }
    Ok([0, 1].map(|k| libm::exp(p[k] - start[k]) - 1.0))
}

fn cos(angle_deg: f64) -> f64 {
    libm::cos(angle_deg.min(STEEPEST_DEG).to_radians())
}

/// ln of pi x radiance / irradiance on the surface.
fn ln_reflectance(mu: [f64; 2], seen: &Setting, f_x: f64) -> Result<f64, Error> {
    let medium = Medium { mu_a: mu[0], mu_s_prime: mu[1], phase: seen.phase, n: seen.n };
    let lines = [seen.incidence_deg, seen.view_deg].map(cos);
    let found = rte::oblique(&medium, seen.thickness, f_x, lines)?.camera;
    Ok(libm::log(found.max(f64::MIN_POSITIVE)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setting() -> Setting {
        Setting {
            phase: PhaseFunction::henyey_greenstein(0.8),
            n: 1.0,
            thickness: None,
            view_deg: 0.0,
            incidence_deg: 0.0,
        }
    }

    fn reading(seen: Setting) -> Reading {
        let sample = Side { mu: [0.05, 1.0], seen };
        Reading { sample, reference: None, table: setting(), f_x: [0.0, 0.1], slopes_corrected: false }
    }

    /// What is seen as the table takes it reads as it is, to where Newton's method ends.
    #[test]
    fn equal_settings_read_the_truth() {
        let found = misreading(&reading(setting())).unwrap();
        assert!(found.iter().all(|x| x.abs() < CLOSE), "{found:?}");
        // A phantom that is taken for what it is changes nothing.
        let side = Side { mu: [0.02, 1.5], seen: Setting { view_deg: 30.0, ..setting() } };
        let divided = Reading { reference: Some((side, side)), slopes_corrected: true, ..reading(setting()) };
        assert!(misreading(&divided).unwrap().iter().all(|x| x.abs() < CLOSE));
    }

    /// What a setting does to R is undone by a table of that setting, whatever it is.
    #[test]
    fn the_table_of_the_same_setting_reads_the_truth() {
        for seen in [
            Setting { thickness: Some(2.0), ..setting() },
            Setting { n: 1.4, ..setting() },
            Setting { phase: PhaseFunction::henyey_greenstein(0.95), ..setting() },
            Setting { view_deg: 45.0, incidence_deg: 60.0, ..setting() },
        ] {
            let own = misreading(&Reading { table: seen, ..reading(seen) }).unwrap();
            assert!(own.iter().all(|x| x.abs() < CLOSE), "{seen:?}: {own:?}");
            let other = misreading(&reading(seen)).unwrap();
            assert!(other.iter().any(|x| x.abs() > 2.0 * CLOSE), "{seen:?}: {other:?}");
        }
    }

    /// A slab that loses light through its far side reads as more absorbing; half as thick, the more so.
    #[test]
    fn thin_slabs_read_dark() {
        let of = |d: f64| misreading(&reading(Setting { thickness: Some(d), ..setting() })).unwrap()[0];
        let (thick, thin) = (of(8.0), of(4.0));
        assert!(thick > 0.0 && thin > 2.0 * thick, "{thick} {thin}");
    }
}
