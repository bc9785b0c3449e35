//! Reading look-up tables: what they mean, ln R of each section and f_x, and their own errors.

use turbid_contract::payload::Lut;
use turbid_contract::{Attributes, Error, serde_json};
use turbid_optics::LogGrid;

/// The most spatial frequencies.
pub const MOST: usize = 16;

/// Equal up to rounding: one f_x may have passed through a table and the other not.
pub fn same_f_x(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// Reflectance and table must mean the same: convention, g and n; where the table was made of phantoms also the reference. Both must say what they mean.
pub fn agree(reflectance: &Attributes, lut: &Attributes) -> Result<(), Error> {
    for name in MEANING {
        for (what, attributes) in [("table", lut), ("reflectance", reflectance)] {
            if !attributes.contains_key(name) {
                return Err(Error::failed(format!("the {what} does not say its {name}")));
            }
        }
    }
    same_meaning(reflectance, lut)
}

/// Attributes that reflectance and table have to share.
const MEANING: [&str; 3] = ["convention", "g", "n"];

/// The same of what both say.
pub fn same_meaning(reflectance: &Attributes, lut: &Attributes) -> Result<(), Error> {
    let of = |attributes: &Attributes, name: &str| {
        attributes.get("reference").and_then(|r| r.get(name)).and_then(serde_json::Value::as_f64)
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
        let same = match (a.as_f64(), b.as_f64()) {
            (Some(a), Some(b)) => same_f_x(a, b),
            _ => a == b,
        };
        if !same {
            return Err(Error::failed_with_hint(
                format!("the reflectance has {name} = {a}, the table {name} = {b}"),
                "calibrate and build_lut must be given the same convention, g and n",
            ));
        }
    }
    Ok(())
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

/// The table of one section at the given f_x: ln R, and where it has any its own relative standard errors.
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
    if r_d.len() != sections(lut) * all.len() * nodes {
        let what = format!("the table has {} rows for {} f_x and {nodes} nodes", r_d.len(), all.len());
        return Err(Error::failed(what));
    }
    let (mut grids, mut errors) = (Vec::new(), Errors { u: ln(&mu_a), v: ln(&mu_s_prime), variances: Vec::new() });
    for &wanted in f_x {
        let k = table_f_x(&all, wanted)?;
        let rows = (section * all.len() + k) * nodes..(section * all.len() + k + 1) * nodes;
        let values = &r_d[rows.clone()];
        grids.push(
            LogGrid::new(&mu_a, &mu_s_prime, values)
                .map_err(|e| Error::failed(format!("the table at f_x = {wanted} mm^-1: {e}")))?,
        );
        let se = lut.0.f64s("r_d_se").map(|se| &se[rows]);
        errors
            .variances
            .push(values.iter().enumerate().map(|(i, r)| se.map_or(0.0, |se| (se[i] / r).powi(2))).collect());
    }
    let known = errors.variances.iter().flatten().any(|&v: &f64| v > 0.0);
    Ok((grids, known.then_some(errors)))
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
