//! The inverse question: what to put into a phantom so that it has wanted properties.

use std::collections::{BTreeMap, BTreeSet};

use turbid_contract::{Artifact, ArtifactKind, Axes, Cells, Error, Payload, Table};

use crate::empirical::{contains, degenerate, hull};
use crate::phantoms::Phantom;
use crate::surface::Surface;

/// One row for each wanted medium: columns wanted_mu_a, wanted_mu_s_prime (mm^-1), and for both axes of the phantoms their value, in the axis' own unit, and
/// its standard error (`NAME`, `NAME_se`).
#[derive(Clone, Debug, PartialEq)]
pub struct Design(pub Table);

impl Payload for Design {
    const NAME: &'static str = "design";
    const KIND: ArtifactKind = ArtifactKind::Table;

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("a design must be a table, not {:?}", other.kind()))),
        }
    }
}

/// The values of the phantoms' two axes, densities for example, that give each wanted (mu_a, mu_s'): ln of either is a polynomial of
/// (ln mu_a, ln mu_s') through the phantoms, as in a table. Errors of the phantoms' properties count by its slopes.
///
/// Errors: other than two axes that vary, values that are no numbers > 0, phantoms on a line, media beyond the phantoms.
pub fn design(axes: &[Axes], phantoms: &[Phantom], wanted: &[[f64; 2]]) -> Result<Design, Error> {
    let varied = varied(axes)?;
    let points: Vec<[f64; 2]> = phantoms.iter().map(|p| p.properties.map(libm::log)).collect();
    let places: Vec<[f64; 2]> = wanted.iter().map(|p| p.map(libm::log)).collect();
    let hull = hull(&points);
    for (i, (place, [mu_a, mu_s_prime])) in places.iter().zip(wanted).enumerate() {
        if hull.len() > 2 && !contains(&hull, *place) {
            let what = format!("no phantom is beyond mu_a = {mu_a}, mu_s' = {mu_s_prime} mm^-1 (wanted.{i})");
            return Err(Error::failed_with_hint(what, "a design is not extrapolated: add phantoms on its other side"));
        }
    }
    let surface = Surface::through(&points, &places).ok_or_else(degenerate)?;
    let mut table = Table::default();
    let column = |k: usize| Cells::F64(wanted.iter().map(|w| w[k]).collect());
    table.push("wanted_mu_a", "mm^-1", column(0));
    table.push("wanted_mu_s_prime", "mm^-1", column(1));
    for (name, values) in varied {
        let logs: Vec<f64> = values.iter().map(|&v| libm::log(v)).collect();
        let moved = |(p, &at): (&Phantom, &[f64; 2])| {
            let slopes = surface.slopes(&logs, at);
            let by = [0, 1].map(|i| slopes[i] * p.properties_se[i] / p.properties[i]);
            by[0] * by[0] + by[1] * by[1]
        };
        let variances: Vec<f64> = phantoms.iter().zip(&points).map(moved).collect();
        let found: Vec<f64> = places.iter().map(|&place| libm::exp(surface.value(&logs, place))).collect();
        let se = |(place, value): (&[f64; 2], &f64)| {
            value * surface.weights(*place).iter().zip(&variances).map(|(w, v)| w * w * v).sum::<f64>().sqrt()
        };
        let se = places.iter().zip(&found).map(se).collect();
        table.push(name.as_str(), "", Cells::F64(found));
        table.push(format!("{name}_se"), "", Cells::F64(se));
    }
    Ok(Design(table))
}

