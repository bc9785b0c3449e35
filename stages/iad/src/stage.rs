//! The stage `calibrate_iad`: readings of a simulated or a real instrument become mu_a, mu_s' and g, row by row.
//!
//! ```yaml
//! fit:
//!   use: calibrate_iad
//!   in: {readings: readings}                    # of calibrate_dis; or a laboratory's file:
//!   # with: {file: data/phantom.rxt, g: 0.8}
//!   with: {N: 16}
//! ```

mod line;
mod params;
mod row;
mod solve;
mod source;

use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{Fit, Readings};
use turbid_contract::serde_json::Value;
use turbid_contract::{
    Artifact, Ctx, Error, FileUse, Form, Forms, Known, Problems, Stage, StagePlan, in_ports, out_ports,
};

pub use params::{FromParam, LostLight, Params, SlidesParams, SpheresChoice, SpheresParams};
use row::{Tools, solve, table};
use source::{Source, has_suffix, is_rxt};

in_ports! {
    pub struct In {
        /// Readings of `calibrate_dis`; or name a `file`.
        readings: optional Readings,
    }
}

out_ports! {
    pub struct Out {
        /// mu_a, mu_s', g with standard errors and status of each row.
        fit: one Fit,
    }
}

/// `use: calibrate_iad`
pub struct CalibrateIad;

/// CPU seconds of a row of M_R and M_T by 16 points; they go with the cube of the points.
const ROW_S: f64 = 4e-3;
/// By what they grow where M_U is inverted as well.
const WITH_M_U: f64 = 1.6;
/// CPU seconds of following the photons that leave beside ports, for one slab.
const LOST_LIGHT_S: f64 = 0.45;
/// Rows of readings that are not there yet.
const USUAL_ROWS: usize = 3;

/// CPU seconds of the run, measured on a machine that walks 35 M flights a second.
fn seconds(params: &Params, known: &Known) -> f64 {
    let file = params.file.as_ref().zip(known.files.get("file"));
    let source = file.and_then(|(path, bytes)| Source::of_bytes(path, &bytes).ok());
    let rows = source.as_ref().map_or(USUAL_ROWS, |source| source.sheet.rows());
    let with_m_u = source.is_some_and(|source| source.sheet.columns.iter().any(|(name, _)| name == "m_u"));
    let points = f64::from(params.points.unwrap_or(16)) / 16.0;
    let row = ROW_S * points.powi(3) * if with_m_u { WITH_M_U } else { 1.0 };
    rows as f64 * (row + if CalibrateIad::draws(params) { LOST_LIGHT_S } else { 0.0 })
}

