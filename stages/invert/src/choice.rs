//! Which layers of a reflectance are read: by what they say, before a run and in it.

use turbid_contract::layers::{values, wavelengths};
use turbid_contract::{AngleDeg, Error, LayerInfo};

use crate::lut::{MOST, same_f_x};
use crate::params::{Method, Params};

/// What is read of a reflectance.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// mm^-1, increasing; the same of each wavelength.
    pub f_x: Vec<f64>,
    /// The places of R_d at each f_x, by wavelength.
    pub of: Vec<(Option<f64>, Vec<usize>)>,
}

/// The layers that `params` ask for.
///
/// Errors: no layer `r_d`, fewer than two f_x or too many, one that is not there, several orientations, wavelengths of different f_x.
pub fn choose(reflectance: &[LayerInfo], params: &Params) -> Result<Choice, Error> {
    let f_x_of = |places: &[usize]| places.iter().map(|&k| f_x(&reflectance[k])).collect::<Vec<f64>>();
    let mut choice = Choice { f_x: Vec::new(), of: Vec::new() };
    for wavelength_nm in wavelengths(reflectance, "r_d") {
        let places = layers(reflectance, wavelength_nm, params)?;
        let own = f_x_of(&places);
        if choice.of.is_empty() {
            choice.f_x = own;
        } else if choice.f_x != own {
            return Err(Error::failed("the wavelengths of the reflectance have different f_x"));
        }
        choice.of.push((wavelength_nm, places));
    }
    if choice.of.is_empty() { Err(Error::failed("the reflectance holds no layer `r_d`")) } else { Ok(choice) }
}

/// The orientation of the fringes, degrees; 0 where there are none. Error: there are several.
pub fn orientation(reflectance: &[LayerInfo], choice: &Choice) -> Result<f64, Error> {
    let mut orientations = Vec::new();
    for info in choice.of.iter().flat_map(|(_, places)| places).map(|&k| &reflectance[k]) {
        let orientation = info.orientation_deg.unwrap_or(0.0);
        if f_x(info) > 0.0 && !orientations.contains(&orientation) {
            orientations.push(orientation);
        }
    }
    if orientations.len() > 1 {
        let all = orientations.iter().map(f64::to_string).collect::<Vec<_>>().join(" and ");
        let what = format!("the fringes run along {all} deg, and a slope stretches each differently");
        return Err(Error::invalid("f_x", format!("{what}; name f_x of one orientation")));
    }
    Ok(orientations.first().copied().unwrap_or(0.0))
}

fn f_x(info: &LayerInfo) -> f64 {
    info.f_x_per_mm.unwrap_or(0.0)
}

/// The places of the f_x to use, increasing.
fn layers(reflectance: &[LayerInfo], wavelength_nm: Option<f64>, params: &Params) -> Result<Vec<usize>, Error> {
    let mut layers: Vec<(usize, f64)> = values(reflectance, "r_d")
        .filter(|(_, info)| info.wavelength_nm == wavelength_nm)
        .filter(|(_, info)| match (params.orientation_deg, info.orientation_deg) {
            (Some(AngleDeg(wanted)), Some(has)) => wanted == has,
            _ => true,
        })
        .map(|(k, info)| (k, f_x(info)))
        .collect();
    layers.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut distinct: Vec<f64> = layers.iter().map(|l| l.1).collect();
    distinct.dedup_by(|a, b| same_f_x(*a, *b));
    let has = || distinct.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let wanted = match &params.f_x {
        Some(f_x) => f_x.iter().map(|f| f.0).collect(),
        None if distinct.len() < 2 => {
            let what = format!("the reflectance has f_x = {} mm^-1; two that differ are needed", has());
            return Err(Error::failed_with_hint(what, "render at f_x: [0, 0.1], for example"));
        }
        None if params.method != Method::LeastSquares => vec![distinct[0], distinct[distinct.len() - 1]],
        None if distinct.len() > MOST => {
            let what = format!("the reflectance has {} f_x, more than {MOST}", distinct.len());
            return Err(Error::failed_with_hint(what, "list those to use in `f_x`"));
        }
        None => distinct.clone(),
    };
    let only = |f_x: f64| {
        let found: Vec<usize> = layers.iter().filter(|(_, f)| same_f_x(*f, f_x)).map(|(k, _)| *k).collect();
        match found[..] {
            [k] => Ok(k),
            [] => Err(Error::invalid("f_x", format!("the reflectance has f_x = {}, not {f_x} mm^-1", has()))),
            _ => Err(Error::invalid(
                "orientation_deg",
                format!("the reflectance has {} orientations at f_x = {f_x} mm^-1; name one", found.len()),
            )),
        }
    };
    wanted.into_iter().map(only).collect()
}
