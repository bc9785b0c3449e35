//! Media: from any pair of coefficients or densities to mu_a and mu_s per channel.

use turbid_contract::Problems;
use turbid_contract::payload::Medium;

use crate::assemble::channels::Channels;
use crate::params::MediumParams;
use crate::per_channel::PerChannel;

pub fn medium(name: &str, m: &MediumParams, channels: Channels, problems: &mut Problems) -> Medium {
    let at = |field: &str| format!("media.{name}.{field}");
    problems.require(m.g.0.abs() < 1.0, at("g"), m.g.0, "", "lie in (-1, 1)");
    problems.require(m.n.0 >= 1.0 && m.n.0 <= 10.0, at("n"), m.n.0, "", "lie in [1, 10]");
    let here = format!("media.{name}");
    let mut values = |given: Vec<f64>, is_list: bool, field: &str, unit: &str| -> Vec<f64> {
        for (i, &v) in given.iter().enumerate() {
            let path = if is_list { format!("{}.{i}", at(field)) } else { at(field) };
            problems.require(v >= 0.0, path, v, unit, "be >= 0");
        }
        if is_list {
            channels.check_length(&at(field), given.len(), problems);
        }
        if is_list { given } else { vec![given[0]; channels.count()] }
    };
    let g = m.g.0;
    let coefficients = match (&m.mu_a, &m.mu_s, &m.mu_s_prime, &m.a_rho, &m.s_rho) {
        (Some(a), Some(s), None, None, None) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            Some((values(a, a_list, "mu_a", "mm^-1"), values(s, s_list, "mu_s", "mm^-1")))
        }
        (Some(a), None, Some(s), None, None) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            let reduced = values(s, s_list, "mu_s_prime", "mm^-1");
            Some((values(a, a_list, "mu_a", "mm^-1"), reduced.into_iter().map(|s| s / (1.0 - g)).collect()))
        }
        (None, None, None, Some(a), Some(s)) => {
            let (a, a_list) = numbers(a, |v| v.0);
            let (s, s_list) = numbers(s, |v| v.0);
            let (a, s) = (values(a, a_list, "A_rho", "m^-1"), values(s, s_list, "S_rho", "m^-1"));
            Some((a.into_iter().map(|v| v / 1000.0).collect(), s.into_iter().map(|v| v / 1000.0).collect()))
        }
        _ => {
            problems.push_with_hint(
                here,
                format!("{name} must have exactly one pair of absorption and scattering"),
                "write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1)",
            );
            None
        }
    };
    let none = || vec![0.0; channels.count()];
    let (mu_a, mu_s): (Vec<f64>, Vec<f64>) = coefficients.unwrap_or_else(|| (none(), none()));
    Medium { mu_a: mu_a.into_iter().map(settle).collect(), mu_s: mu_s.into_iter().map(settle).collect(), g, n: m.n.0 }
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
