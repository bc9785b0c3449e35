//! In a run: what the properties that came out say of how far the table's conditions are from those of each pixel.

use std::collections::BTreeMap;

use turbid_contract::payload::{INCIDENCE_LAYER, MaskReason, Seen, THICKNESS_LAYER, Thickness, VIEW_LAYER};
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerKind};
use turbid_optics::misreading::Setting;

use super::say::{percent, unsaid};
use super::{Cause, Compared, LEAST_TOLD, setting};

/// Pixels are taken together by steps of these: degrees, ln thickness, ln mu.
const ANGLE_DEG: f64 = 5.0;
const LN_THICKNESS: f64 = 0.1;
const LN_MU: f64 = 0.25;
/// So many kinds of pixels are worked out, those with the most pixels; the rest is taken as the nearest of them by place in the list.
const KINDS: usize = 48;
/// Of the good pixels, so many may be off by more than what is told before it is told.
const FEW: f64 = 0.01;

/// Steps that a pixel belongs to: view, light, thickness, mu_a, mu_s'.
type Kind = [i32; 5];

/// Warns where the pixels were not seen as the table takes them to have been, by more than the stated error of the map's mean and 1 %; masks
/// those that are off by more than `most`.
///
/// Error: the run was cancelled.
pub fn tell(
    (compared, wavelengths_nm): (&Compared, &[Option<f64>]),
    stack: &ImageStack,
    maps: &mut ImageStack,
    mut covariance: Option<&mut ImageStack>,
    most: Option<f64>,
    ctx: Ctx<'_>,
) -> Result<(), Error> {
    if let Some(message) = unsaid(compared) {
        ctx.warn(message);
    }
    let Some(said) = &compared.said else { return Ok(()) };
    let causes = |mu: [f64; 2]| -> Vec<Cause> {
        let all = said.seen.iter().flat_map(|seen| compared.causes(seen, mu));
        Cause::ALL.into_iter().filter(|cause| all.clone().any(|c| c == *cause)).collect()
    };
    for &wavelength_nm in wavelengths_nm {
        let pixels = Pixels::of(stack, maps, wavelength_nm);
        // The lowest mu_a goes deepest: what makes no difference there makes none.
        let Some(lowest) = pixels.lowest() else { continue };
        let causes = causes(lowest);
        if causes.is_empty() {
            continue;
        }
        let kinds = pixels.kinds(&said.seen, compared);
        let mut listed = pixels.listed(&kinds);
        listed.sort_by_key(|(kind, of)| (std::cmp::Reverse(of.count), *kind));
        listed.truncate(KINDS);
        let base = said.seen.first().map_or(compared.table, |seen| setting(seen, &compared.table));
        let found = ctx.map_tiles(listed.len(), |i| {
            let (kind, of) = &listed[i];
            let (mu, seen) = (of.mu(), middle(kind, base));
            behind(compared, mu, seen, &causes)
        })?;
        let off: BTreeMap<Kind, [f64; 2]> =
            listed.iter().zip(&found).filter_map(|((kind, _), off)| Some((*kind, (*off)?))).collect();
        let nearest = |kind: &Kind| {
            let apart = |other: &Kind| kind.iter().zip(other).map(|(a, b)| (a - b).unsigned_abs()).sum::<u32>();
            off.get(kind).or_else(|| off.iter().min_by_key(|(other, _)| apart(other)).map(|(_, off)| off)).copied()
        };
        let of_pixel: Vec<Option<[f64; 2]>> = kinds.iter().map(|kind| kind.as_ref().and_then(nearest)).collect();
        if off.is_empty() {
            ctx.warn("by how much maps are off under the conditions of the pixels is not known: the transport solver does not solve these media");
            continue;
        }
        report(maps, wavelength_nm, &of_pixel, &causes, ctx);
        if let Some(most) = most {
            mask(maps, wavelength_nm, &of_pixel, most, ctx);
            if let Some(covariance) = &mut covariance {
                mask(covariance, wavelength_nm, &of_pixel, most, ctx);
            }
        }
    }
    Ok(())
}

/// How often the medium behind a reading is sought anew, and where it is near enough.
const ROUNDS: usize = 10;
const NEAR: f64 = 0.01;

/// What is read over what is there, less 1, where `read` is what was read: of the medium that reads so.
fn behind(compared: &Compared, read: [f64; 2], seen: Setting, causes: &[Cause]) -> Option<[f64; 2]> {
    let mut off = compared.reads(read, seen, causes)?;
    for _ in 0..ROUNDS {
        let truth = [0, 1].map(|k| read[k] / (1.0 + off[k]));
        let next = compared.reads(truth, seen, causes)?;
        let near = (0..2).all(|k| (next[k] - off[k]).abs() < NEAR * (1.0 + off[k]));
        off = next;
        if near {
            break;
        }
    }
    Some(off)
}

