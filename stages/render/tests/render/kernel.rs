//! The kernel that a render names, and what it says of a faster one; how much work its pilot foresees.

use std::sync::Mutex;

use serde_json::{Value, json};
use turbid_contract::payload::{Aperture, Distortion, Object, Payload, Scene, Shape, Surface};
use turbid_contract::{Ctx, Known, StagePlan, StageRow};
use turbid_render::RenderStage;

use crate::setup::{FLOOR, MemoryHost, input, lambertian, medium, object, rig, scene};

pub fn known(scene: &Scene) -> Known {
    let mut known = Known::default();
    known.insert("scene", scene.clone().into_artifact());
    known
}

fn plan(scene: &Scene, params: &Value) -> StagePlan {
    (StageRow::of::<RenderStage>().prepare)(params).unwrap().plan(&known(scene))
}

/// A slab and so many small balls in it, of five media in turn.
fn balls(count: usize) -> Scene {
    let names = ["b", "c", "d", "e", "f"];
    let media = names.iter().enumerate().map(|(i, name)| (*name, medium(0.2 + 0.1 * i as f64, 4.0, 0.8)));
    let mut media: Vec<_> = std::iter::once(("m", medium(0.1, 5.0, 0.8))).chain(media).collect();
    media.truncate(1 + count);
    let mut objects = vec![object(FLOOR, "m", 0)];
    for i in 0..count {
        let center = [8.0 * (i % 5) as f64 - 16.0, 8.0 * (i / 5) as f64, -5.0];
        objects.push(object(Shape::Sphere { diameter: 6.0, center }, names[i % 5], i as i32 + 1));
    }
    scene(&media, objects, rig(500.0, 35.0, 40.0, 8, 160.0))
}

/// What each limit of the lanes says, on its near side and beyond it.
#[test]
fn the_plan_names_the_kernel_and_what_refused_a_faster_one() {
    let params = json!({"f_x": [0.1], "samples": 64, "method": "path"});
    let [sixteen, seventeen] = [15, 16].map(|n| plan(&balls(n), &params));
    assert_eq!(sixteen.kernel.as_deref(), Some("16 paths abreast in f32, 16 bodies"), "{sixteen:?}");
    assert!(sixteen.refused.is_empty(), "{sixteen:?}");
    assert_eq!(
        seventeen.kernel.as_deref(),
        Some("16 paths abreast in f32, 17 bodies, light connections one by one, starts one by one")
    );
    assert_eq!(seventeen.refused, ["17 bodies (a hole counts as one): f32 lanes hold up to 16"]);

    // A corner is 32 sqrt(2) mm from the middle, 4163 free paths of 92 mm^-1: then the image is held in parts, of 64 along a side up to 5793 mm^-1.
    let wide = |mu_s: f64| {
        let scene =
            scene(&[("m", medium(0.1, mu_s, 0.8))], vec![object(FLOOR, "m", 0)], rig(500.0, 35.0, 64.0, 64, 256.0));
        plan(&scene, &params)
    };
    for mu_s in [90.0, 92.0, 5700.0] {
        let held = wide(mu_s);
        assert_eq!((held.kernel.as_deref(), held.refused.len()), (Some("16 paths abreast in f32, 1 body"), 0));
    }
    let beyond = wide(5900.0);
    assert_eq!(beyond.kernel.as_deref(), Some("one path after the other in f64, 1 body"));
    let said = "the camera sees up to 45.3 mm beside its middle, 267004 mean free paths at mu_s = 5900 mm^-1: f32 lanes hold up to 4096 in each part of an image (a pixel, or a 64th of its sides)";
    assert_eq!(beyond.refused, [said]);

    // Each of these leaves the lanes by another door.
    let mut lens = balls(1);
    lens.projector.as_mut().unwrap().distortion = Some(Distortion { k1: 1e-3, ..Distortion::default() });
    let mut aperture = balls(1);
    aperture.camera.as_mut().unwrap().aperture = Some(Aperture { diameter: 0.1, focus: 500.0 });
    let mut mirror = balls(1);
    let glass =
        Object { medium: None, surface: Surface::Mirror, ..object(Shape::Slab { top: -60.0, bottom: -61.0 }, "m", 7) };
    mirror.objects.insert("z".to_owned(), glass);
    let mut two = balls(1);
    two.media.get_mut("m").unwrap().n = 1.4;
    two.media.get_mut("b").unwrap().n = 1.33;
    let doors = [
        (lens, "the projector's lens distorts"),
        (aperture, "the camera has an aperture"),
        (mirror, "mirrors: f32 lanes hold none"),
        (two, "walls of n = 1.33 and n = 1.4 turn light: f32 lanes hold one index"),
    ];
    for (scene, said) in doors {
        let plan = plan(&scene, &params);
        assert!(plan.refused.iter().any(|refused| refused.starts_with(said)), "{said}: {plan:?}");
    }
    let solved = plan(&balls(0), &json!({"f_x": [0.1], "method": "rte"}));
    assert_eq!(solved.kernel.as_deref(), Some("transport solver for plane waves"));
}

