//! The stage `calibrate_iad`: readings of a simulated or a real instrument become mu_a, mu_s' and g, row by row.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{Fit as FitTable, Readings};
use turbid_contract::serde_json::Value;
use turbid_contract::{
    Cells, Ctx, Error as StageError, FileUse, Known, Length, PerLength, Problems, Ratio, Stage, StagePlan, Table,
    in_ports, out_ports,
};

use crate::experiment::Known as KnownCoefficient;
use crate::laboratory::{Sheet, read_csv, read_rxt};
use crate::{Error, Experiment, From, Instrument, Lost, Measurement, Slab, Slide, Sphere, Spheres, solve_with_g};

/// Params of `calibrate_iad`; what is left out is taken from the readings or the header of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Measured readings: `.csv` or `.rxt`; instead of the port `readings`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Refractive index of the sample, >= 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n: Option<Ratio>,
    /// Mean cosine of scattering, in (-1, 1); where M_U was measured, where the search for g starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub g: Option<Ratio>,
    /// Thickness of the sample, > 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness: Option<Length>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slides: Option<SlidesParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spheres: Option<SpheresParams>,
    /// Reflectance of the standard that defines M_R, in (0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub r_standard: Option<Ratio>,
    /// mu_a, where it is known: mu_s' is then found from `from`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerLength>,
    /// mu_s', where it is known: mu_a is then found from `from`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerLength>,
    /// The reading that a single unknown is found from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<FromParam>,
    /// Readings beyond a limit (more light out than in, less than the surfaces reflect) by no more than this many
    /// standard errors count as lying on it.
    #[serde(default = "three")]
    pub limit_sigmas: Ratio,
    /// Quadrature points: 8, 16, 32 or 64.
    #[serde(default = "sixteen", rename = "N")]
    pub points: u32,
}

fn three() -> Ratio {
    Ratio(3.0)
}

fn sixteen() -> u32 {
    16
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FromParam {
    #[serde(rename = "m_r")]
    MR,
    #[serde(rename = "m_t")]
    MT,
}

/// Index and absorption (optical thickness) of the slides; 1 and 0: none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlidesParams {
    #[serde(default = "one")]
    pub top: Ratio,
    #[serde(default = "one")]
    pub bottom: Ratio,
    #[serde(default)]
    pub top_tau: Ratio,
    #[serde(default)]
    pub bottom_tau: Ratio,
}

fn one() -> Ratio {
    Ratio(1.0)
}

/// Spheres of one size with round ports (diameters in mm); the entrance is in the reflectance sphere only, the exit in the other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpheresParams {
    /// 1: each reading with its sphere alone; 2: both spheres at the sample.
    pub count: u32,
    pub diameter: Length,
    pub sample: Length,
    #[serde(default)]
    pub entrance: Length,
    #[serde(default)]
    pub exit: Length,
    pub detector: Length,
    /// In [0, 1].
    pub wall_reflectance: Ratio,
    #[serde(default)]
    pub detector_reflectance: Ratio,
    /// Light falls straight from the sample into the detector; false behind a baffle.
    #[serde(default)]
    pub sees_sample: bool,
    /// The sample closes its port as a plane; false: as a piece of the sphere.
    #[serde(default = "yes")]
    pub flat: bool,
    /// Unscattered light first meets the wall opposite; false: it counts as diffuse.
    #[serde(default = "yes")]
    pub straight: bool,
    /// Share of the unscattered reflected light that is collected; 0 where it leaves through the entrance.
    #[serde(default = "one")]
    pub unscattered_r: Ratio,
    #[serde(default = "one")]
    pub unscattered_t: Ratio,
}

fn yes() -> bool {
    true
}

in_ports! {
    pub struct In {
        /// Readings of `calibrate_dis`; or name a `file`.
        readings: optional Readings,
    }
}

out_ports! {
    pub struct Out {
        /// mu_a, mu_s', g with standard errors and status of each row.
        fit: one FitTable,
    }
}

/// `use: calibrate_iad`
pub struct CalibrateIad;

impl Params {
    fn slab_sides(&self) -> Option<[Slide; 2]> {
        let s = self.slides?;
        Some([Slide { n: s.top.0, tau: s.top_tau.0 }, Slide { n: s.bottom.0, tau: s.bottom_tau.0 }])
    }

