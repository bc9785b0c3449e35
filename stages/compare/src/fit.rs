//! A fit of media against what they are: pairs rows by the name of the medium.

use std::collections::BTreeMap;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Errors, MaskReason, Metrics};
use turbid_contract::{Cells, Ctx, Error, ImageStack, LayerInfo, LayerKind, Table};

use crate::media::{MediaScore, Pair, root_mean_square, score};
use crate::params::MediumParams;

/// mu_a and mu_s' of media by name, mm^-1.
pub struct Media(BTreeMap<String, [f64; 2]>);

/// What is compared, in the order of [`Media`].
pub const QUANTITIES: [&str; 2] = ["mu_a", "mu_s_prime"];

impl Media {
    pub fn named(media: &BTreeMap<String, MediumParams>) -> Self {
        Self(media.iter().map(|(name, m)| (name.clone(), [m.mu_a.0, m.mu_s_prime.0])).collect())
    }

    /// Error: the readings are not of known media (a laboratory's), or two media share a name.
    pub fn of(readings: &Table) -> Result<Self, Error> {
        let names = texts(readings, "medium")?;
        let [mu_a, mu_s_prime] = QUANTITIES.map(|name| {
            readings
                .maybe_f64s(name)
                .ok_or_else(|| Error::failed(format!("the readings do not say {name} of their media")))
        });
        let (mu_a, mu_s_prime) = (mu_a?, mu_s_prime?);
        let mut media = BTreeMap::new();
        for (i, name) in names.iter().enumerate() {
            let Some((mu_a, mu_s_prime)) = mu_a[i].zip(mu_s_prime[i]) else {
                return Err(Error::failed(format!("the readings do not say mu_a and mu_s_prime of `{name}`")));
            };
            if media.insert(name.clone(), [mu_a, mu_s_prime]).is_some() {
                return Err(Error::failed(format!("two media of the readings are called {name}")));
            }
        }
        Ok(Self(media))
    }
}

/// What `status` says of rows that hold numbers; a limit is a number too.
const FITTED: [&str; 4] = ["ok", "conservative", "no_scatter", "empty"];

/// One row for each medium and quantity, then `all`; and the picture if it is wanted.
pub fn compare_fit(fit: &Table, media: &Media, ctx: Ctx<'_>) -> Result<(Metrics, Option<Errors>), Error> {
    let (names, status) = (texts(fit, "medium")?, texts(fit, "status")?);
    if let Some(unfitted) = media.0.keys().find(|name| !names.contains(name)) {
        let message = format!("the fit has no medium `{unfitted}`; it has {}", names.join(", "));
        return Err(Error::failed(message));
    }
    let good: Vec<bool> = status.iter().map(|s| FITTED.contains(&s.split(',').next().unwrap_or_default())).collect();
    let mut pairs: [Vec<Pair>; 2] = Default::default();
    for (quantity, pairs) in pairs.iter_mut().enumerate() {
        let name = QUANTITIES[quantity];
        let missing = |name: &str| Error::failed(format!("the fit has no column {name}"));
        let estimate = fit.maybe_f64s(name).ok_or_else(|| missing(name))?;
        let with_se = format!("{name}_se");
        let se = fit.maybe_f64s(&with_se).ok_or_else(|| missing(&with_se))?;
        for (i, medium) in names.iter().enumerate() {
            let truth = media.0.get(medium).ok_or_else(|| {
                let known: Vec<&str> = media.0.keys().map(String::as_str).collect();
                Error::failed(format!("nothing says what the medium `{medium}` is; known are {}", known.join(", ")))
            })?;
            // A fit that states no error writes 0 or nothing.
            let (estimate, se) = (estimate[i], se[i].filter(|se| *se > 0.0));
            let good = good[i] && estimate.is_some();
            pairs.push(Pair { estimate: estimate.unwrap_or(0.0), se, truth: truth[quantity], good });
        }
    }
    let mut rows = Vec::new();
    for (i, medium) in names.iter().enumerate() {
        for (quantity, pairs) in QUANTITIES.iter().zip(&pairs) {
            rows.extend(score(&pairs[i..=i]).map(|score| Row { medium, quantity, score }));
        }
    }
    let all =
        QUANTITIES.iter().zip(&pairs).filter_map(|(q, p)| Some(Row { medium: "all", quantity: q, score: score(p)? }));
    let all: Vec<Row<'_>> = all.collect();
    let limits = pairs.iter().flatten().filter(|p| p.good && p.estimate == 0.0).count();
    if limits > 0 {
        ctx.warn(format!("{limits} values lie on the limit 0 and are left out of `rms_log`"));
    }
    if let Some(rms_log) = root_mean_square(all.iter().filter_map(|row| row.score.rms_log)) {
        ctx.measure("error: rms log error", 100.0 * rms_log, "%");
    }
    if let Some(z) = root_mean_square(all.iter().filter_map(|row| row.score.z)) {
        ctx.measure("rms_z", z, "1");
    }
    let failed = good.iter().filter(|good| !**good).count();
    if failed > 0 {
        ctx.measure("unknown: media without a fit", failed as f64, "1");
        ctx.warn(format!("{failed} of {} media have no fit: nothing is known of them", good.len()));
    }
    rows.extend(all);
    let errors = ctx.wants("errors").then(|| errors(&pairs, names));
    Ok((table(&rows), errors))
}

