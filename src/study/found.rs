//! What one point of a study says: the error of its pixels, the one that they state, and what the point cost.

use std::collections::{BTreeMap, BTreeSet};

use turbid_compare::score::{Pixels, Standing, score};
use turbid_contract::ImageStack;
use turbid_contract::payload::MaskReason;
use turbid_contract::sharing::Sharing;

use crate::digest::Digest;
use crate::plan::{InstanceId, Plan};
use crate::store::InstanceRecord;

use super::quantity::{layers, truth_of};

/// Pixels of an estimate, of all its layers and instances one behind the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    pub estimate: Vec<f32>,
    /// NaN where not known.
    pub se: Vec<f32>,
    pub se_unknown: Vec<f32>,
    /// Factors of [`Sharing`].
    pub sharing: Vec<f32>,
    pub counts: Vec<bool>,
    pub absent: Vec<bool>,
    /// Empty where no truth is named.
    pub truth: Vec<f32>,
    /// Lengths, which have no natural 0.
    pub position: bool,
    pub unit: String,
}

impl Seen {
    /// Adds the layers `name` of an estimate; `truth` with the name of the layer there.
    ///
    /// Error: there is no such layer, or they are of different size.
    pub fn add(&mut self, stack: &ImageStack, name: &str, truth: Option<(&ImageStack, &str)>) -> Result<(), String> {
        let mut none = true;
        for layer in layers(stack, name) {
            none = false;
            let info = &layer.info;
            self.unit.clone_from(&info.unit);
            self.position = info.unit == "mm";
            let pixels = layer.pixels();
            let sharing = stack.sharing(info);
            self.sharing.extend((0..pixels.len()).map(|i| sharing.at(i) as f32));
            let mut masks: Vec<_> = stack.mask(info.wavelength_nm).into_iter().collect();
            match truth {
                None => {}
                Some((truth, of)) => {
                    let own =
                        truth_of(layer, truth, of).ok_or_else(|| format!("the truth has no layer `{of}` for it"))?;
                    if own.pixels().len() != pixels.len() {
                        return Err("the estimate and the truth differ in size".to_owned());
                    }
                    self.truth.extend(own.pixels().iter());
                    masks.extend(truth.mask(own.info.wavelength_nm));
                }
            }
            let codes = |i: usize| masks.iter().map(|m| m.pixels()[i]).find(|code| *code != 0.0).unwrap_or(0.0);
            let reasons: Vec<f32> = (0..pixels.len()).map(codes).collect();
            self.counts.extend(reasons.iter().map(|&code| code == 0.0));
            let absent = |code: f32| MaskReason::of_code(code).is_some_and(MaskReason::is_structural);
            self.absent.extend(reasons.iter().map(|&code| absent(code)));
            match stack.standard_error(info) {
                Some(se) => self.se.extend(se.pixels().iter()),
                None => self.se.extend(std::iter::repeat_n(f32::NAN, pixels.len())),
            }
            match stack.se_unknown(info) {
                Some(flags) => self.se_unknown.extend(flags.pixels().iter()),
                None => self.se_unknown.extend(std::iter::repeat_n(0.0, pixels.len())),
            }
            self.estimate.extend(pixels.iter());
        }
        if none { Err(format!("there is no layer `{name}`")) } else { Ok(()) }
    }

    /// The error of this name against the truth; nothing where every pixel is masked or no error is relative to 0.
    pub fn error(&self, which: &str) -> Errors {
        let standing: Vec<Standing> = self
            .counts
            .iter()
            .zip(&self.absent)
            .map(|(counts, absent)| match (counts, absent) {
                (true, _) => Standing::Counts,
                (false, true) => Standing::Absent,
                (false, false) => Standing::LeftOut,
            })
            .collect();
        let known = self.se.iter().all(|se| !se.is_nan());
        let sharing = Sharing::of_pixels(self.sharing.clone());
        let pixels = Pixels {
            estimate: &self.estimate,
            se: known.then_some(&self.se[..]),
            se_unknown: Some(&self.se_unknown),
            sharing: &sharing,
            truth: &self.truth,
            position: self.position,
            standing: &standing,
        };
        let Some(score) = score(&pixels, &vec![true; self.estimate.len()]) else { return Errors::default() };
        let relative = |of_mean: f64| Some(100.0 * of_mean / score.truth.filter(|t| *t != 0.0)?.abs());
        // Over the pixels that count and whose own error is known: root mean square of the stated errors, and of the true ones.
        let over_known = |relative: bool| {
            let known = |i: &usize| self.counts[*i] && !self.se[*i].is_nan() && self.se_unknown[*i] == 0.0;
            let of = |i: usize| if relative { f64::from(self.truth[i]) } else { 1.0 };
            let chosen: Vec<usize> = (0..self.se.len()).filter(known).filter(|&i| of(i) != 0.0).collect();
            let root_mean_square = |error: &dyn Fn(usize) -> f64| {
                let squares: f64 = chosen.iter().map(|&i| (error(i) / of(i)).powi(2)).sum();
                (!chosen.is_empty()).then(|| (squares / chosen.len() as f64).sqrt())
            };
            let away = |i: usize| f64::from(self.estimate[i]) - f64::from(self.truth[i]);
            [root_mean_square(&|i| f64::from(self.se[i])), root_mean_square(&away)]
        };
        let of_mean = |se: Option<f64>, error: Option<f64>| [se, error.filter(|_| se.is_some())];
        let (error, [stated, where_stated]) = match which {
            "rmse_percent" => (score.rmse_percent, over_known(true).map(|rms| rms.map(|rms| 100.0 * rms))),
            "rmse" => (score.rmse, over_known(false)),
            "bias_percent" => {
                let se = score.mean_se.filter(|_| known).and_then(relative);
                (score.bias_percent, of_mean(se, score.bias_percent))
            }
            "bias" => (score.bias, of_mean(score.mean_se.filter(|_| known), score.bias)),
            "masked_percent" => (Some(score.masked_percent), [None, None]),
            other => unreachable!("the reader of studies knows no error {other}"),
        };
        Errors { error, stated, where_stated, n: score.n }
    }
}

