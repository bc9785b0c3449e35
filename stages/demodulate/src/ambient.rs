//! Light that does not follow the phases of frames at f_x = 0: black level and room light.
//!
//! Frame n is A + M_DC cos(d_n + turn) + M_DC, so that three phases or more part the ambient light A from M_DC. The turn is common to all pixels (even
//! light has no fringe): that of the frames' sum, which no noise of a pixel moves.

use turbid_contract::ndarray::Array2;
use turbid_contract::{Ctx, ImageStack, Layer, LayerInfo};

use crate::given::Noise;
use crate::phase_shift::Weights;
use crate::set::{Channel, Fringe};

/// A turn beyond this many degrees is told: the phases are not what the frames say.
const LARGE_TURN_DEG: f64 = 5.0;

/// Amplitude of even light in steps over its mean, below which it takes none: a projector without a black (contrast 10 : 1) in a room as bright as
/// itself has some 0.4.
const LEAST_AMPLITUDE: f64 = 0.05;

impl Channel {
    /// Turns the weights at f_x = 0 into the direction that the frames have, and says how far that is from the phases that they say.
    pub fn turn_even_light(&mut self, stack: &ImageStack, ctx: Ctx<'_>) {
        let mask = stack.mask(self.wavelength_nm).map(Layer::pixels);
        let light = crate::doubts::light(self.wavelength_nm);
        let Some(fringe) = self.fringes.iter_mut().find(|fringe| fringe.ambient.is_some()) else { return };
        let infos = fringe.frames.iter().map(|&i| &stack.layers[i].info);
        let phases: Vec<f64> = infos.map(|info| info.phase_rad.expect("weights were made of them")).collect();
        let sum = |&i: &usize| -> f64 {
            let pixels = stack.layers[i].pixels();
            let good = pixels.iter().enumerate().filter(|(i, _)| mask.as_ref().is_none_or(|mask| mask[*i] == 0.0));
            good.map(|(_, &value)| f64::from(value)).filter(|value| value.is_finite()).sum()
        };
        let sums: Vec<f64> = fringe.frames.iter().map(sum).collect();
        let parts = [0.0, 0.25 * std::f64::consts::TAU].map(|turn| {
            let (weights, _) = Weights::amplitude(&phases, turn).expect("weights were made of these phases");
            weights.weights[0].iter().zip(&sums).map(|(weight, sum)| weight * sum).sum::<f64>()
        });
        let turn = libm::atan2(parts[1], parts[0]);
        let (amplitude, mean) = (libm::hypot(parts[0], parts[1]), sums.iter().sum::<f64>() / sums.len() as f64);
        if mean > 0.0 && amplitude < LEAST_AMPLITUDE * mean {
            ctx.warn(format!(
                "the {} frames at f_x = 0{light} follow the phases that they say by {:.2} % of their mean: where the projector shows the same light each time leave the phases out, and the frames are averaged",
                phases.len(),
                100.0 * amplitude / mean
            ));
        }
        let (weights, ambient) = Weights::amplitude(&phases, turn).expect("weights were made of these phases");
        (fringe.weights, fringe.ambient) = (weights, Some(ambient));
        ctx.measure("even_light_turn", turn.to_degrees(), "deg");
        if turn.abs().to_degrees() > LARGE_TURN_DEG {
            ctx.warn(format!(
                "the frames at f_x = 0{light} follow the phases that they say at {:.0} deg beside them: another first phase, or steps in another order; M_DC is their amplitude all the same",
                turn.to_degrees()
            ));
        }
    }
}

/// The ambient light of a channel with its standard error where the frames know theirs; 0 where the mask is set. `None` without phases at f_x = 0.
pub fn of_channel(
    channel: &Channel,
    stack: &ImageStack,
    noise: Option<&Noise<'_>>,
    mask: &Array2<f32>,
    ctx: Ctx<'_>,
) -> Option<(Array2<f32>, Option<Array2<f32>>)> {
    let (fringe, weights) = even(channel)?;
    let planes: Vec<_> = fringe.frames.iter().map(|&i| stack.layers[i].pixels()).collect();
    let mut light = Array2::zeros(mask.dim());
    for (i, (light, mask)) in light.iter_mut().zip(mask).enumerate() {
        if *mask == 0.0 {
            *light = planes.iter().zip(weights).map(|(plane, weight)| weight * f64::from(plane[i])).sum::<f64>() as f32;
        }
    }
    let errors: Option<Vec<_>> = match noise {
        Some(Noise::Frames { se }) => fringe.frames.iter().map(|&k| se[k].as_deref()).collect(),
        _ => None,
    };
    let errors = errors.map(|se| {
        let mut errors = Array2::zeros(mask.dim());
        for (i, (error, mask)) in errors.iter_mut().zip(mask).enumerate() {
            if *mask == 0.0 {
                let terms = se.iter().zip(weights).map(|(se, weight)| (weight * f64::from(se[i])).powi(2));
                *error = terms.sum::<f64>().sqrt() as f32;
            }
        }
        errors
    });
    let good = mask.iter().filter(|mask| **mask == 0.0).count();
    if good > 0 {
        let unit = &stack.layers[fringe.frames[0]].info.unit;
        ctx.measure("ambient", light.iter().map(|&v| f64::from(v)).sum::<f64>() / good as f64, unit);
    }
    Some((light, errors))
}

/// What the layer of ambient light is, where there is one.
pub fn info(channel: &Channel) -> Option<LayerInfo> {
    even(channel).map(|_| {
        let mut info = LayerInfo::value("ambient", &channel.unit).with_f_x(0.0);
        info.wavelength_nm = channel.wavelength_nm;
        info
    })
}

fn even(channel: &Channel) -> Option<(&Fringe, &Vec<f64>)> {
    channel.fringes.iter().find_map(|fringe| Some((fringe, fringe.ambient.as_ref()?)))
}
