//! Channels that share paths: where only absorption differs between them, one walk serves all.
//!
//! A path is walked with the least absorption that any of them has in each medium, and what it brings to a channel is weighed by
//! exp(-(mu_a of the channel - mu_a walked) x length), the lengths summed over the media. No weight is above 1, and each is the
//! mean over the deaths that the channel's own absorption would have dealt.

use crate::lamp::Lamp;
use crate::lengths::{ChannelScale, MOST_LENGTHS, Shared};
use crate::light::{Carrier, Emission, Light};
use crate::projected_images::ProjectedImages;
pub use crate::rig::Channels;
use crate::rig::Rig;
use crate::setting::{Nee, Setting};
use crate::single::Frame;
use crate::single::limits::MOST_CHANNELS;
use crate::walker::Walker;
use crate::world::{Body, Material, World};

/// Channels that are walked together.
#[derive(Clone, Debug)]
pub struct Group {
    /// Their places in the scene, ascending. The first says which random numbers are drawn.
    pub channels: Vec<usize>,
    pub world: World,
    /// `None` for one channel alone.
    pub shared: Option<Shared>,
}

impl Group {
    /// One walk for some channels that differ in absorption alone.
    pub fn of(all: Channels<'_>, channels: Vec<usize>) -> Self {
        let [first, others @ ..] = &channels[..] else { panic!("a group has a channel") };
        if others.is_empty() {
            return Self { world: all.worlds[*first].clone(), channels, shared: None };
        }
        let (world, mu_a) = merged(all.worlds, &channels);
        let mut counted = vec![MOST_LENGTHS; world.materials.len()];
        let tracked: Vec<usize> = (0..counted.len()).filter(|&m| varies(&mu_a[m])).collect();
        assert!(tracked.len() <= MOST_LENGTHS, "{} media differ between channels", tracked.len());
        tracked.iter().enumerate().for_each(|(place, &m)| counted[m] = place);
        let scale = |(place, &channel): (usize, &usize)| {
            let mut excess = [0.0; MOST_LENGTHS];
            excess.iter_mut().zip(&tracked).for_each(|(x, &m)| *x = mu_a[m][place] - world.materials[m].mu_a);
            let (light, steady) = (&all.lights[channel], &all.steady[channel]);
            ChannelScale {
                excess,
                projector: ratio(strength(light), strength(&all.lights[*first])),
                lamps: steady
                    .lamps
                    .iter()
                    .zip(&all.steady[*first].lamps)
                    .map(|(a, b)| ratio(lamp(a), lamp(b)))
                    .collect(),
                ambient: ratio(steady.ambient, all.steady[*first].ambient),
            }
        };
        let shared = Shared { counted, channels: channels.iter().enumerate().map(scale).collect() };
        Self { channels, world, shared: Some(shared) }
    }
}

/// The channels of a rig in groups that share paths, as far as f32 lanes hold them.
pub fn groups(rig: &Rig, carriers: &[Carrier], projected_images: &ProjectedImages) -> Vec<Group> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for channel in 0..rig.worlds.len() {
        match groups.iter_mut().find(|group| alike(&rig.worlds, group, channel)) {
            Some(group) if group.len() < MOST_CHANNELS => group.push(channel),
            _ => groups.push(vec![channel]),
        }
    }
    let in_lanes = |group: &Group| {
        let setting = Setting {
            world: &group.world,
            camera: &rig.camera,
            light: &rig.lights[group.channels[0]],
            steady: &rig.steady[group.channels[0]],
            carriers,
            projected_images,
            key: [0; 2],
            channel: 0,
            nee: Nee::Line,
            shared: group.shared.as_ref(),
        };
        Frame::held(&Walker::new(setting, crate::level::named("baseline"))).is_ok()
    };
    let joined = groups.into_iter().map(|channels| Group::of(rig.channels(), channels));
    let apart = |group: Group| -> Vec<Group> {
        if group.channels.len() == 1 || in_lanes(&group) {
            vec![group]
        } else {
            group.channels.into_iter().map(|channel| Group::of(rig.channels(), vec![channel])).collect()
        }
    };
    joined.flat_map(apart).collect()
}

/// Whether a channel can be walked with a group: all but absorption is the same, and few media differ in that.
fn alike(worlds: &[World], group: &[usize], channel: usize) -> bool {
    let scattering = |m: &Material| Material { mu_a: 0.0, ..*m };
    let (one, other) = (&worlds[group[0]], &worlds[channel]);
    let same = one
        .bodies
        .iter()
        .zip(&other.bodies)
        .all(|(a, b)| scattering(&one.materials[a.material]) == scattering(&other.materials[b.material]));
    same && {
        let channels: Vec<usize> = group.iter().copied().chain([channel]).collect();
        merged(worlds, &channels).1.iter().filter(|mu_a| varies(mu_a)).count() <= MOST_LENGTHS
    }
}

/// The world with the least absorption of these channels, and for each of its materials the absorption in every channel. Materials
/// that are one in some channels only stay apart.
fn merged(worlds: &[World], channels: &[usize]) -> (World, Vec<Vec<f64>>) {
    let first = &worlds[channels[0]];
    // Places in the lists of materials of all channels; void is void in all of them.
    let mut known = vec![vec![0; channels.len()]];
    let bodies = first.bodies.iter().enumerate().map(|(i, body)| {
        let places: Vec<usize> = channels.iter().map(|&c| worlds[c].bodies[i].material).collect();
        let material = known.iter().position(|k| *k == places).unwrap_or(known.len());
        if material == known.len() {
            known.push(places);
        }
        Body { solid: body.solid.clone(), material }
    });
    let bodies: Vec<Body> = bodies.collect();
    let mu_a: Vec<Vec<f64>> = known
        .iter()
        .map(|places| places.iter().zip(channels).map(|(&m, &c)| worlds[c].materials[m].mu_a).collect())
        .collect();
    let materials = known.iter().zip(&mu_a).map(|(places, mu_a)| Material {
        mu_a: mu_a.iter().copied().fold(f64::INFINITY, f64::min),
        ..first.materials[places[0]]
    });
    (World { bodies, materials: materials.collect(), textures: first.textures.clone() }, mu_a)
}

fn varies(values: &[f64]) -> bool {
    values.iter().any(|&v| v != values[0])
}

/// Equal powers, and lights that do not shine, have the ratio 1.
fn ratio(a: f64, b: f64) -> f64 {
    if a == b { 1.0 } else { a / b }
}

fn strength(light: &Light) -> f64 {
    match light.emission {
        Emission::Intensity(x) | Emission::Irradiance(x) => x,
    }
}

fn lamp(lamp: &Lamp) -> f64 {
    match *lamp {
        Lamp::Point { intensity, .. } | Lamp::Spot { intensity, .. } => intensity,
        Lamp::Beam { irradiance, .. } => irradiance,
    }
}
