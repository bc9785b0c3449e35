//! The kernel that a render's paths are walked by, and what keeps a faster one from it.

use std::fmt;

use crate::method::Taken;
use crate::next_event_lanes::{self, bodies_by_material};
use crate::projected::Projected;
use crate::rig::Rig;
use crate::setting::{Nee, Setting};
use crate::single::refusal::Refusal;
use crate::single::{Frame, lane};
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::World;

/// How one walk goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// f32 lanes; whether next-event estimation and the starts of paths go in them.
    Single { next_events: bool, starts: bool, bodies: usize },
    /// f64 lanes; whether next-event estimation goes in them.
    Double { next_events: bool, bodies: usize },
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
        let walker = Walker::new(setting, crate::level::named("baseline"));
        let bodies = setting.world.bodies.len();
        let refusal = match Frame::held(&walker) {
            Ok(frame) => {
                let next_events = frame.blind || (frame.next_events && !frame.lamps);
                let refused = frame.refused.iter().map(Refusal::to_string).collect();
                return (Self::Single { next_events, starts: frame.starts, bodies: frame.parts.len() }, refused);
            }
            Err(refusal) => refusal.to_string(),
        };
        if !setting.world.has_one_term() {
            let also = "a phase function of two terms: f64 lanes scatter by one g".to_owned();
            return (Self::Scalar { bodies }, vec![refusal, also]);
        }
        if setting.shared.is_some() {
            return (Self::Scalar { bodies }, vec![refusal]);
        }
        let next_events = walker.body_of().is_some();
        let also = (!next_events).then(|| singly(&setting));
        (Self::Double { next_events, bodies }, [refusal].into_iter().chain(also).collect())
    }
}

/// Why next-event estimation does not go in f64 lanes.
fn singly(setting: &Setting<'_>) -> String {
    let World { bodies, materials, .. } = setting.world;
    if setting.projected_images.layers() > 0 {
        return "a pattern's images: f64 lanes connect to light under sinusoids".to_owned();
    }
    if Bending::of(setting.world) != Bending::Nowhere {
        return "walls turn light: f64 lanes connect to light where it goes straight on".to_owned();
    }
    if bodies.len() > next_event_lanes::MOST_BODIES {
        return format!(
            "{} bodies: f64 lanes make light connections among up to {}",
            bodies.len(),
            next_event_lanes::MOST_BODIES
        );
    }
    if bodies.iter().any(|body| materials[body.material].is_opaque()) {
        return "an opaque body: f64 lanes make light connections among clear and turbid ones".to_owned();
    }
    debug_assert!(bodies_by_material(setting.world).is_none());
    "a body with facets or holes, a turned one, or two of one medium: f64 lanes make light connections in whole bodies of one medium each"
        .to_owned()
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
            Self::Double { next_events, bodies } => {
                write!(f, "{} paths abreast in f64, {}", next_event_lanes::LANES, among(bodies))?;
                write!(f, "{}", if next_events { "" } else { ", light connections one by one" })
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
