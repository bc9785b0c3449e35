//! The power port: where the light of all sources went, as a table.

use serde_json::json;
use turbid_contract::payload::{Power, Scene};
use turbid_contract::{Cells, ColumnInfo, Form, Table};

use crate::forward::Tally;
use crate::interval::{CONFIDENCE, fraction as interval};

/// One row for each way out, each object that is not void, and each detector, channel by channel. `object_of` gives for each body its place among the objects.
pub fn power(scene: &Scene, object_of: &[usize], tallies: &[Tally]) -> Power {
    let names: Vec<&String> = scene.objects.keys().collect();
    let (mut detectors, mut wavelengths) = (Vec::new(), Vec::new());
    let (mut shares, mut powers): ([Vec<f64>; 3], [Vec<f64>; 3]) = Default::default();
    let (mut share_se, mut power_se) = (Vec::new(), Vec::new());
    for (channel, tally) in tallies.iter().enumerate() {
        let n = tally.photons as f64;
        let absorbed = object_of.iter().zip(&tally.absorbed);
        let absorbed = absorbed.map(|(&object, &count)| (format!("absorbed in {}", names[object]), count));
        let left = ["left upwards", "left downwards"].into_iter().map(str::to_owned).zip(tally.left);
        // Every photon either comes there or does not, ...
        let once = left.chain(absorbed).map(|(name, count)| (name, count, count));
        // ... but it may come through a detector several times.
        let detected = scene.detectors.iter().zip(&tally.detected).map(|((name, d), found)| {
            let name = if d.absorbs { format!("taken by {name}") } else { format!("through {name}") };
            (name, found.passages, found.squares)
        });
        for (detector, sum, squares) in once.chain(detected) {
            let (sum, squares) = (sum as f64, squares as f64);
            let share = sum / n;
            let variance = (squares / n - share * share) / (n - 1.0);
            // Photons that all did the same know nothing of their scatter.
            let se = (variance > 0.0).then(|| variance.sqrt());
            let [low, high] = interval(sum, squares, n);
            detectors.push(detector);
            wavelengths.extend(scene.wavelengths_nm.get(channel));
            for (i, value) in [share, low, high].into_iter().enumerate() {
                shares[i].push(value);
                powers[i].push(tally.power * value);
            }
            share_se.push(se);
            power_se.push(se.map(|se| tally.power * se));
        }
    }
    let mut table = Table::default();
    table.attributes.insert("photons".to_owned(), json!(tallies.first().map_or(0, |t| t.photons)));
    table.attributes.insert("confidence".to_owned(), json!(CONFIDENCE));
    table.push("detector", "", Cells::Text(detectors));
    if !wavelengths.is_empty() {
        table.push("wavelength_nm", "nm", Cells::F64(wavelengths));
    }
    for (name, unit, [value, low, high], se) in [("power", "W", powers, power_se), ("share", "1", shares, share_se)] {
        table.push(name, unit, Cells::F64(value));
        table.push(format!("{name}_se"), unit, Cells::MaybeF64(se));
        table.push(format!("{name}_low"), unit, Cells::F64(low));
        table.push(format!("{name}_high"), unit, Cells::F64(high));
    }
    Power(table)
}

/// The form of that table, by so many `photons` of each wavelength.
pub fn form(scene: &Scene, photons: u32) -> Form {
    let of_channel = 2 + scene.objects.len() + scene.detectors.len();
    let mut columns = vec![ColumnInfo::new("detector", "")];
    if !scene.wavelengths_nm.is_empty() {
        columns.push(ColumnInfo::new("wavelength_nm", "nm"));
    }
    for (name, unit) in [("power", "W"), ("share", "1")] {
        columns.extend(["", "_se", "_low", "_high"].map(|part| ColumnInfo::new(format!("{name}{part}"), unit)));
    }
    let rows = Some((scene.channels() * of_channel) as u64);
    let attributes = [("photons", json!(u64::from(photons))), ("confidence", json!(CONFIDENCE))];
    let attributes = attributes.map(|(name, value)| (name.to_owned(), value)).into();
    Form { rows, columns: Some(columns), attributes, ..Form::default() }
}