    fn known(&self) -> Option<KnownCoefficient> {
        let mu_a = self.mu_a.map(|x| KnownCoefficient::MuA(x.0));
        mu_a.or(self.mu_s_prime.map(|x| KnownCoefficient::MuSPrime(x.0)))
    }
}

impl SpheresParams {
    fn instrument(&self) -> Instrument {
        let of = |third: Length| Sphere {
            detector_reflectance: self.detector_reflectance.0,
            sees_sample: self.sees_sample,
            flat: self.flat,
            ..Sphere::with_round_ports(
                self.diameter.0,
                self.sample.0,
                third.0,
                self.detector.0,
                self.wall_reflectance.0,
            )
        };
        let pair = [of(self.entrance), of(self.exit)];
        Instrument {
            spheres: if self.count == 1 { Spheres::One(pair) } else { Spheres::Two(pair) },
            unscattered: [self.unscattered_r.0, self.unscattered_t.0],
            straight: self.straight,
            ..Instrument::NONE
        }
    }

    fn check(&self, problems: &mut Problems) {
        let count = f64::from(self.count);
        problems.require(
            (1..=2).contains(&self.count),
            "spheres.count",
            count,
            "",
            "be 1 or 2; leave `spheres` out for none",
        );
        let diameter = self.diameter.0;
        problems.require(diameter > 0.0, "spheres.diameter", diameter, "mm", "be > 0");
        let before = problems.is_empty();
        for (name, port, least) in [
            ("sample", self.sample, f64::MIN_POSITIVE),
            ("entrance", self.entrance, 0.0),
            ("exit", self.exit, 0.0),
            ("detector", self.detector, 0.0),
        ] {
            let fits = port.0 >= least && port.0 < diameter;
            let rule =
                format!("be {} and smaller than the sphere of {diameter} mm", if least > 0.0 { "> 0" } else { ">= 0" });
            problems.require(fits, format!("spheres.{name}"), port.0, "mm", &rule);
        }
        for (name, share) in [
            ("wall_reflectance", self.wall_reflectance),
            ("detector_reflectance", self.detector_reflectance),
            ("unscattered_r", self.unscattered_r),
            ("unscattered_t", self.unscattered_t),
        ] {
            problems.require((0.0..=1.0).contains(&share.0), format!("spheres.{name}"), share.0, "", "lie in [0, 1]");
        }
        // What no single field shows: ports that together leave no wall.
        if before
            && problems.is_empty()
            && let Err(error) = self.instrument().check()
        {
            problems.push("spheres", error.to_string());
        }
    }
}

