//! Media: from any pair of absorption and scattering to mu_a and mu_s per channel.

use turbid_contract::Problems;
use turbid_contract::payload::Medium;

use crate::assemble::channels::Channels;
use crate::assemble::chromophores::{absorption, scattering};
use crate::assemble::phase_function::phase_function;
use crate::assemble::plausible::doubt_medium;
use crate::params::MediumParams;
use turbid_contract::PerChannel;

/// `light`: the channels of the scene, and their wavelengths where they are known.
pub fn medium(name: &str, m: &MediumParams, light: (Channels, &[f64]), problems: &mut Problems) -> Medium {
    let (channels, _) = light;
    let at = |field: &str| format!("media.{name}.{field}");
    let phase = phase_function(&format!("media.{name}"), m, problems);
    problems.require(m.n.0 >= 1.0 && m.n.0 <= 10.0, at("n"), m.n.0, "", "lie in [1, 10]");
    let here = format!("media.{name}");
    let chromophores = m.chromophores();
    let g = turbid_geometry::phase_function(&phase).g();
    let mu_a = match (&m.mu_a, &chromophores[..]) {
        (Some(a), []) => Some(values(numbers(a, |v| v.0), &at("mu_a"), "mm^-1", channels, problems)),
        (None, [_, ..]) => Some(absorption(&here, &chromophores, light, problems)),
        _ => None,
    };
    let of_reduced = |reduced: Vec<f64>| reduced.into_iter().map(|s| s / (1.0 - g)).collect();
    let mu_s: Option<Vec<f64>> = match (&m.mu_s, &m.mu_s_prime, m.scattering) {
        (Some(s), None, None) => Some(values(numbers(s, |v| v.0), &at("mu_s"), "mm^-1", channels, problems)),
        (None, Some(s), None) => {
            Some(of_reduced(values(numbers(s, |v| v.0), &at("mu_s_prime"), "mm^-1", channels, problems)))
        }
        (None, None, Some(law)) => Some(of_reduced(scattering(&here, law, light, problems))),
        _ => None,
    };
    let in_mm = m.mu_a.is_some() || !chromophores.is_empty();
    let scatters = m.mu_s.is_some() || m.mu_s_prime.is_some() || m.scattering.is_some();
    let coefficients = match (mu_a.zip(mu_s), &m.a_rho, &m.s_rho) {
        (Some(pair), None, None) => Some(pair),
        (None, Some(a), Some(s)) if !in_mm && !scatters => {
            let a = values(numbers(a, |v| v.0), &at("A_rho"), "m^-1", channels, problems);
            let s = values(numbers(s, |v| v.0), &at("S_rho"), "m^-1", channels, problems);
            Some((a.into_iter().map(|v| v / 1000.0).collect(), s.into_iter().map(|v| v / 1000.0).collect()))
        }
        _ => {
            problems.push_with_hint(
                here,
                format!("{name} must have exactly one pair of absorption and scattering"),
                "write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1); `HbO2`, `Hb`, `water`, \
                 `lipid`, `melanin` may stand in the place of `mu_a`, `scattering: {a, b}` in that of `mu_s`",
            );
            None
        }
    };
    let none = || vec![0.0; channels.count()];
    let (mu_a, mu_s): (Vec<f64>, Vec<f64>) = coefficients.unwrap_or_else(|| (none(), none()));
    let settled = |values: Vec<f64>| values.into_iter().map(settle).collect();
    let medium = Medium { mu_a: settled(mu_a), mu_s: settled(mu_s), phase, n: m.n.0 };
    doubt_medium(name, m, &medium, problems);
    medium
}

/// One value per channel, each >= 0; a list must have as many as there are channels.
fn values(
    (given, is_list): (Vec<f64>, bool),
    at: &str,
    unit: &str,
    channels: Channels,
    problems: &mut Problems,
) -> Vec<f64> {
    for (i, &v) in given.iter().enumerate() {
        let path = if is_list { format!("{at}.{i}") } else { at.to_owned() };
        problems.require(v >= 0.0, path, v, unit, "be >= 0");
    }
    if is_list {
        channels.check_length(at, given.len(), problems);
    }
    if is_list { given } else { vec![given[0]; channels.count()] }
}

fn numbers<T>(given: &PerChannel<T>, number: impl Fn(&T) -> f64) -> (Vec<f64>, bool) {
    match given {
        PerChannel::One(v) => (vec![number(v)], false),
        PerChannel::Each(v) => (v.iter().map(number).collect(), true),
    }
}

/// Rounds to 13 significant digits: 4236 m^-1 and mu_s' = 0.8472 mm^-1 at g = 0.8 differ in the last bits only, are the same
/// medium, and must not make anything stale.
fn settle(value: f64) -> f64 {
    if value.is_finite() { format!("{value:.12e}").parse().expect("a number that was just printed") } else { value }
}
