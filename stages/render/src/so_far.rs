//! What a render has so far, as frames for a picture: means alone, few pixels, so that it costs little.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Scene;
use turbid_contract::serde_json::json;
use turbid_contract::{Artifact, ImageStack};

use crate::field::Field;
use crate::fit::{Fitted, Lattice};
use crate::frames::frame_layer;
use crate::projected::Projected;
use crate::rig::Rig;
use crate::state::State;

/// Longer side of the frames: what a preview shows of an image. Means over squares of pixels where the image has more.
const SIDE: usize = 320;

/// Paths per pixel after which it is worth a look: whenever their batches have doubled.
pub fn is_due(before: u32, now: u32, batch: u32) -> bool {
    (now / batch).checked_ilog2() > (before / batch).checked_ilog2()
}

/// What frames are made from.
#[derive(Clone, Copy)]
pub struct SoFar<'a> {
    pub scene: &'a Scene,
    pub rig: &'a Rig,
    pub projected: &'a Projected,
}

impl SoFar<'_> {
    /// Every pixel by its own paths. What is added at the end is not there yet: control variates, and lamp reflections that no path finds.
    pub fn of_pixels(&self, state: &State, paths: &[u32]) -> Artifact {
        self.frames(&|channel, pixel, i| {
            let more = state.more.as_ref().map_or(0.0, |more| more.channels[channel].mean(pixel, i, paths[pixel]));
            state.channels[channel].mean(pixel, i, paths[pixel]) + more
        })
    }

    /// The surface fitted to what the lattice has; `None` where there is none.
    pub fn of_fit(&self, state: &State, lattice: &Lattice) -> Option<Artifact> {
        let fitted = |channel| {
            let moments = &state.channels[channel];
            Fitted::new(self.rig, &self.projected.carriers, lattice, moments, state.samples)
        };
        let channels: Vec<Fitted> = (0..self.rig.worlds.len()).map(fitted).collect::<Option<_>>()?;
        Some(self.frames(&|channel, pixel, i| channels[channel].mean(pixel, i)))
    }

    /// `mean`: of a channel and a pixel response i.
    fn frames(&self, mean: &dyn Fn(usize, usize, usize) -> f64) -> Artifact {
        let (rows, columns) = (self.rig.camera.rows, self.rig.camera.columns);
        let step = rows.max(columns).div_ceil(SIDE);
        let projected = [rows.div_ceil(step), columns.div_ceil(step)];
        let mut stack = ImageStack::new(projected[0], projected[1]);
        for channel in 0..self.rig.worlds.len() {
            let wavelength_nm = self.scene.wavelengths_nm.get(channel).copied();
            for (info, terms) in &self.projected.frames {
                let pixel = |pixel: usize| terms.iter().map(|&(i, w)| w * mean(channel, pixel, i)).sum::<f64>();
                let data = Array2::from_shape_fn((projected[0], projected[1]), |(row, column)| {
                    let (mut sum, mut count) = (0.0, 0.0);
                    for r in row * step..rows.min((row + 1) * step) {
                        for c in column * step..columns.min((column + 1) * step) {
                            (sum, count) = (sum + pixel(r * columns + c), count + 1.0);
                        }
                    }
                    (sum / count) as f32
                });
                stack.push(frame_layer(info, wavelength_nm), data);
            }
        }
        if let Some(camera) = &self.scene.camera {
            let (name, pitch) = camera.pixel_pitch();
            stack.attributes.insert(name.to_owned(), json!(pitch.map(|pitch| pitch * step as f64)));
        }
        Artifact::Images(stack)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_doubling_is_worth_a_look() {
        let due = |steps: &[u32]| -> Vec<u32> {
            steps.windows(2).filter(|pair| is_due(pair[0], pair[1], 8)).map(|pair| pair[1]).collect()
        };
        assert_eq!(due(&[0, 4, 8, 16, 24, 32, 40, 56, 64, 120, 128]), [8, 16, 32, 64, 128]);
        assert_eq!(due(&[0, 40, 48, 80, 400]), [40, 80, 400], "rounds may pass several at once");
    }
}
