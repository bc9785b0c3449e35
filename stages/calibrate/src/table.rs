//! The file `reference.table`: what a supplier or a laboratory states of its phantom over wavelength.

use turbid_contract::problem::At;
use turbid_contract::{Error, Problem};
use turbid_optics::{Spectrum, spectra};

use crate::model::{Phantom, Plate, Standard};
use crate::reference::{CoefficientUnit, Reference, TABLE, rule};

/// The columns of the file by what they are, coefficients in mm^-1.
#[derive(Clone, Debug)]
pub struct Table {
    file: String,
    columns: Vec<(Column, Spectrum)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    MuA,
    MuSPrime,
    G,
    N,
    /// At this f_x, or at any.
    Reflectance(Option<f64>),
}

impl Column {
    fn name(self) -> &'static str {
        match self {
            Self::MuA => "mu_a",
            Self::MuSPrime => "mu_s_prime",
            Self::G => "g",
            Self::N => "n",
            Self::Reflectance(_) => "reflectance",
        }
    }
}

/// What a column holds, and the unit that its name says; `None` of columns that are for other readers.
fn column(name: &str) -> Option<(Column, Option<CoefficientUnit>)> {
    if let Some(f_x) = name.strip_prefix("reflectance@") {
        let f_x = f_x.parse::<f64>().ok().filter(|f_x| *f_x >= 0.0 && f_x.is_finite())?;
        return Some((Column::Reflectance(Some(f_x)), None));
    }
    let ends = |(end, unit): &(&'static str, CoefficientUnit)| Some((name.strip_suffix(end)?, Some(*unit)));
    let (name, unit) = CoefficientUnit::BY_SUFFIX.iter().find_map(ends).unwrap_or((name, None));
    let found = match (name, unit) {
        ("mu_a", _) => Column::MuA,
        ("mu_s_prime", _) => Column::MuSPrime,
        ("g", None) => Column::G,
        ("n", None) => Column::N,
        ("reflectance", None) => Column::Reflectance(None),
        _ => return None,
    };
    Some((found, unit))
}

impl Table {
    /// Errors, at the field `reference.table`: a file that is no such table, units said twice, quantities missing or said twice.
    pub fn read(reference: &Reference, bytes: &[u8]) -> Result<Self, Error> {
        let file = reference.table.clone().unwrap_or_default();
        let wrong = |message: String| Error::invalid(TABLE, message);
        let value = |name: &str, value: f64| {
            let Some((column, unit)) = column(name) else { return Ok(value) };
            rule(column.name(), value).map_err(str::to_owned)?;
            let coefficient = matches!(column, Column::MuA | Column::MuSPrime);
            let unit = unit.or(reference.unit).unwrap_or_default();
            Ok(if coefficient { value * unit.to_mm() } else { value })
        };
        let all = spectra::read(bytes, &value)
            .map_err(|e| wrong(format!("{file}:{}:{}: {}", e.line, e.column, e.message)))?;
        let mut columns: Vec<(Column, Spectrum)> = Vec::new();
        let names: Vec<String> = all.iter().map(|(name, _)| name.clone()).collect();
        for (name, spectrum) in all {
            let Some((found, unit)) = column(&name) else { continue };
            if columns.iter().any(|(known, _)| *known == found) {
                return Err(wrong(format!("{file}: the column {name} says again what another one says")));
            }
            if let (Some(unit), Some(said)) = (unit, reference.unit)
                && unit != said
            {
                return Err(wrong(format!("{file}: the column {name} has another unit than `unit`; leave `unit` out")));
            }
            columns.push((found, spectrum));
        }
        let table = Self { file, columns };
        let file = &table.file;
        let medium = [Column::MuA, Column::MuSPrime].map(|column| table.find(column).is_some());
        let plate = table.columns.iter().any(|(column, _)| matches!(column, Column::Reflectance(_)));
        match (medium, plate) {
            ([true, true], false) => {
                for (column, given) in [(Column::G, reference.g.is_some()), (Column::N, reference.n.is_some())] {
                    let name = column.name();
                    match (given, table.find(column).is_some()) {
                        (true, true) => {
                            return Err(wrong(format!("{file}: {name} is a column, and `reference.{name}` is given")));
                        }
                        (false, false) => {
                            return Err(wrong(format!("{file}: no column {name}; write `{name}` beside `table`")));
                        }
                        _ => {}
                    }
                }
                Ok(table)
            }
            ([false, false], true) if reference.g.is_none() && reference.n.is_none() => Ok(table),
            ([false, false], true) => Err(wrong(format!("{file}: a plate has no g and n; leave them out"))),
            ([true, true], true) => {
                Err(wrong(format!("{file}: mu_a and mu_s_prime or reflectance are wanted, not both")))
            }
            _ => Err(wrong(format!(
                "{file}: the columns mu_a and mu_s_prime, or reflectance, are wanted; it has {}",
                names.join(", ")
            ))),
        }
    }

    fn find(&self, wanted: Column) -> Option<&Spectrum> {
        self.columns.iter().find(|(column, _)| *column == wanted).map(|(_, spectrum)| spectrum)
    }

    /// The reference at a wavelength, the sample's number `channel`. Errors: frames that do not say their wavelength, one that the table does not reach.
    pub fn at(&self, reference: &Reference, wavelength_nm: Option<f64>, channel: usize) -> Result<Standard, Error> {
        let Self { file, columns } = self;
        let Some(nm) = wavelength_nm else {
            let what = format!("the sample's frames do not say their wavelength, and {file} is a table over it");
            let way_out = "say it: `wavelength_nm` of the scene, or of import_frames";
            return Err(Error::failed_with_hint(what, way_out));
        };
        let [first, last] = columns[0].1.range_nm();
        let of = |spectrum: &Spectrum| {
            spectrum.at(nm).ok_or_else(|| {
                let message = format!(
                    "{file} reaches from {first} to {last} nm, the sample was lit with {nm} nm; nothing is extrapolated"
                );
                let hint = Some("give a table that covers the wavelengths of the frames".to_owned());
                Error::Invalid(Problem { at: At::With, path: TABLE.to_owned(), message, hint })
            })
        };
        let Some((mu_a, mu_s_prime)) = self.find(Column::MuA).zip(self.find(Column::MuSPrime)) else {
            let mut r_d = Vec::new();
            for (column, spectrum) in columns {
                if let Column::Reflectance(f_x) = column {
                    r_d.push((*f_x, of(spectrum)?));
                }
            }
            return Ok(Standard::Plate(Plate { r_d }));
        };
        let number = |column: Column, given: &Option<turbid_contract::PerChannel<f64>>| match self.find(column) {
            Some(spectrum) => of(spectrum),
            None => {
                let given = given.as_ref().and_then(|given| given.of(channel)).copied();
                given.ok_or_else(|| Error::invalid(TABLE, format!("{file}: no column {}", column.name())))
            }
        };
        Ok(Standard::Medium(Phantom {
            mu_a: of(mu_a)?,
            mu_s_prime: of(mu_s_prime)?,
            g: number(Column::G, &reference.g)?,
            n: number(Column::N, &reference.n)?,
        }))
    }
}