/// The axes that are not the same for all phantoms, with the value that each phantom has.
fn varied(axes: &[Axes]) -> Result<Vec<(String, Vec<f64>)>, Error> {
    let mut values: BTreeMap<&String, BTreeSet<String>> = BTreeMap::new();
    for (axis, value) in axes.iter().flatten() {
        values.entry(axis).or_default().insert(value.to_string());
    }
    let names: Vec<&String> = values.iter().filter(|(_, values)| values.len() > 1).map(|(name, _)| *name).collect();
    let two = "a design tells the values of the two axes that make the phantoms, densities of absorber and scatterer for example";
    if names.len() != 2 {
        let has: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
        let what = format!("the phantoms vary along {} axes ({})", has.len(), has.join(", "));
        return Err(Error::failed_with_hint(what, two));
    }
    let of = |name: &String| {
        let value = |axes: &Axes| {
            let found = axes.get(name).and_then(|v| v.as_f64()).filter(|&v| v > 0.0);
            found.ok_or_else(|| {
                let what = format!("the phantoms' axis {name} has a value that is no number > 0");
                Error::failed_with_hint(what, two)
            })
        };
        Ok((name.clone(), axes.iter().map(value).collect::<Result<Vec<f64>, Error>>()?))
    };
    names.into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Densities to properties: power laws, a little crossed, as mixtures are.
    fn properties(a: f64, s: f64) -> [f64; 2] {
        [1e-3 * libm::pow(a, 1.1) * libm::pow(s / 1e4, 0.05), 2e-4 * libm::pow(s, 0.95) * libm::pow(a, -0.02)]
    }

    fn phantoms(se: f64) -> (Vec<Axes>, Vec<Phantom>) {
        let grid = [1.0, 50.0, 100.0].into_iter().flat_map(|a| [5e3, 12.5e3, 20e3].map(|s| (a, s)));
        let one = |(a, s): (f64, f64)| {
            let axes =
                Axes::from([("A".to_owned(), json!(a)), ("S".to_owned(), json!(s)), ("g".to_owned(), json!(0.8))]);
            let properties = properties(a, s);
            let properties_se = [se * properties[0], 0.0];
            (axes, Phantom { properties, properties_se, ratio: Vec::new(), ratio_se: Vec::new(), ratio_known: true })
        };
        grid.map(one).unzip()
    }

    /// Power laws come back exactly, also between the phantoms; where they stand their own error of mu_a is that of the density, by the exponent
    /// (1 / 1.1, and a thousandth for the crossing).
    #[test]
    fn densities_of_wanted_media_come_back() {
        let (axes, phantoms) = phantoms(0.02);
        let densities = [(3.0, 7e3), (20.0, 15e3), (90.0, 6e3), (50.0, 12.5e3)];
        let wanted: Vec<[f64; 2]> = densities.iter().map(|&(a, s)| properties(a, s)).collect();
        let Design(table) = design(&axes, &phantoms, &wanted).unwrap();
        let column = |name: &str| table.f64s(name).unwrap();
        for (i, (a, s)) in densities.into_iter().enumerate() {
            let off = [column("A")[i] / a - 1.0, column("S")[i] / s - 1.0];
            assert!(off.iter().all(|off| off.abs() < 1e-9), "({a}, {s}): {off:?}");
        }
        let se = column("A_se")[3] / 50.0;
        assert!((se / (0.02 / 1.101) - 1.0).abs() < 2e-3, "{se}");
        assert_eq!(column("wanted_mu_a")[0], wanted[0][0]);
    }

    #[test]
    fn mistakes_are_named() {
        let (mut axes, phantoms) = phantoms(0.0);
        let message = |axes: &[Axes], wanted: [f64; 2]| design(axes, &phantoms, &[wanted]).unwrap_err().to_string();
        assert!(message(&axes, [0.5, 2.0]).contains("no phantom is beyond mu_a = 0.5, mu_s' = 2"), "{axes:?}");
        let inside = properties(20.0, 1e4);
        axes[3].insert("g".to_owned(), json!(0.9));
        assert!(message(&axes, inside).contains("vary along 3 axes (A, S, g)"));
        axes[3].insert("g".to_owned(), json!(0.8));
        axes[3].insert("A".to_owned(), json!("black"));
        assert!(message(&axes, inside).contains("axis A has a value that is no number > 0"));
    }
}
