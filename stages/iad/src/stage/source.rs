//! Where readings come from, and what their source says of sample and instrument.

use std::collections::HashMap;
use std::fmt::Debug;

use turbid_contract::serde_json::Value;
use turbid_contract::{Cells, Ctx, Error, Table};
use turbid_optics::PhaseFunction;

use super::line::Constraint;
use super::params::{FromParam, LostLight, Params, SpheresChoice};
use crate::laboratory::{Header, Sheet, read_csv, read_rxt};
use crate::{Incidence, Instrument, Lost, Measurement, Slab, Slide, Sphere, Spheres, Spot};

pub fn has_suffix(path: &str, suffix: &str) -> bool {
    path.to_ascii_lowercase().ends_with(suffix)
}

pub fn is_rxt(path: &str) -> bool {
    has_suffix(path, ".rxt")
}

/// Readings with what their source says of sample and instrument.
pub struct Source {
    pub sheet: Sheet,
    /// Columns of which some cells are not known.
    partial: Vec<(String, Vec<Option<f64>>)>,
    /// The file's name.
    path: String,
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
    pub light: Incidence,
    pub instrument: Instrument,
    /// What was not read is 0 here.
    pub measured: Measurement,
    /// Whether M_R and M_T were read.
    pub read: [bool; 2],
    /// Which of them the unknowns are found from.
    pub used: [bool; 2],
    /// With its standard error.
    pub m_u: Option<(f64, f64)>,
    /// All readings that are used come with standard errors.
    pub stated: bool,
    pub known: Option<Constraint>,
    /// The beam and the ports beside which light is lost, where the readings do not tell what they lost.
    pub spot: Option<Spot>,
    /// Rows of the same slab, light and instrument have the same number,
    pub config: usize,
    /// and those of the same slab and light this one.
    pub slab_config: usize,
}