/// Only a run that has a limit asks the clock: one that does not is never stopped by it, however long it takes.
#[test]
fn without_a_limit_nobody_asks_the_clock() {
    let asked = |params: Value| {
        let mut host = MemoryHost::new(1, &[], 1);
        host.patience = Mutex::new(Some(1000));
        StageRow::of::<RenderStage>().run(&params, &input(balls(1)), Ctx::new(&host)).unwrap();
        1000 - host.patience.into_inner().unwrap().expect("it was set")
    };
    assert_eq!(asked(json!({"f_x": [0.1], "samples": 64, "method": "path"})), 0);
    assert!(asked(json!({"f_x": [0.1], "samples": 64, "method": "path", "max_seconds": 1000})) > 0);
}

/// Flights that the pilot foresees against those that the render counts. A pilot holds thousands of paths, whose mean number of flights it knows to
/// some percent; where control variates pay is decided by its own few paths, and that is at most a factor of 2 in the flights.
#[test]
fn the_pilot_foresees_the_flights() {
    let cases = [
        ("half-space, fit", balls(0), json!({"f_x": [0, 0.1], "samples": 256})),
        ("half-space, fit to an error", balls(0), json!({"f_x": [0, 0.1], "target_error": 0.004})),
        ("half-space, pixel by pixel", balls(0), json!({"f_x": [0, 0.1], "samples": 128, "method": "path"})),
        (
            "half-space, pixel by pixel to an error",
            balls(0),
            json!({"f_x": [0.1], "target_error": 0.1, "method": "path"}),
        ),
        ("balls in a slab, beside stand-ins", balls(2), json!({"f_x": [0.1], "samples": 256})),
        ("seventeen bodies", balls(16), json!({"f_x": [0.1], "samples": 128, "method": "path"})),
        (
            "opaque floor",
            scene(&[], vec![lambertian(FLOOR, 0.5)], rig(500.0, 35.0, 40.0, 16, 160.0)),
            json!({"f_x": [0.1], "samples": 64, "method": "path"}),
        ),
        (
            "low absorption",
            scene(&[("m", medium(0.001, 20.0, 0.8))], vec![object(FLOOR, "m", 0)], rig(500.0, 35.0, 20.0, 12, 160.0)),
            json!({"f_x": [0.1], "samples": 64, "method": "path"}),
        ),
        (
            "thin slab",
            scene(
                &[("m", medium(0.01, 10.0, 0.9))],
                vec![object(Shape::Slab { top: 0.0, bottom: -1.0 }, "m", 0)],
                rig(500.0, 35.0, 20.0, 12, 160.0),
            ),
            json!({"f_x": [0.1], "samples": 64, "method": "path"}),
        ),
    ];
    for (name, scene, params) in cases {
        let row = StageRow::of::<RenderStage>();
        let pilot = (row.prepare)(&params)
            .unwrap()
            .pilot(&known(&scene), Ctx::new(&MemoryHost::new(1, &[], 1)))
            .expect("there are paths");
        let host = MemoryHost::new(2, &[], 2);
        row.run(&params, &input(scene.clone()), Ctx::new(&host)).unwrap();
        let counted = host.measures.into_inner().unwrap()["flights"];
        let ratio = pilot.whole / counted;
        assert!((0.5..=2.0).contains(&ratio), "{name}: {:e} flights foreseen, {counted:e} made", pilot.whole);
        // Small beside the whole, unless that is small itself.
        assert!(pilot.done < 0.5 * pilot.whole || pilot.done < 2e6, "{name}: {pilot:?}");
    }
}
