//! Legal scenes that look as if a number stood in another unit: coefficients in cm^-1, lengths in m. Warnings, never more than one for a
//! medium, a view or an object; the usual ranges and their sources are in [`Usual`].

use glam::DVec3;
use turbid_contract::payload::{Medium, Object, Projection, Scene};
use turbid_contract::{Problems, Usual};

use crate::assemble::{Placed, is_void};
use crate::params::MediumParams;
use turbid_contract::PerChannel;

/// Reduced scattering of what may be tissue, mm^-1: only there an unusual absorption is doubted.
const TURBID: std::ops::RangeInclusive<f64> = 0.1..=15.0;
/// A view that is wider than this, field over distance, is wider than 157 degrees.
const WIDEST: f64 = 10.0;
/// Fields over distances that are usual.
const USUAL_VIEWS: std::ops::RangeInclusive<f64> = 0.01..=4.0;

/// Warns of the first value of a medium that another unit would make usual.
///
/// Media that do not scatter are dyes, glass and black absorbers of any strength: nothing is said of them, and nothing of an absorption
/// beside a scattering that is none of tissue's. Too little scattering is doubted where there is more absorption.
pub fn doubt_medium(name: &str, params: &MediumParams, medium: &Medium, problems: &mut Problems) {
    let (absorption, scattering) = (absorption(params), scattering(params));
    let g = turbid_geometry::phase_function(&medium.phase).g();
    for (i, (&mu_a, &mu_s)) in medium.mu_a.iter().zip(&medium.mu_s).enumerate() {
        let mu_s_prime = mu_s * (1.0 - g);
        let doubted = scattering.filter(|s| mu_s > 0.0 && (s.value(i) > s.usual.most || mu_s_prime < mu_a));
        let doubted = doubted.filter(|s| !s.usual.meant(s.value(i)).is_empty());
        let Some(given) = doubted.or(absorption.filter(|_| TURBID.contains(&mu_s_prime))) else { continue };
        let value = given.value(i);
        if let Some((message, hint)) = given.usual.doubt(value) {
            let at = format!("media.{name}.{}{}", given.usual.name, given.index(i));
            return problems.warn_ranked(given.usual.off(value), at, message, hint);
        }
    }
}

/// A coefficient as it was given.
#[derive(Clone, Copy)]
struct Given<'a> {
    usual: &'static Usual,
    values: Values<'a>,
}

#[derive(Clone, Copy)]
enum Values<'a> {
    PerMm(&'a PerChannel<turbid_contract::PerLength>),
    PerM(&'a PerChannel<turbid_contract::Density>),
}

impl Given<'_> {
    fn value(&self, channel: usize) -> f64 {
        fn of<T>(given: &PerChannel<T>, channel: usize, number: impl Fn(&T) -> f64) -> f64 {
            match given {
                PerChannel::One(value) => number(value),
                PerChannel::Each(values) => values.get(channel).map_or(0.0, number),
            }
        }
        match self.values {
            Values::PerMm(given) => of(given, channel, |v| v.0),
            Values::PerM(given) => of(given, channel, |v| v.0),
        }
    }

    /// `.1` in a list.
    fn index(&self, channel: usize) -> String {
        match self.values {
            Values::PerMm(PerChannel::Each(_)) | Values::PerM(PerChannel::Each(_)) => format!(".{channel}"),
            _ => String::new(),
        }
    }
}

fn absorption(m: &MediumParams) -> Option<Given<'_>> {
    let per_mm = m.mu_a.as_ref().map(|v| Given { usual: &Usual::MU_A, values: Values::PerMm(v) });
    per_mm.or(m.a_rho.as_ref().map(|v| Given { usual: &Usual::A_RHO, values: Values::PerM(v) }))
}

fn scattering(m: &MediumParams) -> Option<Given<'_>> {
    let reduced = m.mu_s_prime.as_ref().map(|v| Given { usual: &Usual::MU_S_PRIME, values: Values::PerMm(v) });
    let whole = || m.mu_s.as_ref().map(|v| Given { usual: &Usual::MU_S, values: Values::PerMm(v) });
    let density = || m.s_rho.as_ref().map(|v| Given { usual: &Usual::S_RHO, values: Values::PerM(v) });
    reduced.or_else(whole).or_else(density)
}

