//! The kernel that a render's paths are walked by, and what keeps a faster one from it.

use std::fmt;

use crate::image_part::{ImagePart, parts_along};
use crate::level::named;
use crate::method::Taken;
use crate::projected::Projected;
use crate::rig::Rig;
use crate::setting::{Nee, Setting};
use crate::single::limits::range;
use crate::single::refusal::Refusal;
use crate::single::{Frame, lane};
use crate::walker::Walker;

/// How one walk goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// f32 lanes; whether next-event estimation and the starts of paths go in them.
    Single { next_events: bool, starts: bool, bodies: usize },
    /// One path after the other.
    Scalar { bodies: usize },
}

/// What a render does its work by.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Kernels {
    /// In words.
    pub name: String,
    /// Why not by a faster one, each with the value and the limit.
    pub refused: Vec<String>,
}

impl Kernel {
    /// Of paths in a setting, as [`walk_among`](crate::packet::walk_among) takes it.
    fn of(setting: Setting<'_>) -> (Self, Vec<String>) {
        let (mut walker, along) =
            (Walker::new(setting, named("baseline")), parts_along(&setting, range(setting.world)));
        // All parts are alike but for how they are seen, so the middle and the corners stand for them.
        let (middle, last) = (along / 2, along - 1);
        let parts = [[middle; 2], [0; 2], [last, 0], [0, last], [last; 2]];
        let held = parts.iter().take(if along == 1 { 1 } else { parts.len() }).map(|&at| {
            walker.image_part = ImagePart::of(along, at);
            Frame::held(&walker)
        });
        match held.collect::<Result<Vec<_>, _>>() {
            Ok(frames) => {
                let frame = &frames[0];
                let next_events = frame.blind || (frame.next_events && !frame.lamps);
                let refused = frame.refused.iter().map(Refusal::to_string).collect();
                (Self::Single { next_events, starts: frame.starts, bodies: frame.parts.len() }, refused)
            }
            Err(refusal) => (Self::Scalar { bodies: setting.world.bodies.len() }, vec![refusal.to_string()]),
        }
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let among = |n: usize| if n == 1 { "1 body".to_owned() } else { format!("{n} bodies") };
        match *self {
            Self::Single { next_events, starts, bodies } => {
                write!(f, "{} paths abreast in f32, {}", lane::LANES, among(bodies))?;
                write!(f, "{}", if next_events { "" } else { ", light connections one by one" })?;
                write!(f, "{}", if starts { "" } else { ", starts one by one" })
            }
            Self::Scalar { bodies } => write!(f, "one path after the other in f64, {}", among(bodies)),
        }
    }
}

impl Kernels {
    /// Those of all walks of a render; `power`: photons are counted, too.
    pub fn of(taken: &Taken, rig: &Rig, projected: &Projected, power: bool) -> Self {
        let mut names: Vec<String> = Vec::new();
        let mut refused: Vec<String> = Vec::new();
        let add = |list: &mut Vec<String>, text: String| {
            if !list.contains(&text) {
                list.push(text);
            }
        };
        if matches!(taken, Taken::Rte { .. }) {
            names.push("transport solver for plane waves".to_owned());
        } else {
            for group in crate::channels::groups(rig, &projected.carriers, &projected.projected_images) {
                let channel = group.channels[0];
                let (kernel, reasons) = Kernel::of(Setting {
                    world: &group.world,
                    camera: &rig.camera,
                    light: &rig.lights[channel],
                    steady: &rig.steady[channel],
                    carriers: &projected.carriers,
                    projected_images: &projected.projected_images,
                    key: [0; 2],
                    channel: 0,
                    nee: Nee::Line,
                    shared: group.shared.as_ref(),
                });
                add(&mut names, kernel.to_string());
                reasons.into_iter().for_each(|reason| add(&mut refused, reason));
            }
        }
        if power {
            names.push("photons for `power` one after the other in f64".to_owned());
        }
        Self { name: names.join("; "), refused }
    }
}
