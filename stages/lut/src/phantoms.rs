//! Phantoms: what was seen of media whose properties are known, gathered from the inputs.

use std::collections::{BTreeMap, BTreeSet};

use turbid_contract::layers::{standard_error, values};
use turbid_contract::payload::{Fit, Modulation, Rig, Sections, Shares, Truth};
use turbid_contract::{Axes, Cells, Error, ImageStack, Layer, LayerInfo, Many, Payload};

/// One phantom: its properties, and what the camera saw of it beside the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Phantom {
    /// (mu_a, mu_s'), mm^-1, both > 0.
    pub properties: [f64; 2],
    /// Their standard errors, 0 where they are exact.
    pub properties_se: [f64; 2],
    /// M / M of the reference at each f_x, over the pixels that are good in both.
    pub ratio: Vec<f64>,
    /// Their standard errors: where `ratio_known` is false, no more than a part of them.
    pub ratio_se: Vec<f64>,
    /// Whether phantom and reference know their standard errors.
    pub ratio_known: bool,
}

/// The pixels that a table is made of.
pub enum Part {
    All,
    /// One of the sections of a surface, with the share of each pixel that it has.
    Section {
        number: usize,
        shares: Vec<f64>,
        size: (usize, usize),
    },
}

impl Part {
    /// One for each section, or all pixels.
    pub fn of(sections: Option<&Sections>) -> Result<Vec<Self>, Error> {
        let Some(sections) = sections else { return Ok(vec![Self::All]) };
        let pixels = sections.shares()?;
        let share = |pixel: &Option<Shares>, number: usize| {
            let of = |(section, share): (usize, f64)| if section == number { share } else { 0.0 };
            pixel.map_or(0.0, |[own, other]| of(own) + of(other))
        };
        let size = (sections.0.rows(), sections.0.columns());
        let part = |number| Self::Section { number, shares: pixels.iter().map(|p| share(p, number)).collect(), size };
        Ok((0..sections.list()?.len()).map(part).collect())
    }

    fn share(&self, pixel: usize) -> f64 {
        match self {
            Self::All => 1.0,
            Self::Section { shares, .. } => shares[pixel],
        }
    }

    fn fits(&self, stack: &ImageStack) -> bool {
        match self {
            Self::All => true,
            Self::Section { size, .. } => *size == (stack.rows(), stack.columns()),
        }
    }

    fn place(&self) -> String {
        match self {
            Self::All => String::new(),
            Self::Section { number, .. } => format!(" in section {number}"),
        }
    }
}

/// What the ports bring; each `Many` loads one artifact at a time.
pub struct Sources<'a, 'b> {
    pub phantoms: &'b Many<'a, Modulation>,
    pub references: &'b Many<'a, Modulation>,
    pub properties: &'b Many<'a, Fit>,
    pub truths: &'b Many<'a, Truth>,
}

/// All phantoms, in the order of their axes, as each of `parts` shows them.
///
/// Errors: a phantom without reference or properties, without f_x, without a good pixel in some part, or darker than zero.
pub fn gather(sources: &Sources<'_, '_>, f_x: &[f64], parts: &[Part]) -> Result<Vec<Vec<Phantom>>, Error> {
    let mut reference: Option<(usize, ImageStack)> = None;
    let mut phantoms = vec![Vec::new(); parts.len()];
    for (i, axes) in sources.phantoms.axes().iter().enumerate() {
        let name = name(axes);
        let at = partner(sources.references, axes, "references")?;
        // One reference for all phantoms is the rule: it is loaded once.
        if reference.as_ref().is_none_or(|(loaded, _)| *loaded != at) {
            reference = Some((at, sources.references.load(at)?.0));
        }
        let against = &reference.as_ref().expect("loaded above").1;
        let sample = sources.phantoms.load(i)?.0;
        Rig::shared(&sample.attributes, &against.attributes)?;
        let light = wavelength_nm(&sample.infos(), f_x)?;
        let (properties, properties_se) = properties(sources, axes, light, &name)?;
        if properties.iter().any(|&p| !(p > 0.0 && p.is_finite())) {
            let [a, s] = properties;
            let what = format!("{name} has mu_a = {a} and mu_s' = {s} mm^-1; the axes of the table are logarithmic");
            return Err(Error::failed_with_hint(what, "both must be > 0: leave the phantom out"));
        }
        for (phantoms, part) in phantoms.iter_mut().zip(parts) {
            let ratios: Result<Vec<[f64; 2]>, Error> =
                f_x.iter().map(|&f_x| ratio(&sample, against, f_x, part, &name)).collect();
            let (ratio, ratio_se) = ratios?.into_iter().map(|[r, se]| (r, se)).unzip();
            let ratio_known = f_x.iter().all(|&f_x| knows(&sample, f_x) && knows(against, f_x));
            phantoms.push(Phantom { properties, properties_se, ratio, ratio_se, ratio_known });
        }
    }
    Ok(phantoms)
}

