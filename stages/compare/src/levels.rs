//! Means of images, their differences and ratios, with standard errors.

use turbid_contract::serde_json::Value;
use turbid_contract::{Axes, Error, ImageStack, Layer, LayerInfo, LayerKind};

/// The mean of one layer over the pixels that are not masked.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    pub info: LayerInfo,
    pub pixels: u64,
    pub n: u64,
    /// `None` without pixels.
    pub mean: Option<f64>,
    /// Its standard error; none where that of a pixel is not known, or of all of them.
    pub mean_se: Option<f64>,
}

/// The level of each value layer of a stack, in its order.
pub fn levels(stack: &ImageStack) -> Vec<Level> {
    stack.layers.iter().filter(|layer| layer.info.kind == LayerKind::Value).map(|layer| level(stack, layer)).collect()
}

fn level(stack: &ImageStack, layer: &Layer) -> Level {
    let info = &layer.info;
    let mask = stack.mask(info.wavelength_nm).map(Layer::pixels);
    let unknown = stack.se_unknown(info).map(Layer::pixels);
    let se = stack.standard_error(info).map(Layer::pixels);
    let pixels = layer.pixels();
    let (mut n, mut sum, mut known) = (0_u64, 0.0, se.is_some());
    for (i, &value) in pixels.iter().enumerate() {
        if mask.as_ref().is_some_and(|mask| mask[i] != 0.0) {
            continue;
        }
        n += 1;
        sum += f64::from(value);
        known &= unknown.as_ref().is_none_or(|unknown| unknown[i] == 0.0);
    }
    let good = |i: usize| mask.as_ref().is_none_or(|mask| mask[i] == 0.0);
    let mean_se = se.and_then(|se| stack.sharing(info).mean_se(&se, good));
    Level {
        info: info.clone(),
        pixels: pixels.len() as u64,
        n,
        mean: (n > 0).then(|| sum / n as f64),
        mean_se: mean_se.filter(|_| known),
    }
}

impl Level {
    /// Whether both describe one quantity.
    pub fn matches(&self, other: &Self) -> bool {
        same_quantity(&self.info, &other.info)
    }

    /// The difference of two means; their errors count as independent.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Self {
        let se = |a: f64, b: f64| (a * a + b * b).sqrt();
        Self {
            info: self.info.clone(),
            pixels: self.pixels,
            n: self.n.min(other.n),
            mean: self.mean.zip(other.mean).map(|(a, b)| a - b),
            mean_se: self.mean_se.zip(other.mean_se).map(|(a, b)| se(a, b)),
        }
    }

    /// The ratio of two means, errors independent, to the first order; not known where either is not. `None` where the divisor is 0.
    pub fn over(&self, divisor: &Self) -> Option<Self> {
        if divisor.mean == Some(0.0) {
            return None;
        }
        let means = self.mean.zip(divisor.mean);
        let se = |(a, b): (f64, f64)| {
            let (mean, by) = means?;
            let ratio = mean / by;
            Some((a * a + ratio * ratio * b * b).sqrt() / by.abs())
        };
        Some(Self {
            info: LayerInfo { unit: "1".to_owned(), ..self.info.clone() },
            pixels: self.pixels,
            n: if divisor.n > 0 { self.n } else { 0 },
            mean: means.map(|(mean, by)| mean / by),
            mean_se: self.mean_se.zip(divisor.mean_se).and_then(se),
        })
    }

    /// What tells the layer from the others of its stack.
    pub fn label(&self) -> String {
        label(&self.info)
    }
}

/// Whether both describe one quantity, whatever their units.
pub fn same_quantity(a: &LayerInfo, b: &LayerInfo) -> bool {
    let what = |info: &LayerInfo| (info.f_x_per_mm, info.phase_rad, info.orientation_deg, info.wavelength_nm);
    a.name == b.name && what(a) == what(b)
}

/// Error: means in two units are to be subtracted, or divided by each other.
pub fn same_unit(values: &LayerInfo, other: &LayerInfo) -> Result<(), Error> {
    if values.unit == other.unit {
        return Ok(());
    }
    let what = format!("{} is in {} here, and in {} on the port `values`", label(values), other.unit, values.unit);
    Err(Error::failed_with_hint(what, "connect images that are in one unit"))
}

