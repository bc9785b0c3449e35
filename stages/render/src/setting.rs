//! What a path is, and what stays the same over the paths of one channel.

use glam::DVec3;

use crate::camera::Camera;
use crate::lamp::Steady;
use crate::lengths::{Lengths, Shared};
use crate::light::{Carrier, Light};
use crate::projected_images::ProjectedImages;
use crate::random::before;
use crate::response::Layout;
use crate::world::{SurfacePoint, World};

/// How scatterings are connected to the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nee {
    /// At the scattering itself. The reference that the others are tested against.
    Point,
    /// One scattering ahead: a point on a line along the path's own next direction or along one drawn around the light,
    /// one sample of the two, weighted by the balance heuristic. Takes the Henyey-Greenstein peak out of the variance.
    Line,
}

/// Everything that stays the same over the paths of one channel.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    pub world: &'a World,
    pub camera: &'a Camera,
    pub light: &'a Light,
    pub steady: &'a Steady,
    /// Those with f_x > 0.
    pub carriers: &'a [Carrier],
    pub projected_images: &'a ProjectedImages,
    pub key: [u32; 2],
    pub channel: u32,
    pub nee: Nee,
    /// Where several channels share the paths, what tells them apart.
    pub shared: Option<&'a Shared>,
}

impl Setting<'_> {
    pub fn layout(&self) -> Layout {
        Layout {
            carriers: self.carriers.len(),
            projected_images: self.projected_images.layers(),
            steady: self.steady.shines(),
        }
    }

    /// How many channels see what a path brings.
    pub fn channels(&self) -> usize {
        self.shared.map_or(1, |shared| shared.channels.len())
    }
}

/// A path between two flights.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub r: DVec3,
    /// Direction of flight.
    pub w: DVec3,
    pub material: usize,
    pub surface_point: Option<SurfacePoint>,
    /// No boundary is nearer than this.
    pub clear: f64,
    /// Optical depth of absorption that is left until the path ends.
    pub absorption_depth: f64,
    /// What the path stands for, after the roulettes it survived.
    pub weight: f64,
    pub pixel: u32,
    pub sample: u32,
    /// Number of the next flight, by which its random numbers are known (`random.rs`).
    pub number: u64,
    /// Whether the next flight has been scored ahead, up to its first boundary (beyond it is when it gets there) ...
    pub ahead: bool,
    /// ... or wholly: where nothing has scattered it yet.
    pub wholly: bool,
    /// Whether it has been scattered, by a medium or diffusely.
    pub scattered: bool,
    /// Whether smooth or rough interfaces have turned it, and nothing has scattered it.
    pub specular: bool,
    /// MIS weight of the light that the next flight's end sees, against that of a light-directed branch.
    pub mis_weight: f64,
    /// Whether it is a light-directed branch: it ends where its flight does.
    pub light_branch: bool,
    /// Which of the walker's responses is its own.
    pub response: usize,
    /// How far it has come in each medium that tells channels apart.
    pub lengths: Lengths,
}

impl Place {
    /// Number of the flight that has come here; 0 at the camera.
    pub(crate) fn flight(&self) -> u64 {
        before(self.number, self.light_branch)
    }
}
