//! The bytes of a render belong to the stage's version: whoever changes them raises it.

use serde_json::json;
use turbid_contract::Stage;
use turbid_contract::payload::{Medium, Mesh, Shape, Specular};
use turbid_render::RenderStage;

use crate::setup::*;
use crate::shapes::icosphere;

/// FNV-1a over the f32 of all layers of all ports of seven scenes: looks by the queue, looks one by one with surfaces, deep
/// paths under roulette, a fit, a mesh in tissue, a boundary that refracts, with something under it, and channels that share paths. On every machine, with every number of threads and every vector width.
#[test]
fn bytes_belong_to_the_version() {
    let media = [
        ("m", medium(0.05, 4.0, 0.8)),
        ("core", medium(0.3, 3.0, 0.5)),
        ("pale", medium(0.001, 10.0, 0.7)),
        ("dense", Medium { n: 1.4, ..medium(0.05, 4.0, 0.8) }),
        ("denser", Medium { n: 1.4, ..medium(0.3, 3.0, 0.5) }),
    ];
    let (vertices, triangles) = icosphere(2.0, [1.0, 0.0, -0.5].into(), 3);
    let lump = Shape::Mesh(Mesh { vertices, triangles });
    let sunk = Shape::Sphere { diameter: 2.0, center: [1.0, 0.0, -2.0] };
    let slab = || Shape::Slab { top: 0.0, bottom: -50.0 };
    let ball = || Shape::Sphere { diameter: 4.0, center: [1.0, 0.0, -0.5] };
    let block = lambertian(Shape::Box { size: [2.0, 2.0, 1.0], center: [-2.0, 1.0, 0.5] }, 0.7);
    let scenes = [
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(slab(), "m", 0), object(ball(), "m", 1), block],
        vec![object(slab(), "pale", 0)],
        vec![object(slab(), "core", 0)],
        vec![object(slab(), "m", 0), object(lump, "core", 1)],
        vec![object(slab(), "dense", 0), object(sunk, "denser", 1)],
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
    ];
    let last = scenes.len() - 1;
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    let mut digests = Vec::new();
    for (i, objects) in scenes.into_iter().enumerate() {
        let mut rig = rig(80.0, 9.0, 8.0, 5, 40.0);
        rig.0.specular = Some(Specular::Exclude);
        let mut scene = scene(&media, objects, rig);
        if i == last {
            scene.wavelengths_nm = vec![530.0, 635.0];
            for m in scene.media.values_mut() {
                (m.mu_a, m.mu_s) = (vec![m.mu_a[0], 0.4 * m.mu_a[0]], vec![m.mu_s[0]; 2]);
            }
            scene.projector.as_mut().unwrap().power = vec![5.0, 2.0];
        }
        let params = json!({"f_x": [0, 0.1, 0.2], "orientation_deg": [0, 60], "samples": 20});
        for byte in run(&scene, &params, 11)
            .values()
            .flat_map(|stack| &stack.layers)
            .flat_map(|layer| layer.data.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
        {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        digests.push(digest);
    }
    // After each scene, so that it shows which of them has changed first.
    let expected = [
        0xf8c6_3282_5ca6_c699,
        0xb989_fa09_7a90_48be,
        0x469e_cff1_8fcd_30a4,
        0x7234_cd9c_6c1b_496b,
        0xf3bb_0c10_ef25_7c0d,
        0x40bf_490a_563b_f900,
        0x8f74_14be_c4df_d303,
    ];
    assert_eq!((RenderStage::VERSION, &digests[..]), (17, &expected[..]), "digests {digests:#x?}");
}
