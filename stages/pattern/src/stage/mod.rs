//! The stages `pattern` and `predistort`, and what both put out.

mod pattern;
mod predistort;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, SurfaceFrequency};
use turbid_contract::{Ctx, Error, Extent, ImageStack, Known, Problems};
use turbid_geometry::Hit;

pub use pattern::{In as PatternIn, Out as PatternOut, PatternStage};
pub use predistort::{In as PredistortIn, Out as PredistortOut, Predistort};

use crate::form::{self, of_fringe};
use crate::frequency::{Reached, fringe, places, reached};
use crate::screen::{Lack, Screen};

/// CPU seconds for a value of a layer (measured).
const PER_VALUE: f64 = 2e-7;
/// Bytes for each pixel of the projector beside its layers: where its light falls, coordinates and irradiance there, and what the preview says of it.
const OF_PIXEL: u64 = 128;

/// Bytes that a run holds at the most: its layers twice, and what is known of each pixel.
fn memory(layers: Extent) -> u64 {
    2 * layers.bytes() + OF_PIXEL * layers.pixels()
}

/// Reports why a scene has no screen: at the field that is at fault, or at the port where it is the scene.
fn unfit_scene((field, what, way_out): Lack, known: &Known, problems: &mut Problems) {
    if field.is_empty() {
        problems.unfit(known, "scene", Error::failed_with_hint(what, way_out));
    } else {
        problems.push_with_hint(field, what, way_out);
    }
}

/// A plane of the screen's size.
fn plane(screen: &Screen, values: Vec<f32>) -> Array2<f32> {
    Array2::from_shape_vec((screen.rows, screen.columns), values).expect("one value per pixel")
}

/// The frequency map of a pattern.
struct Map<'a> {
    screen: &'a Screen,
    /// What the light of a pixel's centre meets, where that counts.
    hit: &'a (dyn Fn(usize) -> Option<Hit> + Sync),
    /// The most cycles over a pixel.
    most_cycles: f64,
}

/// A fringe below this amplitude is none.
const LEAST_AMPLITUDE: f64 = 1e-4;

impl Map<'_> {
    /// Of the fringes (f_x, orientation, the layers of their phases); `coordinate` as its own layer where there is one, and `finer` is
    /// where the pattern was left flat.
    fn of(
        &self,
        fringes: &[(f64, f64, Vec<&[f32]>)],
        coordinate: Option<Vec<f32>>,
        finer: &[bool],
        ctx: Ctx<'_>,
    ) -> Result<SurfaceFrequency, Error> {
        let pixels = self.screen.pixels();
        let places = places(self.screen, self.hit, ctx)?;
        let lit: Vec<bool> = places.iter().map(Option::is_some).collect();
        let mut mask: Vec<MaskReason> =
            lit.iter().map(|&lit| if lit { MaskReason::Good } else { MaskReason::Background }).collect();
        let mut found: Vec<Vec<Option<Reached>>> = Vec::new();
        for (_, _, layers) in fringes {
            let shown = fringe(layers).into_iter().enumerate().map(|(pixel, z)| {
                let strong = z.0 * z.0 + z.1 * z.1 > LEAST_AMPLITUDE * LEAST_AMPLITUDE;
                (lit[pixel] && !finer[pixel] && strong).then_some(z)
            });
            let shown: Vec<_> = shown.collect();
            let map = reached(self.screen, &places, &shown, ctx)?;
            for (mask, (reached, finer)) in mask.iter_mut().zip(map.iter().zip(finer)) {
                // Room for a pitch that was meant to be at the limit.
                let resolved = reached.is_some_and(|r| r.cycles <= self.most_cycles * (1.0 + 1e-6));
                if *mask == MaskReason::Good && !resolved {
                    let too_fine = *finer || reached.is_some();
                    *mask = if too_fine { MaskReason::BeyondProjector } else { MaskReason::LowSignal };
                }
            }
            found.push(map);
        }
        let mut stack = ImageStack::new(self.screen.rows, self.screen.columns);
        for ((f_x, orientation_deg, _), map) in fringes.iter().zip(&found) {
            let good = |value: &dyn Fn(&Reached) -> f64| {
                let pixel = |(r, m): (&Option<Reached>, &MaskReason)| match (r, m) {
                    (Some(r), MaskReason::Good) => value(r) as f32,
                    _ => 0.0,
                };
                plane(self.screen, map.iter().zip(&mask).map(pixel).collect())
            };
            let [f_surface, cycles] = of_fringe(*f_x, *orientation_deg);
            stack.push(f_surface, good(&|r| r.f_surface));
            stack.push(cycles, good(&|r| r.cycles));
            self.report(*f_x, map, &mask, ctx);
        }
        if let Some(s) = coordinate {
            stack.push(form::coordinate(), plane(self.screen, s));
        }
        let codes = mask.iter().map(|m| m.code()).collect();
        stack.push(form::mask(), plane(self.screen, codes));
        let count = |reason: MaskReason| mask.iter().filter(|&&m| m == reason).count() as f64;
        let on_surface = pixels as f64 - count(MaskReason::Background);
        if on_surface > 0.0 {
            ctx.measure("beyond the projector", 100.0 * count(MaskReason::BeyondProjector) / on_surface, "%");
        }
        Ok(SurfaceFrequency(stack))
    }

    /// Median of the frequency, and how far 95 % of the pixels are from what was asked for.
    fn report(&self, f_x: f64, map: &[Option<Reached>], mask: &[MaskReason], ctx: Ctx<'_>) {
        let good = map.iter().zip(mask).filter(|(_, m)| **m == MaskReason::Good);
        let mut f: Vec<f64> = good.filter_map(|(r, _)| r.map(|r| r.f_surface)).collect();
        if f.is_empty() {
            ctx.warn(format!("f_x = {f_x} mm^-1: no pixel of the projector shows the fringe on the surface"));
            return;
        }
        f.sort_by(f64::total_cmp);
        ctx.measure(&format!("surface frequency at f_x = {f_x}, median"), f[f.len() / 2], "mm^-1");
        let mut off: Vec<f64> = f.iter().map(|f| 100.0 * (f / f_x - 1.0).abs()).collect();
        off.sort_by(f64::total_cmp);
        ctx.measure(
            &format!("error: surface frequency at f_x = {f_x}, of 95 % of pixels"),
            off[(off.len() - 1) * 19 / 20],
            "%",
        );
    }
}