/// What is known of each pixel.
struct Pixels<'a> {
    mu: [std::borrow::Cow<'a, [f32]>; 2],
    mask: Option<std::borrow::Cow<'a, [f32]>>,
    view: Option<std::borrow::Cow<'a, [f32]>>,
    incidence: Option<std::borrow::Cow<'a, [f32]>>,
    thickness: Option<std::borrow::Cow<'a, [f32]>>,
}

impl<'a> Pixels<'a> {
    fn of(stack: &'a ImageStack, maps: &'a ImageStack, wavelength_nm: Option<f64>) -> Self {
        let map = |name: &str| {
            let wanted = |l: &&Layer| {
                l.info.name == name && l.info.kind == LayerKind::Value && l.info.wavelength_nm == wavelength_nm
            };
            maps.layers.iter().find(wanted).expect("maps hold both properties").pixels()
        };
        let layer = |name: &str| {
            let wanted = |l: &&Layer| l.info.name == name && l.info.kind == LayerKind::Condition;
            stack.layers.iter().find(wanted).map(Layer::pixels)
        };
        Self {
            mu: [map("mu_a"), map("mu_s_prime")],
            mask: maps.mask(wavelength_nm).map(Layer::pixels),
            view: layer(VIEW_LAYER),
            incidence: layer(INCIDENCE_LAYER),
            thickness: layer(THICKNESS_LAYER),
        }
    }

    /// Each kind with its pixels.
    fn listed(&self, kinds: &[Option<Kind>]) -> Vec<(Kind, OfKind)> {
        let mut all: BTreeMap<Kind, OfKind> = BTreeMap::new();
        for (i, kind) in kinds.iter().enumerate() {
            let Some(kind) = kind else { continue };
            let of = all.entry(*kind).or_default();
            of.count += 1;
            (0..2).for_each(|k| of.ln_mu[k] += libm::log(f64::from(self.mu[k][i])));
        }
        all.into_iter().collect()
    }

    fn good(&self, i: usize) -> bool {
        self.mask.as_ref().is_none_or(|m| m[i] == 0.0) && self.mu.iter().all(|mu| mu[i] > 0.0)
    }

    fn lowest(&self) -> Option<[f64; 2]> {
        let good =
            (0..self.mu[0].len()).filter(|&i| self.good(i)).map(|i| self.mu.each_ref().map(|mu| f64::from(mu[i])));
        good.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1])])
    }

    fn kinds(&self, seen: &[Seen], compared: &Compared) -> Vec<Option<Kind>> {
        let base = seen.first().map_or(compared.table, |seen| setting(seen, &compared.table));
        let thickness = base.thickness.or(match seen.first().and_then(|s| s.thickness) {
            Some(Thickness::Mm([_, median, _])) => Some(median),
            _ => None,
        });
        let steps = |x: f64, step: f64| (x / step).round() as i32;
        let ln_steps = |x: f64, step: f64| if x > 0.0 { steps(libm::log(x), step) } else { NO_THICKNESS };
        let at = |layer: &Option<std::borrow::Cow<'_, [f32]>>, i: usize, base: f64| {
            layer.as_ref().map_or(base, |l| f64::from(l[i]))
        };
        let kind = |i: usize| {
            let depth = self.thickness.as_ref().map(|l| f64::from(l[i])).or(thickness);
            self.good(i).then(|| {
                [
                    steps(at(&self.view, i, base.view_deg), ANGLE_DEG),
                    steps(at(&self.incidence, i, base.incidence_deg), ANGLE_DEG),
                    depth.map_or(NO_THICKNESS, |d| ln_steps(d, LN_THICKNESS)),
                    ln_steps(f64::from(self.mu[0][i]), LN_MU),
                    ln_steps(f64::from(self.mu[1][i]), LN_MU),
                ]
            })
        };
        (0..self.mu[0].len()).map(kind).collect()
    }
}

/// The pixels of a kind: how many, and their ln mu_a and ln mu_s', added up.
#[derive(Clone, Copy, Default)]
struct OfKind {
    count: usize,
    ln_mu: [f64; 2],
}

impl OfKind {
    /// The mean of mu_a and mu_s' in the logarithm, mm^-1.
    fn mu(&self) -> [f64; 2] {
        self.ln_mu.map(|sum| libm::exp(sum / self.count as f64))
    }
}

/// In place of steps, for a half-space.
const NO_THICKNESS: i32 = i32::MAX / 8;

