//! Maps against images of the truth: pairs the layers by name, and scores each region.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Errors, MaskReason, Metrics};
use turbid_contract::sharing::Sharing;
use turbid_contract::{Cells, Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind, Table};

use crate::params::Params;
use crate::region::{Region, Selection, View};
use crate::score::{Pixels, Score, Standing, score};
use crate::shared::shared;

/// Figures of each region and quantity, and the pictures if they are wanted.
pub fn compare_maps(
    params: &Params,
    estimate: &ImageStack,
    truth: &ImageStack,
    ctx: Ctx<'_>,
) -> Result<(Metrics, Option<Errors>), Error> {
    let (rows, columns) = (truth.rows(), truth.columns());
    if (estimate.rows(), estimate.columns()) != (rows, columns) {
        return Err(Error::failed(format!(
            "the estimate has {} x {} pixels, the truth {columns} x {rows}",
            estimate.columns(),
            estimate.rows()
        )));
    }
    let regions = regions(params, truth)?;
    let quantities = quantities(estimate, truth)?;
    let mut found: Vec<Row<'_>> = Vec::new();
    for (name, selection) in &regions {
        for quantity in &quantities {
            let without = if quantity.is_position() {
                0
            } else {
                (0..selection.0.len()).filter(|&i| selection.0[i] && quantity.truth[i] == 0.0).count()
            };
            if without > 0 {
                let name_of = &quantity.name;
                ctx.warn(format!(
                    "region `{name}`: {without} pixels without {name_of} are left out, nothing is relative to 0"
                ));
            }
            if let Some(score) = score(&quantity.pixels(), &selection.0) {
                if score.n == 0 {
                    let name_of = &quantity.name;
                    ctx.warn(format!("region `{name}`: every pixel is masked, nothing is known of {name_of}"));
                }
                if let Some(message) = selected_by_value(&score, quantity) {
                    ctx.warn(format!("region `{name}`: {message}"));
                }
                let unit = quantity.info.unit.clone();
                found.push(Row { region: name, quantity: quantity.name.clone(), unit, score });
            }
        }
    }
    measure(&found, ctx);
    let errors = ctx.wants("errors").then(|| errors(&quantities, estimate, truth));
    Ok((table(&found), errors))
}

/// A share of pixels that are left out above which a warning says what the mean may owe to it.
const WORTH_A_WORD: f64 = 0.01;

/// What to say where pixels were left out for what was measured there.
fn selected_by_value(score: &Score, quantity: &Quantity<'_>) -> Option<String> {
    let (shift, of) = (score.possible_shift?, score.n + score.n_left_out);
    if score.n_left_out as f64 <= WORTH_A_WORD * of as f64 {
        return None;
    }
    let shift = match score.possible_shift_percent {
        Some(percent) => format!("{percent:.2} %"),
        None => format!("{shift:.3} {}", quantity.info.unit),
    };
    Some(format!(
        "{} of {of} pixels are masked for what was measured there: the mean of {} may be off by up to {shift} for it",
        score.n_left_out, quantity.name
    ))
}

/// The worst of the figures: relative ones in percent, those of positions in mm.
fn measure(rows: &[Row<'_>], ctx: Ctx<'_>) {
    let worst = |position: bool, f: fn(&Score) -> Option<f64>| {
        let of = rows.iter().filter(|row| (row.unit == POSITION) == position);
        of.filter_map(|row| f(&row.score)).map(f64::abs).fold(None, |worst, x| Some(x.max(worst.unwrap_or(0.0))))
    };
    let tell = |name: &str, unit: &str, worst: Option<f64>| {
        if let Some(worst) = worst {
            ctx.measure(name, worst, unit);
        }
    };
    tell("error: worst bias", "%", worst(false, |s| s.bias_percent));
    tell("worst_rmse", "%", worst(false, |s| s.rmse_percent));
    // A position is right in the mean where it is off by as much to either side: the error of its pixels is what counts.
    tell("error: worst RMSE", POSITION, worst(true, |s| s.rmse));
    tell("worst_bias_mm", POSITION, worst(true, |s| s.bias));
    tell("possible_shift", "%", worst(false, |s| s.possible_shift_percent));
    let sum = |f: fn(&Score) -> u64| rows.iter().map(|row| f(&row.score)).sum::<u64>() as f64;
    let without = rows.iter().filter(|row| row.score.n == 0).count();
    if without > 0 {
        ctx.measure("unknown: rows with every pixel masked", without as f64, "1");
    }
    let counted = sum(|s| s.n);
    if counted > 0.0 {
        ctx.measure("se_unknown", 100.0 * sum(|s| s.n_unknown) / counted, "%");
    }
}

/// The unit of positions.
const POSITION: &str = "mm";

/// An estimated layer, the truth of it, and which pixels count.
struct Quantity<'a> {
    name: String,
    info: &'a LayerInfo,
    estimate: Vec<f32>,
    se: Option<Vec<f32>>,
    se_unknown: Option<Vec<f32>>,
    sharing: Sharing,
    truth: Vec<f32>,
    /// Reason for each pixel that does not count.
    mask: Vec<f32>,
    standing: Vec<Standing>,
}