/// `radiance f_x=0.1 phase_deg=120`: what tells a layer from the others of its stack.
pub fn label(info: &LayerInfo) -> String {
    let mut text = info.name.clone();
    let degrees = info.phase_rad.map(|phase| (phase.to_degrees() * 1e6).round() / 1e6);
    let parts = [
        (" f_x=", info.f_x_per_mm, ""),
        (" phase_deg=", degrees, ""),
        (" orientation_deg=", info.orientation_deg.filter(|&turn| turn != 0.0), ""),
        (" @", info.wavelength_nm, "nm"),
    ];
    for (name, value, unit) in parts {
        text.push_str(&value.map(|value| format!("{name}{value}{unit}")).unwrap_or_default());
    }
    text
}

/// The value of an axis in words.
pub fn text(value: &Value) -> String {
    match (value.as_f64(), value.as_str()) {
        (Some(number), _) => number.to_string(),
        (None, Some(text)) => text.to_owned(),
        (None, None) => value.to_string(),
    }
}

/// `A_rho=1,S_rho=0`.
pub fn point(axes: &Axes) -> String {
    let parts: Vec<String> = axes.iter().map(|(name, value)| format!("{name}={}", text(value))).collect();
    if parts.is_empty() { "all".to_owned() } else { parts.join(",") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_contract::ndarray::array;

    /// Two pixels of which one is masked in the second stack, worked out by hand.
    #[test]
    fn means_differences_and_ratios() {
        let stack = |values: [f32; 2], se: [f32; 2], mask: [f32; 2]| {
            let mut stack = ImageStack::new(1, 2);
            let info = LayerInfo::value("radiance", "W").with_f_x(0.1);
            stack.push(info.clone(), array![values]);
            stack.push(info.standard_error(), array![se]);
            stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), array![mask]);
            stack
        };
        let a = &levels(&stack([3.0, 5.0], [0.75, 1.0], [0.0, 0.0]))[0];
        assert_eq!((a.n, a.mean, a.mean_se), (2, Some(4.0), Some(0.625)));
        let b = &levels(&stack([2.0, 9.0], [0.5, 1.0], [0.0, 1.0]))[0];
        assert_eq!((b.n, b.pixels, b.mean, b.mean_se), (1, 2, Some(2.0), Some(0.5)));
        let difference = a.minus(b);
        assert_eq!((difference.mean, difference.mean_se), (Some(2.0), Some(0.640_625_f64.sqrt())));
        let ratio = a.over(b).unwrap();
        assert_eq!((ratio.mean, ratio.mean_se), (Some(2.0), Some((0.390_625_f64 + 4.0 * 0.25).sqrt() / 2.0)));
        assert_eq!(a.label(), "radiance f_x=0.1");
        assert!(a.matches(b));
        let nothing = &levels(&stack([2.0, 9.0], [0.5, 1.0], [2.0, 1.0]))[0];
        assert_eq!((nothing.n, nothing.mean, nothing.mean_se), (0, None, None));
        // What is made of nothing known is not known either, in whichever place it stands.
        for of in [a.minus(nothing), nothing.minus(a), a.over(nothing).unwrap(), nothing.over(a).unwrap()] {
            assert_eq!((of.n, of.mean, of.mean_se), (0, None, None));
        }
        assert_eq!(a.over(&a.minus(a)), None, "nothing is relative to 0");
    }

    /// A pixel whose error is not known leaves that of the mean unknown, and the mean as it is.
    #[test]
    fn unknown_errors_stay_unknown() {
        let mut stack = ImageStack::new(1, 2);
        let info = LayerInfo::value("radiance", "W");
        stack.push(info.clone(), array![[3.0, 5.0]]);
        stack.push(info.standard_error(), array![[1.0, 1.0]]);
        stack.push(info.se_unknown(), array![[0.0, 1.0]]);
        let level = &levels(&stack)[0];
        assert_eq!((level.n, level.mean, level.mean_se), (2, Some(4.0), None));
    }
}
