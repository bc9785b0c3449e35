//! Objects: shape, surface and medium of each.

use std::sync::Arc;

use turbid_contract::payload::{Mesh, Object, Shape};
use turbid_contract::{Fixed, Problems, suggest};

use crate::assemble::path::path;
use crate::assemble::relief::relief;
use crate::assemble::scatter::{body_name, scatter};
use crate::assemble::shape::{mesh, shapes};
use crate::assemble::surface::surface;
use crate::params::{ObjectParams, Params};

const SHAPES_HINT: &str =
    "give exactly one of slab, box, sphere, spheroid, cylinder, tube, sphere_shell, mesh, relief, path, scatter";

/// The object with its name; of `scatter` one for each body.
pub fn objects(
    name: &str,
    o: &ObjectParams,
    params: &Params,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Vec<(String, Object)> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let mut shapes = shapes(name, o, problems);
    let mut given = shapes.len();
    let mut made = |mesh: Option<Mesh>| {
        given += 1;
        shapes.extend(mesh.map(|mesh| Shape::Mesh(Fixed::new(mesh))));
    };
    if let Some(m) = &o.mesh {
        made(mesh(name, m, file, problems));
    }
    if let Some(r) = &o.relief {
        made(relief(name, r, problems));
    }
    if let Some(p) = &o.path {
        made(path(name, p, problems));
    }
    if let Some(s) = &o.scatter {
        given += 1;
        shapes.extend(scatter(name, s, problems).unwrap_or_default());
    }
    if given != 1 {
        let rule = if given == 0 { "has no shape" } else { "has more than one shape" };
        problems.push_with_hint(format!("objects.{name}"), format!("{name} {rule}"), SHAPES_HINT);
    }
    let surface = surface(&at("surface"), &o.surface, shapes.first(), file, problems);
    let opaque = surface.is_opaque();
    match &o.medium {
        Some(medium) if !params.media.contains_key(medium) => {
            let known = params.media.keys().map(String::as_str);
            let hint = suggest::hint(medium, known);
            let hint = hint.unwrap_or_else(|| format!("add it: `media: {{{medium}: {{mu_a, mu_s_prime, g, n}}}}`"));
            problems.push_with_hint(at("medium"), format!("there is no medium `{medium}`"), hint);
        }
        None if !opaque => {
            problems.push_with_hint(
                at("medium"),
                format!("{name} has no medium"),
                "name an entry of `media`; only an opaque surface needs none",
            );
        }
        _ => {}
    }
    // Light never enters an opaque object: what lies below cannot matter.
    let medium = if opaque { None } else { o.medium.clone() };
    let object =
        |shape: Shape| Object { shape, medium: medium.clone(), priority: o.priority, surface: surface.clone() };
    if o.scatter.is_none() {
        return shapes.into_iter().take(1).map(|shape| (name.to_owned(), object(shape))).collect();
    }
    shapes.into_iter().enumerate().map(|(i, shape)| (body_name(name, i), object(shape))).collect()
}
