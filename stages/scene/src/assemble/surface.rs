//! Surfaces: what light meets at the skin of an object.

use std::sync::Arc;

use turbid_contract::payload::{Motif, Shape, Surface, Texture};
use turbid_contract::{Length, Problems, Ratio};
use turbid_geometry::picture;

use crate::assemble::plain;
use crate::params::{AlbedoParams, ImageParams, SurfaceParams, TextureParams, WaveParams};

/// `path` is the field's, `shape` that of the object, if it has one.
pub fn surface(
    path: &str,
    surface: &SurfaceParams,
    shape: Option<&Shape>,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Surface {
    match surface {
        SurfaceParams::Smooth => Surface::Smooth,
        SurfaceParams::Mirror => Surface::Mirror,
        SurfaceParams::Rough(alpha) => {
            let rule = "lie in (0, 1]; `smooth` is the limit of 0";
            problems.require(alpha.0 > 0.0 && alpha.0 <= 1.0, format!("{path}.rough"), alpha.0, "", rule);
            Surface::Rough(alpha.0)
        }
        SurfaceParams::Lambertian(AlbedoParams::Even(rho)) => {
            let path = format!("{path}.lambertian");
            problems.require((0.0..=1.0).contains(&rho.0), path, rho.0, "", "lie in [0, 1]");
            Surface::Lambertian(rho.0)
        }
        SurfaceParams::Lambertian(AlbedoParams::Textured(t)) => {
            let path = format!("{path}.lambertian");
            if let Some(what) = shape.and_then(without_coordinates) {
                problems.push_with_hint(
                    path.clone(),
                    format!("{what} has no surface coordinates by which a texture could be wrapped around it"),
                    "write one number for all of it, or take another shape",
                );
            }
            texture(&path, t, shape, file, problems).map_or(Surface::Lambertian(0.0), Surface::Textured)
        }
    }
}

/// What it is, of shapes for which [`Solid::coordinates`](turbid_optics::solid::Solid::coordinates) says `None`.
pub fn without_coordinates(shape: &Shape) -> Option<&'static str> {
    match shape {
        Shape::Mesh(_) => Some("a mesh"),
        Shape::Spheroid { diameters: [x, y, _], .. } if x != y => {
            Some("a spheroid of different diameters along x and y")
        }
        Shape::Turned { shape, .. } => without_coordinates(shape),
        _ => None,
    }
}

/// `None` where its picture cannot be read.
fn texture(
    path: &str,
    texture: &TextureParams,
    shape: Option<&Shape>,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Option<Texture> {
    let mut positive = |field: String, length: Length| {
        problems.require(length.0 > 0.0, format!("{path}.{field}"), length.0, "mm", "be > 0");
        length.0
    };
    let (kind, low, high, origin, motif) = match texture {
        TextureParams::Sinusoid(WaveParams { period, orientation_deg, low, high, origin }) => {
            let period = positive("sinusoid.period".to_owned(), *period);
            let motif = Motif::Sinusoid { period, orientation_deg: orientation_deg.0 + 0.0 };
            ("sinusoid", low, high, origin, Some(motif))
        }
        TextureParams::Stripes(WaveParams { period, orientation_deg, low, high, origin }) => {
            let period = positive("stripes.period".to_owned(), *period);
            let motif = Motif::Stripes { period, orientation_deg: orientation_deg.0 + 0.0 };
            ("stripes", low, high, origin, Some(motif))
        }
        TextureParams::Checker(c) => {
            let motif = Motif::Checker { side: positive("checker.side".to_owned(), c.side) };
            ("checker", &c.low, &c.high, &c.origin, Some(motif))
        }
        TextureParams::Image(i) => {
            let size = i.size.map(|size| [0, 1].map(|k| positive(format!("image.size.{k}"), size[k])));
            ("image", &i.low, &i.high, &i.origin, image(path, i, size, shape, file, problems))
        }
    };
    for (field, Ratio(rho)) in [("low", low), ("high", high)] {
        let field = format!("{path}.{kind}.{field}");
        problems.require((0.0..=1.0).contains(rho), field, *rho, "", "lie in [0, 1]: it is an albedo");
    }
    let [u, v] = *origin;
    let [u, v, _] = plain([u, v, Length(0.0)]);
    Some(Texture { low: low.0 + 0.0, high: high.0 + 0.0, origin: [u, v], motif: motif? })
}

fn image(
    path: &str,
    image: &ImageParams,
    size: Option<[f64; 2]>,
    shape: Option<&Shape>,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Option<Motif> {
    let at = format!("{path}.image.file");
    if size.is_none() && matches!(shape, Some(Shape::Slab { .. })) {
        problems.push_with_hint(
            format!("{path}.image"),
            "a slab has no bounds sideways that the picture could cover",
            "give `size: [width, height]` in mm, or the slab a `size`",
        );
    }
    let Some(bytes) = file(&at) else {
        problems.push(at, format!("`{}` has not been read", image.file));
        return None;
    };
    match picture::read(&bytes) {
        Ok(picture) => Some(Motif::Image { picture, size }),
        Err(error) => {
            let hint = "save it as a PNG of grey values, 8 or 16 bit, without transparency";
            problems.push_with_hint(at, format!("`{}`: {error}", image.file), hint);
            None
        }
    }
}