/// Rows and columns, where two axes make a full grid of the phantoms (the second runs fastest).
pub fn grid(axes: &[Axes]) -> Option<[usize; 2]> {
    let mut values: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (axis, value) in axes.iter().flatten() {
        values.entry(axis).or_default().insert(value.to_string());
    }
    let counts: Vec<usize> = values.values().map(BTreeSet::len).filter(|&n| n > 1).collect();
    match counts[..] {
        [rows, columns] if rows * columns == axes.len() => Some([rows, columns]),
        _ => None,
    }
}

fn name(axes: &Axes) -> String {
    let values: Vec<String> = axes.iter().map(|(axis, value)| format!("{axis} = {value}")).collect();
    if values.is_empty() { "the phantom".to_owned() } else { format!("the phantom with {}", values.join(", ")) }
}

/// The artifact on another port that belongs to a phantom: the one whose axes it carries.
fn partner<T: Payload>(port: &Many<'_, T>, axes: &Axes, what: &str) -> Result<usize, Error> {
    belonging(port.axes(), axes, what)
}

/// The same among the axes of all that the port `what` has.
pub fn belonging(all: &[Axes], axes: &Axes, what: &str) -> Result<usize, Error> {
    let belongs = |own: &Axes| own.iter().all(|(axis, value)| axes.get(axis).is_none_or(|v| v == value));
    let found: Vec<usize> = (0..all.len()).filter(|&k| belongs(&all[k])).collect();
    match found[..] {
        [k] => Ok(k),
        _ => Err(Error::failed_with_hint(
            format!("{} of `{what}` belong to {}; one is needed", found.len(), name(axes)),
            "give it the axes of the phantoms, or one for all",
        )),
    }
}

/// The wavelength that the phantom was seen at.
///
/// Errors: it was not seen at these f_x, or at several wavelengths.
pub fn wavelength_nm(layers: &[LayerInfo], f_x: &[f64]) -> Result<Option<f64>, Error> {
    let first = f_x.first().map(|&f_x| modulation(layers, f_x, "the phantom")).transpose()?;
    Ok(first.and_then(|k| layers[k].wavelength_nm))
}

/// The layer of a truth that says a quantity at the wavelength of the phantom; one that names no wavelength holds for all of them.
pub fn true_layer(truth: &[LayerInfo], quantity: &str, wavelength_nm: Option<f64>) -> Result<usize, Error> {
    let holds = |info: &LayerInfo| info.wavelength_nm.is_none() || info.wavelength_nm == wavelength_nm;
    if let Some((k, _)) = values(truth, quantity).find(|(_, info)| holds(info)) {
        return Ok(k);
    }
    let light = |nm: Option<f64>| nm.map_or_else(|| "no wavelength".to_owned(), |nm| format!("{nm} nm"));
    let has: Vec<String> = values(truth, quantity).map(|(_, info)| light(info.wavelength_nm)).collect();
    let what = if has.is_empty() {
        format!("the truth has no {quantity}")
    } else {
        format!("the truth has {quantity} at {}, the phantom was seen at {}", has.join(", "), light(wavelength_nm))
    };
    Err(Error::failed_with_hint(what, "connect the `truth` of the render that made the phantom's frames"))
}

/// Columns that are read of a fit.
pub const OF_A_FIT: [&str; 4] = ["mu_a", "mu_s_prime", "mu_a_se", "mu_s_prime_se"];

