//! Phase differences to a reference surface: subtracted as phasors, then unwrapped in space or through the spatial frequencies.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use turbid_contract::layers::{place, values, wavelengths};
use turbid_contract::payload::MaskReason;
use turbid_contract::sharing::Sharing;
use turbid_contract::{Error, ImageStack, Layer, LayerInfo};

use crate::geometry::Rig;
use crate::params::{Params, ReferenceSurface, Tube};

/// The difference in (-pi, pi].
pub fn wrap(difference: f64) -> f64 {
    let rest = difference - TAU * (difference / TAU).round();
    if rest <= -PI { rest + TAU } else { rest }
}

/// The fringes that are used: one orientation, by rising f_x.
pub struct Fringes<'a> {
    pub layers: Vec<&'a Layer>,
    pub orientation_deg: f64,
}

impl<'a> Fringes<'a> {
    /// Error: see [`choose`].
    pub fn of(stack: &'a ImageStack, params: &Params) -> Result<Self, Error> {
        let (places, orientation_deg) = choose(&stack.infos(), params)?;
        Ok(Self { layers: places.into_iter().map(|k| &stack.layers[k]).collect(), orientation_deg })
    }

    pub fn f_x(&self, k: usize) -> f64 {
        self.layers[k].info.f_x_per_mm.expect("chosen by f_x")
    }

    pub fn last(&self) -> usize {
        self.layers.len() - 1
    }
}

/// The places of the fringes to use, by rising f_x, and their orientation, degrees.
///
/// Errors: no phase, no such f_x or orientation, several orientations or wavelengths to choose from.
pub fn choose(phase: &[LayerInfo], params: &Params) -> Result<(Vec<usize>, f64), Error> {
    let f_x = |k: &usize| phase[*k].f_x_per_mm.unwrap_or(0.0);
    let orientation = |k: &usize| phase[*k].orientation_deg.unwrap_or(0.0);
    let mut places: Vec<usize> = values(phase, "phase").map(|(k, _)| k).collect();
    if wavelengths(phase, "phase").len() > 1 {
        return Err(Error::failed("the phase has several wavelengths; profilometry takes one"));
    }
    if let Some(wanted) = params.orientation_deg {
        let mut known: Vec<String> = places.iter().map(|k| orientation(k).to_string()).collect();
        known.dedup();
        places.retain(|k| orientation(k) == wanted.0);
        if places.is_empty() && !known.is_empty() {
            let message = format!("the phase has no fringes of {wanted}, only of {} deg", known.join(", "));
            return Err(Error::invalid("orientation_deg", message));
        }
    }
    let orientation_deg = places.first().map_or(0.0, orientation);
    if places.iter().any(|k| orientation(k) != orientation_deg) {
        return Err(Error::invalid("orientation_deg", "the phase has several orientations: say which one to use"));
    }
    places.sort_by(|a, b| f_x(a).total_cmp(&f_x(b)));
    if let Some(wanted) = params.f_x {
        places.retain(|k| f_x(k) <= wanted.0);
        if places.last().is_none_or(|k| f_x(k) != wanted.0) {
            return Err(Error::invalid("f_x", format!("the phase has no fringes of f_x = {wanted}")));
        }
    }
    match places.last() {
        Some(k) if f_x(k) > 0.0 => Ok((places, orientation_deg)),
        _ => Err(Error::failed_with_hint(
            "the sample has no phase of fringes (f_x > 0)",
            "connect the port `phase` of demodulate",
        )),
    }
}

/// The place of the phase of the reference with the f_x and orientation of `info`.
pub fn counterpart(reference: &[LayerInfo], info: &LayerInfo) -> Result<usize, Error> {
    let orientation = |info: &LayerInfo| info.orientation_deg.unwrap_or(0.0);
    let fits = |other: &LayerInfo| {
        other.f_x_per_mm == info.f_x_per_mm
            && orientation(other) == orientation(info)
            && other.wavelength_nm == info.wavelength_nm
    };
    let found = values(reference, "phase").find(|(_, other)| fits(other)).map(|(k, _)| k);
    found.ok_or_else(|| {
        let has: Vec<String> = values(reference, "phase").map(|(_, info)| place(info)).collect();
        let has = if has.is_empty() { "none".to_owned() } else { has.join("; ") };
        let what = format!("the sample has a phase at {}, the reference has it at {has}", place(info));
        Error::failed_with_hint(what, "project the same fringes on both")
    })
}

/// The layer of `stack` with the f_x and orientation of `info`.
pub fn same<'a>(stack: &'a ImageStack, info: &LayerInfo) -> Result<&'a Layer, Error> {
    Ok(&stack.layers[counterpart(&stack.infos(), info)?])
}

/// What each pixel's light would have as coordinate u (mm) if the surface were the reference; why there is none, where it does not see it.
pub fn reference_coordinates(rig: &Rig, surface: &ReferenceSurface) -> Vec<Result<f64, MaskReason>> {
    let on_surface = |pixel: usize| match surface {
        ReferenceSurface::Plane(height) => rig.on_plane(pixel, height.0).ok_or(MaskReason::NoHeight),
        ReferenceSurface::Tube(tube) => tube.seen(rig.ray(pixel)).ok_or(MaskReason::OutsideReference),
    };
    let coordinate = |pixel: usize| rig.coordinate(on_surface(pixel)?).ok_or(MaskReason::NoHeight);
    (0..rig.columns * rig.rows).map(coordinate).collect()
}

