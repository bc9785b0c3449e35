//! Scenes with meshes against the same scenes with the solids that they stand for.

use serde_json::json;
use turbid_contract::payload::{Medium, Mesh, Scene, Shape, Specular};

use crate::setup::*;
use crate::shapes::{block, icosphere, ring};

/// z of the difference between two images, pixel by pixel and layer by layer.
fn scores(a: &Scene, b: &Scene, samples: u32) -> Vec<f64> {
    let params = json!({"f_x": [0, 0.1], "samples": samples});
    let (a, b) = (&run(a, &params, 1)["frames"], &run(b, &params, 2)["frames"]);
    let of = |stack: &turbid_contract::ImageStack, name: &str| -> Vec<f64> {
        let layers = stack.layers.iter().filter(|l| l.info.name == name);
        layers.flat_map(|l| l.data.iter().map(|&x| f64::from(x)).collect::<Vec<_>>()).collect()
    };
    let [av, bv] = [a, b].map(|s| of(s, "radiance"));
    let [ae, be] = [a, b].map(|s| of(s, "radiance_se"));
    let both = av.iter().zip(&bv).zip(ae.iter().zip(&be));
    both.filter(|(_, (ea, eb))| **ea + **eb > 0.0).map(|((a, b), (ea, eb))| (a - b) / f64::hypot(*ea, *eb)).collect()
}

fn agree(name: &str, a: &Scene, b: &Scene, samples: u32) {
    let z = scores(a, b, samples);
    let n = z.len() as f64;
    let (mean, rms) = (z.iter().sum::<f64>() / n, (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt());
    let worst = z.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
    // Four frames of a pixel share its paths: n / 4 independent values.
    assert!(mean.abs() < 4.0 * (4.0 / n).sqrt(), "{name}: mean z {mean} of {n}");
    assert!((rms - 1.0).abs() < 0.15 && worst < 4.5, "{name}: rms z {rms}, worst {worst}");
}

fn mesh((vertices, triangles): (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> Shape {
    Shape::Mesh(Mesh { vertices, triangles }.into())
}

/// 81,920 triangles are 2e-5 of the radius away from the sphere; a box and a tube beside and below other bodies.
#[test]
fn meshes_look_like_what_they_stand_for() {
    let media = [("m", medium(0.05, 2.0, 0.7)), ("core", medium(0.3, 4.0, 0.5))];
    let compare = |name: &str, shape: Shape, mesh: Shape, around: Option<Shape>| {
        let with = |shape: Shape| {
            let mut objects = vec![object(shape, "core", 1)];
            objects.extend(around.clone().map(|shape| object(shape, "m", 0)));
            let (mut camera, mut projector) = rig(40.0, 9.0, 9.0, 8, 14.0);
            camera.position[0] = 6.0;
            projector.position[0] = -8.0;
            scene(&media, objects, (camera, projector))
        };
        agree(name, &with(mesh), &with(shape), 300);
    };
    let sphere = Shape::Sphere { diameter: 6.0, center: [0.5, 0.0, 0.0] };
    let fine = icosphere(3.0, [0.5, 0.0, 0.0].into(), 6);
    assert_eq!(fine.1.len(), 81_920);
    compare("sphere", sphere.clone(), mesh(fine.clone()), None);
    compare("sphere in a slab", sphere, mesh(fine), Some(FLOOR));
    let cuboid = Shape::Box { size: [3.0, 4.0, 2.0], center: [0.0, 0.5, -0.5] };
    compare("box", cuboid, mesh(block([-1.5, -1.5, -1.5].into(), [1.5, 2.5, 0.5].into())), Some(FLOOR));
    let tube = Shape::Tube { inner_diameter: 4.0, outer_diameter: 7.0, top: 1.0, bottom: -1.0, center: [0.0, 0.0] };
    compare("tube", tube, mesh(ring(2.0, 3.5, 1.0, 1024)), None);
}

/// The truth port sees a mesh as it sees the sphere.
#[test]
fn truth_of_a_mesh_is_that_of_its_solid() {
    let media = [("m", medium(0.05, 2.0, 0.7)), ("core", medium(0.3, 4.0, 0.5))];
    let truth = |shape: Shape| {
        let scene = scene(&media, vec![object(FLOOR, "m", 0), object(shape, "core", 1)], rig(40.0, 9.0, 9.0, 24, 14.0));
        run(&scene, &json!({"f_x": [0], "samples": 2}), 1).remove("truth").unwrap()
    };
    let exact = truth(Shape::Sphere { diameter: 6.0, center: [0.5, 0.0, 0.0] });
    let found = truth(mesh(icosphere(3.0, [0.5, 0.0, 0.0].into(), 5)));
    // Facets 0.1 mm wide lie at most 4e-4 below the sphere and are tilted by up to 0.02 ; at the rim, 50 pixels long,
    // either may be missed.
    for (name, tolerance) in [("mu_a", 0.0), ("height", 4e-3), ("depth", 4e-3), ("normal_z", 0.02), ("object", 0.0)] {
        let [a, b] = [&exact, &found].map(|t| t.find(name, None).unwrap().data.clone());
        let off = a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() > tolerance).count();
        assert!(off <= 20, "{name}: {off} of {} pixels differ", a.len());
    }
}

/// No byte depends on the order of the triangles, nor so on the tree over them: a mesh that scatters, one that refracts too, one by itself.
#[test]
fn triangles_in_any_order_give_the_same_bytes() {
    let dense = |mu_a| Medium { n: 1.4, ..medium(mu_a, 3.0, 0.5) };
    let media = [("m", medium(0.05, 4.0, 0.8)), ("core", medium(0.3, 3.0, 0.5)), ("denser", dense(0.3))];
    for (own, top) in [("core", 5.0), ("denser", 5.0), ("denser", 0.0)] {
        let layers = |step: usize| {
            let (vertices, triangles) = icosphere(2.0, [1.0, 0.0, 2.5].into(), 3);
            let n = triangles.len();
            let triangles = (0..n).map(|i| triangles[i * step % n]).collect();
            let lump = Shape::Mesh(Mesh { vertices, triangles }.into());
            let objects = vec![object(Shape::Slab { top, bottom: -50.0 }, "m", 0), object(lump, own, 1)];
            let mut rig = rig(80.0, 9.0, 8.0, 5, 40.0);
            rig.0.specular = Some(Specular::Exclude);
            let ports = run(&scene(&media, objects, rig), &json!({"f_x": [0, 0.1], "samples": 20}), 11);
            let bits = ports.values().flat_map(|stack| &stack.layers).flat_map(|layer| layer.data.iter());
            bits.map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        // 1,280 triangles: coprime to their number.
        assert!(layers(1) == layers(7919), "{own} {top}");
    }
}