/// Estimate, truth and relative error in percent (where the truth of some medium is 0 the error itself): a pixel for each medium, one below the
/// other; the attribute `media` names them.
fn errors(pairs: &[Vec<Pair>; 2], media: &[String]) -> Errors {
    let mut stack = ImageStack::new(media.len(), 1);
    stack.attributes.insert("media".to_owned(), media.into());
    let column = |of: &[Pair], f: fn(&Pair) -> f64| Array2::from_shape_fn((media.len(), 1), |(i, _)| f(&of[i]) as f32);
    for (name, of) in QUANTITIES.iter().zip(pairs) {
        stack.push(LayerInfo::value(*name, "mm^-1"), column(of, |p| p.estimate));
        stack.push(LayerInfo::value(format!("{name}_truth"), "mm^-1"), column(of, |p| p.truth));
        let percent = |p: &Pair| if p.good { 100.0 * (p.estimate / p.truth - 1.0) } else { 0.0 };
        let own = |p: &Pair| if p.good { p.estimate - p.truth } else { 0.0 };
        let error = LayerInfo::value(format!("{name}_error"), "");
        match of.iter().any(|p| p.good && p.truth == 0.0) {
            true => stack.push(LayerInfo { unit: "mm^-1".to_owned(), ..error }, column(of, own)),
            false => stack.push(LayerInfo { unit: "%".to_owned(), ..error }, column(of, percent)),
        }
    }
    let reason = |p: &Pair| if p.good { 0.0 } else { f64::from(MaskReason::NoFit.code()) };
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), column(&pairs[0], reason));
    Errors(stack)
}

fn texts<'a>(table: &'a Table, name: &str) -> Result<&'a [String], Error> {
    let column = table.columns.iter().find(|c| c.name == name);
    match column.map(|c| &c.cells) {
        Some(Cells::Text(texts)) => Ok(texts),
        _ => Err(Error::failed(format!("the table has no column of texts `{name}`"))),
    }
}

/// A row of the metrics.
struct Row<'a> {
    medium: &'a str,
    quantity: &'a str,
    score: MediaScore,
}

/// Columns of the metrics, with their units.
pub const COLUMNS: [(&str, &str); 16] = [
    ("region", ""),
    ("quantity", ""),
    ("n", "1"),
    ("mean", "mm^-1"),
    ("mean_se", "mm^-1"),
    ("truth", "mm^-1"),
    ("bias_percent", "%"),
    ("rmse_percent", "%"),
    ("masked_percent", "%"),
    ("bias", "mm^-1"),
    ("rmse", "mm^-1"),
    ("p95", "mm^-1"),
    ("z", "1"),
    ("rms_log", "1"),
    ("n_unknown", "1"),
    ("unit", ""),
];

fn table(rows: &[Row<'_>]) -> Metrics {
    let text = |f: &dyn Fn(&Row<'_>) -> String| Cells::Text(rows.iter().map(f).collect());
    let number = |f: fn(&MediaScore) -> Option<f64>| Cells::MaybeF64(rows.iter().map(|r| f(&r.score)).collect());
    let count = |f: fn(&MediaScore) -> u64| Cells::I64(rows.iter().map(|r| f(&r.score) as i64).collect());
    let cells = [
        text(&|r| r.medium.to_owned()),
        text(&|r| r.quantity.to_owned()),
        count(|s| s.score.n),
        number(|s| s.score.mean),
        number(|s| s.score.mean_se),
        number(|s| s.score.truth),
        number(|s| s.score.bias_percent),
        number(|s| s.score.rmse_percent),
        number(|s| Some(s.score.masked_percent)),
        number(|s| s.score.bias),
        number(|s| s.score.rmse),
        number(|s| s.score.p95),
        number(|s| s.z),
        number(|s| s.rms_log),
        count(|s| s.score.n_unknown),
        text(&|_| "mm^-1".to_owned()),
    ];
    let mut table = Table::default();
    for ((name, unit), cells) in COLUMNS.into_iter().zip(cells) {
        table.push(name, unit, cells);
    }
    Metrics(table)
}