/// A row of the metrics.
struct Row<'a> {
    region: &'a str,
    quantity: String,
    unit: String,
    score: Score,
}

impl Quantity<'_> {
    /// Lengths are positions: errors relative to the choice of 0 mean nothing.
    fn is_position(&self) -> bool {
        self.info.unit == POSITION
    }

    fn pixels(&self) -> Pixels<'_> {
        Pixels {
            estimate: &self.estimate,
            se: self.se.as_deref(),
            se_unknown: self.se_unknown.as_deref(),
            sharing: &self.sharing,
            truth: &self.truth,
            position: self.is_position(),
            standing: &self.standing,
        }
    }
}

/// Every value layer of the estimate that the truth knows too.
fn quantities<'a>(estimate: &'a ImageStack, truth: &ImageStack) -> Result<Vec<Quantity<'a>>, Error> {
    let mut found = Vec::new();
    for (k, of) in shared(&estimate.infos(), &truth.infos())? {
        let (layer, true_layer) = (&estimate.layers[k], &truth.layers[of]);
        let info = &layer.info;
        let mut mask = vec![0.0; estimate.rows() * estimate.columns()];
        for source in [truth.mask(info.wavelength_nm), estimate.mask(info.wavelength_nm)].into_iter().flatten() {
            mask.iter_mut().zip(source.pixels().iter()).for_each(|(m, &code)| *m = if *m == 0.0 { code } else { *m });
        }
        found.push(Quantity {
            name: info.wavelength_nm.map_or(info.name.clone(), |nm| format!("{}@{nm}nm", info.name)),
            info,
            estimate: layer.pixels().into_owned(),
            se: estimate.standard_error(info).map(|l| l.pixels().into_owned()),
            sharing: estimate.sharing(info),
            truth: true_layer.pixels().into_owned(),
            se_unknown: estimate.se_unknown(info).map(|l| l.pixels().into_owned()),
            standing: mask.iter().map(|&code| standing(code)).collect(),
            mask,
        });
    }
    Ok(found)
}

/// What a mask's value means for a mean over pixels.
fn standing(code: f32) -> Standing {
    match MaskReason::of_code(code) {
        Some(MaskReason::Good) => Standing::Counts,
        Some(reason) if reason.is_structural() => Standing::Absent,
        _ => Standing::LeftOut,
    }
}

/// The regions that were asked for, or `all` and every object that is seen.
fn regions(params: &Params, truth: &ImageStack) -> Result<Vec<(String, Selection)>, Error> {
    let objects: Vec<String> =
        truth.attributes.get("objects").and_then(|list| serde_json::from_value(list.clone()).ok()).unwrap_or_default();
    let mask = truth.mask(None).map(Layer::pixels);
    let layer = truth.find("object", None).map(Layer::pixels);
    let label = |i: usize| {
        let seen = mask.as_ref().is_none_or(|m| m[i] == 0.0);
        seen.then(|| layer.as_ref().map_or(0, |l| l[i].max(0.0) as usize))
    };
    let labels: Vec<Option<usize>> = (0..truth.rows() * truth.columns()).map(label).collect();
    let field: Option<[f64; 2]> = truth.attributes.get("field").and_then(|f| serde_json::from_value(f.clone()).ok());
    let pixel_mm = field.map(|[w, h]| [w / truth.columns() as f64, h / truth.rows() as f64]);
    let view = View {
        columns: truth.columns(),
        rows: truth.rows(),
        pixel_mm: pixel_mm.unwrap_or([1.0, 1.0]),
        labels: &labels,
        objects: &objects,
    };
    if params.regions.is_empty() {
        let everything = Selection(labels.iter().map(Option::is_some).collect());
        let each = objects.iter().map(|name| {
            let region = Region { object: Some(name.clone()), ..Region::default() };
            (name.clone(), region.select(&view))
        });
        let seen = each.filter(|(_, selection)| selection.0.contains(&true));
        return Ok(std::iter::once(("all".to_owned(), everything)).chain(seen).collect());
    }
    let mut found = Vec::new();
    for (name, region) in &params.regions {
        let path = format!("regions.{name}");
        if let Some(object) = region.object.as_ref().filter(|o| !objects.contains(o)) {
            let message = format!("the scene has no object `{object}`; it has {}", objects.join(", "));
            return Err(Error::invalid(format!("{path}.object"), message));
        }
        if region.needs_mm() && pixel_mm.is_none() {
            return Err(Error::invalid(
                path,
                "the truth does not say how many mm its field is; use erode_px or object",
            ));
        }
        let selection = region.select(&view);
        if !selection.0.contains(&true) {
            return Err(Error::invalid(path, "the region holds no pixel"));
        }
        found.push((name.clone(), selection));
    }
    Ok(found)
}

