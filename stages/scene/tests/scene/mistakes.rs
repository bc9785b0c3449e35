//! What the stage refuses, and what it lets pass.

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::{Ctx, Error, MemoryHost, StageRow};
use turbid_scene::SceneStage;

use crate::{carcinoma, check, with};

/// Each mistake: where it stands, and words that the message or the way out must have.
#[test]
fn mistakes_are_named() {
    let terms = json!({"g_forward": 0.9, "g_backward": -0.3, "forward": 0.95});
    let two_term = |field: &str, value: Value| {
        let mut params = with("/media/scc/g", Value::Null);
        let mut terms = terms.clone();
        match value {
            Value::Null => drop(terms.as_object_mut().unwrap().remove(field)),
            value => terms[field] = value,
        }
        params["media"]["scc"]["phase"] = json!({"two_term": terms});
        params
    };
    let two = |second: Value| {
        let mut p = carcinoma();
        p["objects"] = json!({"a": {"box": {"size": [4, 4, 4], "center": [0, 0, 0]}, "medium": "scc"}, "b": second});
        p
    };
    let two_camera = |projection: &str, more: Value| {
        let mut params = with("/camera/projection", json!(projection));
        let camera = params["camera"].as_object_mut().unwrap();
        camera.extend(more.as_object().unwrap().clone());
        params
    };
    let light = |lamp: Value| with("/lights", json!({"lamp": lamp}));
    let wrapped = |albedo: Value| with("/objects/tissue/surface", json!({"lambertian": albedo}));
    let disc = |key: &str, value: Value| {
        let mut disc = json!({"position": [0, 0, 100], "look_at": [0, 0, 0], "diameter": 10});
        disc[key] = value;
        with("/detectors", json!({"eye": {"disc": disc}}))
    };
    let face = |size: Value, up: Value| {
        let face = json!({"position": [0, 0, 100], "look_at": [0, 0, 0], "size": size, "up": up});
        with("/detectors", json!({"eye": {"rectangle": face}}))
    };
    let table: Vec<(Value, &str, &[&str])> = vec![
        (with("/media/healthy/A_rho", json!(-3)), "media.healthy.A_rho", &["A_rho = -3 m^-1", ">= 0"]),
        (with("/media/scc/mu_s_prime", json!(-0.5)), "media.scc.mu_s_prime", &["-0.5 mm^-1", ">= 0"]),
        (with("/media/scc/g", json!(1)), "media.scc.g", &["g = 1", "(-1, 1)"]),
        (with("/media/scc/g", json!(-1.5)), "media.scc.g", &["g = -1.5"]),
        (with("/media/scc/g", Value::Null), "media.scc.g", &["`g` is missing", "two_term"]),
        (with("/media/scc/phase", json!({"two_term": terms})), "media.scc.phase", &["beside `g`"]),
        (two_term("g_forward", json!(1)), "media.scc.phase.two_term.g_forward", &["g_forward = 1", "(-1, 1)"]),
        (two_term("g_backward", json!(-1)), "media.scc.phase.two_term.g_backward", &["g_backward = -1", "(-1, 1)"]),
        (two_term("g_backward", json!(0.9)), "media.scc.phase.two_term.g_backward", &["less than g_forward = 0.9"]),
        (two_term("forward", json!(1)), "media.scc.phase.two_term.forward", &["forward = 1", "(0, 1)", "`g`"]),
        (two_term("forward", json!(95)), "media.scc.phase.two_term.forward", &["forward = 95", "95 %"]),
        (two_term("forward", Value::Null), "media.scc.phase.two_term", &["`forward` is missing"]),
        (with("/media/scc/n", Value::Null), "media.scc", &["`n` is missing"]),
        (with("/media/scc/n", json!(0.9)), "media.scc.n", &["n = 0.9"]),
        (with("/media/scc/mu_q", json!(1)), "media.scc.mu_q", &["there is no key `mu_q`", "did you mean `mu_a`?"]),
        (with("/media/scc/mu_a", json!("0.1 mm")), "media.scc.mu_a", &["dimension length", "inverse length"]),
        (with("/media/scc/mu_a", Value::Null), "media.scc", &["exactly one pair", "mu_s_prime"]),
        (with("/media/scc/A_rho", json!(1)), "media.scc", &["exactly one pair"]),
        (with("/media/scc/mu_a", json!([0.1, 0.2])), "media.scc.mu_a", &["2 values", "wavelength_nm"]),
        (wrapped(json!(1.5)), "objects.tissue.surface.lambertian", &["1.5", "[0, 1]"]),
        (wrapped(json!("half")), "objects.tissue.surface.lambertian", &["\"half\""]),
        (
            wrapped(json!({"stripe": {}})),
            "objects.tissue.surface.lambertian.stripe",
            &["there is no choice `stripe`", "did you mean `stripes`?"],
        ),
        (
            wrapped(json!({"stripes": {"period": 2, "wide": 1}})),
            "objects.tissue.surface.lambertian.stripes.wide",
            &["there is no key `wide`", "known: `period`"],
        ),
        (
            wrapped(json!({"sinusoid": {"period": 0}})),
            "objects.tissue.surface.lambertian.sinusoid.period",
            &["period = 0 mm", "> 0"],
        ),
        (
            wrapped(json!({"checker": {"side": 1, "high": 1.2}})),
            "objects.tissue.surface.lambertian.checker.high",
            &["1.2", "[0, 1]"],
        ),
        (
            wrapped(json!({"image": {"file": "a.png"}})),
            "objects.tissue.surface.lambertian.image",
            &["no bounds sideways", "size"],
        ),
        (with("/wavelength_nm", json!([500, 500])), "wavelength_nm.1", &["500 nm", "twice"]),
        (with("/wavelength_nm", json!([-5])), "wavelength_nm.0", &["-5 nm", "> 0"]),
        (with("/objects", json!({})), "objects", &["no object"]),
        (
            with("/objects/tissue/medium", json!("heathy")),
            "objects.tissue.medium",
            &["`heathy`", "did you mean `healthy`"],
        ),
        (
            with("/objects/tissue/medium", json!("bone")),
            "objects.tissue.medium",
            &["`bone`", "known: `healthy`, `scc`"],
        ),
        (with("/objects/tissue/medium", Value::Null), "objects.tissue.medium", &["has no medium"]),
        (
            with("/objects/tissue/slab/thickness", json!(0)),
            "objects.tissue.slab.thickness",
            &["thickness = 0 mm", "> 0"],
        ),
        (with("/objects/polyp/spheroid/diameters/2", json!(-80)), "objects.polyp.spheroid.diameters.2", &["-80 mm"]),
        (with("/objects/polyp/spheroid/diameters", json!([1, 2])), "objects.polyp.spheroid.diameters", &["2 values"]),
        (with("/objects/tissue/slab/center", json!([1, 2])), "objects.tissue.slab.center", &["infinite", "size"]),
        (with("/objects/tissue/slab", Value::Null), "objects.tissue", &["no shape", "spheroid"]),
        (
            with("/objects/tissue/sphere", json!({"diameter": 1, "center": [0, 0, 0]})),
            "objects.tissue",
            &["more than one shape"],
        ),
        (with("/objects/tissue/cone", json!({})), "objects.tissue.cone", &["there is no key `cone`", "`spheroid`"]),
        (with("/objects/tissue/surface", json!("mirror")), "camera.specular", &["is a mirror"]),
        (
            with("/objects/tissue/surface", json!({"lambertian": 1.5})),
            "objects.tissue.surface.lambertian",
            &["1.5", "[0, 1]"],
        ),
        (
            with("/objects/polyp/priority", json!(0)),
            "objects.tissue",
            &["polyp and tissue overlap", "priority 0", "higher"],
        ),
        (
            two(json!({"box": {"size": [4, 4, 4], "center": [3.9, 0, 0]}, "medium": "scc"})),
            "objects.b",
            &["a and b overlap"],
        ),
        (light(json!({"moon": {}})), "lights.lamp", &["moon", "`ambient`"]),
        (disc("diameter", json!(0)), "detectors.eye.disc.diameter", &["0 mm", "> 0"]),
        (disc("look_at", json!([0, 0, 100])), "detectors.eye.disc.look_at", &["own position"]),
        (disc("half_angle_deg", json!(91)), "detectors.eye.disc.half_angle_deg", &["91 deg", "(0, 90]"]),
        (face(json!([1, -1]), json!([0, 1, 0])), "detectors.eye.rectangle.size.1", &["-1 mm", "> 0"]),
        (face(json!([1, 1]), json!([0, 0, 1])), "detectors.eye.rectangle.up", &["up vector", "[0, 0, 1]"]),
        (light(json!({"point": {"power": 1}})), "lights.lamp.point", &["position"]),
        (light(json!({"point": {"position": [0, 0, 9], "power": 0}})), "lights.lamp.point.power", &["0 W", "> 0"]),
        (
            light(json!({"point": {"position": [0, 0, 9], "power": 1}})),
            "lights.lamp.point.position",
            &["light lamp", "inside the solid polyp"],
        ),
        (
            light(json!({"point": {"position": [0, 0, 90], "power": [1, 2]}})),
            "lights.lamp.point.power",
            &["names no wavelengths"],
        ),
        (
            light(json!({"spot": {"position": [0, 0, 90], "look_at": [0, 0, 90], "angle_deg": 360, "power": 1}})),
            "lights.lamp.spot.look_at",
            &["own position"],
        ),
        (
            light(json!({"spot": {"position": [0, 0, 90], "look_at": [0, 0, 0], "angle_deg": 360, "power": 1}})),
            "lights.lamp.spot.angle_deg",
            &["360 deg", "full angle"],
        ),
        (
            light(json!({"collimated": {"position": [0, 0, 90], "look_at": [0, 0, 0], "diameter": -1, "power": 1}})),
            "lights.lamp.collimated.diameter",
            &["-1 mm", "> 0"],
        ),
        (
            light(json!({"collimated": {"position": [50, 0, 9], "look_at": [50, 9, 9], "diameter": 20, "power": 1}})),
            "lights.lamp.collimated.position",
            &["rim", "inside the solid tissue"],
        ),
        (light(json!({"ambient": {"radiance": -2}})), "lights.lamp.ambient.radiance", &["W mm^-2 sr^-1", "> 0"]),
        (
            two(json!({"cylinder": {"diameter": 2, "length": 9, "center": [2.5, 0, 0], "axis": "x"}, "medium": "scc"})),
            "objects.b",
            &["a and b overlap"],
        ),
        (
            two(json!({"tube": {"inner_diameter": 5.6, "outer_diameter": 9, "length": 1, "top": 0}, "medium": "scc"})),
            "objects.b",
            &["a and b overlap"],
        ),
        (
            two(json!({"cylinder": {"diameter": 0, "length": 9, "center": [0, 0, 0]}, "medium": "scc"})),
            "objects.b.cylinder.diameter",
            &["diameter = 0 mm", "> 0"],
        ),
        (
            two(
                json!({"cylinder": {"diameter": 1, "length": 9, "center": [0, 0, 0], "axis": [0, 0, 0]}, "medium": "scc"}),
            ),
            "objects.b.cylinder.axis",
            &["no direction", "not zero"],
        ),
        (
            two(json!({"cylinder": {"diameter": 1, "length": 9, "center": [0, 0, 0], "axis": "up"}, "medium": "scc"})),
            "objects.b.cylinder.axis",
            &["`up` is no direction"],
        ),
        (
            two(json!({"tube": {"inner_diameter": 9, "outer_diameter": 9, "length": 1, "top": 0}, "medium": "scc"})),
            "objects.b.tube.outer_diameter",
            &["outer_diameter = 9 mm must be > inner_diameter = 9 mm", "thickness"],
        ),
        (
            two(json!({"sphere_shell": {"inner_diameter": 50, "wall": 0}, "surface": {"lambertian": 0.9}})),
            "objects.b.sphere_shell.wall",
            &["wall = 0 mm", "> 0"],
        ),
        (
            two(json!({
                "sphere_shell": {"inner_diameter": 50, "wall": 5, "ports": [{"square": {"direction": "z", "side": 40}}]},
                "surface": {"lambertian": 0.9},
            })),
            "objects.b.sphere_shell.ports.0.square.side",
            &["side = 40 mm", "not narrower", "50 mm"],
        ),
        (with("/camera/pixels", json!([0, 64])), "camera.pixels.0", &["pixels = 0", ">= 1"]),
        (with("/camera/pixels", json!([100_000, 100_000])), "camera.pixels", &["10000000000 pixels"]),
        (with("/camera/field", json!([64, 0])), "camera.field.1", &["0 mm", "> 0"]),
        (with("/camera/aperture", json!(0)), "camera.aperture", &["aperture = 0 mm", "> 0"]),
        (with("/camera/focus", json!(400)), "camera.focus", &["400 mm", "through a pinhole", "aperture"]),
        (with("/camera/projection", json!("wide")), "camera.projection", &["wide", "`fisheye`"]),
        (with("/camera/distortion", json!({"k4": 1})), "camera.distortion.k4", &["k4", "did you mean `k1`?"]),
        // The corner lies at 45 / 500: r (1 - 50 r^2) has its fold at 0.082, where the image's radius is 0.054.
        (with("/camera/distortion", json!({"k1": -50})), "camera.distortion", &["folds", "smaller"]),
        (with("/projector/distortion", json!({"k1": -30})), "projector.distortion", &["folds the projector's image"]),
        (two_camera("fisheye", json!({"aperture": 2})), "camera.aperture", &["pinhole"]),
        (two_camera("orthographic", json!({"distortion": {"k1": 0.1}})), "camera.distortion", &["pinhole"]),
        (two_camera("fisheye", json!({"field": [3000, 2000]})), "camera.field", &["pi rad"]),
        (
            two_camera("orthographic", json!({"position": [0, 25, 30], "look_at": [0, 0, 20], "field": [10, 64]})),
            "camera.position",
            &["inside the solid"],
        ),
        (with("/camera/position", json!([0, 0, -5])), "camera.position", &["inside the solid polyp", "carve"]),
        (with("/camera/position", json!([0, 0, 0])), "camera.look_at", &["own position"]),
        (with("/camera/position", json!([500, 0, 0])), "camera.position", &["plane z = 0 mm"]),
        (with("/camera/up", json!([0, 0, 1])), "camera.up", &["along its up vector", "[0, 1, 0]"]),
        (with("/camera/up", json!([0, 0, 0])), "camera.up", &["along its up vector"]),
        (with("/camera/specular", json!("some")), "camera.specular", &["some", "`exclude`"]),
        (with("/projector/position", json!([100, 0, -1000])), "projector.position", &["inside the solid tissue"]),
        (with("/projector/power", json!(0)), "projector.power", &["power = 0 W", "> 0"]),
        (with("/projector/power", json!("5 mm")), "projector.power", &["dimension length", "power"]),
        (with("/projector/profile", json!("round")), "projector.profile", &["round", "`uniform_intensity`, `flat`"]),
        (with("/projector/pixels", json!([0, 1])), "projector.pixels.0", &["pixels = 0"]),
        (with("/projector/look_at", json!([0, 35, 900])), "projector.look_at", &["lights nothing"]),
        (with("/media/healthy/n", json!(1.4)), "camera.specular", &["tissue has n != 1", "exclude"]),
    ];
    let mut lacking = Vec::new();
    for (params, path, words) in table {
        let (mistakes, _) = check(&params);
        let found = mistakes.iter().find(|m| m.path == path);
        let Some(found) = found else { panic!("nothing at {path}, but {mistakes:?}") };
        let text = found.to_string();
        if !words.iter().all(|w| text.contains(w)) {
            lacking.push(format!("{path}: `{text}` lacks one of {words:?}"));
        }
        let run = StageRow::of::<SceneStage>().run(&params, &Inputs::none(), Ctx::new(&MemoryHost::default()));
        assert!(matches!(run, Err(Error::Invalid(_))), "{path}: ran all the same");
    }
    assert!(lacking.is_empty(), "{lacking:#?}");
}

