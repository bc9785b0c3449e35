//! A medium by what absorbs in it and by its power law of scattering, at the wavelengths of the scene.

use turbid_contract::Problems;
use turbid_optics::chromophore::{Chromophore, reduced_scattering};

use crate::assemble::channels::Channels;
use crate::params::ScatteringParams;

/// mu_a for each channel, mm^-1: the sum over what absorbs. `at` is the place of the medium.
pub fn absorption(
    at: &str,
    chromophores: &[(Chromophore, f64)],
    (channels, wavelengths_nm): (Channels, &[f64]),
    problems: &mut Problems,
) -> Vec<f64> {
    let mut mu_a = vec![0.0; channels.count()];
    let name = chromophores[0].0.name();
    if !names_wavelengths(&format!("{at}.{name}"), name, channels, problems) {
        return mu_a;
    }
    for &(chromophore, amount) in chromophores {
        let (name, field) = (chromophore.name(), format!("{at}.{}", chromophore.name()));
        match chromophore.unit() {
            "1" => problems.require(
                (0.0..=1.0).contains(&amount),
                &field,
                amount,
                "",
                "lie in [0, 1], a share of the volume",
            ),
            unit => problems.require(amount >= 0.0, &field, amount, unit, "be >= 0"),
        }
        let [first, last] = chromophore.range_nm();
        for (mu_a, &wavelength) in mu_a.iter_mut().zip(wavelengths_nm) {
            match chromophore.mu_a_per_mm(wavelength) {
                Some(per_unit) => *mu_a += amount * per_unit,
                None => problems.push_with_hint(
                    &field,
                    format!("the absorption of {name} is known from {first} to {last} nm, not at {wavelength} nm"),
                    "give `mu_a` with a value for each wavelength instead",
                ),
            }
        }
    }
    let shares = chromophores.iter().filter(|(chromophore, _)| chromophore.unit() == "1");
    let whole: f64 = shares.map(|(_, share)| share).sum();
    // A rounding of 0.7 + 0.2 + 0.1 is no mistake.
    if whole > 1.0 + 1e-9 {
        let message = format!("water, lipid and melanin take {whole} of the volume, more than there is");
        problems.push_with_hint(at, message, "their shares must add up to 1 at the most");
    }
    mu_a
}

/// mu_s' for each channel, mm^-1.
pub fn scattering(
    at: &str,
    ScatteringParams { a, b }: ScatteringParams,
    (channels, wavelengths_nm): (Channels, &[f64]),
    problems: &mut Problems,
) -> Vec<f64> {
    problems.require(a.0 >= 0.0, format!("{at}.scattering.a"), a.0, "mm^-1", "be >= 0");
    problems.require(b.abs() <= 4.0, format!("{at}.scattering.b"), b, "", "lie in [-4, 4]");
    if !names_wavelengths(&format!("{at}.scattering"), "scattering", channels, problems) || wavelengths_nm.is_empty() {
        return vec![0.0; channels.count()];
    }
    wavelengths_nm.iter().map(|&wavelength| reduced_scattering(a.0, b, wavelength)).collect()
}

/// Whether the scene says, or its rig is going to say, at which wavelengths.
fn names_wavelengths(at: &str, name: &str, channels: Channels, problems: &mut Problems) -> bool {
    let named = channels != Channels::Single;
    if !named {
        let message = format!("{name} depends on the wavelength, and the scene names none");
        problems.push_with_hint(at, message, "add `wavelength_nm: [..]` beside `media`, or to the rig");
    }
    named
}