/// Warns of lights and wavelengths that another unit would make usual; `value` stands at `path`.
pub fn doubt(usual: &Usual, path: &str, value: f64, problems: &mut Problems) {
    if let Some((message, hint)) = usual.doubt(value) {
        problems.warn_ranked(usual.off(value), path, message, hint);
    }
}

/// Warns of views and objects that look as if they were given in m.
pub fn doubt_sizes(scene: &Scene, objects: &[Placed<'_>], problems: &mut Problems) {
    let Some(camera) = &scene.camera else { return };
    if camera.projection == Projection::Pinhole {
        doubt_view("camera", camera.position, camera.look_at, camera.field, problems);
    }
    if let Some(p) = &scene.projector {
        doubt_view("projector", p.position, p.look_at, p.field, problems);
    }
    let field = camera.field[0].max(camera.field[1]);
    let distance = (DVec3::from(camera.position) - DVec3::from(camera.look_at)).length();
    let pixels = camera.pixels[0].max(camera.pixels[1]);
    // A view of a few pixels may be as narrow as a ray.
    if field < 1.0 && pixels >= 16 && USUAL_VIEWS.contains(&(1000.0 * field / distance)) {
        let message = format!("the camera sees {field} mm, less than light spreads in tissue");
        return problems.warn_ranked(1.0 / field, "camera.field", message, in_metres(field));
    }
    doubt_objects(scene, objects, field, field / f64::from(pixels), problems);
}

fn doubt_view(who: &str, position: [f64; 3], look_at: [f64; 3], field: [f64; 2], problems: &mut Problems) {
    let distance = (DVec3::from(position) - DVec3::from(look_at)).length();
    let wide = field[0].max(field[1]) / distance;
    if wide > WIDEST && USUAL_VIEWS.contains(&(wide / 1000.0)) {
        let message =
            format!("the {who} is {distance} mm from look_at, very near for a field of {} mm", field[0].max(field[1]));
        problems.warn_ranked(wide, format!("{who}.position"), message, in_metres(distance));
    }
}

fn in_metres(length: f64) -> String {
    format!("lengths are in mm; if m is meant, write `{length} m`")
}

/// The thickest of the objects that light enters is thin beside the field; or an object is smaller than a pixel.
fn doubt_objects(scene: &Scene, objects: &[Placed<'_>], field: f64, pixel: f64, problems: &mut Problems) {
    let enters = |o: &&Placed<'_>| {
        let Object { surface, medium, .. } = o.object;
        !surface.is_opaque() && medium.is_some() && !is_void(scene, o.object)
    };
    let thickest = objects.iter().filter(enters).max_by(|a, b| extent(a).0.total_cmp(&extent(b).0));
    if let Some(o) = thickest
        && extent(o).0 < field / 100.0
        && (field / 10.0..=1000.0 * field).contains(&(1000.0 * extent(o).0))
    {
        let thickness = extent(o).0;
        let message = format!("{} is {thickness} mm thick, and nothing is thicker, in a field of {field} mm", o.name);
        return problems.warn_ranked(field / thickness, format!("objects.{}", o.name), message, in_metres(thickness));
    }
    for o in objects.iter().filter(enters) {
        let size = extent(o).1;
        if size < 0.5 * pixel && (2.0 * pixel..=10.0 * field).contains(&(1000.0 * size)) {
            let message = format!("{} is {size} mm across, less than a pixel of the camera ({pixel} mm)", o.name);
            problems.warn_ranked(pixel / size, format!("objects.{}", o.name), message, in_metres(size));
        }
    }
}

/// The smallest and the largest extent along the axes, mm; an infinite one is none.
fn extent(o: &Placed<'_>) -> (f64, f64) {
    let (low, high) = o.solid.bounds();
    let sizes = (high - low).to_array();
    let finite = || sizes.into_iter().filter(|size| size.is_finite());
    let largest = if sizes.iter().all(|size| size.is_finite()) { finite().fold(0.0, f64::max) } else { f64::INFINITY };
    (finite().fold(f64::INFINITY, f64::min), largest)
}