/// Properties of a phantom with standard errors: from a fit, or from what the camera truly looked at.
fn properties(
    sources: &Sources<'_, '_>,
    axes: &Axes,
    wavelength_nm: Option<f64>,
    name: &str,
) -> Result<([f64; 2], [f64; 2]), Error> {
    if sources.properties.axes().is_empty() {
        let truth = sources.truths.load(partner(sources.truths, axes, "truths")?)?.0;
        let of = |quantity: &str| uniform(&truth, quantity, wavelength_nm, name);
        let exact = [of("mu_a")?, of("mu_s_prime")?];
        return Ok((exact, [0.0; 2]));
    }
    let Fit(table) = sources.properties.load(partner(sources.properties, axes, "properties")?)?;
    let text = |column: &str| {
        let column = table.columns.iter().find(|c| c.name == column);
        column.and_then(|c| if let Cells::Text(cells) = &c.cells { Some(cells) } else { None })
    };
    let row = match (table.rows(), text("medium")) {
        (1, _) => Some(0),
        (_, Some(media)) => media.iter().position(|m| axes.values().any(|v| v.as_str() == Some(m))),
        _ => None,
    };
    let Some(row) = row else {
        let what = format!("the fit has {} rows, and none is named as {name}", table.rows());
        return Err(Error::failed_with_hint(what, "fit each phantom on its own axes, or let an axis name the media"));
    };
    if let Some(status) = text("status").map(|s| &s[row])
        && !status.starts_with("ok")
    {
        let what = format!("the fit of {name} ended as `{status}`");
        return Err(Error::failed_with_hint(what, "leave the phantom out, or mend its readings"));
    }
    let cell = |column: &str| {
        let cells = table.maybe_f64s(column).map(|cells| cells[row]);
        let cell = cells.ok_or_else(|| Error::failed(format!("the fit has no column {column}")))?;
        cell.ok_or_else(|| Error::failed(format!("the fit of {name} does not know {column}")))
    };
    let se = |column: &str| {
        let cells = table.maybe_f64s(column).map(|cells| cells[row]);
        cells.ok_or_else(|| Error::failed(format!("the fit has no column {column}")))?.ok_or_else(|| {
            let what = format!("the fit of {name} does not know its standard error ({column})");
            Error::failed_with_hint(what, "state m_r_se and m_t_se in the readings or in `calibrate_iad`")
        })
    };
    Ok(([cell("mu_a")?, cell("mu_s_prime")?], [se("mu_a_se")?, se("mu_s_prime_se")?]))
}

/// The one value of a layer of the truth.
fn uniform(truth: &ImageStack, quantity: &str, wavelength_nm: Option<f64>, name: &str) -> Result<f64, Error> {
    let layer = &truth.layers[true_layer(&truth.infos(), quantity, wavelength_nm)?];
    let mask = truth.mask(layer.info.wavelength_nm).map(Layer::pixels);
    let pixels = layer.pixels();
    let good = pixels.iter().enumerate().filter(|(i, _)| mask.as_ref().is_none_or(|m| m[*i] == 0.0));
    let range = good.fold(None, |range: Option<[f32; 2]>, (_, &v)| {
        Some(range.map_or([v, v], |[low, high]| [low.min(v), high.max(v)]))
    });
    match range {
        Some([low, high]) if low == high => Ok(f64::from(low)),
        Some([low, high]) => Err(Error::failed_with_hint(
            format!("{name} shows {quantity} from {low} to {high} mm^-1"),
            "a phantom is one medium: let the camera see nothing else",
        )),
        None => Err(Error::failed(format!("the camera does not see {name}"))),
    }
}

