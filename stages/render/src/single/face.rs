//! Faces of convex bodies through which light may come.

use glam::DVec3;
use turbid_optics::solid::Solid;

use super::ground::Shape;
use super::limits::MOST_FACES;

/// A face of a body through which light may come.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    pub body: usize,
    pub form: Form,
    /// Those before it that lie in its plane, by bits.
    same: u32,
}

#[derive(Clone, Copy, Debug)]
pub enum Form {
    /// Across an axis (0 is x) at a coordinate, out of the body by `up` (1 or -1), the light at a height (mm) above it.
    Flat { axis: usize, at: f32, up: f32, height: f32, within: Within },
    /// All around an ellipsoid, or an endless cylinder, of which a part is there.
    Round { shape: Shape, least: f32, low: f32, high: f32 },
}

/// What of a plane is there.
#[derive(Clone, Copy, Debug)]
pub enum Within {
    Everywhere,
    Box { low: [f32; 3], high: [f32; 3] },
    Disc { axis: [f32; 2], radius: f32 },
}

/// What bends light.
#[derive(Clone, Debug)]
pub struct Interfaces {
    pub faces: Vec<Face>,
    /// The projector, local.
    pub(super) light: [f32; 3],
    /// n of the bodies; outside it is 1.
    pub m: f32,
    /// m^2 - 1.
    pub(super) excess: f32,
    /// How far behind interfaces paths are put that start on them, mm: so little of a free path that light does not see it.
    pub behind: f64,
}

impl Face {
    /// Those before it that lie in its plane, by bits: a connection by one of them is its own.
    pub fn same(&self) -> impl Iterator<Item = usize> + use<> {
        let same = self.same;
        (0..MOST_FACES).filter(move |i| same >> i & 1 == 1)
    }
}

/// Appends the faces of a solid beyond which the light is, in the order of `Solid::crossings`.
pub fn faces_of(solid: &Solid, shape: Shape, body: usize, origin: DVec3, lamp: DVec3, faces: &mut Vec<Face>) {
    let local = |p: DVec3| (p - origin).as_vec3().to_array();
    let mut flat = |axis: usize, at: f64, up: f64, within: Within| {
        let height = (lamp[axis] - at) * up;
        let (place, up) = ((at - origin[axis]) as f32, up as f32);
        if height > 0.0 {
            let shares = |face: &Face| match face.form {
                Form::Flat { axis: a, at, up: u, .. } => a == axis && at == place && u == up,
                Form::Round { .. } => false,
            };
            let same = faces.iter().enumerate().filter(|(_, face)| shares(face)).fold(0, |bits, (i, _)| bits | 1 << i);
            let form = Form::Flat { axis, at: place, up, height: height as f32, within };
            faces.push(Face { body, form, same });
        }
    };
    match *solid {
        Solid::Slab { bottom, top } => {
            flat(2, bottom, -1.0, Within::Everywhere);
            flat(2, top, 1.0, Within::Everywhere);
        }
        Solid::Box { low, high } => {
            let within = Within::Box { low: local(low), high: local(high) };
            for axis in 0..3 {
                flat(axis, low[axis], -1.0, within);
                flat(axis, high[axis], 1.0, within);
            }
        }
        Solid::Cylinder { axis, radius, bottom, top } => {
            let axis = (axis - origin.truncate()).as_vec2().to_array();
            let within = Within::Disc { axis, radius: radius as f32 };
            flat(2, bottom, -1.0, within);
            flat(2, top, 1.0, within);
            let Shape::Cylinder { bottom, top, .. } = shape else { return };
            let endless =
                Shape::Cylinder { axis, radius: radius as f32, bottom: f32::NEG_INFINITY, top: f32::INFINITY };
            let form = Form::Round { shape: endless, least: radius as f32, low: bottom, high: top };
            faces.push(Face { body, form, same: 0 });
        }
        Solid::Ellipsoid { radii, .. } => {
            let form =
                Form::Round { shape, least: radii.min_element() as f32, low: f32::NEG_INFINITY, high: f32::INFINITY };
            faces.push(Face { body, form, same: 0 });
        }
        _ => {}
    }
}

/// The largest coordinate of interfaces that light comes to, mm.
pub fn extent(solid: &Solid, origin: DVec3) -> f64 {
    if let Solid::Slab { bottom, top } = *solid {
        return (bottom - origin.z).abs().min((top - origin.z).abs());
    }
    let (low, high) = solid.bounds();
    let far = (low - origin).abs().max((high - origin).abs()).to_array();
    far.into_iter().filter(|x| x.is_finite()).fold(0.0, f64::max)
}