impl Stage for CalibrateIad {
    const NAME: &'static str = "calibrate_iad";
    const VERSION: u32 = 3;
    const ABOUT: &'static str = "mu_a, mu_s' and g from reflectance and transmittance: inverse adding-doubling";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn files(params: &Params) -> Vec<FileUse> {
        params.file.iter().map(|path| FileUse { at: "file".into(), path: path.clone() }).collect()
    }

    fn canonical(params: &Params) -> Result<Value, String> {
        // The content is in the key of its own; folders do not matter.
        let file = params.file.as_ref().and_then(|path| path.rsplit(['/', '\\']).next()).map(str::to_owned);
        canonical_value(&Params { file, ..params.clone() })
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        match (&params.file, known.connected.iter().any(|port| port == "readings")) {
            (Some(_), true) => problems.push("file", "readings come from the port and from a file; give one of them"),
            (None, false) => problems.push("file", "no readings: connect the port `readings` or name a file"),
            _ => {}
        }
        if let Some(n) = params.n {
            problems.require(n.0 >= 1.0 && n.0.is_finite(), "n", n.0, "", "be a refractive index >= 1");
        }
        if let Some(g) = params.g {
            problems.require(g.0.abs() < 1.0, "g", g.0, "", "lie in (-1, 1)");
        }
        if let Some(d) = params.thickness {
            problems.require(d.0 > 0.0, "thickness", d.0, "mm", "be > 0");
        }
        if let Some(r) = params.r_standard {
            problems.require(r.0 > 0.0 && r.0 <= 1.0, "r_standard", r.0, "", "lie in (0, 1]");
        }
        if let Some(slides) = params.slides {
            for (name, n) in [("top", slides.top), ("bottom", slides.bottom)] {
                problems.require(n.0 >= 1.0, format!("slides.{name}"), n.0, "", "be a refractive index >= 1");
            }
            for (name, tau) in [("top_tau", slides.top_tau), ("bottom_tau", slides.bottom_tau)] {
                problems.require(tau.0 >= 0.0, format!("slides.{name}"), tau.0, "", "be >= 0");
            }
        }
        for (name, known) in [("mu_a", params.mu_a), ("mu_s_prime", params.mu_s_prime)] {
            if let Some(x) = known {
                problems.require(x.0 >= 0.0, name, x.0, "mm^-1", "be >= 0");
            }
        }
        if params.mu_a.is_some() && params.mu_s_prime.is_some() {
            problems.push("mu_s_prime", "mu_a and mu_s_prime are both given: nothing is left to find");
        }
        if params.from.is_some() && params.known().is_none() {
            problems.push("from", "`from` names the reading for one unknown; give mu_a or mu_s_prime, or leave it out");
        }
        let sigmas = params.limit_sigmas.0;
        problems.require((0.0..=100.0).contains(&sigmas), "limit_sigmas", sigmas, "", "lie in [0, 100]");
        let points = params.points;
        problems.require([8, 16, 32, 64].contains(&points), "N", f64::from(points), "", "be 8, 16, 32 or 64");
        if let Some(spheres) = &params.spheres {
            spheres.check(problems);
        }
        if let Some(path) = &params.file {
            check_file(params, path, known, problems);
        }
    }

    fn plan(params: &Params, _known: &Known) -> StagePlan {
        let mut left_out = Vec::new();
        if params.spheres.is_none() && params.file.as_ref().is_some_and(|f| !is_rxt(f)) {
            left_out.push("sphere correction (none named)".to_owned());
        }
        StagePlan {
            method: Some(format!("Newton, N = {}", params.points)),
            left_out,
            seconds: Some(0.1),
            ..StagePlan::default()
        }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, StageError> {
        let source = match (&params.file, &inputs.readings) {
            (Some(_), Some(_)) => {
                return Err(StageError::invalid(
                    "file",
                    "readings come from the port and from a file; give one of them",
                ));
            }
            (None, None) => {
                return Err(StageError::invalid("file", "no readings: connect the port `readings` or name a file"));
            }
            (Some(path), None) => Source::of_file(path, ctx)?,
            (None, Some(readings)) => Source::of_readings(&readings.0)?,
        };
        let cases = source.cases(params)?;
        let found = ctx.map_tiles(cases.len(), |i| match params.points {
            8 => solve::<8>(params, &cases[i]),
            16 => solve::<16>(params, &cases[i]),
            32 => solve::<32>(params, &cases[i]),
            _ => solve::<64>(params, &cases[i]),
        })?;
        let failed = found.iter().filter(|f| f.is_err()).count();
        if failed > 0 {
            ctx.warn(format!("{failed} of {} rows have no fit; column `status` names why", found.len()));
        }
        ctx.measure("rows_without_fit", failed as f64, "1");
        Ok(Out { fit: table(&source.sheet.media, &found) })
    }
}

/// What the content of the file says, and what it leaves open.
fn check_file(params: &Params, path: &str, known: &Known, problems: &mut Problems) {
    if !is_rxt(path) && !has_suffix(path, ".csv") {
        return problems.push("file", format!("`{path}` must end in .csv or .rxt"));
    }
    let Some(bytes) = known.files.get("file") else { return };
    let source = match Source::of_bytes(path, bytes) {
        Ok(source) => source,
        Err(StageError::Invalid(problem)) => return problems.push(problem.path, problem.message),
        Err(other) => return problems.push("file", other.to_string()),
    };
    if let Err(error) = source.instrument.check() {
        problems.push("file", format!("{path}: {error}"));
    }
    if let Err(StageError::Invalid(problem)) = source.cases(params) {
        problems.push(problem.path, problem.message);
    }
}

fn has_suffix(path: &str, suffix: &str) -> bool {
    path.to_ascii_lowercase().ends_with(suffix)
}

fn is_rxt(path: &str) -> bool {
    has_suffix(path, ".rxt")
}

/// Readings with what their source says of sample and instrument.
struct Source {
    sheet: Sheet,
    n: Option<f64>,
    thickness_mm: Option<f64>,
    slides: Option<f64>,
    instrument: Instrument,
}

