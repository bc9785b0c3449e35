//! Which quantities an estimate and a truth have in common: by what their layers say, before a run and in it.

use turbid_contract::layers::values;
use turbid_contract::{Error, LayerInfo, LayerKind};

/// The quantities that both hold. Errors: none, or one in two units.
pub fn shared(estimate: &[LayerInfo], truth: &[LayerInfo]) -> Result<Vec<(usize, usize)>, Error> {
    let mut found = Vec::new();
    for (k, info) in estimate.iter().enumerate().filter(|(_, info)| info.kind == LayerKind::Value) {
        // A truth without wavelength holds for all of them.
        let same = |other: &LayerInfo| other.wavelength_nm.is_none() || other.wavelength_nm == info.wavelength_nm;
        let Some((of, other)) = values(truth, &info.name).find(|(_, other)| same(other)) else { continue };
        if other.unit != info.unit {
            return Err(Error::failed(format!("{} is given in {}, the truth in {}", info.name, info.unit, other.unit)));
        }
        found.push((k, of));
    }
    if found.is_empty() {
        let names = |infos: &[LayerInfo]| {
            let values = infos.iter().filter(|info| info.kind == LayerKind::Value);
            values.map(|info| info.name.clone()).collect::<Vec<_>>().join(", ")
        };
        let what = format!("estimate ({}) and truth ({}) share no quantity", names(estimate), names(truth));
        return Err(Error::failed(what));
    }
    Ok(found)
}
