//! What patterns and their frequency maps will hold.

use turbid_contract::payload::Scene;
use turbid_contract::{Form, Forms, Known, LayerInfo, LayerKind};
use turbid_geometry::picture;

use crate::fringes::{Fringe, fringes};
use crate::image;
use crate::params::{pattern, predistort};
use crate::screen::Screen;

/// What the layers of a pattern say, in their order.
pub fn layers(params: &pattern::Params) -> Vec<LayerInfo> {
    match (&params.image, &params.speckle) {
        (Some(image), _) => image.infos().collect(),
        (None, Some(speckle)) => vec![LayerInfo::value("pattern", "1"); speckle.count as usize],
        (None, None) => fringes(&params.f_x, &params.orientation_deg, params.phases).iter().map(Fringe::info).collect(),
    }
}

/// Spatial frequency and orientation of the fringes whose frequency on the surface is mapped.
pub fn mapped(params: &pattern::Params) -> Vec<(f64, f64)> {
    let own = params.f_x.iter().flat_map(|f| params.orientation_deg.iter().map(move |o| (f.0, o.0)));
    let of_image = params.image.iter().filter_map(|image| Some((image.f_x?.0, image.orientation_deg.0)));
    own.chain(of_image).filter(|(f, _)| *f > 0.0).collect()
}

/// Frequency along the surface and cycles per pixel of a fringe.
pub fn of_fringe(f_x: f64, orientation_deg: f64) -> [LayerInfo; 2] {
    [("f_surface", "mm^-1"), ("cycles_per_pixel", "1")].map(|(name, unit)| LayerInfo {
        orientation_deg: Some(orientation_deg),
        ..LayerInfo::value(name, unit).with_f_x(f_x)
    })
}

pub fn coordinate() -> LayerInfo {
    LayerInfo::value("coordinate", "mm")
}

pub fn mask() -> LayerInfo {
    LayerInfo::new("mask", LayerKind::Mask, "1")
}

/// The forms of `pattern`. How many pixels there are is open where neither scene, params nor the header of a picture say so.
pub fn of_pattern(params: &pattern::Params, known: &Known) -> Forms {
    let mut map: Vec<LayerInfo> = mapped(params).into_iter().flat_map(|(f, o)| of_fringe(f, o)).collect();
    map.push(mask());
    let first = params.image.is_some().then(|| known.files.get(&image::at(0))).flatten();
    let size = first.and_then(|bytes| picture::size(&bytes).ok());
    forms(known, size.or(params.pixels), layers(params), map)
}

/// The forms of `predistort`.
pub fn of_predistort(params: &predistort::Params, known: &Known) -> Forms {
    let o = params.orientation_deg;
    let shown = fringes(&params.f_x, &[o], params.phases);
    let mapped = params.f_x.iter().filter(|f| f.0 > 0.0).flat_map(|f| of_fringe(f.0, o.0));
    let map = mapped.chain([coordinate(), mask()]).collect();
    let mut forms = forms(known, params.pixels, shown.iter().map(Fringe::info).collect(), map);
    let along = (FRINGES_ALONG.to_owned(), params.surface.clone().into());
    forms.entry("pattern").or_default().attributes.extend([along]);
    forms
}

/// The attribute of a pattern that names the surface along which its f_x is meant, not in the plane of the pattern.
pub const FRINGES_ALONG: &str = "fringes_along";

fn forms(known: &Known, pixels: Option<[u32; 2]>, pattern: Vec<LayerInfo>, map: Vec<LayerInfo>) -> Forms {
    let screen = known.get::<Scene>("scene").and_then(|scene| Screen::of(&scene, pixels).ok());
    let pixels = screen.map(|screen| [screen.rows as u64, screen.columns as u64]);
    let of = |layers| Form { pixels, layers: Some(layers), ..Form::default() };
    Forms::from([("pattern", of(pattern)), ("surface_frequency", of(map))])
}
