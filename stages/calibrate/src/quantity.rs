//! Which layers of sample and reference are divided by each other: by what they say, before a run and in it.

use turbid_contract::layers::{place, size, values, wavelengths};
use turbid_contract::{Error, LayerInfo};

/// A quantity to calibrate: the layer of the sample, and the f_x at which it counts.
pub struct Quantity {
    pub layer: usize,
    pub f_x_per_mm: f64,
}

/// The wavelengths of the sample. Error: it has no fringes.
pub fn lit(sample: &[LayerInfo]) -> Result<Vec<Option<f64>>, Error> {
    let wavelengths = wavelengths(sample, "m_ac");
    if wavelengths.is_empty() { Err(Error::failed("the sample holds no layer `m_ac`")) } else { Ok(wavelengths) }
}

/// Wavelengths in words.
pub fn listed(wavelengths: &[Option<f64>]) -> String {
    let named: Vec<String> = wavelengths.iter().flatten().map(f64::to_string).collect();
    match (wavelengths.len(), named.is_empty()) {
        (1, true) => "one wavelength".to_owned(),
        (1, false) => format!("one wavelength ({} nm)", named[0]),
        (count, _) => format!("{count} wavelengths ({} nm)", named.join(", ")),
    }
}

/// Wavelengths that one arm has and the other lacks, in words. Error where the reference lacks some.
pub fn same_wavelengths(sample: &[LayerInfo], reference: &[LayerInfo]) -> Result<Option<String>, Error> {
    let [own, others] = [sample, reference].map(|infos| wavelengths(infos, "m_ac"));
    let lacks = |of: &[Option<f64>], there: &[Option<f64>]| -> Vec<String> {
        let missing = of.iter().filter(|w| !there.contains(w));
        missing.map(|w| w.map_or("a wavelength without a name".to_owned(), |nm| format!("{nm} nm"))).collect()
    };
    let (missing, unused) = (lacks(&own, &others), lacks(&others, &own));
    if !missing.is_empty() && !others.is_empty() {
        let mut what = format!("the sample was lit with {}, the reference was not", missing.join(", "));
        if !unused.is_empty() {
            what += &format!("; the reference was lit with {}, the sample was not", unused.join(", "));
        }
        return Err(Error::failed_with_hint(what, "render or measure the reference at the wavelengths of the sample"));
    }
    Ok((!unused.is_empty()).then(|| format!("the reference was lit with {}, the sample was not", unused.join(", "))))
}

/// Sizes are (rows, columns). Error: they differ.
pub fn same_size(sample: [u64; 2], reference: [u64; 2]) -> Result<(), Error> {
    if sample == reference {
        return Ok(());
    }
    let what = format!("the sample has {}, the reference {}", size(sample), size(reference));
    Err(Error::failed_with_hint(what, "both must be seen by the same camera"))
}

/// M_AC of each f_x; where there was no frame at f_x = 0, the mean of the fringes of the lowest f_x stands for it.
pub fn quantities(sample: &[LayerInfo], wavelength_nm: Option<f64>) -> Vec<Quantity> {
    let of = |name: &'static str| {
        let layers = values(sample, name).filter(move |(_, info)| info.wavelength_nm == wavelength_nm);
        layers.map(|(layer, info)| Quantity { layer, f_x_per_mm: info.f_x_per_mm.unwrap_or(0.0) })
    };
    let mut found: Vec<Quantity> = of("m_ac").collect();
    if found.iter().all(|q| q.f_x_per_mm > 0.0) {
        let lowest = of("m_dc").min_by(|a, b| a.f_x_per_mm.total_cmp(&b.f_x_per_mm));
        found.splice(0..0, lowest.map(|q| Quantity { f_x_per_mm: 0.0, ..q }));
    }
    found
}

/// The layer of the reference that shows the same quantity. M_DC of fringes is that at f_x = 0: where one arm has a frame of even light and the other has
/// none, the mean of the other's fringes takes its place, of those of the lowest f_x. Error: there is none, or it is in another unit.
pub fn counterpart(reference: &[LayerInfo], wanted: &LayerInfo) -> Result<usize, Error> {
    let lit = |info: &LayerInfo| info.wavelength_nm == wanted.wavelength_nm;
    let same = |info: &LayerInfo| {
        lit(info) && info.f_x_per_mm == wanted.f_x_per_mm && info.orientation_deg == wanted.orientation_deg
    };
    let f_x = |info: &LayerInfo| info.f_x_per_mm.unwrap_or(0.0);
    let even = wanted.name == "m_dc" || f_x(wanted) == 0.0;
    let means = || {
        let all = values(reference, "m_dc").filter(|(_, info)| lit(info));
        all.min_by(|(_, a), (_, b)| f_x(a).total_cmp(&f_x(b)))
    };
    let found = values(reference, &wanted.name).find(|(_, info)| same(info)).or_else(|| even.then(means).flatten());
    let Some((k, found)) = found else {
        let has: Vec<String> = values(reference, &wanted.name).map(|(_, info)| place(info)).collect();
        let has = if has.is_empty() { "none".to_owned() } else { has.join("; ") };
        return Err(Error::failed_with_hint(
            format!("the sample has {} at {}, the reference has it at {has}", wanted.name, place(wanted)),
            "render or measure the reference at the f_x, orientation and wavelength of the sample",
        ));
    };
    if found.unit != wanted.unit {
        let what = format!("the sample has {} in {}, the reference in {}", wanted.name, wanted.unit, found.unit);
        return Err(Error::failed_with_hint(what, "import or render both arms in the same unit"));
    }
    Ok(k)
}
