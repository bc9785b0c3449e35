//! What can only be seen with all parts of a scene in place.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use turbid_contract::Problems;
use turbid_contract::payload::{Lamp, Object, Scene, Surface};
use turbid_geometry::{camera_view, projector_view};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::solid::Solid;
use turbid_optics::view::View;

use crate::assemble::plausible::doubt_sizes;
use crate::assemble::surface::without_coordinates;
use crate::assemble::{Placed, is_void, object_at, placed};
use crate::overlap::overlap;

/// Overlaps, eyes inside solids, lights that light nothing; `scattered` tells which objects were placed so that they do not meet.
pub fn check_whole(scene: &Scene, scattered: &BTreeMap<String, String>, problems: &mut Problems) {
    let objects = placed(scene);
    fn origin<'a>(name: &'a str, scattered: &'a BTreeMap<String, String>) -> &'a str {
        scattered.get(name).map_or(name, String::as_str)
    }
    let mut told = BTreeSet::new();
    for (i, a) in objects.iter().enumerate() {
        for b in &objects[i + 1..] {
            let both = [a.name, b.name].map(|name| origin(name, scattered));
            if a.object.priority == b.object.priority
                && both[0] != both[1]
                && !told.contains(&both)
                && overlap(&a.solid, &b.solid)
            {
                told.insert(both);
                problems.push_with_hint(
                    format!("objects.{}", b.name),
                    format!("{} and {} overlap and have the same priority {}", a.name, b.name, a.object.priority),
                    "give the one that shall win a higher `priority`",
                );
            }
        }
    }
    for textured in objects.iter().filter(|o| matches!(o.object.surface, Surface::Textured(_))) {
        let carves = |o: &&Placed<'_>| {
            without_coordinates(&o.object.shape).is_some()
                && o.object.priority > textured.object.priority
                && overlap(&o.solid, &textured.solid)
        };
        if let Some(hole) = objects.iter().find(carves) {
            problems.push_with_hint(
                format!("objects.{}.surface", textured.name),
                format!(
                    "{} is carved into {}, and has no surface coordinates for its texture",
                    hole.name, textured.name
                ),
                "give it one albedo, or carve with another shape",
            );
        }
    }
    let solid_around = |p: &[f64; 3]| {
        let found = object_at(&objects, (*p).into()).map(|i| &objects[i]);
        found.filter(|o| !is_void(scene, o.object))
    };
    for (who, path, points) in places(scene) {
        if let Some((position, Placed { name, .. })) = points.iter().find_map(|p| Some((p, solid_around(p)?))) {
            problems.push_with_hint(
                path,
                format!("the {who} at {position:?} mm is inside the solid {name}"),
                "move it out, or carve a hole with an object of higher priority whose medium has mu_a = mu_s = 0",
            );
        }
    }
    // A rig for other scenes: they are what it lights and sees.
    if objects.is_empty() {
        return;
    }
    let solids: Vec<&Solid> = objects.iter().filter(|o| !is_void(scene, o.object)).map(|o| &o.solid).collect();
    if let Some(p) = &scene.projector
        && !projector_view(p).is_ok_and(|view| sees_something(&solids, &view))
    {
        problems.push_with_hint(
            "projector.look_at",
            "the projector lights nothing: no ray of its field meets an object",
            "check position, look_at and field against the objects",
        );
    }
    if let Some(c) = &scene.camera {
        if !camera_view(c).is_ok_and(|view| sees_something(&solids, &view)) {
            problems.warn("camera.look_at", "the camera sees no object");
        }
        let reflects = |o: &Object| match &o.medium {
            _ if o.surface == Surface::Mirror => Some("is a mirror"),
            Some(medium) if !o.surface.is_opaque() && scene.media[medium].n != 1.0 => Some("has n != 1"),
            _ => None,
        };
        let reflecting = scene.objects.iter().find_map(|(name, o)| reflects(o).map(|why| (name, why)));
        if let (Some((name, why)), None) = (reflecting, c.specular) {
            problems.push_with_hint(
                "camera.specular",
                format!("the surface of {name} {why}, so it must be said whether its reflexes are seen"),
                "write `specular: exclude` (crossed polarisers) or `specular: include`",
            );
        }
    }
    doubt_sizes(scene, &objects, problems);
}

/// Where camera, projector and lights stand: what, the field that says so, the points.
fn places(scene: &Scene) -> Vec<(String, String, Vec<[f64; 3]>)> {
    let mut places = Vec::new();
    if let Some(c) = &scene.camera
        && let Ok(view) = camera_view(c)
    {
        // Where rays start: at the pinhole, on the rim of the lens, or at the corners of an orthographic image.
        let corners = [(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| view.ray(x, y).0);
        let rim = (0..16).map(|i| view.ray_through(0.5, 0.5, 1.0, f64::from(i) / 16.0).0);
        let origins = corners.into_iter().chain(rim).map(DVec3::into).collect();
        places.push(("camera".into(), "camera.position".into(), origins));
    }
    places.extend(scene.projector.iter().map(|p| ("projector".into(), "projector.position".into(), vec![p.position])));
    for (name, lamp) in &scene.lights {
        let path = |kind: &str| format!("lights.{name}.{kind}.position");
        match lamp {
            Lamp::Point { position, .. } => places.push((format!("light {name}"), path("point"), vec![*position])),
            Lamp::Spot { position, .. } => places.push((format!("light {name}"), path("spot"), vec![*position])),
            Lamp::Collimated { position, look_at, diameter, .. } => {
                let (center, end) = (DVec3::from(*position), DVec3::from(*look_at));
                let (x, y) = (end - center).normalize().any_orthonormal_pair();
                let rim = (0..16).map(|i| {
                    let (sin, cos) = sin_cos_turns(f64::from(i) / 16.0);
                    (center + 0.5 * diameter * (cos * x + sin * y)).to_array()
                });
                let disc = std::iter::once(*position).chain(rim).collect();
                places.push((format!("rim or centre of the light {name}"), path("collimated"), disc));
            }
            Lamp::Ambient { .. } => {}
        }
    }
    places
}

/// Whether a ray of the view meets anything that is not void: on a grid of 65 x 65 and at every object's middle.
fn sees_something(solids: &[&Solid], view: &View) -> bool {
    let meets = |(origin, along): (DVec3, DVec3)| {
        let mut stays = Vec::new();
        solids.iter().any(|solid| {
            solid.cut(origin, along, None, &mut stays);
            stays.iter().any(|stay| stay.leave > 0.0)
        })
    };
    let steps = 64;
    let grid = (0..=steps).flat_map(|i| (0..=steps).map(move |j| (f64::from(i), f64::from(j))));
    let n = f64::from(steps);
    // An object smaller than the grid's mesh is found by its middle.
    let middles = solids.iter().filter_map(|s| {
        let (low, high) = s.bounds();
        let middle = 0.5 * (low + high);
        middle.is_finite().then_some(middle)
    });
    let in_field = |(x, y): &(f64, f64)| (0.0..=1.0).contains(x) && (0.0..=1.0).contains(y);
    grid.map(|(i, j)| view.ray(i / n, j / n)).any(meets)
        || middles.filter_map(|m| view.image_position(m)).filter(in_field).any(|(x, y)| meets(view.ray(x, y)))
}
