//! Camera and projector.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use turbid_contract::Problems;
use turbid_contract::payload::{Aperture, Camera, Distortion, Projection, Projector};
use turbid_geometry::{camera_view, projector_view};
use turbid_optics::view::{View, ViewError};

use crate::assemble::channels::Channels;
use crate::assemble::plain;
use crate::params::{CameraParams, DistortionParams, ProjectorParams};

/// The largest image that a scene may ask for, pixels.
const MOST_PIXELS: u64 = 1 << 28;

pub fn camera(c: &CameraParams, problems: &mut Problems) -> Camera {
    check_field("camera", plain(c.field), problems);
    check_pixels("camera", c.pixels, problems);
    let pinhole = c.projection == Projection::Pinhole;
    for (given, field) in [(c.distortion.is_some(), "distortion"), (c.aperture.is_some(), "aperture")] {
        if given && !pinhole {
            problems.push_with_hint(
                format!("camera.{field}"),
                format!("{field} is that of a pinhole camera, not of this projection"),
                "leave it out, or write `projection: pinhole`",
            );
        }
    }
    if let (Some(focus), None) = (c.focus, c.aperture) {
        problems.push_with_hint(
            "camera.focus",
            format!("focus = {focus} mm, but through a pinhole everything is sharp"),
            "give the lens an `aperture` (its diameter), or leave `focus` out",
        );
    }
    let aperture = c.aperture.map(|diameter| {
        let distance = (DVec3::from(plain(c.look_at)) - DVec3::from(plain(c.position))).length();
        let aperture = Aperture { diameter: diameter.0, focus: c.focus.map_or(distance, |f| f.0) };
        problems.require(aperture.diameter > 0.0, "camera.aperture", aperture.diameter, "mm", "be > 0");
        problems.require(aperture.focus > 0.0, "camera.focus", aperture.focus, "mm", "be > 0");
        aperture
    });
    let camera = Camera {
        position: plain(c.position),
        look_at: plain(c.look_at),
        up: c.up,
        field: plain(c.field),
        pixels: c.pixels,
        specular: c.specular,
        projection: c.projection,
        distortion: distortion("camera", c.distortion, problems),
        aperture,
    };
    if camera.projection == Projection::Fisheye {
        let distance = (DVec3::from(camera.look_at) - DVec3::from(camera.position)).length();
        let corner = 0.5 * DVec2::from(camera.field).length() / distance;
        let rule = "be <= pi rad: half the diagonal of the field over the distance of look_at";
        problems.require(corner <= PI || distance == 0.0, "camera.field", corner, "rad", rule);
    }
    check_view("camera", camera_view(&camera), camera.look_at, camera.up, problems);
    camera
}

pub fn projector(p: &ProjectorParams, channels: Channels, problems: &mut Problems) -> Projector {
    check_field("projector", plain(p.field), problems);
    let power = channels.values(
        "projector.power",
        &p.power,
        |v| v.0,
        problems,
        |path, v, problems| {
            problems.require(v > 0.0, path, v, "W", "be > 0");
        },
    );
    if let Some(pixels) = p.pixels {
        check_pixels("projector", pixels, problems);
    }
    let projector = Projector {
        position: plain(p.position),
        look_at: plain(p.look_at),
        up: p.up,
        field: plain(p.field),
        power,
        profile: p.profile,
        pixels: p.pixels,
        distortion: distortion("projector", p.distortion, problems),
    };
    check_view("projector", projector_view(&projector), projector.look_at, projector.up, problems);
    projector
}

/// The coefficients; all zero is no distortion, and the same record.
fn distortion(who: &str, given: Option<DistortionParams>, problems: &mut Problems) -> Option<Distortion> {
    let DistortionParams { k1, k2, p1, p2, k3 } = given?;
    for (name, value) in [("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)] {
        problems.require(value.is_finite(), format!("{who}.distortion.{name}"), value, "", "be finite");
    }
    let distortion = Distortion { k1, k2, p1, p2, k3 };
    (distortion != Distortion::default()).then_some(distortion)
}

fn check_field(who: &str, field: [f64; 2], problems: &mut Problems) {
    for (i, &f) in field.iter().enumerate() {
        problems.require(f > 0.0, format!("{who}.field.{i}"), f, "mm", "be > 0");
    }
}

fn check_pixels(who: &str, pixels: [u32; 2], problems: &mut Problems) {
    for (i, &n) in pixels.iter().enumerate() {
        problems.require(
            n > 0,
            format!("{who}.pixels.{i}"),
            f64::from(n),
            "",
            "be >= 1: the image would have no pixel",
        );
    }
    let total = u64::from(pixels[0]) * u64::from(pixels[1]);
    if total > MOST_PIXELS {
        problems.push(format!("{who}.pixels"), format!("{total} pixels are more than {MOST_PIXELS}"));
    }
}

fn check_view(who: &str, view: Result<View, ViewError>, look_at: [f64; 3], up: [f64; 3], problems: &mut Problems) {
    match view {
        Ok(_) => {}
        Err(ViewError::NoDirection) => problems.push_with_hint(
            format!("{who}.look_at"),
            format!("look_at = {look_at:?} mm is the {who}'s own position"),
            "move one of them",
        ),
        Err(ViewError::AlongUp) => problems.push_with_hint(
            format!("{who}.up"),
            format!("the {who} looks along its up vector {up:?}, so that its image has no upper side"),
            "choose an `up` across the line of sight, such as [0, 1, 0]",
        ),
        Err(ViewError::Grazing) => problems.push_with_hint(
            format!("{who}.position"),
            format!("the {who} looks along the plane z = {} mm in which its field is measured", look_at[2]),
            "raise or lower the position above or below look_at",
        ),
        Err(ViewError::Folded) => problems.push_with_hint(
            format!("{who}.distortion"),
            format!("the distortion folds the {who}'s image over before its edge: some places would show two directions, or none"),
            "take smaller coefficients or a smaller field; they are in the unit `distance of look_at`, not in pixels",
        ),
    }
}
