//! Camera and projector as views.

use glam::DVec3;
use turbid_contract::payload::{Camera, Projection, Projector};
use turbid_optics::view::{Lens, View, ViewError};

/// The view of a camera.
///
/// Error: it is none; a checked scene holds no such camera.
pub fn camera_view(c: &Camera) -> Result<View, ViewError> {
    let [position, look_at, up] = [c.position, c.look_at, c.up].map(DVec3::from);
    if c.projection == Projection::Fisheye {
        return View::fisheye(position, look_at, up, c.field.into());
    }
    let mut view = View::new(position, look_at, up, c.field.into())?;
    if c.projection == Projection::Orthographic {
        view.lens = Lens::Orthographic;
    }
    if let Some(a) = c.aperture {
        view.lens = Lens::Thin { radius: 0.5 * a.diameter, focus: a.focus };
    }
    c.distortion.map_or(Ok(view), |d| view.distorted(d.coefficients()))
}

/// The view of a projector.
///
/// Error: it is none; a checked scene holds no such projector.
pub fn projector_view(p: &Projector) -> Result<View, ViewError> {
    let view = View::new(p.position.into(), p.look_at.into(), p.up.into(), p.field.into())?;
    p.distortion.map_or(Ok(view), |d| view.distorted(d.coefficients()))
}