impl Tube {
    /// Where a ray meets the bore from inside; `None` where it passes beside the mouth, or leaves through the other end.
    pub fn seen(&self, (origin, w): (DVec3, DVec3)) -> Option<DVec3> {
        let [center_x, center_y] = self.center.map(|c| c.0);
        let (x, y, radius) = (origin.x - center_x, origin.y - center_y, 0.5 * self.inner_diameter.0);
        // |(x, y) + t (w.x, w.y)| = radius, from inside: the far root.
        let (a, b, c) = (w.x * w.x + w.y * w.y, x * w.x + y * w.y, x * x + y * y - radius * radius);
        let root = b * b - a * c;
        let t = (-b + root.sqrt()) / a;
        if !(root >= 0.0 && t > 0.0 && t.is_finite()) {
            return None;
        }
        let (top, bottom) = (self.top.0, self.top.0 - self.length.0);
        // Where the ray enters: through an end, or it starts in the bore.
        let end = if origin.z > top { top } else { origin.z.max(bottom) };
        let entry = if end == origin.z { origin } else { origin + (end - origin.z) / w.z * w };
        let enters = (entry.x - center_x).powi(2) + (entry.y - center_y).powi(2) < radius * radius;
        let r = origin + t * w;
        (enters && (bottom..=top).contains(&r.z)).then_some(r)
    }
}

/// Differences to the reference of one f_x: wrapped, NaN where masked.
pub struct Difference {
    pub delta: Vec<f64>,
    /// Standard errors, rad, where known.
    pub se: Option<Vec<f64>>,
    /// Where `se` is a lower bound of an error that is not known; `None` where it is known everywhere.
    pub se_unknown: Option<Vec<bool>>,
    /// How the errors of pixels are common.
    pub sharing: Sharing,
}

/// Sample minus reference; the reference's phase is measured (`reference`) or 2 pi f_x u.
pub fn difference(
    sample: &ImageStack,
    layer: &Layer,
    reference: Option<&ImageStack>,
    coordinates: &[Result<f64, MaskReason>],
    mask: &[MaskReason],
) -> Result<Difference, Error> {
    let f_x = layer.info.f_x_per_mm.expect("chosen by f_x");
    let phase = layer.pixels();
    let own = sample.standard_error(&layer.info).map(Layer::pixels);
    let mut flagged = vec![sample.se_unknown(&layer.info)];
    let (base, base_se, of_base) = match reference {
        Some(stack) => {
            let layer = same(stack, &layer.info)?;
            flagged.push(stack.se_unknown(&layer.info));
            (Some(layer.pixels()), stack.standard_error(&layer.info).map(Layer::pixels), stack.sharing(&layer.info))
        }
        None => (None, None, Sharing::NONE),
    };
    let flagged: Vec<_> = flagged.into_iter().flatten().map(Layer::pixels).collect();
    let se_unknown =
        (!flagged.is_empty()).then(|| (0..phase.len()).map(|i| flagged.iter().any(|f| f[i] != 0.0)).collect());
    let of = |i: usize| {
        if mask[i] != MaskReason::Good {
            return 0.0;
        }
        let from = match (&base, coordinates[i]) {
            (Some(base), _) => f64::from(base[i]),
            (None, Ok(u)) => TAU * wrap_turns(f_x * u),
            (None, Err(_)) => return 0.0,
        };
        wrap(f64::from(phase[i]) - from)
    };
    let square = |se: f32| f64::from(se) * f64::from(se);
    let of_sample = sample.sharing(&layer.info);
    let (mut se, mut factors) = (own.is_some().then(Vec::new), Vec::new());
    for (i, &own) in own.iter().flat_map(|own| own.iter().enumerate()) {
        let (own, base) = (square(own), base_se.as_ref().map_or(0.0, |b| square(b[i])));
        let sum = own + base;
        let shared = of_sample.at(i) * own + of_base.at(i) * base;
        factors.push(if sum > 0.0 { (shared / sum) as f32 } else { 1.0 });
        se.iter_mut().for_each(|se| se.push(sum.sqrt()));
    }
    let sharing = Sharing::of_pixels(factors);
    Ok(Difference { delta: (0..phase.len()).map(of).collect(), se, se_unknown, sharing })
}

/// Turns without whole ones.
fn wrap_turns(turns: f64) -> f64 {
    turns - turns.round()
}

/// Takes the whole turns of a finer difference from a coarser one that has none missing: `ratio` = f_fine / f_coarse.
pub fn refine(coarse: &[f64], fine: &mut [f64], ratio: f64) {
    for (fine, coarse) in fine.iter_mut().zip(coarse) {
        *fine += TAU * ((coarse * ratio - *fine) / TAU).round();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_wrapped_to_one_turn() {
        for (difference, want) in [(0.0, 0.0), (PI, PI), (-PI, PI), (4.0, 4.0 - TAU), (-20.0, -20.0 + 3.0 * TAU)] {
            assert!((wrap(difference) - want).abs() < 1e-14, "{difference}");
        }
    }

    /// From f to r f the turns are right while the coarse error times r stays below half a turn.
    #[test]
    fn coarse_fringes_count_the_turns_of_fine_ones() {
        for (error, right) in [(0.0, true), (0.3, true), (0.51, true), (0.54, false)] {
            let (truth, ratio) = (2.9, 6.0);
            let mut fine = [wrap(truth * ratio)];
            refine(&[truth + error], &mut fine, ratio);
            assert_eq!((fine[0] - truth * ratio).abs() < 1e-9, right, "error {error}");
        }
    }
}