#[test]
fn legal_oddities_are_accepted() {
    let touching = {
        let mut p = carcinoma();
        p["objects"] = json!({
            "left": {"slab": {"thickness": 100, "top": 0, "size": [50, 100], "center": [-25, 0]}, "medium": "healthy"},
            "right": {"slab": {"thickness": 100, "top": 0, "size": [50, 100], "center": [25, 0]}, "medium": "scc"},
            "ball": {"sphere": {"diameter": 3, "center": [0, 0, 1.5]}, "surface": {"lambertian": 1}},
        });
        p
    };
    let carved = {
        let mut p = with("/camera/position", json!([0, 0, -50]));
        p["media"]["air"] = json!({"mu_a": 0, "mu_s": 0, "g": 0, "n": 1});
        p["camera"]["look_at"] = json!([0, 0, -60]);
        p["objects"]["hole"] =
            json!({"sphere": {"diameter": 9, "center": [0, 0, -50]}, "medium": "air", "priority": 2});
        p
    };
    let refracting = {
        let mut p = with("/media/healthy/n", json!(1.4));
        p["camera"]["specular"] = json!("exclude");
        p
    };
    // A rod fills the bore of a tube to its wall, a ball lies in a hollow sphere, a turned box lies on one face.
    let fitting = {
        let mut p = carcinoma();
        p["objects"] = json!({
            "tissue": {"tube": {"inner_diameter": 8, "outer_diameter": 20, "length": 100, "top": 0}, "medium": "healthy"},
            "rod": {"cylinder": {"diameter": 8, "length": 100, "center": [0, 0, -50]}, "medium": "scc"},
            "cap": {"sphere_shell": {"inner_diameter": 4, "wall": 1, "center": [30, 0, 3]}, "surface": {"lambertian": 1}},
            "ball": {"sphere": {"diameter": 4, "center": [30, 0, 3]}, "medium": "scc"},
            "block": {"box": {"size": [4, 4, 4], "center": [-30, 0, 2], "rotation_deg": [0, 0, 30]}, "medium": "scc"},
            "floor": {"box": {"size": [30, 60, 1], "center": [-30, 0, -0.5]}, "medium": "healthy"},
            "across": {"cylinder": {"diameter": 2, "length": 5, "center": [-30, 0, 5], "axis": [1, 1, 0]}, "medium": "scc"},
        });
        p
    };
    for params in [touching, carved, refracting, fitting, with("/camera", Value::Null), with("/projector", Value::Null)]
    {
        let (mistakes, _) = check(&params);
        assert!(mistakes.is_empty(), "{mistakes:?}");
    }
    let (mistakes, warnings) = check(&with("/camera/look_at", json!([0, 0, 600])));
    assert!(mistakes.is_empty() && warnings[0].path == "camera.look_at", "{mistakes:?} {warnings:?}");
}
