//! `method: rte`: exact where nothing depends on angles, within its bound elsewhere, and refused where there is none.

use serde_json::{Value, json};
use turbid_contract::payload::{Projection, Scene, Shape, Specular};
use turbid_contract::{ImageStack, Layer, LayerKind, Problems};
use turbid_render::Params;

use crate::setup::*;

fn values(stack: &ImageStack) -> Vec<(&Layer, &Layer)> {
    let pairs = stack.layers.windows(2).filter(|w| w[0].info.kind == LayerKind::Value);
    pairs.map(|w| (&w[0], &w[1])).collect()
}

/// A slab under a camera and a projector at `distance`.
fn far(objects: &[(Shape, &str)], n: f64, distance: f64, projection: Projection) -> Scene {
    let (mut camera, projector) = rig(distance, 20.0, 40.0, 16, 140.0);
    camera.projection = projection;
    camera.specular = Some(Specular::Exclude);
    let mut m = medium(0.05, 5.0, 0.8);
    m.n = n;
    let objects = objects.iter().map(|(shape, name)| object(shape.clone(), name, 0)).collect();
    scene(&[("m", m), ("other", medium(0.1, 2.0, 0.0))], objects, (camera, projector))
}

fn half_space() -> [(Shape, &'static str); 1] {
    [(FLOOR, "m")]
}

/// A Lambertian floor below the pattern's plane, seen and lit obliquely: E rho / pi, the pattern averaged over the pixel.
#[test]
fn a_lambertian_floor_is_exact() {
    let (mut camera, mut projector) = rig(300.0, 0.0, 40.0, 16, 140.0);
    camera.position = [-60.0, 30.0, 300.0];
    projector.position = [80.0, 20.0, 250.0];
    let floor = lambertian(Shape::Slab { top: -20.0, bottom: -99.0 }, 0.7);
    let scene = scene(&[], vec![floor], (camera, projector));
    let solved = &run(&scene, &json!({"f_x": [0, 0.1], "method": "rte"}), 1)["frames"];
    let traced = &run(&scene, &json!({"f_x": [0, 0.1], "method": "path", "samples": 1024}), 1)["frames"];
    let (mut squares, mut count) = (0.0, 0.0);
    for ((a, a_se), (b, b_se)) in values(solved).into_iter().zip(values(traced)) {
        assert!(a_se.data.iter().all(|&se| se == 0.0), "there is nothing to be off by");
        for ((a, b), se) in a.data.iter().zip(&b.data).zip(&b_se.data) {
            // Beside noise: how irradiance bends within a pixel of 2.5 mm at 270 mm, and f32.
            let z = (f64::from(a - b).abs() - 3e-5 * f64::from(*b)).max(0.0) / f64::from(se + f32::MIN_POSITIVE);
            assert!(z < 4.5, "{:?}: {a} {b} +- {se}", a);
            (squares, count) = (squares + z * z, count + 1.0);
        }
    }
    assert!(squares / count < 1.3, "{}", squares / count);
}

/// Against smooth fits with some 0.5 % of noise, from rigs far and near, parallel and not, matched and refracting, deep and thin: every pixel of
/// every frame lies within the stated standard error, which is the bound, and the bound falls with the distance.
#[test]
fn the_bound_holds() {
    let thin = [(Shape::Slab { top: 0.0, bottom: -2.0 }, "m")];
    let mut bounds = Vec::new();
    for (objects, n, distance, projection) in [
        (half_space(), 1.0, 500.0, Projection::Pinhole),
        (half_space(), 1.0, 4000.0, Projection::Pinhole),
        (half_space(), 1.0, 4000.0, Projection::Orthographic),
        (half_space(), 1.4, 4000.0, Projection::Orthographic),
        (thin, 1.4, 1000.0, Projection::Orthographic),
    ] {
        let scene = far(&objects, n, distance, projection);
        let host = MemoryHost::new(3, &[], 2);
        let solved = &run_on(&host, &scene, &json!({"f_x": [0, 0.1], "method": "rte"})).unwrap()["frames"];
        bounds.push(host.measures.lock().unwrap()["bound of a frame's error"]);
        let fitted = &run(&scene, &json!({"f_x": [0, 0.1], "method": "fit", "samples": 1024}), 3)["frames"];
        for ((a, bound), (b, se)) in values(solved).into_iter().zip(values(fitted)) {
            let [mean, noise] = [a, se].map(|l| f64::from(l.data.mean().expect("pixels")));
            assert!(noise < 1.2e-2 * mean, "{:?}: too noisy to tell: {noise:e} of {mean:e}", a.info);
            for (at, &x) in a.data.indexed_iter() {
                let [off, bound, se] = [(x - b.data[at]).abs(), bound.data[at], se.data[at]].map(f64::from);
                let case = format!("n {n}, {distance} mm, {projection:?}, {:?}", a.info);
                assert!(off <= bound + 4.5 * se, "{case}: off by {off:e}, bound {bound:e}, noise {se:e}");
            }
        }
    }
    assert!(bounds[1] < bounds[0] && bounds[2] < bounds[1], "{bounds:?}");
}

/// What is not one slab is refused by name; `auto` takes the solver where its bound is within the target.
#[test]
fn refused_or_taken_by_the_bound() {
    let check = |scene: &Scene, params: &Value| {
        let params: Params = serde_json::from_value(params.clone()).unwrap();
        let mut problems = Problems::default();
        params.check(false, &mut problems);
        params.check_scene(scene, false, &mut problems);
        problems.into_parts().0
    };
    let rte = json!({"f_x": [0, 0.1], "method": "rte"});
    let alone = far(&half_space(), 1.4, 4000.0, Projection::Orthographic);
    assert!(check(&alone, &rte).is_empty(), "it needs nothing to stop by");
    let layers = [(Shape::Slab { top: 0.0, bottom: -2.0 }, "m"), (Shape::Slab { top: -2.0, bottom: -20.0 }, "other")];
    let layers = far(&layers, 1.0, 4000.0, Projection::Orthographic);
    let mut blurred = far(&half_space(), 1.0, 4000.0, Projection::Pinhole);
    blurred.camera.as_mut().unwrap().aperture =
        Some(turbid_contract::payload::Aperture { diameter: 5.0, focus: 4000.0 });
    for (scene, word) in [(layers, "one slab alone"), (blurred, "aperture")] {
        let found = check(&scene, &rte);
        assert!(found.len() == 1 && found[0].path == "method" && found[0].message.contains(word), "{found:?}");
    }
    let run_auto = |target: f64| {
        let host = MemoryHost::new(1, &[], 2);
        run_on(&host, &alone, &json!({"f_x": [0, 0.1], "target_error": target})).unwrap();
        let measures = host.measures.lock().unwrap();
        (measures.get("bound of a frame's error").copied(), measures.get("order of the fit").copied())
    };
    let (bound, order) = run_auto(0.1);
    assert!(bound.is_some_and(|b| b > 0.1 && b <= 10.0) && order.is_none(), "{bound:?}, {order:?}");
    let (bound, order) = run_auto(0.01);
    assert!(bound.is_none() && order.is_some(), "{bound:?}, {order:?}");
}