/// An error, the one that is stated in the same unit, and of how many pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    pub error: Option<f64>,
    /// Over the pixels whose own error is known.
    pub stated: Option<f64>,
    /// The error over these pixels.
    pub where_stated: Option<f64>,
    pub n: u64,
}

/// What an instance cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spent {
    pub cpu_s: f64,
    pub wall_s: f64,
    pub flights: f64,
    pub peak_bytes: u64,
}

impl Spent {
    fn of(record: &InstanceRecord) -> Self {
        let flights = record.measures.iter().filter(|(name, ..)| name == "flights").map(|(_, value, _)| value).sum();
        let cost = &record.cost;
        Self { cpu_s: cost.cpu_s, wall_s: cost.wall_s, flights, peak_bytes: cost.peak_bytes }
    }

    pub fn and(self, other: Self) -> Self {
        Self {
            cpu_s: self.cpu_s + other.cpu_s,
            wall_s: self.wall_s + other.wall_s,
            flights: self.flights + other.flights,
            peak_bytes: self.peak_bytes.max(other.peak_bytes),
        }
    }
}

/// What one point says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    pub errors: Errors,
    /// In the order of the study's `also`.
    pub also: Vec<Option<f64>>,
    /// The pixels themselves, where no truth is named, for repeats are compared with each other: of the estimate, then of those of `also` at these places.
    pub seen: Vec<Seen>,
    pub also_seen: Vec<usize>,
    pub unit: String,
    /// What the estimate depends on, by key.
    pub spent: BTreeMap<Digest, Spent>,
}

/// What the estimates depend on, themselves included.
pub fn spent(
    plan: &Plan,
    estimates: impl IntoIterator<Item = InstanceId>,
    record: impl Fn(InstanceId) -> Option<InstanceRecord>,
) -> BTreeMap<Digest, Spent> {
    let (mut open, mut seen): (Vec<InstanceId>, BTreeSet<InstanceId>) =
        (estimates.into_iter().collect(), BTreeSet::new());
    let mut spent = BTreeMap::new();
    while let Some(id) = open.pop() {
        if !seen.insert(id) {
            continue;
        }
        spent.extend(record(id).map(|record| (record.key, Spent::of(&record))));
        open.extend(plan.sources(id).map(|(source, _)| source));
    }
    spent
}

#[cfg(test)]
mod tests {
    use turbid_contract::ndarray::Array2;
    use turbid_contract::{LayerInfo, LayerKind};

    use super::*;

    fn stack(name: &str, values: [f32; 4], se: Option<[f32; 4]>, mask: Option<[f32; 4]>) -> ImageStack {
        let mut stack = ImageStack::new(2, 2);
        let info = LayerInfo::value(name, "mm^-1");
        let plane = |v: [f32; 4]| Array2::from_shape_vec((2, 2), v.to_vec()).unwrap();
        stack.push(info.clone(), plane(values));
        if let Some(se) = se {
            stack.push(info.standard_error(), plane(se));
        }
        if let Some(mask) = mask {
            stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), plane(mask));
        }
        stack
    }

    /// By hand: errors of 10, -10 and 20 % of a truth of 1, one pixel masked.
    #[test]
    fn errors_are_those_of_the_pixels_that_count() {
        let masked = MaskReason::Saturated.code();
        let estimate = stack("mu_a", [1.1, 0.9, 1.2, 9.0], Some([0.1; 4]), Some([0.0, 0.0, 0.0, masked]));
        let truth = stack("mu_a", [1.0; 4], None, None);
        let mut seen = Seen::default();
        seen.add(&estimate, "mu_a", Some((&truth, "mu_a"))).unwrap();
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-5, "{a:?} {b}");
        let rmse = seen.error("rmse_percent");
        near(rmse.error, 100.0 * (0.06_f64 / 3.0).sqrt());
        near(rmse.stated, 10.0);
        assert_eq!(rmse.n, 3);
        let bias = seen.error("bias_percent");
        near(bias.error, 100.0 * 0.2 / 3.0);
        near(bias.stated, 10.0 / 3.0_f64.sqrt());
        near(seen.error("masked_percent").error, 25.0);
        let mut other = Seen::default();
        assert!(other.add(&estimate, "mu_s_prime", None).unwrap_err().contains("no layer"));
        assert!(other.add(&estimate, "mu_a", Some((&truth, "height"))).unwrap_err().contains("no layer `height`"));
    }

    /// Without standard errors nothing is stated; nothing is relative to a truth of 0.
    #[test]
    fn what_is_not_known_is_not_stated() {
        let estimate = stack("mu_a", [1.0, 2.0, 3.0, 4.0], None, None);
        let mut seen = Seen::default();
        seen.add(&estimate, "mu_a", Some((&stack("mu_a", [2.0; 4], None, None), "mu_a"))).unwrap();
        assert_eq!(seen.error("rmse").stated, None);
        assert_eq!(seen.error("bias").stated, None);
        let mut seen = Seen::default();
        seen.add(&estimate, "mu_a", Some((&stack("mu_a", [0.0; 4], None, None), "mu_a"))).unwrap();
        assert_eq!(seen.error("rmse_percent"), Errors::default());
    }
}