/// Columns of the metrics; those without a unit have that of the quantity, where all rows share one.
pub const COLUMNS: [(&str, Option<&str>); 17] = [
    ("region", Some("")),
    ("quantity", Some("")),
    ("n", Some("1")),
    ("mean", None),
    ("mean_se", None),
    ("truth", None),
    ("bias_percent", Some("%")),
    ("rmse_percent", Some("%")),
    ("masked_percent", Some("%")),
    ("bias", None),
    ("rmse", None),
    ("p95", None),
    ("possible_shift_percent", Some("%")),
    ("possible_shift", None),
    ("n_unknown", Some("1")),
    ("n_left_out", Some("1")),
    ("unit", Some("")),
];

fn table(rows: &[Row<'_>]) -> Metrics {
    // Else the column `unit` tells.
    let unit = rows.first().map_or("", |r| r.unit.as_str());
    let unit = if rows.iter().all(|r| r.unit == unit) { unit } else { "" };
    let text = |f: &dyn Fn(&Row<'_>) -> String| Cells::Text(rows.iter().map(f).collect());
    let number = |f: fn(&Score) -> Option<f64>| Cells::MaybeF64(rows.iter().map(|r| f(&r.score)).collect());
    let count = |f: fn(&Score) -> u64| Cells::I64(rows.iter().map(|r| f(&r.score) as i64).collect());
    let cells = [
        text(&|r| r.region.to_owned()),
        text(&|r| r.quantity.clone()),
        count(|s| s.n),
        number(|s| s.mean),
        number(|s| s.mean_se),
        number(|s| s.truth),
        number(|s| s.bias_percent),
        number(|s| s.rmse_percent),
        number(|s| Some(s.masked_percent)),
        number(|s| s.bias),
        number(|s| s.rmse),
        number(|s| s.p95),
        number(|s| s.possible_shift_percent),
        number(|s| s.possible_shift),
        count(|s| s.n_unknown),
        count(|s| s.n_left_out),
        text(&|r| r.unit.clone()),
    ];
    let mut table = Table::default();
    for ((name, own), cells) in COLUMNS.into_iter().zip(cells) {
        table.push(name, own.unwrap_or(unit), cells);
    }
    Metrics(table)
}

/// Estimate, truth and relative error in percent (of a position, and where some truth is 0, the error itself) of each quantity, where the estimate is but the end of a
/// table (`outside`), and the mask.
fn errors(quantities: &[Quantity<'_>], estimate: &ImageStack, truth: &ImageStack) -> Errors {
    let (rows, columns) = (truth.rows(), truth.columns());
    let mut stack = ImageStack::new(rows, columns);
    stack.take_pixel_pitch(estimate);
    stack.take_pixel_pitch(truth);
    let plane = |f: &dyn Fn(usize) -> f32| Array2::from_shape_fn((rows, columns), |(r, c)| f(r * columns + c));
    let mut masks: Vec<(Option<f64>, &[f32])> = Vec::new();
    for q in quantities {
        let named = |suffix: &str, unit: &str| {
            let mut info = LayerInfo::value(format!("{}{suffix}", q.info.name), unit);
            info.wavelength_nm = q.info.wavelength_nm;
            info
        };
        let counts = |i: usize| q.standing[i] == Standing::Counts;
        // Where the truth is 0 there is no percentage, and an error of 0 % would be made up.
        let absolute = q.is_position() || (0..q.truth.len()).any(|i| counts(i) && q.truth[i] == 0.0);
        let error = |i: usize| {
            let (estimate, truth) = (f64::from(q.estimate[i]), f64::from(q.truth[i]));
            if absolute { estimate - truth } else { 100.0 * (estimate / truth - 1.0) }
        };
        stack.push(named("", &q.info.unit), plane(&|i| q.estimate[i]));
        stack.push(named("_truth", &q.info.unit), plane(&|i| q.truth[i]));
        stack.push(
            named("_error", if absolute { &q.info.unit } else { "%" }),
            plane(&|i| if counts(i) { error(i) as f32 } else { 0.0 }),
        );
        if masks.iter().all(|(wavelength, _)| *wavelength != q.info.wavelength_nm) {
            masks.push((q.info.wavelength_nm, &q.mask));
        }
    }
    for layer in estimate.layers.iter().filter(|l| l.info.kind == LayerKind::Value && l.info.name == "outside") {
        stack.push(layer.info.clone(), layer.data.clone());
    }
    for (wavelength_nm, mask) in masks {
        let mut info = LayerInfo::new("mask", LayerKind::Mask, "1");
        info.wavelength_nm = wavelength_nm;
        stack.push(info, plane(&|i| mask[i]));
    }
    Errors(stack)
}
