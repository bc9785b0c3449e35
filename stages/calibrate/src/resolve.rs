//! The reference at each wavelength of the sample, from what is said of it; what the reflectance then says of its reference.

use std::sync::Arc;

use turbid_contract::payload::{CONDITIONS, Conditions, PhaseFunction};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Attributes, Error, PerChannel, serde_json};

use crate::model::{Phantom, Plate, Standard};
use crate::quantity::listed;
use crate::reference::{Reference, TABLE};
use crate::table::Table;

/// Content of the file that a field names.
pub type Lend<'a> = dyn Fn(&str) -> Option<Arc<[u8]>> + 'a;

/// The reference at each wavelength, and the attributes `reference`, `g`, `n` of the reflectance (no g and n of a plate).
#[derive(Clone, Debug)]
pub struct Resolved {
    pub at: Vec<Standard>,
    pub said: Vec<(&'static str, Value)>,
}

/// `arm`: what the reference arm says of itself. `None` where the file of the table cannot be read (which is told elsewhere), or params are incomplete.
///
/// Errors: lists of another length than the wavelengths, a file that is no table or does not reach, an object that the arm does not show.
pub fn resolve(
    reference: &Reference,
    wavelengths_nm: &[Option<f64>],
    arm: &Attributes,
    lend: &Lend<'_>,
) -> Result<Option<Resolved>, Error> {
    if let Some((name, values)) = reference.unfit(wavelengths_nm.len()).next() {
        let what = format!("{values} values for the sample's {}", listed(wavelengths_nm));
        let message = format!("{what}; give one for each, or one number for all");
        return Err(Error::invalid(format!("reference.{name}"), message));
    }
    let channels = wavelengths_nm.iter().enumerate();
    let found: Option<Vec<Standard>> = if reference.table.is_some() {
        let Some(bytes) = lend(TABLE) else { return Ok(None) };
        let table = Table::read(reference, &bytes)?;
        let at: Result<Vec<Standard>, Error> = channels.map(|(k, &nm)| table.at(reference, nm, k)).collect();
        Some(at?)
    } else if let Some(object) = &reference.object {
        Some(shown(object, arm, wavelengths_nm)?)
    } else if let Some(reflectance) = &reference.reflectance {
        let plate = |k: usize| Some(Standard::Plate(Plate { r_d: vec![(None, reflectance.of(k)?.0)] }));
        channels.map(|(k, _)| plate(k)).collect()
    } else {
        channels.map(|(k, _)| given(reference, k).map(Standard::Medium)).collect()
    };
    let as_given = reference.table.is_none() && reference.object.is_none();
    Ok(found.map(|at| {
        let said = if as_given { as_written(reference) } else { as_found(&at) };
        Resolved { at, said }
    }))
}

fn given(reference: &Reference, channel: usize) -> Option<Phantom> {
    Some(Phantom {
        mu_a: reference.mu_a.as_ref()?.of(channel)?.0,
        mu_s_prime: reference.mu_s_prime.as_ref()?.of(channel)?.0,
        g: *reference.g.as_ref()?.of(channel)?,
        n: *reference.n.as_ref()?.of(channel)?,
    })
}

/// The object of that name, as the reference arm says that it was seen.
fn shown(object: &str, arm: &Attributes, wavelengths_nm: &[Option<f64>]) -> Result<Vec<Standard>, Error> {
    let wrong = |message: String| Error::invalid("reference.object", message);
    let Some(Conditions { seen, .. }) = Conditions::of(arm, CONDITIONS) else {
        return Err(wrong(
            "the reference arm does not say what it shows; write `mu_a`, `mu_s_prime`, `g`, `n`".to_owned(),
        ));
    };
    let Some(of) = seen.iter().find(|seen| seen.object == object) else {
        let named: Vec<&str> = seen.iter().map(|seen| seen.object.as_str()).filter(|name| !name.is_empty()).collect();
        let shows = if named.is_empty() { "nothing that has a name".to_owned() } else { named.join(", ") };
        return Err(wrong(format!("the reference arm shows {shows}, not `{object}`")));
    };
    let g = match of.phase {
        None => None,
        Some(PhaseFunction::HenyeyGreenstein(g)) => Some(g),
        Some(PhaseFunction::TwoTermHenyeyGreenstein { .. }) => {
            let what = "which the models of phantoms do not know: they scatter by one g";
            let way_out = "give its `reflectance`, or `mu_a`, `mu_s_prime`, `g`, `n` of a phantom that stands for it";
            return Err(wrong(format!("`{object}` has the phase function two_term, {what}; {way_out}")));
        }
    };
    let (Some(g), Some(n)) = (g, of.n) else {
        return Err(wrong(format!("g and n of `{object}` are not known; write `mu_a`, `mu_s_prime`, `g`, `n`")));
    };
    let count = wavelengths_nm.len();
    if of.mu_a.len() != count || of.mu_s_prime.len() != count {
        let what =
            format!("`{object}` is known at {} wavelengths, the sample has {}", of.mu_a.len(), listed(wavelengths_nm));
        return Err(wrong(what));
    }
    let pairs = of.mu_a.iter().zip(&of.mu_s_prime);
    pairs
        .map(|(&mu_a, &mu_s_prime)| {
            let phantom = Phantom { mu_a, mu_s_prime, g, n };
            let scatters = mu_s_prime > 0.0;
            scatters.then_some(Standard::Medium(phantom)).ok_or_else(|| wrong(format!("`{object}` does not scatter")))
        })
        .collect()
}

fn as_written(reference: &Reference) -> Vec<(&'static str, Value)> {
    let json = |value: Result<Value, serde_json::Error>| value.expect("names and finite numbers are JSON");
    let mut said = vec![("reference", json(serde_json::to_value(reference)))];
    for (name, list) in [("g", &reference.g), ("n", &reference.n)] {
        said.extend(list.as_ref().map(|list| (name, json(serde_json::to_value(list)))));
    }
    said
}

/// Each quantity at each wavelength; one number where all wavelengths share it.
fn as_found(at: &[Standard]) -> Vec<(&'static str, Value)> {
    let list = |values: Vec<f64>| match values[..] {
        [first, ..] if values.iter().all(|v| *v == first) => PerChannel::One(first),
        _ => PerChannel::Each(values),
    };
    let phantoms: Vec<&Phantom> =
        at.iter().filter_map(|s| if let Standard::Medium(p) = s { Some(p) } else { None }).collect();
    if phantoms.len() == at.len() {
        let of = |value: &dyn Fn(&Phantom) -> f64| json!(list(phantoms.iter().map(|p| value(p)).collect()));
        let (g, n) = (of(&|p| p.g), of(&|p| p.n));
        let medium = json!({"mu_a": of(&|p| p.mu_a), "mu_s_prime": of(&|p| p.mu_s_prime), "g": g, "n": n});
        return vec![("reference", medium), ("g", g), ("n", n)];
    }
    let plates: Vec<&Plate> =
        at.iter().filter_map(|s| if let Standard::Plate(p) = s { Some(p) } else { None }).collect();
    let columns = plates.first().map_or(0, |plate| plate.r_d.len());
    let r_d = |k: usize| list(plates.iter().map(|plate| plate.r_d[k].1).collect());
    let f_x: Vec<Option<f64>> = plates.first().into_iter().flat_map(|plate| &plate.r_d).map(|(f_x, _)| *f_x).collect();
    let said = match f_x[..] {
        [None] => json!({"reflectance": r_d(0)}),
        _ => json!({"f_x": f_x, "reflectance": (0..columns).map(r_d).collect::<Vec<_>>()}),
    };
    vec![("reference", said)]
}
