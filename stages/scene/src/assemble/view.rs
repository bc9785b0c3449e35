//! Camera and projector.

use turbid_contract::Problems;
use turbid_contract::payload::{Camera, Projector};
use turbid_optics::view::{View, ViewError};

use crate::assemble::{per_channel, plain};
use crate::params::Params;

/// The largest image that a scene may ask for, pixels.
const MOST_PIXELS: u64 = 1 << 28;

pub fn camera(params: &Params, problems: &mut Problems) -> Option<Camera> {
    let c = params.camera.as_ref()?;
    check_view("camera", plain(c.position), plain(c.look_at), c.up, plain(c.field), problems);
    check_pixels("camera", c.pixels, problems);
    Some(Camera {
        position: plain(c.position),
        look_at: plain(c.look_at),
        up: c.up,
        field: plain(c.field),
        pixels: c.pixels,
        specular: c.specular,
    })
}

pub fn projector(params: &Params, problems: &mut Problems) -> Option<Projector> {
    let p = params.projector.as_ref()?;
    check_view("projector", plain(p.position), plain(p.look_at), p.up, plain(p.field), problems);
    let power = per_channel(
        "projector.power",
        &p.power,
        |v| v.0,
        params,
        problems,
        |path, v, problems| {
            problems.require(v > 0.0, path, v, "W", "be > 0");
        },
    );
    if let Some(pixels) = p.pixels {
        check_pixels("projector", pixels, problems);
    }
    Some(Projector {
        position: plain(p.position),
        look_at: plain(p.look_at),
        up: p.up,
        field: plain(p.field),
        power,
        profile: p.profile,
        pixels: p.pixels,
    })
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

fn check_view(
    who: &str,
    position: [f64; 3],
    look_at: [f64; 3],
    up: [f64; 3],
    field: [f64; 2],
    problems: &mut Problems,
) {
    for (i, &f) in field.iter().enumerate() {
        problems.require(f > 0.0, format!("{who}.field.{i}"), f, "mm", "be > 0");
    }
    match View::new(position.into(), look_at.into(), up.into(), field.into()) {
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
    }
}
