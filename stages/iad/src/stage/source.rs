//! Where readings come from, and what their source says of sample and instrument.

use turbid_contract::serde_json::Value;
use turbid_contract::{Cells, Ctx, Error, Table};

use super::params::{LostLight, Params, SpheresChoice};
use crate::laboratory::{Sheet, read_csv, read_rxt};
use crate::{Instrument, Lost, Measurement, Slab, Slide, Sphere, Spheres};

pub fn has_suffix(path: &str, suffix: &str) -> bool {
    path.to_ascii_lowercase().ends_with(suffix)
}

pub fn is_rxt(path: &str) -> bool {
    has_suffix(path, ".rxt")
}

/// Readings with what their source says of sample and instrument.
pub struct Source {
    pub sheet: Sheet,
    n: Option<f64>,
    thickness_mm: Option<f64>,
    slides: Option<f64>,
    pub instrument: Instrument,
    /// What the readings say of their spheres that the energy balance does not know.
    pub beyond_balance: Vec<String>,
}

/// A row with all that its inversion needs.
pub struct Case {
    pub slab: Slab,
    pub instrument: Instrument,
    pub measured: Measurement,
    /// With its standard error.
    pub m_u: Option<(f64, f64)>,
}

impl Source {
    pub fn of_file(path: &str, ctx: Ctx<'_>) -> Result<Self, Error> {
        let bytes = ctx.file("file").ok_or_else(|| Error::failed(format!("`{path}` was not handed over")))?;
        Self::of_bytes(path, &bytes)
    }

    pub fn of_bytes(path: &str, bytes: &[u8]) -> Result<Self, Error> {
        let read = if is_rxt(path) { read_rxt(bytes) } else { read_csv(bytes) };
        let sheet =
            read.map_err(|e| Error::invalid("file", format!("{path}:{}:{}: {}", e.line, e.column, e.message)))?;
        let header = sheet.header.clone();
        Ok(Self {
            n: header.as_ref().map(|h| h.n_sample),
            thickness_mm: header.as_ref().map(|h| h.thickness_mm),
            slides: header.as_ref().map(|h| h.n_slides),
            instrument: header.map_or(Instrument::NONE, |h| h.instrument),
            beyond_balance: Vec::new(),
            sheet,
        })
    }

    pub fn of_readings(table: &Table) -> Result<Self, Error> {
        let mut sheet = Sheet::default();
        for column in &table.columns {
            match &column.cells {
                Cells::Text(names) if column.name == "medium" => sheet.media = names.clone(),
                Cells::F64(values) => sheet.columns.push((column.name.clone(), values.clone())),
                _ => {}
            }
        }
        let number = |name: &str| table.attributes.get(name).and_then(Value::as_f64);
        let mut instrument = Instrument { r_standard: number("r_standard").unwrap_or(1.0), ..Instrument::NONE };
        let mut beyond_balance = Vec::new();
        if let Some(spheres) = table.attributes.get("spheres") {
            if let Some(bounces) = spheres.get("bounces").and_then(Value::as_u64) {
                beyond_balance.push(format!("light that ends after {bounces} bounces"));
            }
            // A rounding of the rim's depth is no neck.
            if let Some(neck) = spheres.get("neck").and_then(Value::as_f64).filter(|neck| *neck > 1e-9) {
                beyond_balance.push(format!("a sample {neck:.3} mm behind its port"));
            }
            let of = |third: &str| -> Option<Sphere> {
                let number = |name: &str| spheres.get(name).and_then(Value::as_f64);
                Some(Sphere {
                    sample: number("sample")?,
                    third: number(third).unwrap_or(0.0),
                    detector: number("detector")?,
                    wall_reflectance: number("wall_reflectance")?,
                    detector_reflectance: 0.0,
                    sees_sample: spheres.get("sees_sample").and_then(Value::as_bool).unwrap_or(true),
                    flat: true,
                })
            };
            let pair = of("entrance").zip(of("exit"));
            let (first, second) = pair.ok_or_else(|| {
                Error::failed("the readings do not say how large ports and how white walls are (attribute `spheres`)")
            })?;
            instrument.spheres = Spheres::Two([first, second]);
            instrument.straight = true;
        }
        Ok(Self {
            sheet,
            n: None,
            thickness_mm: number("thickness"),
            slides: number("slides"),
            instrument,
            beyond_balance,
        })
    }

    pub fn cases(&self, params: &Params) -> Result<Vec<Case>, Error> {
        let missing = |name: &str| Error::invalid(name, format!("{name} stands neither here nor in the readings"));
        let mut instrument = match &params.spheres {
            Some(SpheresChoice::None) => Instrument::NONE,
            Some(SpheresChoice::These(spheres)) => {
                Instrument { r_standard: self.instrument.r_standard, ..spheres.instrument() }
            }
            None => self.instrument,
        };
        if let Some(r) = params.r_standard {
            instrument.r_standard = r.0;
        }
        let thickness_mm = params.thickness.map(|d| d.0).or(self.thickness_mm).ok_or_else(|| missing("thickness"))?;
        let [top, bottom] = params.slab_sides().unwrap_or([Slide::clear(self.slides.unwrap_or(1.0)); 2]);
        let cell = |name: &str, row: usize| self.sheet.column(name).map(|c| c[row]);
        let or_zero = |name: &str, row: usize| cell(name, row).unwrap_or(0.0);
        (0..self.sheet.rows())
            .map(|row| {
                let m_u = cell("m_u", row).filter(|m_u| *m_u > 0.0).map(|m_u| (m_u, or_zero("m_u_se", row)));
                let g = params.g.map(|g| g.0).or(cell("g", row)).or(m_u.map(|_| 0.5)).ok_or_else(|| missing("g"))?;
                let n = params.n.map(|n| n.0).or(cell("n", row)).or(self.n).ok_or_else(|| missing("n"))?;
                let pair = |name: &str, suffix: &str| {
                    let at = |side: &str| match params.lost_light {
                        LostLight::Correct => or_zero(&format!("lost_{side}{name}{suffix}"), row),
                        LostLight::Ignore => 0.0,
                    };
                    [at("r"), at("t")]
                };
                let measured = Measurement {
                    m_r: cell("m_r", row).ok_or_else(|| missing("m_r"))?,
                    m_t: cell("m_t", row).ok_or_else(|| missing("m_t"))?,
                    m_r_se: or_zero("m_r_se", row),
                    m_t_se: or_zero("m_t_se", row),
                    m_rt_cov: or_zero("m_rt_cov", row),
                    lost: Lost { beam: pair("", ""), diffuse: pair("_diffuse", "") },
                    lost_se: Lost { beam: pair("", "_se"), diffuse: pair("_diffuse", "_se") },
                    limit_sigmas: params.limit_sigmas.0,
                };
                Ok(Case { slab: Slab { n, g, thickness_mm, top, bottom }, instrument, measured, m_u })
            })
            .collect()
    }
}
