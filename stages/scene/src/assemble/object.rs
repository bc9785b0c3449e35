//! Objects: shape, surface and medium of each.

use std::sync::Arc;

use turbid_contract::payload::{Object, Shape};
use turbid_contract::{Fixed, Problems, suggest};

use crate::assemble::shape::{mesh, shapes};
use crate::assemble::surface::surface;
use crate::params::{ObjectParams, Params};

const SHAPES_HINT: &str = "give exactly one of slab, box, sphere, spheroid, cylinder, tube, sphere_shell, mesh";

pub fn object(
    name: &str,
    o: &ObjectParams,
    params: &Params,
    file: &dyn Fn(&str) -> Option<Arc<[u8]>>,
    problems: &mut Problems,
) -> Option<Object> {
    let at = |field: &str| format!("objects.{name}.{field}");
    let mut shapes = shapes(name, o, problems);
    let mut given = shapes.len();
    if let Some(m) = &o.mesh {
        given += 1;
        shapes.extend(mesh(name, m, file, problems).map(|mesh| Shape::Mesh(Fixed::new(mesh))));
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
    Some(Object { shape: shapes.into_iter().next()?, medium, priority: o.priority, surface })
}
