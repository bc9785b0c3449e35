//! The chromophores that params name, with their spectra; what is wrong with them, found before a run.

use std::collections::BTreeMap;
use std::sync::Arc;

use turbid_contract::{Problems, suggest};
use turbid_optics::{Chromophore, Spectrum, spectra};

use crate::amount::Amount;
use crate::least_squares::MOST;
use crate::params::Params;

/// Content of the file that a field names.
pub type Lend<'a> = dyn Fn(&str) -> Option<Arc<[u8]>> + 'a;

/// A chromophore with what one unit of it absorbs.
#[derive(Clone, Debug)]
pub struct Species {
    pub name: String,
    /// Of its concentration: uM, or 1 for a share of the volume.
    pub unit: &'static str,
    spectrum: Known,
}

#[derive(Clone, Debug)]
enum Known {
    Here(Chromophore),
    Own(Spectrum),
}

impl Species {
    /// mm^-1 for one unit; `None` where the spectrum does not reach.
    pub fn mu_a(&self, wavelength_nm: f64) -> Option<f64> {
        match &self.spectrum {
            Known::Here(chromophore) => chromophore.mu_a_per_mm(wavelength_nm),
            Known::Own(spectrum) => spectrum.at(wavelength_nm),
        }
    }

    fn range_nm(&self) -> [f64; 2] {
        match &self.spectrum {
            Known::Here(chromophore) => chromophore.range_nm(),
            Known::Own(spectrum) => spectrum.range_nm(),
        }
    }

    /// What it absorbs at each wavelength. Reported at the field `at` where its spectrum does not reach one of them, or is 0 at all of them.
    pub fn column(&self, wavelengths_nm: &[f64], at: &str, problems: &mut Problems) -> Option<Vec<f64>> {
        let (name, [first, last]) = (&self.name, self.range_nm());
        let beyond = |nm: &&f64| self.mu_a(**nm).is_none();
        let outside: Vec<String> = wavelengths_nm.iter().filter(beyond).map(f64::to_string).collect();
        if !outside.is_empty() {
            let message =
                format!("the spectrum of {name} reaches from {first} to {last} nm, not to {} nm", outside.join(", "));
            let way_out = "nothing is extrapolated: leave these wavelengths out (`wavelength_nm: [..]`), or give a spectrum that covers them";
            problems.push_with_hint(at, message, way_out);
            return None;
        }
        let column: Vec<f64> = wavelengths_nm.iter().filter_map(|&nm| self.mu_a(nm)).collect();
        if column.iter().all(|&v| v == 0.0) {
            let message = format!("{name} absorbs nothing at any of the wavelengths");
            problems.push_with_hint(at, message, "leave it out, or add a wavelength at which it absorbs");
            return None;
        }
        Some(column)
    }
}

/// Everything that may be named.
pub struct Catalogue {
    all: Vec<Species>,
    /// Whether a file could not be looked into: then names may be its.
    unread: bool,
}

impl Catalogue {
    /// What is known here, and what the files hold. Mistakes in files are reported at their fields.
    pub fn of(params: &Params, file: &Lend<'_>, problems: &mut Problems) -> Self {
        let mut catalogue = Self { all: Vec::new(), unread: false };
        for (k, from) in params.spectra.iter().enumerate() {
            let at = format!("spectra.{k}.file");
            let Some(bytes) = file(&at) else {
                catalogue.unread = true;
                continue;
            };
            let to_mm = from.unit.to_mm();
            let in_mm = |_: &str, value: f64| if value < 0.0 { Err("be >= 0".to_owned()) } else { Ok(value * to_mm) };
            match spectra::read(&bytes, &in_mm) {
                Err(e) => {
                    catalogue.unread = true;
                    problems.push_with_hint(
                        at,
                        format!("{}:{}:{}: {}", from.file, e.line, e.column, e.message),
                        "a table of text is wanted: `wavelength_nm, NAME..`, then a row for each wavelength, rising",
                    );
                }
                Ok(spectra) => {
                    for (name, spectrum) in spectra {
                        if RESERVED.contains(&name.as_str()) {
                            let message =
                                format!("{}: a chromophore may not be called {name}, as another layer is", from.file);
                            problems.push_with_hint(&at, message, "give the column another name");
                        } else if catalogue.all.iter().any(|s| s.name == name) {
                            let message = format!("{}: an earlier file holds {name}, too", from.file);
                            problems.push_with_hint(&at, message, "give one of the two columns another name");
                        } else {
                            let (unit, spectrum) = (from.unit.of_amount(), Known::Own(spectrum));
                            catalogue.all.push(Species { name, unit, spectrum });
                        }
                    }
                }
            }
        }
        for chromophore in Chromophore::ALL {
            if catalogue.all.iter().all(|s| s.name != chromophore.name()) {
                let (name, unit) = (chromophore.name().to_owned(), chromophore.unit());
                catalogue.all.push(Species { name, unit, spectrum: Known::Here(chromophore) });
            }
        }
        catalogue
    }

    /// The species of that name; reported at `at` where there is none.
    fn find(&self, name: &str, at: &str, problems: &mut Problems) -> Option<&Species> {
        let found = self.all.iter().find(|s| s.name == name);
        if found.is_none() && !self.unread {
            let hint = suggest::hint(name, self.all.iter().map(|s| s.name.as_str())).unwrap_or_default();
            problems.push_with_hint(at, format!("there is no chromophore `{name}`"), hint);
        }
        found
    }

    /// The species that `chromophores` names, in its order. `None` where one of them is not known.
    pub fn wanted(&self, params: &Params, problems: &mut Problems) -> Option<Vec<Species>> {
        let names = &params.chromophores;
        if names.is_empty() || names.len() > MOST {
            let message = format!("{} chromophores are named; 1 to {MOST} are taken", names.len());
            problems.push_with_hint("chromophores", message, "write `chromophores: [HbO2, Hb]`, for example");
            return None;
        }
        let mut found = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let at = format!("chromophores.{k}");
            if names[..k].contains(name) {
                problems.push_with_hint(at, format!("{name} stands twice"), "name each chromophore once");
                return None;
            }
            found.push(self.find(name, &at, problems).cloned());
        }
        found.into_iter().collect()
    }

    /// The species of a list of amounts below the field `at`, with their amounts in their units.
    pub fn amounts(
        &self,
        amounts: &BTreeMap<String, Amount>,
        at: &str,
        problems: &mut Problems,
    ) -> Vec<(Species, f64)> {
        let mut found = Vec::new();
        for (name, amount) in amounts {
            let at = format!("{at}.{name}");
            let Some(species) = self.find(name, &at, problems) else { continue };
            match (species.unit, amount.unit) {
                (unit, Some(written)) if written != unit => {
                    let (is, wanted) =
                        if unit == "1" { ("uM", "a share of the volume, 0.7 or `70 %`,") } else { ("1", "uM") };
                    problems.push(at, format!("{name} stands in {is}; {wanted} is wanted"));
                    continue;
                }
                ("1", _) => {
                    let rule = "lie in [0, 1], a share of the volume";
                    problems.require((0.0..=1.0).contains(&amount.value), at, amount.value, "", rule);
                }
                (unit, _) => problems.require(amount.value >= 0.0, at, amount.value, unit, "be >= 0"),
            }
            found.push((species.clone(), amount.value));
        }
        found
    }
}

/// Names of layers that are no chromophores.
const RESERVED: [&str; 8] = ["THb", "StO2", "scatter_a", "scatter_b", "residual", "at_bound", "mask", "cov"];
