//! Params, spectra and maps brought together: what a run works with, and every mistake before it.

use turbid_contract::{Error, LayerInfo, Problems};

use crate::channels::{Channels, listed};
use crate::condition::{condition_number, most_alike};
use crate::design::Design;
use crate::params::Params;
use crate::species::{Catalogue, Lend, Species};

/// What a run works with.
#[derive(Clone, Debug)]
pub struct Resolved {
    pub species: Vec<Species>,
    pub channels: Channels,
    /// mm^-1 for one unit of each species, by wavelength.
    pub columns: Vec<Vec<f64>>,
    /// mu_a of what is fixed, mm^-1 by wavelength.
    pub fixed: Vec<f64>,
    pub condition: f64,
    /// Places of HbO2 and Hb among the species.
    pub haemoglobin: Option<[usize; 2]>,
    pub design: Option<Design>,
}

/// `layers`: those of the maps, where they are known, with the name of who makes them. `None` where something is wrong or not known yet.
pub fn resolve(
    params: &Params,
    lend: &Lend<'_>,
    layers: Option<(&[LayerInfo], &str)>,
    wants_design: bool,
    problems: &mut Problems,
) -> Option<Resolved> {
    let largest = params.largest_condition;
    problems.require(largest >= 1.0, "largest_condition", largest, "", "be >= 1");
    let catalogue = Catalogue::of(params, lend, problems);
    let wanted = catalogue.wanted(params, problems);
    let fixed = catalogue.amounts(&params.fixed, "fixed", problems);
    for (species, _) in fixed.iter().filter(|(species, _)| params.chromophores.contains(&species.name)) {
        let message = format!("{} is looked for and fixed", species.name);
        problems.push_with_hint(
            format!("fixed.{}", species.name),
            message,
            "take it out of `chromophores` or of `fixed`",
        );
    }
    if wants_design && params.design.is_none() {
        let way_out = "design: {choose: 3, typical: {HbO2: 40, Hb: 20}}, or leave out what reads `design`";
        problems.push_with_hint("design", "the output `design` is wanted, and not said what for", way_out);
    }
    let only: Vec<f64> = params.wavelength_nm.iter().map(|w| w.0).collect();
    let channels = layers.and_then(|(layers, producer)| {
        let found = Channels::of(layers, &only, params.scattering);
        found.map_err(|error| unfit(producer, error, problems)).ok()
    });
    let species = wanted?;
    let haemoglobin = ["HbO2", "Hb"].map(|name| species.iter().position(|s| s.name == name && s.unit == "uM"));
    let haemoglobin = if let [Some(a), Some(b)] = haemoglobin { Some([a, b]) } else { None };
    let design = params.design.as_ref().and_then(|design| {
        let of_maps = channels.as_ref().map(|c| &c.wavelengths_nm[..]);
        Design::of(design, (&species, haemoglobin, &fixed), of_maps, largest, &catalogue, problems)
    });
    let channels = channels?;
    let wavelengths = &channels.wavelengths_nm;
    let columns =
        species.iter().enumerate().map(|(k, s)| s.column(wavelengths, &format!("chromophores.{k}"), problems));
    let columns: Vec<Option<Vec<f64>>> = columns.collect();
    let mut known = vec![0.0; wavelengths.len()];
    for (species, amount) in &fixed {
        let column = species.column(wavelengths, &format!("fixed.{}", species.name), problems)?;
        known.iter_mut().zip(column).for_each(|(sum, mu_a)| *sum += amount * mu_a);
    }
    let columns: Vec<Vec<f64>> = columns.into_iter().collect::<Option<_>>()?;
    if wavelengths.len() < columns.len() {
        let (many, few) = (columns.len(), wavelengths.len());
        let message = format!("{many} chromophores are looked for at {few} wavelengths, {} nm", listed(wavelengths));
        problems.push_with_hint(
            "chromophores",
            message,
            "name fewer, write known amounts in `fixed`, or measure at more wavelengths",
        );
        return None;
    }
    let condition = condition_number(&columns);
    if condition > largest && largest >= 1.0 {
        let alike = most_alike(&columns).map(|(i, k, cosine)| {
            format!("; {} and {} are most alike, cosine {cosine:.5}", species[i].name, species[k].name)
        });
        let message = format!(
            "{} nm do not tell the chromophores apart: condition number {condition:.1} is above {largest}{}",
            listed(wavelengths),
            alike.unwrap_or_default()
        );
        let way_out = "look for fewer, write known amounts in `fixed`, or measure at other wavelengths (`design` says which); \
                       `largest_condition` is the limit";
        problems.push_with_hint("chromophores", message, way_out);
    }
    let resolved = Resolved { species, channels, columns, fixed: known, condition, haemoglobin, design };
    problems.is_empty().then_some(resolved)
}

/// What does not fit of the maps, with the name of who makes them.
fn unfit(producer: &str, error: Error, problems: &mut Problems) {
    if let Error::Failed { what, way_out } = error {
        let way_out = way_out.unwrap_or_else(|| "connect maps of several wavelengths".to_owned());
        problems.at_input("maps", format!("`{producer}`: {what}"), way_out);
    }
}