/// Columns of simulated readings that say what was simulated.
const TRUTH: [&str; 5] = ["mu_a", "mu_s_prime", "mu_s", "albedo", "optical_thickness"];

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
            path: path.to_owned(),
            sheet,
            partial: Vec::new(),
        })
    }

    pub fn of_readings(table: &Table) -> Result<Self, Error> {
        let (mut sheet, mut partial) = (Sheet::default(), Vec::new());
        for column in &table.columns {
            match &column.cells {
                Cells::Text(names) if column.name == "medium" => sheet.media = names.clone(),
                // The truth of simulated readings is not handed to their inversion.
                _ if TRUTH.contains(&column.name.as_str()) => {}
                Cells::F64(values) => sheet.columns.push((column.name.clone(), values.clone())),
                Cells::MaybeF64(values) => partial.push((column.name.clone(), values.clone())),
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
                    third_reflectance: 0.0,
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
            partial,
            path: String::new(),
            n: None,
            thickness_mm: number("thickness"),
            slides: number("slides"),
            instrument,
            beyond_balance,
        })
    }

    /// What the file leaves open and the stage assumes, and where the program that wrote such files differs.
    pub fn assumptions(&self, params: &Params) -> Vec<String> {
        let Some(header) = &self.sheet.header else { return Vec::new() };
        let mut found = Vec::new();
        let has_m_u = (0..self.sheet.rows()).all(|row| self.cell("m_u", row).is_some_and(|m_u| m_u > 0.0));
        if params.g.is_none() && self.sheet.column("g").is_none() && !has_m_u {
            found.push(
                "g stands neither here nor in the file; rows without M_U are inverted with g = 0, as the program `iad` does: give `g` \
                 where it is known"
                    .to_owned(),
            );
        }
        let [reflectance, transmittance] = &header.pair;
        if params.spheres.is_none() && matches!(header.instrument.spheres, Spheres::One(_)) {
            let first = reflectance.wall_reflectance * (1.0 - reflectance.third);
            found.push(format!(
                "M_R counts a standard as its reflectance, as the manual of the program `iad` defines it; version 4 of that program \
                 (baffles, its default) counts a white standard as {first:.3} and finds other coefficients from this file"
            ));
        }
        if params.spheres.is_none()
            && header.instrument.spheres != Spheres::None
            && transmittance.third > 0.0
            && self.sheet.column("t_standard").is_none()
            && self.sheet.column("m_t").is_some()
        {
            found.push(
                "the third port of the transmittance sphere counts as open; a column T (the reflectance of what closes it) or a \
                 diameter of 0 closes it"
                    .to_owned(),
            );
        }
        found
    }

    fn cell(&self, name: &str, row: usize) -> Option<f64> {
        match self.sheet.column(name) {
            Some(cells) => Some(cells[row]),
            None => self.partial.iter().find(|(column, _)| column == name).and_then(|(_, cells)| cells[row]),
        }
    }

    /// A mistake in a row of the file, or of a table.
    fn wrong_row(&self, row: usize, message: &str) -> Error {
        match self.sheet.places.get(row) {
            Some((line, column)) => Error::invalid("file", format!("{}:{line}:{column}: {message}", self.path)),
            None => Error::failed(format!("row {} ({}): {message}", row + 1, self.sheet.media[row])),
        }
    }

    pub fn cases(&self, params: &Params) -> Result<Vec<Case>, Error> {
        let mut cases: Vec<Case> = Vec::with_capacity(self.sheet.rows());
        let mut configs: Numbers<(Slab, Incidence, Instrument)> = Numbers::default();
        let mut slabs: Numbers<(Slab, Incidence)> = Numbers::default();
        for row in 0..self.sheet.rows() {
            let mut case = self.case(params, row)?;
            case.config = configs.of((case.slab, case.light, case.instrument));
            case.slab_config = slabs.of((case.slab, case.light));
            cases.push(case);
        }
        Ok(cases)
    }

    fn case(&self, params: &Params, row: usize) -> Result<Case, Error> {
        let missing = |name: &str| Error::invalid(name, format!("{name} stands neither here nor in the readings"));
        let header = self.sheet.header.as_ref();
        let cell = |name: &str| self.cell(name, row);
        // In that program's files 0 means that nothing was read.
        let reading = |name: &str| cell(name).filter(|m| header.is_none() || name == "m_r" || *m != 0.0);
        let (m_r, m_t) = (reading("m_r"), reading("m_t"));
        let read = [m_r.is_some(), m_t.is_some()];
        let m_u = cell("m_u").filter(|m_u| *m_u > 0.0);
        let with_se = |name: &str, own: Option<turbid_contract::Ratio>| cell(name).or(own.map(|se| se.0));
        let ses = [with_se("m_r_se", params.m_r_se), with_se("m_t_se", params.m_t_se)];
        let m_u_se = with_se("m_u_se", params.m_u_se);

        let known = self.known(params, row)?;
        if let (Some(Constraint::OpticalThickness(_)), Some(_)) = (known, m_u) {
            return Err(self.wrong_row(
                row,
                "the optical thickness is known and M_U says it, too: leave out the column or `optical_thickness`, or M_U",
            ));
        }
        let from = params.from;
        if from.is_some() && known.is_none() {
            let message = "`from` names the reading for one unknown; give mu_a or mu_s_prime, or leave it out";
            return Err(Error::invalid("from", message));
        }
        let used = match from {
            Some(FromParam::MR) => [true, false],
            Some(FromParam::MT) => [false, true],
            None => read,
        };
        let stated = (0..2).all(|i| !used[i] || !read[i] || ses[i].is_some()) && (m_u.is_none() || m_u_se.is_some());

        let g = params.g.map(|g| g.0).or(cell("g")).or(m_u.map(|_| 0.5)).or(header.map(|_| 0.0));
        let g = g.ok_or_else(|| missing("g"))?;
        let n = params.n.map(|n| n.0).or(cell("n")).or(self.n).ok_or_else(|| missing("n"))?;
        let thickness_mm = params.thickness.map(|d| d.0).or(cell("thickness")).or(self.thickness_mm);
        let thickness_mm = thickness_mm.ok_or_else(|| missing("thickness"))?;
        let slide_mm = cell("slide_thickness").or(header.map(|h| h.slide_mm));
        let [top, bottom] = params.slab_sides().unwrap_or_else(|| {
            let n = cell("n_slides").or(self.slides).filter(|n| *n != 0.0 && slide_mm != Some(0.0)).unwrap_or(1.0);
            [Slide { n, tau: cell("slide_tau").unwrap_or(0.0) }; 2]
        });
        let slab = Slab { n, phase: PhaseFunction::henyey_greenstein(g), thickness_mm, top, bottom };
        let degrees = cell("angle").unwrap_or(0.0);
        let light = if degrees == 0.0 { Incidence::Normal } else { Incidence::Oblique(degrees.to_radians()) };
        let instrument = self.instrument_of(params, row);

        let pair = |name: &str, suffix: &str| {
            let at = |side: &str| match params.lost_light {
                // Light of which nothing was lost, or met, adds neither to the reading nor to its error.
                LostLight::Correct => cell(&format!("lost_{side}{name}{suffix}")).unwrap_or(0.0),
                LostLight::Ignore => 0.0,
            };
            [at("r"), at("t")]
        };
        let measured = Measurement {
            m_r: m_r.unwrap_or(0.0),
            m_t: m_t.unwrap_or(0.0),
            m_r_se: ses[0].unwrap_or(0.0),
            m_t_se: ses[1].unwrap_or(0.0),
            m_rt_cov: cell("m_rt_cov").unwrap_or(0.0),
            lost: Lost { beam: pair("", ""), diffuse: pair("_diffuse", "") },
            lost_se: Lost { beam: pair("", "_se"), diffuse: pair("_diffuse", "_se") },
            limit_sigmas: params.limit_sigmas.0,
        };
        let corrects = params.lost_light == LostLight::Correct && instrument.spheres != Spheres::None;
        let spot = header.filter(|_| corrects && params.spheres.is_none()).map(|header: &Header| Spot {
            beam_mm: cell("beam").unwrap_or(header.beam_mm),
            angle: degrees.to_radians(),
            ports_mm: header.ports_mm,
            slides_mm: [slide_mm.unwrap_or(0.0); 2],
        });
        let m_u = m_u.map(|m_u| (m_u, m_u_se.unwrap_or(0.0)));
        Ok(Case { slab, light, instrument, measured, read, used, m_u, stated, known, spot, config: 0, slab_config: 0 })
    }

    /// The one thing that is known of a row's sample; what stands in the params takes the place of columns.
    fn known(&self, params: &Params, row: usize) -> Result<Option<Constraint>, Error> {
        if let Some((_, known)) = params.known().first() {
            return Ok(Some(*known));
        }
        let cell = |name: &str| self.cell(name, row);
        let all = [
            cell("mu_a").map(Constraint::MuA),
            cell("mu_s_prime").map(Constraint::MuSPrime),
            cell("mu_s").map(Constraint::MuS),
            cell("albedo").map(Constraint::Albedo),
            cell("optical_thickness").map(Constraint::OpticalThickness),
        ];
        let mut all = all.into_iter().flatten();
        let (first, second) = (all.next(), all.next());
        if let (Some(first), Some(second)) = (first, second) {
            let message = format!(
                "{} and {} are both given: nothing is left to find; leave one of the columns out",
                first.name(),
                second.name()
            );
            return Err(self.wrong_row(row, &message));
        }
        if let Some(known) = first
            && let Err(rule) = known.check()
        {
            let unit = if known.unit().is_empty() { String::new() } else { format!(" {}", known.unit()) };
            return Err(self.wrong_row(row, &format!("{} = {}{unit} must {rule}", known.name(), known.value())));
        }
        Ok(first)
    }

    fn instrument_of(&self, params: &Params, row: usize) -> Instrument {
        let cell = |name: &str| self.cell(name, row);
        let mut instrument = match &params.spheres {
            Some(SpheresChoice::None) => Instrument::NONE,
            Some(SpheresChoice::These(spheres)) => {
                Instrument { r_standard: self.instrument.r_standard, ..spheres.instrument() }
            }
            None => {
                let mut own = self.instrument;
                if let (Some(header), Some(count)) = (&self.sheet.header, cell("spheres")) {
                    own.spheres = match count as usize {
                        1 => Spheres::One(header.pair),
                        2 => Spheres::Two(header.pair),
                        _ => Spheres::None,
                    };
                }
                if let Spheres::One(pair) | Spheres::Two(pair) = &mut own.spheres {
                    for (sphere, wall) in pair.iter_mut().zip([cell("wall_r"), cell("wall_t")]) {
                        sphere.wall_reflectance = wall.unwrap_or(sphere.wall_reflectance);
                    }
                    pair[1].third_reflectance = cell("t_standard").unwrap_or(0.0);
                }
                own.t_standard = cell("t_standard").unwrap_or(1.0);
                own
            }
        };
        if !matches!(params.spheres, Some(SpheresChoice::These(_))) {
            let share =
                |own: Option<turbid_contract::Ratio>, column: &str| own.map(|x| x.0).or(cell(column)).unwrap_or(1.0);
            instrument.unscattered =
                [share(params.unscattered_r, "unscattered_r"), share(params.unscattered_t, "unscattered_t")];
        }
        if let Some(r) = params.r_standard.map(|r| r.0).or(cell("r_standard")) {
            instrument.r_standard = r;
        }
        instrument
    }
}

/// Numbers of things, equal ones the same, in the order in which they come.
struct Numbers<T> {
    last: Option<(T, usize)>,
    all: HashMap<String, usize>,
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        Self { last: None, all: HashMap::new() }
    }
}

impl<T: PartialEq + Debug> Numbers<T> {
    fn of(&mut self, own: T) -> usize {
        // Neighbours are alike more often than not.
        if let Some((last, number)) = &self.last
            && *last == own
        {
            return *number;
        }
        // What is written of a number tells it from all others.
        let next = self.all.len();
        let number = *self.all.entry(format!("{own:?}")).or_insert(next);
        self.last = Some((own, number));
        number
    }
}
