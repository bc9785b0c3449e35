//! From the scene of the pipeline to the world, camera and lights that paths meet.

use glam::DVec3;
use turbid_contract::Error;
use turbid_contract::payload::{self, Profile, Scene, Specular, Surface};
use turbid_geometry::{camera_view, phase_function, projector_view, solid};
use turbid_optics::PhaseFunction;
use turbid_optics::solid::Solid;
use turbid_optics::view::Lens;

use crate::bsdf::Bsdf;
use crate::camera::Camera;
use crate::lamp::{Lamp, Steady};
use crate::light::Light;
use crate::texture::Texture;
use crate::world::{Body, Material, World};

/// The scene ready for tracing.
pub struct Rig {
    pub camera: Camera,
    /// The projector's, one per channel; dark where there is none.
    pub lights: Vec<Light>,
    /// One per channel.
    pub steady: Vec<Steady>,
    /// Whether light that was never scattered is not seen.
    pub excludes_specular: bool,
    /// One per channel; they differ in their materials only.
    pub worlds: Vec<World>,
    /// For each body, the place of its object in the scene.
    pub object_of: Vec<usize>,
}

impl Rig {
    pub fn of(scene: &Scene) -> Result<Self, Error> {
        let missing = |what: &str| Error::failed(format!("the scene has no {what} that can be used"));
        let c = scene.camera.as_ref().ok_or_else(|| missing("camera"))?;
        let camera_view = camera_view(c).map_err(|_| missing("camera"))?;
        let lights = match &scene.projector {
            None => vec![Light::none(); scene.channels()],
            Some(p) => {
                let view = projector_view(p).map_err(|_| missing("projector"))?;
                p.power.iter().map(|&power| Light::new(view, power, p.profile == Profile::Flat)).collect()
            }
        };
        let camera = Camera { view: camera_view, columns: c.pixels[0] as usize, rows: c.pixels[1] as usize };
        let mut order: Vec<usize> = (0..scene.objects.len()).collect();
        let objects: Vec<_> = scene.objects.values().collect();
        order.sort_by_key(|&i| std::cmp::Reverse(objects[i].priority));
        let solids: Vec<Solid> = order.iter().map(|&i| solid(&objects[i].shape)).collect();
        let worlds = (0..scene.channels()).map(|channel| {
            let (mut materials, mut textures) = (vec![Material::VOID], Vec::new());
            let bodies = order.iter().zip(&solids).map(|(&i, solid)| {
                let medium = objects[i].medium.as_ref().map(|m| &scene.media[m]);
                let material = match (&objects[i].surface, medium) {
                    (Surface::Lambertian(rho), _) => Material::lambertian(*rho),
                    (Surface::Textured(texture), _) => {
                        textures.push(Texture::of(texture));
                        Material { bsdf: Bsdf::Textured(textures.len() - 1), ..Material::VOID }
                    }
                    (Surface::Mirror, _) => Material { bsdf: Bsdf::Mirror, ..Material::VOID },
                    (surface @ (Surface::Smooth | Surface::Rough(_)), Some(m)) => {
                        let (mu_a, mu_s) = (m.mu_a[channel], m.mu_s[channel]);
                        // Without scattering there is no phase function; equal materials shall be one.
                        let scatters = mu_s > 0.0;
                        let phase = if scatters { phase_function(&m.phase) } else { PhaseFunction::ISOTROPIC };
                        let medium = Material::medium(mu_a, mu_s, phase, m.n);
                        match surface {
                            Surface::Rough(alpha) if m.n != 1.0 => Material { bsdf: Bsdf::Rough(*alpha), ..medium },
                            _ => medium,
                        }
                    }
                    (Surface::Smooth | Surface::Rough(_), None) => Material::VOID,
                };
                let index = materials.iter().position(|m| *m == material).unwrap_or(materials.len());
                if index == materials.len() {
                    materials.push(material);
                }
                Body { solid: solid.clone(), material: index }
            });
            let bodies = bodies.collect();
            World { bodies, materials, textures }
        });
        let steady = (0..scene.channels()).map(|channel| steady(scene, channel)).collect();
        Ok(Self {
            excludes_specular: c.specular == Some(Specular::Exclude),
            camera,
            lights,
            steady,
            worlds: worlds.collect(),
            object_of: order,
        })
    }

    /// What tells the channels apart.
    pub fn channels(&self) -> Channels<'_> {
        Channels { worlds: &self.worlds, lights: &self.lights, steady: &self.steady }
    }
}

impl Rig {
    /// Whether there is a light at a place or in a direction.
    pub fn shines(&self) -> bool {
        self.lights[0].shines() || !self.steady[0].lamps.is_empty()
    }

    /// Whether the camera's rays are parallel, and those of a light.
    pub fn is_parallel(&self) -> bool {
        let beam = |steady: &Steady| steady.lamps.iter().any(|lamp| matches!(lamp, Lamp::Beam { .. }));
        self.camera.view.lens == Lens::Orthographic && self.steady.iter().any(beam)
    }
}

fn steady(scene: &Scene, channel: usize) -> Steady {
    let mut steady = Steady::default();
    for lamp in scene.lights.values() {
        match lamp {
            payload::Lamp::Point { position, power } => {
                steady.lamps.push(Lamp::point((*position).into(), power[channel]));
            }
            payload::Lamp::Spot { position, look_at, angle_deg, power } => {
                let (from, to) = (DVec3::from(*position), DVec3::from(*look_at));
                steady.lamps.push(Lamp::spot(from, (to - from).normalize(), *angle_deg, power[channel]));
            }
            payload::Lamp::Collimated { position, look_at, diameter, power } => {
                let (from, to) = (DVec3::from(*position), DVec3::from(*look_at));
                steady.lamps.push(Lamp::beam(from, (to - from).normalize(), *diameter, power[channel]));
            }
            payload::Lamp::Ambient { radiance } => steady.ambient += radiance[channel],
        }
    }
    steady
}

/// What channels see: one entry each. Their worlds have the same bodies, and lights stand at the same places.
#[derive(Clone, Copy)]
pub struct Channels<'a> {
    pub worlds: &'a [World],
    pub lights: &'a [Light],
    pub steady: &'a [Steady],
}