impl Stage for CalibrateIad {
    const NAME: &'static str = "calibrate_iad";
    const VERSION: u32 = 5;
    const ABOUT: &'static str = "mu_a, mu_s' and g from reflectance and transmittance: inverse adding-doubling";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(params: &Params) -> bool {
        // Light that leaves beside a port is found by following photons; other readings say themselves what they lost.
        params.file.as_ref().is_some_and(|path| is_rxt(path))
            && params.lost_light == LostLight::Correct
            && params.spheres.is_none()
    }

    fn files(params: &Params) -> Vec<FileUse> {
        params.file.iter().map(|path| FileUse::new("file", path, params.max_file_mb)).collect()
    }

    fn canonical(params: &Params) -> Result<Value, String> {
        // The content is in the key of its own; folders do not matter.
        let file = params.file.as_ref().and_then(|path| path.rsplit(['/', '\\']).next()).map(str::to_owned);
        canonical_value(&Params { file, ..params.clone() })
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        if let Some(message) = sources(params, known.connected.iter().any(|port| port == "readings")) {
            problems.push("file", message);
        }
        params.check(problems);
        check_readings(params, known, problems);
        if let Some(path) = &params.file {
            check_file(params, path, known, problems);
        }
    }

    fn describe(_params: &Params, known: &Known) -> Forms {
        // Of a file the rows are counted when it is read.
        let rows = known.form("readings").and_then(|form| form.rows);
        let Fit(empty) = table(&[], &[]);
        Forms::from([("fit", Form { rows, ..Form::of(&Artifact::Table(empty)) })])
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let mut left_out = Vec::new();
        match params.spheres {
            Some(SpheresChoice::None) => left_out.push("sphere correction (spheres: none)".to_owned()),
            None if params.file.as_ref().is_some_and(|f| !is_rxt(f)) => {
                left_out.push("sphere correction (none named)".to_owned());
            }
            _ => {}
        }
        if params.lost_light == LostLight::Ignore {
            left_out.push("lost light (lost_light: ignore)".to_owned());
        }
        StagePlan {
            method: Some(match params.points {
                Some(points) => format!("Newton, N = {points}"),
                None => "Newton, N = 16, doubled where twice as many points say otherwise (64 at most)".to_owned(),
            }),
            left_out,
            seconds: Some(seconds(params, known)),
            ..StagePlan::default()
        }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        if let Some(message) = sources(params, inputs.readings.is_some()) {
            return Err(Error::invalid("file", message));
        }
        let source = match (&params.file, &inputs.readings) {
            (Some(path), _) => Source::of_file(path, ctx)?,
            (None, Some(readings)) => Source::of_readings(&readings.0)?,
            (None, None) => return Err(Error::failed("neither readings nor a file")),
        };
        if params.spheres.is_none() && !source.beyond_balance.is_empty() {
            let what = source.beyond_balance.join(" and ");
            ctx.warn(format!(
                "the energy balance of the spheres knows nothing of {what}: mu_a and mu_s' carry its error; `spheres: none` takes M_R and M_T as they are"
            ));
        }
        let cases = source.cases(params)?;
        let tools = Tools::new(&cases, ctx.seed());
        let found = ctx.map_tiles(cases.len(), |i| solve(params, &cases[i], &tools))?;
        let failed = found.iter().filter(|f| f.is_err()).count();
        if failed > 0 {
            ctx.measure("unknown: rows without a fit", failed as f64, "1");
            ctx.warn(format!("{failed} of {} rows have no fit; column `status` names why", found.len()));
        }
        let count = |holds: fn(&row::Found) -> bool| found.iter().flatten().filter(|f| holds(f)).count();
        let ambiguous = count(|f| f.status() == "ambiguous");
        if ambiguous > 0 {
            ctx.warn(format!(
                "{ambiguous} of {} rows have a second medium with the same readings (column `message`): walls this white hardly tell mu_s'",
                found.len()
            ));
        }
        let disagree = count(|f| f.status() == "disagree");
        if disagree > 0 {
            ctx.warn(format!(
                "in {disagree} of {} rows no medium with what is known gives both readings (columns `message`, `m_r_residual`, \
                 `m_t_residual`): check what is known, or name the reading to trust with `from`",
                found.len()
            ));
        }
        let coarse = count(row::Found::is_coarse);
        if coarse > 0 {
            ctx.warn(format!(
                "in {coarse} of {} rows 64 quadrature points are few (columns `message`, `*_model_error`)",
                found.len()
            ));
        }
        Ok(Out { fit: table(&source.sheet.media, &found) })
    }
}

/// What is wrong with where the readings come from.
fn sources(params: &Params, connected: bool) -> Option<&'static str> {
    match (&params.file, connected) {
        (Some(_), true) => Some("readings come from the port and from a file; give one of them"),
        (None, false) => Some("no readings: connect the port `readings` or name a file"),
        _ => None,
    }
}

/// What the readings on the port must hold beside what the params say.
fn check_readings(params: &Params, known: &Known, problems: &mut Problems) {
    let Some(form) = known.form("readings") else { return };
    let Some(columns) = &form.columns else { return };
    let has = |name: &str| columns.iter().any(|column| column.name == name);
    for (name, given) in [("m_r", false), ("g", params.g.is_some()), ("n", params.n.is_some())] {
        if !given && !has(name) {
            let way_out = "connect the readings of calibrate_dis, or name a `file`";
            let what = format!("it has no column `{name}`");
            problems.unfit(known, "readings", Error::failed_with_hint(what, way_out));
        }
    }
    let thick = params.thickness.is_some() || form.attributes.get("thickness").is_some_and(|d| !d.is_null());
    if !thick && !has("thickness") {
        let what = "it does not say how thick its samples are";
        problems.unfit(known, "readings", Error::failed_with_hint(what, "give `thickness`"));
    }
}

/// What the content of the file says, and what it leaves open.
fn check_file(params: &Params, path: &str, known: &Known, problems: &mut Problems) {
    if !is_rxt(path) && !has_suffix(path, ".csv") {
        return problems.push("file", format!("`{path}` must end in .csv or .rxt"));
    }
    let Some(bytes) = known.files.get("file") else { return };
    let source = match Source::of_bytes(path, &bytes) {
        Ok(source) => source,
        Err(Error::Invalid(problem)) => return problems.push(problem.path, problem.message),
        Err(other) => return problems.push("file", other.to_string()),
    };
    if let Err(error) = source.instrument.check() {
        problems.push("file", format!("{path}: {error}"));
    }
    if let Err(Error::Invalid(problem)) = source.cases(params) {
        problems.push(problem.path, problem.message);
    }
    for assumption in source.assumptions(params) {
        problems.warn("file", format!("{path}: {assumption}"));
    }
}
