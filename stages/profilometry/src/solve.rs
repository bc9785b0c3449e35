//! From unwrapped phase differences to heights, by each of the methods.

use std::f64::consts::TAU;

use turbid_contract::payload::MaskReason;

use crate::formula::{Formula, of_shift};
use crate::geometry::Rig;

/// A height (world z, mm) and its derivative by the phase difference, mm / rad; or why there is none.
pub type Height = Result<(f64, f64), MaskReason>;

/// Smallest sine of the angle between camera ray and projector plane: below it a coordinate fixes no place.
const LEAST_SINE: f64 = 0.02;

/// Rays against planes: any geometry.
pub fn triangulate(rig: &Rig, pixel: usize, f_x: f64, reference: Option<f64>, delta: f64) -> Height {
    let u = reference.ok_or(MaskReason::NoHeight)? + delta / (TAU * f_x);
    let place = rig.triangulate(pixel, u).ok_or(MaskReason::NoHeight)?;
    if place.sine < LEAST_SINE {
        return Err(MaskReason::NoHeight);
    }
    Ok((place.r.z, place.dz_du / (TAU * f_x)))
}

/// The formula, over a plane at world z = `plane`.
pub fn by_formula(formula: &Formula, plane: f64, delta: f64) -> Height {
    let (h, slope) = formula.height(delta).ok_or(MaskReason::NoHeight)?;
    Ok((plane + h, slope))
}

/// One line of pixels along the fringes' direction: where it lies on the reference plane, and its phase there without jumps.
pub struct Line {
    /// (position along the direction, mm; phase, rad), by rising position.
    samples: Vec<(f64, f64)>,
}

impl Line {
    /// `None` where fewer than two pixels are known or the phase does not rise everywhere: then it is no ruler.
    pub fn new(positions: &[Option<f64>], wrapped: &[Option<f64>]) -> Option<Self> {
        let mut samples: Vec<(f64, f64)> =
            positions.iter().zip(wrapped).filter_map(|(&b, &phase)| Some((b?, phase?))).collect();
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        for k in 1..samples.len() {
            samples[k].1 = samples[k - 1].1 + crate::phase::wrap(samples[k].1 - samples[k - 1].1);
        }
        let rises = samples.windows(2).all(|w| w[1].1 > w[0].1 && w[1].0 > w[0].0);
        (samples.len() > 1 && rises).then_some(Self { samples })
    }

    /// The phase at a position that is one of the samples.
    fn phase(&self, b: f64) -> Option<f64> {
        let k = self.samples.partition_point(|s| s.0 < b);
        self.samples.get(k).filter(|s| s.0 == b).map(|s| s.1)
    }

    /// Where the line has this phase, and d position / d phase; `None` beyond its ends.
    fn position(&self, phase: f64) -> Option<(f64, f64)> {
        let k = self.samples.partition_point(|s| s.1 <= phase).min(self.samples.len() - 1);
        let ((b0, p0), (b1, p1)) = (*self.samples.get(k.checked_sub(1)?)?, self.samples[k]);
        if phase > p1 {
            return None;
        }
        let slope = (b1 - b0) / (p1 - p0);
        Some((b0 + slope * (phase - p0), slope))
    }

    /// Height over the plane of a pixel at position `b` whose phase is `delta` ahead of the reference there.
    pub fn height(&self, rig: &Rig, plane: f64, b: Option<f64>, delta: f64) -> Height {
        let b = b.ok_or(MaskReason::NoHeight)?;
        let own = self.phase(b).ok_or(MaskReason::LowReference)?;
        let (a, slope) = self.position(own + delta).ok_or(MaskReason::OutsideReference)?;
        let pupil = |p: glam::DVec3| [p.dot(rig.along), p.z - plane];
        let (camera, projector) = (pupil(rig.camera.position), pupil(rig.projector.position));
        let (h, by_a) = of_shift(b, a, camera, projector).ok_or(MaskReason::NoHeight)?;
        Ok((plane + h, by_a * slope))
    }
}
