//! The power port: where the light of all sources went, as a table.

use serde_json::json;
use turbid_contract::payload::{Power, Scene};
use turbid_contract::{Cells, Table};

use crate::forward::Tally;

/// One row for each way out, each object that is not void and each detector, channel by channel. `object_of` gives for each body its place among
/// the objects.
pub fn power(scene: &Scene, object_of: &[usize], tallies: &[Tally]) -> Power {
    let names: Vec<&String> = scene.objects.keys().collect();
    let (mut detectors, mut wavelengths) = (Vec::new(), Vec::new());
    let mut figures: [Vec<f64>; 4] = Default::default();
    for (channel, tally) in tallies.iter().enumerate() {
        let n = tally.photons as f64;
        let absorbed = object_of.iter().zip(&tally.absorbed);
        let absorbed = absorbed.map(|(&object, &count)| (format!("absorbed in {}", names[object]), count));
        let left = ["left upwards", "left downwards"].into_iter().map(str::to_owned).zip(tally.left);
        // Every photon either comes there or does not, ...
        let once = left.chain(absorbed).map(|(name, count)| {
            let share = count as f64 / n;
            (name, share, share * (1.0 - share))
        });
        // ... but it may come through a detector several times.
        let detected = scene.detectors.iter().zip(&tally.detected).map(|((name, d), found)| {
            let name = if d.absorbs { format!("taken by {name}") } else { format!("through {name}") };
            let share = found.passages as f64 / n;
            (name, share, (found.squares as f64 / n - share * share).max(0.0))
        });
        for (detector, share, variance) in once.chain(detected) {
            let se = (variance / (n - 1.0)).sqrt();
            detectors.push(detector);
            wavelengths.extend(scene.wavelengths_nm.get(channel));
            for (figure, value) in figures.iter_mut().zip([tally.power * share, tally.power * se, share, se]) {
                figure.push(value);
            }
        }
    }
    let mut table = Table::default();
    table.attributes.insert("photons".to_owned(), json!(tallies.first().map_or(0, |t| t.photons)));
    table.push("detector", "", Cells::Text(detectors));
    if !wavelengths.is_empty() {
        table.push("wavelength_nm", "nm", Cells::F64(wavelengths));
    }
    let units = [("power", "W"), ("power_se", "W"), ("share", "1"), ("share_se", "1")];
    for ((name, unit), figure) in units.into_iter().zip(figures) {
        table.push(name, unit, Cells::F64(figure));
    }
    Power(table)
}
