//! Objects: shape, surface and medium of each.

use turbid_contract::Problems;
use turbid_contract::payload::{Object, Shape, Surface};

use crate::assemble::plain;
use crate::params::{ObjectParams, Params, SurfaceParams};

pub fn object(name: &str, o: &ObjectParams, params: &Params, problems: &mut Problems) -> Option<Object> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let shapes = shapes(name, o, problems);
    if shapes.len() != 1 {
        let rule = if shapes.is_empty() { "has no shape" } else { "has more than one shape" };
        problems.push_with_hint(
            format!("objects.{name}"),
            format!("{name} {rule}"),
            "give exactly one of slab, box, sphere, spheroid",
        );
    }
    let surface = surface(name, o, problems);
    match &o.medium {
        Some(medium) if !params.media.contains_key(medium) => {
            let known: Vec<&str> = params.media.keys().map(String::as_str).collect();
            let message = format!("there is no medium `{medium}`");
            match closest(medium, &known) {
                Some(near) => problems.push_with_hint(at("medium"), message, format!("did you mean `{near}`?")),
                None => problems.push_with_hint(at("medium"), message, format!("known: {}", known.join(", "))),
            }
        }
        None if surface == Surface::Smooth => {
            problems.push_with_hint(
                at("medium"),
                format!("{name} has no medium"),
                "name an entry of `media`; only an opaque surface needs none",
            );
        }
        _ => {}
    }
    // Light never enters an opaque object: what lies below cannot matter.
    let medium = if surface == Surface::Smooth { o.medium.clone() } else { None };
    Some(Object { shape: *shapes.first()?, medium, priority: o.priority, surface })
}

/// Every shape that it names; a scene needs exactly one.
fn shapes(name: &str, o: &ObjectParams, problems: &mut Problems) -> Vec<Shape> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let mut positive = |field: &str, v: f64| {
        problems.require(v > 0.0, at(field), v, "mm", "be > 0");
        v
    };
    let mut shapes = Vec::new();
    if let Some(s) = &o.slab {
        let thickness = positive("slab.thickness", s.thickness.0);
        let (top, bottom) = (s.top.0, s.top.0 - thickness);
        shapes.push(match s.size {
            None => Shape::Slab { top, bottom },
            Some(size) => {
                let (x, y) = (positive("slab.size.0", size[0].0), positive("slab.size.1", size[1].0));
                let center = s.center.unwrap_or_default();
                Shape::Box { size: [x, y, thickness], center: [center[0].0, center[1].0, top - 0.5 * thickness] }
            }
        });
    }
    if let Some(b) = &o.cuboid {
        let size = [0, 1, 2].map(|i| positive(&format!("box.size.{i}"), b.size[i].0));
        shapes.push(Shape::Box { size, center: plain(b.center) });
    }
    if let Some(s) = &o.sphere {
        shapes.push(Shape::Sphere { diameter: positive("sphere.diameter", s.diameter.0), center: plain(s.center) });
    }
    if let Some(s) = &o.spheroid {
        let diameters = [0, 1, 2].map(|i| positive(&format!("spheroid.diameters.{i}"), s.diameters[i].0));
        let center = plain(s.center);
        shapes.push(if diameters[0] == diameters[1] && diameters[1] == diameters[2] {
            Shape::Sphere { diameter: diameters[0], center }
        } else {
            Shape::Spheroid { diameters, center }
        });
    }
    if let Some(s) = &o.slab
        && s.center.is_some()
        && s.size.is_none()
    {
        problems.push_with_hint(
            at("slab.center"),
            "a slab that is infinite sideways has no center",
            "add `size: [x, y]`, or leave `center` out",
        );
    }
    shapes
}

/// What light meets at its skin.
fn surface(name: &str, o: &ObjectParams, problems: &mut Problems) -> Surface {
    let at = |field: &str| format!("objects.{name}.{field}");
    match o.surface {
        SurfaceParams::Smooth => Surface::Smooth,
        SurfaceParams::Lambertian(rho) => {
            problems.require((0.0..=1.0).contains(&rho.0), at("surface.lambertian"), rho.0, "", "lie in [0, 1]");
            Surface::Lambertian(rho.0)
        }
    }
}

/// The known name nearest to `name` by edit distance, if it is near enough to be a slip.
fn closest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let distance = |a: &str, b: &str| {
        let b: Vec<char> = b.chars().collect();
        let mut row: Vec<usize> = (0..=b.len()).collect();
        for (i, x) in a.chars().enumerate() {
            let mut diagonal = row[0];
            row[0] = i + 1;
            for (j, &y) in b.iter().enumerate() {
                let next = (diagonal + usize::from(x != y)).min(row[j] + 1).min(row[j + 1] + 1);
                diagonal = row[j + 1];
                row[j + 1] = next;
            }
        }
        row[b.len()]
    };
    let (d, near) = known.iter().map(|k| (distance(name, k), *k)).min()?;
    (d <= 1 + name.chars().count() / 3).then_some(near)
}