/// M / M_reference with its standard error: the ratio of sums over the pixels of the part that are good in both.
fn ratio(sample: &ImageStack, reference: &ImageStack, f_x: f64, part: &Part, name: &str) -> Result<[f64; 2], Error> {
    if !part.fits(sample) {
        return Err(Error::failed(format!("the sections are of another camera: {name} has an image of another size")));
    }
    if (sample.rows(), sample.columns()) != (reference.rows(), reference.columns()) {
        return Err(Error::failed_with_hint(
            format!("{name} and its reference have images of different sizes"),
            "both must be seen by the same camera",
        ));
    }
    let place = |stack: &ImageStack, name: &str| modulation(&stack.infos(), f_x, name);
    let sample_layer = &sample.layers[place(sample, name)?];
    let reference_layer = &reference.layers[place(reference, "the reference")?];
    let mask =
        |stack: &ImageStack, layer: &Layer| stack.mask(layer.info.wavelength_nm).map(Layer::pixels).map(|p| p.to_vec());
    let masks = [mask(sample, sample_layer), mask(reference, reference_layer)];
    let good = |i: usize| masks.iter().flatten().all(|m| m[i] == 0.0);
    let sums = |stack: &ImageStack, layer: &Layer| {
        let (mut sum, mut shares, mut squares) = (0.0, 0.0, 0.0);
        let se = stack.standard_error(&layer.info).map(Layer::pixels);
        for (i, &m) in layer.pixels().iter().enumerate().filter(|(i, _)| good(*i)) {
            let share = part.share(i);
            sum += share * f64::from(m);
            shares += share;
            squares += share * share;
        }
        let parts = se.iter().flat_map(|se| se.iter().enumerate()).filter(|&(i, _)| good(i));
        let parts = parts.map(|(i, &se)| (i, (part.share(i) * f64::from(se)).powi(2)));
        [sum / shares, stack.sharing(&layer.info).variance_of_sum(parts, shares * shares / squares).sqrt() / shares]
    };
    let [[m, m_se], [m_r, m_r_se]] = [sums(sample, sample_layer), sums(reference, reference_layer)];
    let usable = |x: f64| x > 0.0 && x.is_finite();
    if !usable(m) || !usable(m_r) {
        let place = part.place();
        let found = match [m, m_r].map(f64::is_finite) {
            [true, true] => format!("means {m} and {m_r}"),
            _ => "no pixel is good in both".to_owned(),
        };
        return Err(Error::failed_with_hint(
            format!("{name} and its reference have no modulation in common at f_x = {f_x} mm^-1{place}: {found}"),
            "take more samples, lower f_x, or fewer sections",
        ));
    }
    let ratio = m / m_r;
    Ok([ratio, ratio * libm::hypot(m_se / m, m_r_se / m_r)])
}

/// Whether a modulation comes with standard errors at `f_x`.
fn knows(stack: &ImageStack, f_x: f64) -> bool {
    let infos = stack.infos();
    modulation(&infos, f_x, "").is_ok_and(|k| standard_error(&infos, &infos[k]).is_some())
}

/// The place of M_AC at `f_x`; at 0 without a frame of its own that of the mean of the fringes of the lowest f_x.
pub fn modulation(layers: &[LayerInfo], f_x: f64, name: &str) -> Result<usize, Error> {
    let f_x_of = |info: &LayerInfo| info.f_x_per_mm.unwrap_or(0.0);
    let same = |info: &LayerInfo| (f_x_of(info) - f_x).abs() <= 1e-9 * f_x;
    let found: Vec<usize> = values(layers, "m_ac").filter(|(_, info)| same(info)).map(|(k, _)| k).collect();
    let lowest = || values(layers, "m_dc").min_by(|a, b| f_x_of(a.1).total_cmp(&f_x_of(b.1))).map(|(k, _)| k);
    match (&found[..], lowest().filter(|_| f_x == 0.0)) {
        ([k], _) => Ok(*k),
        ([], Some(k)) => Ok(k),
        ([], None) => {
            let what = format!("{name} was seen at f_x = {} mm^-1, not at {f_x}", seen_at(layers));
            Err(Error::invalid("f_x", what))
        }
        _ => {
            let what = format!("{name} has {} images at f_x = {f_x} mm^-1 (orientations or wavelengths)", found.len());
            Err(Error::failed_with_hint(what, "one table is for one orientation and one wavelength"))
        }
    }
}

/// The f_x of all M_AC, for a message.
fn seen_at(layers: &[LayerInfo]) -> String {
    let f_x = values(layers, "m_ac").map(|(_, info)| info.f_x_per_mm.unwrap_or(0.0).to_string());
    f_x.collect::<Vec<_>>().join(", ")
}