/// How a kind was seen.
fn middle(kind: &Kind, base: Setting) -> Setting {
    let [view, light, depth, ..] = *kind;
    let thickness = (depth != NO_THICKNESS).then(|| libm::exp(f64::from(depth) * LN_THICKNESS));
    // Steps of five degrees are too coarse for what is seen of one plane: where all pixels are of one step, its median.
    let near = |steps: i32, base: f64| {
        let middle = f64::from(steps) * ANGLE_DEG;
        if (middle - base).abs() <= 0.5 * ANGLE_DEG { base } else { middle }
    };
    let near_depth = |d: f64| match base.thickness {
        Some(base) if (libm::log(d / base)).abs() <= 0.5 * LN_THICKNESS => base,
        _ => d,
    };
    Setting {
        view_deg: near(view, base.view_deg),
        incidence_deg: near(light, base.incidence_deg),
        thickness: thickness.map(near_depth),
        ..base
    }
}

/// Measures what comes of it, and warns where it exceeds the stated error of the mean and 1 %.
fn report(
    maps: &ImageStack,
    wavelength_nm: Option<f64>,
    of_pixel: &[Option<[f64; 2]>],
    causes: &[Cause],
    ctx: Ctx<'_>,
) {
    let good = of_pixel.iter().flatten().count().max(1);
    let mut said = Vec::new();
    for (k, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
        let mut off: Vec<f64> = of_pixel.iter().flatten().map(|off| off[k]).collect();
        off.sort_by(f64::total_cmp);
        let Some(&median) = off.get(off.len() / 2) else { continue };
        let info = maps.layers.iter().map(|l| &l.info);
        let info =
            info.clone().find(|i| i.name == name && i.kind == LayerKind::Value && i.wavelength_nm == wavelength_nm);
        let layer = maps.find(name, None);
        let mean = layer.map_or(0.0, |l| l.data.iter().map(|&v| f64::from(v)).sum::<f64>() / good as f64);
        let stated = info.and_then(|i| i.mean_se).filter(|_| mean > 0.0).map(|se| se / mean);
        let least = stated.unwrap_or(0.0).max(LEAST_TOLD);
        let share = off.iter().filter(|off| off.abs() > least).count() as f64 / good as f64;
        if share > FEW {
            ctx.measure(&format!("error: {name}, conditions unlike the table's"), 100.0 * median.abs(), "%");
            let stated =
                stated.map_or_else(String::new, |s| format!(", the stated error of the mean {:.1} %", 100.0 * s));
            let (low, high) = (off[off.len() / 20], off[off.len() - 1 - off.len() / 20]);
            let range = format!("{} (90 % of them {} to {})", percent(median), percent(low), percent(high));
            said.push(format!("{name} reads {range}{stated}"));
        }
    }
    if !said.is_empty() {
        let named = causes.iter().map(|cause| match cause {
            Cause::Angles => "angles of view and light",
            Cause::Thickness => "thickness",
            Cause::Phase => "g",
            Cause::N => "n",
        });
        let named = named.collect::<Vec<_>>().join(", ");
        ctx.warn(format!(
            "the pixels were not seen as the table takes them to be ({named}): in the median {}",
            said.join("; ")
        ));
    }
}

/// Masks pixels of which mu_a or mu_s' is off by more than `most`.
fn mask(maps: &mut ImageStack, wavelength_nm: Option<f64>, of_pixel: &[Option<[f64; 2]>], most: f64, ctx: Ctx<'_>) {
    let beyond = |i: usize| of_pixel[i].is_some_and(|off| off.iter().any(|x| x.abs() > most));
    let count = (0..of_pixel.len()).filter(|&i| beyond(i)).count();
    ctx.measure("masked for conditions", 100.0 * count as f64 / of_pixel.len() as f64, "%");
    if count == 0 {
        return;
    }
    let before = maps.clone();
    for layer in maps.layers.iter_mut().filter(|l| l.info.wavelength_nm == wavelength_nm) {
        let value = if layer.info.is_pixel_mask() { MaskReason::OtherConditions.code() } else { 0.0 };
        layer.data.iter_mut().enumerate().filter(|(i, _)| beyond(*i)).for_each(|(_, v)| *v = value);
    }
    // Pixels share as much of their errors as before.
    for k in 0..maps.layers.len() {
        let info = &maps.layers[k].info;
        if info.kind != LayerKind::Value || info.mean_se.is_none() || info.wavelength_nm != wavelength_nm {
            continue;
        }
        let sharing = before.sharing(&before.layers[k].info);
        let Some(se) = maps.standard_error(info).map(Layer::pixels) else { continue };
        let mask = maps.mask(wavelength_nm).map(Layer::pixels);
        let of_mean = sharing.mean_se(&se, |i| mask.as_ref().is_none_or(|m| m[i] == 0.0));
        maps.layers[k].info.mean_se = of_mean;
    }
}
