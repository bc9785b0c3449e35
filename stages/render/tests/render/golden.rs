//! The bytes of a render belong to the stage's version: whoever changes them raises it.

use serde_json::json;
use turbid_contract::Stage;
use turbid_contract::payload::{Lamp, Medium, Mesh, Shape, Specular};
use turbid_render::RenderStage;

use crate::patterns::{show, sinusoids};
use crate::setup::*;
use crate::shapes::icosphere;

/// FNV-1a over the f32 of all layers of all ports of eleven scenes: connections by the queue, connections one by one with surfaces, deep
/// paths under roulette, a fit, a mesh in tissue, a boundary that refracts, with something under it, channels that share paths, lamps beside the
/// projector, a pattern of images, light-directed branches in a tube, and a ball that stands out of a slab where both refract. On every machine, with every number of threads and every vector width.
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
    let lump = Shape::Mesh(Mesh { vertices, triangles }.into());
    let sunk = Shape::Sphere { diameter: 2.0, center: [1.0, 0.0, -2.0] };
    let slab = || Shape::Slab { top: 0.0, bottom: -50.0 };
    let ball = || Shape::Sphere { diameter: 4.0, center: [1.0, 0.0, -0.5] };
    let tube = Shape::Tube { inner_diameter: 4.0, outer_diameter: 20.0, center: [0.0, 0.0], bottom: -30.0, top: 0.0 };
    let block = lambertian(Shape::Box { size: [2.0, 2.0, 1.0], center: [-2.0, 1.0, 0.5] }, 0.7);
    let scenes = [
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(slab(), "m", 0), object(ball(), "m", 1), block],
        vec![object(slab(), "pale", 0)],
        vec![object(slab(), "core", 0)],
        vec![object(slab(), "m", 0), object(lump, "core", 1)],
        vec![object(slab(), "dense", 0), object(sunk, "denser", 1)],
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(slab(), "m", 0), object(ball(), "core", 1)],
        vec![object(tube, "m", 0)],
        vec![object(slab(), "dense", 0), object(ball(), "denser", 1)],
    ];
    let [coloured, lamp_lit, pictured] = [6, 7, 8];
    let mut digests = Vec::new();
    for (i, objects) in scenes.into_iter().enumerate() {
        let mut rig = rig(80.0, 9.0, 8.0, 5, 40.0);
        rig.0.specular = Some(Specular::Exclude);
        let mut scene = scene(&media, objects, rig);
        if i == coloured {
            scene.wavelengths_nm = vec![530.0, 635.0];
            for m in scene.media.values_mut() {
                (m.mu_a, m.mu_s) = (vec![m.mu_a[0], 0.4 * m.mu_a[0]], vec![m.mu_s[0]; 2]);
            }
            scene.projector.as_mut().unwrap().power = vec![5.0, 2.0];
        }
        if i == lamp_lit {
            let (position, power) = ([6.0, -3.0, 30.0], vec![0.5]);
            let look_at = [1.0, 0.0, 0.0];
            let lamps = [
                Lamp::Point { position, power: power.clone() },
                Lamp::Spot { position, look_at, angle_deg: 8.0, power: power.clone() },
                Lamp::Collimated { position, look_at, diameter: 3.0, power },
                Lamp::Ambient { radiance: vec![1e-4] },
            ];
            scene.lights = lamps.into_iter().enumerate().map(|(i, lamp)| (format!("l{i}"), lamp)).collect();
        }
        let params = json!({"f_x": [0, 0.1, 0.2], "orientation_deg": [0, 60], "samples": 20});
        let ports = if i == pictured {
            show(&scene, &sinusoids(40.0, 64, 0.1), &json!({"samples": 20}), 11).expect("it fits the projector")
        } else {
            run(&scene, &params, 11)
        };
        let mut digest = 0xcbf2_9ce4_8422_2325_u64;
        for byte in ports
            .values()
            .flat_map(|stack| &stack.layers)
            .flat_map(|layer| layer.data.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
        {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        digests.push(digest);
    }
    let expected = [
        0x5241_4568_261b_9cf2,
        0x4f75_c814_382e_fd3b,
        0x2d02_54e0_af65_0468,
        0xbcb8_1ce2_c345_6e32,
        0xe0f8_3e9f_503f_d50d,
        0x2e09_a90a_78c5_efd1,
        0xf066_d97d_b1af_c6fb,
        0xbbd8_5235_26a7_1f78,
        0x827a_6989_0e9b_515d,
        0x72f2_011b_3dcc_5b00,
        0x4455_251c_06d7_6081,
    ];
    assert_eq!((RenderStage::VERSION, &digests[..]), (33, &expected[..]), "digests {digests:#x?}");
}
