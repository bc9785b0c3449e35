//! Reading look-up tables: what they mean, ln R of each section and f_x, and their own errors.

use turbid_contract::payload::Lut;
use turbid_contract::serde_json::Value;
use turbid_contract::{Attributes, Error, serde_json};
use turbid_optics::LogGrid;

/// The most spatial frequencies.
pub const MOST: usize = 16;

/// Equal up to rounding: one f_x may have passed through a table and the other not.
pub fn same_f_x(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// Reflectance and table must mean the same: convention, g and n at each of the reflectance's wavelengths; where the table was made of phantoms also the
/// reference. Both must say what they mean; the reflectance beside a plate, which is no medium, has no g and n.
pub fn agree(reflectance: &Attributes, lut: &Attributes, wavelengths_nm: &[Option<f64>]) -> Result<(), Error> {
    let beside_plate = reflectance.get("reference").is_some_and(|reference| reference.get("reflectance").is_some());
    for name in MEANING {
        for (what, attributes) in [("table", lut), ("reflectance", reflectance)] {
            let open = beside_plate && what == "reflectance" && name != "convention";
            if !attributes.contains_key(name) && !open {
                return Err(Error::failed(format!("the {what} does not say its {name}")));
            }
        }
    }
    places(lut, wavelengths_nm)?;
    same_meaning(reflectance, lut, Some(wavelengths_nm))
}

/// Attributes that reflectance and table have to share.
const MEANING: [&str; 3] = ["convention", "g", "n"];

/// The same of what both say; of lists only where the wavelengths of the reflectance are known.
pub fn same_meaning(
    reflectance: &Attributes,
    lut: &Attributes,
    wavelengths_nm: Option<&[Option<f64>]>,
) -> Result<(), Error> {
    let of = |attributes: &Attributes, name: &str| {
        attributes.get("reference").and_then(|r| r.get(name)).and_then(Value::as_f64)
    };
    for name in ["mu_a", "mu_s_prime"] {
        if let (Some(a), Some(b)) = (of(reflectance, name), of(lut, name))
            && !same_f_x(a, b)
        {
            return Err(Error::failed_with_hint(
                format!(
                    "the reflectance is relative to a reference with {name} = {a} mm^-1, the table's phantoms to one with {b}"
                ),
                "both must have been seen beside the same reference phantom, said to be the same",
            ));
        }
    }
    for name in MEANING {
        let (Some(a), Some(b)) = (reflectance.get(name), lut.get(name)) else { continue };
        let same = |a: &Value, b: &Value| match (a.as_f64(), b.as_f64()) {
            (Some(a), Some(b)) => same_f_x(a, b),
            _ => a == b,
        };
        let unlike = |a: &Value, b: &Value, at: String| {
            Error::failed_with_hint(
                format!("the reflectance has {name} = {a}{at}, the table {name} = {b}"),
                "calibrate and build_lut must be given the same convention, g and n",
            )
        };
        if !a.is_array() && !b.is_array() {
            if !same(a, b) {
                return Err(unlike(a, b, String::new()));
            }
            continue;
        }
        let Some(wavelengths_nm) = wavelengths_nm else { continue };
        let Ok(places) = places(lut, wavelengths_nm) else { continue };
        for (channel, &wavelength_nm) in wavelengths_nm.iter().enumerate() {
            let a = if a.is_array() { a.get(channel) } else { Some(a) };
            let b = if b.is_array() { places[channel].and_then(|place| b.get(place)) } else { Some(b) };
            if let (Some(a), Some(b)) = (a, b)
                && !same(a, b)
            {
                return Err(unlike(a, b, wavelength_nm.map_or_else(String::new, |nm| format!(" at {nm} nm"))));
            }
        }
    }
    Ok(())
}

/// The place of each wavelength among `wavelengths_nm` of the table; `None` of a table that names none, and is for all. Error: wavelengths that it lacks.
pub fn places(lut: &Attributes, wavelengths_nm: &[Option<f64>]) -> Result<Vec<Option<usize>>, Error> {
    let own = own_wavelengths(lut);
    if own.is_empty() {
        return Ok(vec![None; wavelengths_nm.len()]);
    }
    let place = |nm: f64| own.iter().position(|&other| same_f_x(nm, other));
    let found: Vec<Option<usize>> = wavelengths_nm.iter().map(|nm| nm.and_then(place)).collect();
    let lacks = wavelengths_nm.iter().zip(&found).filter(|(_, place)| place.is_none()).map(|(nm, _)| *nm);
    let lacks: Vec<String> =
        lacks.map(|nm| nm.map_or("a wavelength that is not said".to_owned(), |nm| format!("{nm} nm"))).collect();
    if lacks.is_empty() {
        return Ok(found);
    }
    let what = format!("the reflectance is of {}, the table is for {}", lacks.join(", "), listed(&own));
    Err(Error::failed_with_hint(what, "`wavelengths_nm` of build_lut must name each wavelength of the frames"))
}

/// Wavelengths that the table has and the reflectance lacks, in words.
pub fn unused(lut: &Attributes, wavelengths_nm: &[Option<f64>]) -> Option<String> {
    let here = |nm: &f64| wavelengths_nm.iter().flatten().any(|other| same_f_x(*nm, *other));
    let unused: Vec<f64> = own_wavelengths(lut).into_iter().filter(|nm| !here(nm)).collect();
    (!unused.is_empty()).then(|| format!("the table is also for {}, the reflectance is not", listed(&unused)))
}

fn own_wavelengths(lut: &Attributes) -> Vec<f64> {
    lut.get("wavelengths_nm").and_then(|list| serde_json::from_value(list.clone()).ok()).unwrap_or_default()
}

fn listed(wavelengths_nm: &[f64]) -> String {
    let all: Vec<String> = wavelengths_nm.iter().map(f64::to_string).collect();
    format!("{} nm", all.join(", "))
}

/// g and n of each table that the artifact holds, one after the other, and which of them each of its wavelengths reads.
fn media(lut: &Attributes) -> (Vec<[f64; 2]>, Vec<usize>) {
    let at = |name: &str, k: usize| {
        let value = lut.get(name)?;
        if value.is_array() { value.get(k)?.as_f64() } else { value.as_f64() }
    };
    let (mut found, mut of) = (Vec::new(), Vec::new());
    for k in 0..own_wavelengths(lut).len() {
        let Some(medium) = at("g", k).zip(at("n", k)).map(|(g, n)| [g, n]) else { continue };
        let place = found.iter().position(|known| *known == medium).unwrap_or_else(|| {
            found.push(medium);
            found.len() - 1
        });
        of.push(place);
    }
    (found, of)
}

/// How many tables the artifact holds beside each other, one for each pair of g and n: 1 where it names no wavelengths.
pub fn tables(lut: &Attributes) -> usize {
    media(lut).0.len().max(1)
}

/// Which of its tables a wavelength reads, from [`places`].
pub fn table_of(lut: &Attributes, place: Option<usize>) -> usize {
    place.and_then(|place| media(lut).1.get(place).copied()).unwrap_or(0)
}

/// What the artifact says of itself as of its table number `table` alone.
pub fn of_table(lut: &Attributes, table: usize) -> Attributes {
    let mut attributes = lut.clone();
    if let ([g, n], true) = (media(lut).0.get(table).copied().unwrap_or_default(), tables(lut) > 1) {
        attributes.insert("g".to_owned(), g.into());
        attributes.insert("n".to_owned(), n.into());
    }
    attributes
}

/// The place of an f_x among those of the table. Error: it is not there.
pub fn table_f_x(all: &[f64], wanted: f64) -> Result<usize, Error> {
    all.iter().position(|&f| same_f_x(f, wanted)).ok_or_else(|| {
        let has: Vec<String> = all.iter().map(f64::to_string).collect();
        Error::failed_with_hint(
            format!("the table has f_x = {} mm^-1, the reflectance needs {wanted}", has.join(", ")),
            "build_lut must be given the f_x of the frames",
        )
    })
}

/// How many sections the table has: 1 where it does not speak of any.
pub fn sections(lut: &Lut) -> usize {
    lut.0.attributes.get("sections").and_then(|s| s.as_array()).map_or(1, Vec::len)
}

/// The table of one section, or of one pair of g and n, at the given f_x: ln R, and where it has any its own relative standard errors.
///
/// Errors: axes or columns missing, an f_x that the table lacks, values that no surface goes through.
pub fn read(lut: &Lut, section: usize, f_x: &[f64]) -> Result<(Vec<LogGrid>, Option<Errors>), Error> {
    let axis = |name: &str| -> Result<Vec<f64>, Error> {
        let list = lut.0.attributes.get(name).and_then(|v| serde_json::from_value(v.clone()).ok());
        list.ok_or_else(|| Error::failed(format!("the table does not list its {name}")))
    };
    let (all, mu_a, mu_s_prime) = (axis("f_x")?, axis("mu_a")?, axis("mu_s_prime")?);
    let r_d = lut.0.f64s("r_d").ok_or_else(|| Error::failed("the table has no column r_d"))?;
    let nodes = mu_a.len() * mu_s_prime.len();
    if r_d.len() != parts(lut) * all.len() * nodes {
        let what = format!("the table has {} rows for {} f_x and {nodes} nodes", r_d.len(), all.len());
        return Err(Error::failed(what));
    }
    let column = lut.0.maybe_f64s("r_d_se");
    let (mut grids, mut errors) = (Vec::new(), Errors { u: ln(&mu_a), v: ln(&mu_s_prime), variances: Vec::new() });
    for &wanted in f_x {
        let k = table_f_x(&all, wanted)?;
        let rows = (section * all.len() + k) * nodes..(section * all.len() + k + 1) * nodes;
        let values = &r_d[rows.clone()];
        grids.push(
            LogGrid::new(&mu_a, &mu_s_prime, values)
                .map_err(|e| Error::failed(format!("the table at f_x = {wanted} mm^-1: {e}")))?,
        );
        let of = |i: usize| column.as_ref().and_then(|column| column[rows.start + i]);
        errors
            .variances
            .push(values.iter().enumerate().map(|(i, r)| of(i).map_or(0.0, |se| (se / r).powi(2))).collect());
    }
    let known = errors.variances.iter().flatten().any(|&v: &f64| v > 0.0);
    Ok((grids, known.then_some(errors)))
}

/// Tables that stand one after the other: sections, or pairs of g and n.
pub fn parts(lut: &Lut) -> usize {
    sections(lut) * tables(&lut.0.attributes)
}

/// Whether a table has random errors that it does not know.
pub fn has_unknown_errors(lut: &Lut) -> bool {
    lut.0.maybe_f64s("r_d_se").is_some_and(|column| column.contains(&None))
}

fn ln(nodes: &[f64]) -> Vec<f64> {
    nodes.iter().map(|&x| libm::log(x)).collect()
}

/// Random errors of a table, relative to R: bilinear between the nodes.
pub struct Errors {
    /// ln mu_a and ln mu_s' of the nodes.
    u: Vec<f64>,
    v: Vec<f64>,
    /// For each f_x, ln mu_s' running fastest.
    variances: Vec<Vec<f64>>,
}

impl Errors {
    /// Relative variance of R at `p` for each f_x in use; beyond the nodes that of the nearest edge.
    pub fn at(&self, p: [f64; 2]) -> [f64; MOST] {
        let place = |nodes: &[f64], x: f64| {
            let i = nodes.partition_point(|&node| node <= x).clamp(1, nodes.len() - 1) - 1;
            (i, ((x - nodes[i]) / (nodes[i + 1] - nodes[i])).clamp(0.0, 1.0))
        };
        let ((i, s), (j, t)) = (place(&self.u, p[0]), place(&self.v, p[1]));
        let mut found = [0.0; MOST];
        for (found, variances) in found.iter_mut().zip(&self.variances) {
            let at = |i: usize, j: usize| variances[i * self.v.len() + j];
            *found = (1.0 - s) * ((1.0 - t) * at(i, j) + t * at(i, j + 1))
                + s * ((1.0 - t) * at(i + 1, j) + t * at(i + 1, j + 1));
        }
        found
    }
}
