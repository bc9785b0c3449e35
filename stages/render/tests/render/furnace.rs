//! A furnace: under an even sky of radiance 1 whatever absorbs nothing is as bright as the sky. What rough walls lose between their facets is missing, and said.

use serde_json::json;
use turbid_contract::payload::{Lamp, Medium, Object, Scene, Shape, Surface};
use turbid_contract::{Artifact, Cells, Ctx, StageRow};
use turbid_optics::between_facets::{lost_in_furnace, shares, shares_at};
use turbid_render::RenderStage;

use crate::setup::*;

const N: f64 = 1.4;

/// A slab of milk without absorption, so thick that light in it is even; all of the image is it.
fn furnace(surface: Surface, pixels: u32) -> Scene {
    let milk = Medium { n: N, ..medium(0.0, 2.0, 0.0) };
    let slab = Object { surface, ..object(Shape::Slab { top: 0.0, bottom: -10.0 }, "milk", 0) };
    let mut scene = scene(&[("milk", milk)], vec![slab], rig(1000.0, 0.0, 4.0, pixels, 9.0));
    scene.projector = None;
    scene.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![1.0] })].into();
    scene
}

/// The radiance seen straight down falls short of 1 by what the quadrature says: what the wall loses at once, and of what goes in what it loses on
/// the way out. 4 standard errors, and 5 % of the loss, since the light in the slab is not quite even where the wall takes of it. A smooth wall loses nothing, exactly.
#[test]
fn rough_walls_lose_what_the_quadrature_says() {
    let smooth = &run(&furnace(Surface::Smooth, 4), &json!({"f_x": [0], "samples": 64}), 1)["frames"];
    assert!(smooth.find("radiance", None).unwrap().data.iter().all(|&x| (x - 1.0).abs() < 1e-6));
    for alpha in [0.1, 0.3, 0.5, 1.0] {
        let (found, se) = dc(&furnace(Surface::Rough(alpha), 4), 1000, 2);
        let (down, inside) = (shares_at(alpha, [1.0, N], 1.0), shares(alpha, [N, 1.0]));
        let lost = down.lost + down.transmitted * inside.lost / (inside.lost + inside.transmitted);
        println!(
            "alpha {alpha}: {found} +- {se}, expected {}, even light {}",
            1.0 - lost,
            lost_in_furnace(alpha, 1.0, N)
        );
        assert!((found - (1.0 - lost)).abs() < 4.0 * se + 0.05 * lost, "alpha {alpha}: {found} +- {se}, {lost} lost");
    }
}

/// Where a rough wall loses more than 1 % the errors of pixels that see it are unknown, and so is that of the mean; where it loses less, and of what
/// does not see it, they are known.
#[test]
fn errors_are_unknown_where_light_is_lost() {
    let flags = |alpha: f64| {
        let mut scene = furnace(Surface::Rough(alpha), 8);
        // Over three and a half of eight columns lies a sheet of white.
        let sheet = Shape::Box { size: [10.0, 10.0, 1.0], center: [5.25, 0.0, 1.0] };
        scene.objects.insert("sheet".to_owned(), Object { priority: 2, ..lambertian(sheet, 0.9) });
        let frames = &run(&scene, &json!({"f_x": [0], "samples": 16}), 3)["frames"];
        let layer = frames.find("radiance", None).unwrap();
        let flags = frames.se_unknown(&layer.info).map(|l| l.data.iter().filter(|&&x| x == 1.0).count());
        (flags, layer.info.mean_se)
    };
    let (some, mean_se) = flags(0.3);
    assert!(lost_in_furnace(0.3, 1.0, N) > 0.01 && some == Some(5 * 8) && mean_se.is_none(), "{some:?} {mean_se:?}");
    let (none, mean_se) = flags(0.01);
    assert!(lost_in_furnace(0.01, 1.0, N) < 0.01 && none.is_none() && mean_se.is_some(), "{none:?} {mean_se:?}");
}

/// `power` has a row of its own for what is lost between facets; a medium that absorbs nothing has absorbed nothing, with an interval in place of an
/// error of 0; the shares sum to 1. A beam that falls straight down loses what the quadrature says. Without rough walls there is no such row.
#[test]
fn power_says_what_is_lost_between_facets() {
    let photons = 20_000;
    let alpha = 0.5;
    let table = power_table(&beam_on(furnace(Surface::Rough(alpha), 1)), photons, 4);
    let Cells::Text(names) = &table.columns[0].cells else { panic!("names") };
    let at = |name: &str| names.iter().position(|n| n == name).unwrap_or_else(|| panic!("{name} of {names:?}"));
    let (share, se) = (table.f64s("share").unwrap(), table.maybe_f64s("share_se").unwrap());
    let [low, high] = ["share_low", "share_high"].map(|name| table.f64s(name).unwrap());
    let (lost, absorbed) = (at("lost between facets"), at("absorbed in a"));
    assert!((share.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{share:?}");
    assert_eq!((share[absorbed], se[absorbed], low[absorbed]), (0.0, None, 0.0));
    // 1 - 0.025^(1 / n) of nothing.
    assert!((high[absorbed] * f64::from(photons) / 3.689 - 1.0).abs() < 1e-3, "{}", high[absorbed]);
    let (down, inside) = (shares_at(alpha, [1.0, N], 1.0), shares(alpha, [N, 1.0]));
    let expected = down.lost + down.transmitted * inside.lost / (inside.lost + inside.transmitted);
    assert!((share[lost] - expected).abs() < 4.0 * se[lost].unwrap() + 0.05 * expected, "{} {expected}", share[lost]);
    assert!(low[lost] < share[lost] && share[lost] < high[lost]);
    let smooth = power_table(&beam_on(furnace(Surface::Smooth, 1)), 1000, 4);
    let Cells::Text(names) = &smooth.columns[0].cells else { panic!("names") };
    assert!(!names.iter().any(|name| name.contains("facets")), "{names:?}");
}

/// `plan` names the wall, its roughness and what it loses.
#[test]
fn the_plan_says_what_a_wall_loses() {
    use turbid_contract::payload::Payload;
    let mut known = turbid_contract::Known::default();
    let artifact: Artifact = furnace(Surface::Rough(0.3), 4).into_artifact();
    known.insert("scene", artifact);
    let needs = (StageRow::of::<RenderStage>().prepare)(&json!({"f_x": [0], "samples": 4}))
        .unwrap()
        .plan(&known)
        .needs
        .join("; ");
    assert!(needs.contains("alpha = 0.3 loses 2") && needs.contains("unknown"), "{needs}");
}

/// The run says it, too.
#[test]
fn the_run_warns_of_lost_light() {
    let host = MemoryHost::new(1, &[], 2);
    let scene = furnace(Surface::Rough(0.3), 1);
    StageRow::of::<RenderStage>().run(&json!({"f_x": [0], "samples": 2}), &input(scene), Ctx::new(&host)).unwrap();
    let warnings = host.warnings.lock().unwrap();
    assert!(warnings.iter().any(|w| w.contains("between their facets")), "{warnings:?}");
}