struct Case {
    slab: Slab,
    instrument: Instrument,
    measured: Measurement,
    m_u: Option<(f64, f64)>,
}

impl Source {
    fn of_file(path: &str, ctx: Ctx<'_>) -> Result<Self, StageError> {
        let bytes = ctx.file("file").ok_or_else(|| StageError::failed(format!("`{path}` was not handed over")))?;
        Self::of_bytes(path, &bytes)
    }

    fn of_bytes(path: &str, bytes: &[u8]) -> Result<Self, StageError> {
        let read = if is_rxt(path) { read_rxt(bytes) } else { read_csv(bytes) };
        let sheet =
            read.map_err(|e| StageError::invalid("file", format!("{path}:{}:{}: {}", e.line, e.column, e.message)))?;
        let header = sheet.header.clone();
        Ok(Self {
            n: header.as_ref().map(|h| h.n_sample),
            thickness_mm: header.as_ref().map(|h| h.thickness_mm),
            slides: header.as_ref().map(|h| h.n_slides),
            instrument: header.map_or(Instrument::NONE, |h| h.instrument),
            sheet,
        })
    }

    fn of_readings(table: &Table) -> Result<Self, StageError> {
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
        if let Some(spheres) = table.attributes.get("spheres") {
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
                StageError::failed(
                    "the readings do not say how large ports and how white walls are (attribute `spheres`)",
                )
            })?;
            instrument.spheres = Spheres::Two([first, second]);
            instrument.straight = true;
        }
        Ok(Self { sheet, n: None, thickness_mm: number("thickness"), slides: number("slides"), instrument })
    }

    fn cases(&self, params: &Params) -> Result<Vec<Case>, StageError> {
        let missing = |name: &str| StageError::invalid(name, format!("{name} stands neither here nor in the readings"));
        let mut instrument = match &params.spheres {
            Some(spheres) => Instrument { r_standard: self.instrument.r_standard, ..spheres.instrument() },
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
                    let at = |side: &str| or_zero(&format!("lost_{side}{name}{suffix}"), row);
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

/// One row of the result.
#[derive(Clone, Default)]
struct Found {
    mu_a: f64,
    mu_s_prime: f64,
    g: f64,
    /// Standard errors of mu_a, mu_s', g and the covariance of the first two.
    se: Option<[f64; 4]>,
    status: &'static str,
}

fn solve<const N: usize>(params: &Params, case: &Case) -> Result<Found, Error> {
    let Case { slab, instrument, measured, m_u } = case;
    if let Some((m_u, m_u_se)) = *m_u {
        return solve_three::<N>(case, m_u, m_u_se);
    }
    let experiment = Experiment::<N>::new(slab, instrument)?;
    if let Some(known) = params.known() {
        let from = if params.from == Some(FromParam::MT) { From::MT } else { From::MR };
        let (x, se) = experiment.solve_one(measured, known, from)?;
        let found = match known {
            KnownCoefficient::MuA(mu_a) => {
                Found { mu_a, mu_s_prime: x, se: Some([0.0, se, 0.0, 0.0]), ..Found::default() }
            }
            KnownCoefficient::MuSPrime(s) => {
                Found { mu_a: x, mu_s_prime: s, se: Some([se, 0.0, 0.0, 0.0]), ..Found::default() }
            }
        };
        return Ok(Found { g: slab.g, status: "ok", ..found });
    }
    let solution = experiment.solve(measured)?;
    let status = match (solution.fit.flags.conservative, solution.fit.flags.no_scatter) {
        (false, false) => "ok",
        (true, false) => "conservative",
        (false, true) => "no_scatter",
        (true, true) => "empty",
    };
    Ok(Found {
        mu_a: solution.fit.mu_a_per_mm,
        mu_s_prime: solution.fit.mu_s_prime_per_mm,
        g: slab.g,
        se: solution.covariance.map(|[a, s, both]| [a.sqrt(), s.sqrt(), 0.0, both]),
        status,
    })
}

/// With M_U: errors from how the solution moves with each reading; lost light counts as exact there.
fn solve_three<const N: usize>(case: &Case, m_u: f64, m_u_se: f64) -> Result<Found, Error> {
    let Case { slab, instrument, measured, .. } = case;
    let at = |r: f64, t: f64, u: f64| -> Result<[f64; 3], Error> {
        let moved = Measurement { m_r: measured.m_r + r, m_t: measured.m_t + t, ..*measured };
        let found = solve_with_g::<N>(slab, instrument, &moved, m_u + u)?;
        Ok([found.fit.mu_a_per_mm, found.fit.mu_s_prime_per_mm, found.g])
    };
    let best = at(0.0, 0.0, 0.0)?;
    let slope = |r: f64, t: f64, u: f64| -> Option<[f64; 3]> {
        let (high, low) = (at(r, t, u).ok()?, at(-r, -t, -u).ok()?);
        Some(std::array::from_fn(|i| 0.5 * (high[i] - low[i]) / (r + t + u)))
    };
    // Small against the readings and what is left over for absorption, large against the 1e-8 of a fit.
    let h = 1e-5;
    let se = (|| {
        let (by_r, by_t) = (slope(h * measured.m_r, 0.0, 0.0)?, slope(0.0, h * measured.m_t, 0.0)?);
        let by_u = slope(0.0, 0.0, h * m_u)?;
        let (vr, vt, cov) = (measured.m_r_se * measured.m_r_se, measured.m_t_se * measured.m_t_se, measured.m_rt_cov);
        let product = |i: usize, j: usize| {
            by_r[i] * by_r[j] * vr
                + by_t[i] * by_t[j] * vt
                + (by_r[i] * by_t[j] + by_t[i] * by_r[j]) * cov
                + by_u[i] * by_u[j] * m_u_se * m_u_se
        };
        let root = |i: usize| product(i, i).max(0.0).sqrt();
        Some([root(0), root(1), root(2), product(0, 1)])
    })();
    Ok(Found { mu_a: best[0], mu_s_prime: best[1], g: best[2], se, status: "ok" })
}

fn name(error: &Error) -> &'static str {
    match error {
        Error::NotFinite { .. } => "not_finite",
        Error::InvalidIndex { .. } => "invalid_index",
        Error::InvalidG { .. } => "invalid_g",
        Error::InvalidThickness { .. } => "invalid_thickness",
        Error::Range { .. } | Error::AbsorbingSlide { .. } => "out_of_range",
        Error::Unresolved { .. } => "unresolved",
        Error::TooMuchLight { .. } => "too_much_light",
        Error::BelowSpecular { .. } => "below_specular",
        Error::AboveMax { .. } => "above_max",
        Error::OutOfReach { .. } => "out_of_reach",
        Error::UnscatteredExceedsTotal { .. } => "unscattered_exceeds_total",
        Error::Inconsistent { .. } => "inconsistent",
        Error::Underdetermined { .. } => "underdetermined",
        Error::NotConverged { .. } => "not_converged",
    }
}

fn table(media: &[String], found: &[Result<Found, Error>]) -> FitTable {
    let mut table = Table::default();
    table.push("medium", "", Cells::Text(media.to_vec()));
    let mut push = |name: &str, unit: &str, value: fn(&Found) -> f64| {
        let cells = found.iter().map(|f| f.as_ref().map_or(0.0, value)).collect();
        table.push(name, unit, Cells::F64(cells));
    };
    push("mu_a", "mm^-1", |f| f.mu_a);
    push("mu_a_se", "mm^-1", |f| f.se.unwrap_or_default()[0]);
    push("mu_s_prime", "mm^-1", |f| f.mu_s_prime);
    push("mu_s_prime_se", "mm^-1", |f| f.se.unwrap_or_default()[1]);
    push("mu_cov", "mm^-2", |f| f.se.unwrap_or_default()[3]);
    push("g", "1", |f| f.g);
    push("g_se", "1", |f| f.se.unwrap_or_default()[2]);
    let status = |f: &Result<Found, Error>| match f {
        Ok(found) if found.se.is_none() => format!("{}, no_se", found.status),
        Ok(found) => found.status.to_owned(),
        Err(error) => name(error).to_owned(),
    };
    table.push("status", "", Cells::Text(found.iter().map(status).collect()));
    let message = |f: &Result<Found, Error>| f.as_ref().err().map_or(String::new(), ToString::to_string);
    table.push("message", "", Cells::Text(found.iter().map(message).collect()));
    FitTable(table)
}
