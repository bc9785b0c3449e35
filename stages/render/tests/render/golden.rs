//! The bytes of a render belong to the stage's version: whoever changes them raises it.

use serde_json::json;
use turbid_contract::Stage;
use turbid_contract::payload::Shape;
use turbid_render::RenderStage;

use crate::setup::*;

/// FNV-1a over the f32 of all layers of all ports of four scenes: looks by the queue, looks one by one with surfaces, deep
/// paths under roulette, and a fit. On every machine, with every number of threads and every vector width.
#[test]
fn bytes_belong_to_the_version() {
    let media = [("m", medium(0.05, 4.0, 0.8)), ("core", medium(0.3, 3.0, 0.5)), ("pale", medium(0.001, 10.0, 0.7))];
    let slab = || Shape::Slab { top: 0.0, bottom: -50.0 };
    let ball = || Shape::Sphere { diameter: 4.0, center: [1.0, 0.0, -0.5] };
    let block = lambertian(Shape::Box { size: [2.0, 2.0, 1.0], center: [-2.0, 1.0, 0.5] }, 0.7);
    let scenes = [
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(slab(), "m", 0), object(ball(), "m", 1), block],
        vec![object(slab(), "pale", 0)],
        vec![object(slab(), "core", 0)],
    ];
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    for objects in scenes {
        let scene = scene(&media, objects, rig(80.0, 9.0, 8.0, 5, 40.0));
        let params = json!({"f_x": [0, 0.1, 0.2], "orientation_deg": [0, 60], "samples": 20});
        for byte in run(&scene, &params, 11)
            .values()
            .flat_map(|stack| &stack.layers)
            .flat_map(|layer| layer.data.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
        {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    assert_eq!((RenderStage::VERSION, digest), (12, 0xbb7f_b6e4_260e_b010), "digest {digest:#x}");
}
