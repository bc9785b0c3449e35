//! Objects: shape, surface and medium of each.

use std::sync::Arc;

use turbid_contract::Problems;
use turbid_contract::payload::{Object, Shape};

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
        shapes.extend(mesh(name, m, file, problems).map(Shape::Mesh));
    }
    if given != 1 {
        let rule = if given == 0 { "has no shape" } else { "has more than one shape" };
        problems.push_with_hint(format!("objects.{name}"), format!("{name} {rule}"), SHAPES_HINT);
    }
    let surface = surface(&at("surface"), &o.surface, shapes.first(), file, problems);
    let opaque = surface.is_opaque();
    match &o.medium {
        Some(medium) if !params.media.contains_key(medium) => {
            let known: Vec<&str> = params.media.keys().map(String::as_str).collect();
            let message = format!("there is no medium `{medium}`");
            match closest(medium, &known) {
                _ if known.is_empty() => {
                    let hint = format!("add it: `media: {{{medium}: {{mu_a, mu_s_prime, g, n}}}}`");
                    problems.push_with_hint(at("medium"), message, hint);
                }
                Some(near) => problems.push_with_hint(at("medium"), message, format!("did you mean `{near}`?")),
                None => problems.push_with_hint(at("medium"), message, format!("known: {}", known.join(", "))),
            }
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
