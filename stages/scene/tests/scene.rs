//! The stage as the engine calls it: what it makes of good parameters, and what it says of wrong ones.

use serde_json::{Value, json};
use turbid_contract::payload::{Lamp, Motif, Outline, Payload, Scene, Shape, Surface, Texture};
use turbid_contract::{Artifact, Axes, Ctx, Error, InputSource, Known, MemoryHost, Problem, Problems, StageRow};
use turbid_scene::SceneStage;

struct NoInputs;

impl InputSource for NoInputs {
    fn one(&self, _: &str) -> Result<Option<Artifact>, Error> {
        Ok(None)
    }
    fn many(&self, _: &str) -> Vec<Axes> {
        Vec::new()
    }
    fn load(&self, port: &str, _: usize) -> Result<Artifact, Error> {
        Err(Error::failed(port))
    }
}

fn carcinoma() -> Value {
    json!({
        "media": {
            "healthy": {"A_rho": 25, "S_rho": 4236, "g": 0.8, "n": 1.0},
            "scc": {"mu_a": 0.12, "mu_s_prime": 0.64, "g": 0.8, "n": 1.0},
        },
        "objects": {
            "tissue": {"slab": {"thickness": 2000, "top": 0}, "medium": "healthy"},
            "polyp": {"spheroid": {"diameters": [40, 40, 80], "center": [0, 0, 0]}, "medium": "scc", "priority": 1},
        },
        "camera": {"position": [0, 0, 500], "look_at": [0, 0, 0], "field": [64, 64], "pixels": [64, 64]},
        "projector": {"position": [0, 35, 500], "look_at": [0, 0, 0], "field": [128, 128], "power": 5},
    })
}

/// `carcinoma` with the value at a JSON pointer replaced, or taken out where `value` is null.
fn with(pointer: &str, value: Value) -> Value {
    let mut params = carcinoma();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let map = params.pointer_mut(parent).unwrap();
    match map {
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
        Value::Object(map) if value.is_null() => drop(map.remove(key)),
        Value::Object(map) => drop(map.insert(key.to_owned(), value)),
        other => panic!("{other}"),
    }
    params
}

/// Textures survive the record, pictures with their values; what means the same gives the same bytes, and a number its old record.
#[test]
fn textures_are_kept() {
    let tissue = |albedo: Value| with("/objects/tissue/surface", json!({"lambertian": albedo}));
    let surface = |params: &Value| scene(params).objects["tissue"].surface.clone();
    let checker = tissue(json!({"checker": {"side": "0.2 cm", "low": "10 %", "origin": [1, -0.0]}}));
    let Surface::Textured(texture) = surface(&checker) else { panic!("a texture") };
    assert_eq!(texture, Texture { low: 0.1, high: 1.0, origin: [1.0, 0.0], motif: Motif::Checker { side: 2.0 } });
    assert_eq!(surface(&tissue(json!("40 %"))), surface(&tissue(json!(0.4))));
    let record = serde_json::to_value(surface(&tissue(json!(0.4)))).unwrap();
    assert_eq!(record, json!({"lambertian": 0.4}));
    let params = tissue(json!({"image": {"file": "a/dots.png", "size": [4, 4]}}));
    let row = StageRow::of::<SceneStage>();
    let prepared = (row.prepare)(&params).unwrap();
    let at = "objects.tissue.surface.lambertian.image.file";
    assert_eq!((prepared.files[0].at.as_str(), prepared.files[0].path.as_str()), (at, "a/dots.png"));
    assert_eq!(prepared.canonical.pointer("/objects/tissue/surface/lambertian/image/file"), Some(&json!("dots.png")));
    let host = MemoryHost { files: [(at.to_owned(), DOT.into())].into(), ..MemoryHost::default() };
    let scene = Scene::from_artifact((row.run)(&params, &NoInputs, Ctx::new(&host)).unwrap().remove(0).1).unwrap();
    let Surface::Textured(Texture { motif: Motif::Image { picture, size }, .. }) = &scene.objects["tissue"].surface
    else {
        panic!("an image")
    };
    assert_eq!((picture.grey.as_slice(), *size), (&[257 * 128][..], Some([4.0, 4.0])));
    assert_eq!(Scene::from_artifact(scene.clone().into_artifact()).unwrap(), scene);
    let host = MemoryHost { files: [(at.to_owned(), b"solid".as_slice().into())].into(), ..MemoryHost::default() };
    let Err(Error::Invalid(problem)) = (row.run)(&params, &NoInputs, Ctx::new(&host)) else { panic!("no PNG") };
    assert!(problem.path == at && problem.message.contains("no PNG"), "{problem}");
}

/// A PNG of one grey pixel, 128.
const DOT: &[u8] = include_bytes!("dot.png");

/// Lights survive the record; a scene without any has the record it had before there were lights.
#[test]
fn lights_are_kept_by_name() {
    let lit = with(
        "/lights",
        json!({
            "sky": {"ambient": {"radiance": 1e-6}},
            "lamp": {"spot": {"position": [0, -100, 200], "look_at": [0, 0, 0], "angle_deg": "0.5 rad", "power": "20 mW"}},
        }),
    );
    let (mistakes, warnings) = check(&lit);
    assert!(mistakes.is_empty() && warnings.is_empty(), "{mistakes:?} {warnings:?}");
    let lit = scene(&lit);
    assert_eq!(lit.lights["sky"], Lamp::Ambient { radiance: vec![1e-6] });
    let Lamp::Spot { angle_deg, ref power, .. } = lit.lights["lamp"] else { panic!("{:?}", lit.lights) };
    assert!((angle_deg - 0.5f64.to_degrees()).abs() < 1e-12 && power == &[0.02]);
    assert_eq!(Scene::from_artifact(lit.clone().into_artifact()).unwrap(), lit);
    let Artifact::Record(record) = scene(&carcinoma()).into_artifact() else { panic!("a record") };
    assert!(!record.fields.contains_key("lights"));
}

/// Detectors survive the record with all that was left out filled in; a scene without any has the record it had before there were any.
#[test]
fn detectors_are_kept_by_name() {
    let watched = with(
        "/detectors",
        json!({
            "eye": {"disc": {"position": [0, 0, 100], "look_at": [0, 0, 0], "diameter": "1 cm", "half_angle_deg": 20}},
            "face": {"rectangle": {"position": [9, 0, 0], "look_at": [0, 0, 0], "size": [4, 2], "absorbs": true}},
        }),
    );
    let watched = scene(&watched);
    let (eye, face) = (&watched.detectors["eye"], &watched.detectors["face"]);
    assert_eq!(
        (eye.outline, eye.facing, eye.half_angle_deg),
        (Outline::Disc { diameter: 10.0 }, [0.0, 0.0, -1.0], 20.0)
    );
    assert_eq!(face.outline, Outline::Rectangle { up: [0.0, 1.0, 0.0], size: [4.0, 2.0] });
    assert!((face.facing, face.half_angle_deg) == ([-1.0, 0.0, 0.0], 90.0) && face.absorbs && !eye.absorbs);
    let Artifact::Record(record) = scene(&carcinoma()).into_artifact() else { panic!("a record") };
    assert!(!record.fields.contains_key("detectors"));
}

fn check(params: &Value) -> (Vec<Problem>, Vec<Problem>) {
    let mut problems = Problems::default();
    (StageRow::of::<SceneStage>().check)(params, &Known::default(), &mut problems);
    problems.into_parts()
}

fn run(params: &Value, wanted: &[&str]) -> Vec<(&'static str, Artifact)> {
    let host = MemoryHost { wanted: wanted.iter().map(|&w| w.to_owned()).collect(), ..MemoryHost::default() };
    (StageRow::of::<SceneStage>().run)(params, &NoInputs, Ctx::new(&host)).unwrap()
}

fn scene(params: &Value) -> Scene {
    Scene::from_artifact(run(params, &[]).remove(0).1).unwrap()
}

#[test]
fn the_carcinoma_scene_is_accepted_and_survives_the_record() {
    let (mistakes, warnings) = check(&carcinoma());
    assert!(mistakes.is_empty() && warnings.is_empty(), "{mistakes:?} {warnings:?}");
    let scene = scene(&carcinoma());
    assert_eq!(scene.media["healthy"].mu_s, [4.236]);
    assert_eq!(scene.objects["tissue"].shape, Shape::Slab { top: 0.0, bottom: -2000.0 });
    assert_eq!(Scene::from_artifact(scene.clone().into_artifact()).unwrap(), scene);
}

/// What means the same gives the same bytes, so that nothing downstream becomes stale.
#[test]
fn equal_meaning_equal_scene() {
    let original = scene(&carcinoma());
    let same = [
        ("/media/healthy", json!({"mu_a": 0.025, "mu_s": 4.236, "g": 0.8, "n": 1})),
        ("/media/healthy", json!({"mu_a": 0.025, "mu_s_prime": 0.8472, "g": 0.8, "n": 1})),
        ("/media/healthy", json!({"A_rho": "0.025 mm^-1", "S_rho": "42.36 cm^-1", "g": "80 %", "n": 1})),
        ("/media/unused", json!({"mu_a": 1, "mu_s": 1, "g": 0, "n": 1.4})),
        ("/objects/tissue/slab/thickness", json!("2 m")),
        ("/objects/polyp/spheroid/center", json!([-0.0, 0, 0])),
        ("/lights", json!({})),
        ("/camera/up", json!([0, 1, 0])),
    ];
    for (pointer, value) in same {
        assert_eq!(scene(&with(pointer, value.clone())), original, "{pointer}: {value}");
    }
    let polyp = |shape: Value| {
        let mut object = json!({"medium": "scc", "priority": 1});
        object.as_object_mut().unwrap().extend(shape.as_object().unwrap().clone());
        scene(&with("/objects/polyp", object))
    };
    let same = [
        [
            json!({"cylinder": {"diameter": 4, "length": 9, "center": [1, 2, 3], "axis": "-x"}}),
            json!({"cylinder": {"diameter": 4, "length": 9, "center": [1, 2, 3], "axis": [2, 0, 0]}}),
        ],
        [
            json!({"box": {"size": [1, 2, 3], "center": [1, 2, 3], "rotation_deg": [0, "-0 deg", 0]}}),
            json!({"box": {"size": [1, 2, 3], "center": [1, 2, 3]}}),
        ],
        [
            json!({"sphere_shell": {"inner_diameter": 9, "wall": 1, "ports": [{"round": {"direction": "z", "diameter": 2}}]}}),
            json!({"sphere_shell": {"inner_diameter": 9, "wall": 1, "center": [0, 0, 0],
                "ports": [{"round": {"direction": [0, 0, 7], "diameter": "2 mm"}}]}}),
        ],
    ];
    for [a, b] in same {
        assert_eq!(polyp(a.clone()), polyp(b), "{a}");
    }
    assert_ne!(scene(&with("/media/healthy/A_rho", json!(25.000001))), original);
    let ball = scene(&with(
        "/objects/polyp",
        json!({"spheroid": {"diameters": [4, 4, 4], "center": [0, 0, 9]}, "medium": "scc"}),
    ));
    assert_eq!(ball.objects["polyp"].shape, Shape::Sphere { diameter: 4.0, center: [0.0, 0.0, 9.0] });
    let block =
        scene(&with("/objects/tissue/slab", json!({"thickness": 8, "top": 1, "size": [60, 70], "center": [5, 6]})));
    assert_eq!(block.objects["tissue"].shape, Shape::Box { size: [60.0, 70.0, 8.0], center: [5.0, 6.0, -3.0] });
}

#[test]
fn channels_broadcast_single_numbers() {
    let mut params = with("/media/healthy", json!({"mu_a": [0.1, 0.2], "mu_s": 5, "g": 0.8, "n": 1}));
    params["wavelength_nm"] = json!([530, "0.635 um"]);
    let scene = scene(&params);
    assert_eq!(scene.wavelengths_nm, [530.0, 635.0]);
    assert_eq!(
        (&scene.media["healthy"].mu_a[..], &scene.media["healthy"].mu_s[..]),
        (&[0.1, 0.2][..], &[5.0, 5.0][..])
    );
}

/// Each mistake: where it stands, and words that the message or the way out must have.
#[test]
fn mistakes_are_named() {
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
        (with("/media/scc/g", Value::Null), "media.scc", &["missing field `g`"]),
        (with("/media/scc/n", Value::Null), "media.scc", &["missing field `n`"]),
        (with("/media/scc/n", json!(0.9)), "media.scc.n", &["n = 0.9"]),
        (with("/media/scc/mu_q", json!(1)), "media.scc.mu_q", &["unknown field `mu_q`", "mu_a"]),
        (with("/media/scc/mu_a", json!("0.1 mm")), "media.scc.mu_a", &["dimension length", "inverse length"]),
        (with("/media/scc/mu_a", Value::Null), "media.scc", &["exactly one pair", "mu_s_prime"]),
        (with("/media/scc/A_rho", json!(1)), "media.scc", &["exactly one pair"]),
        (with("/media/scc/mu_a", json!([0.1, 0.2])), "media.scc.mu_a", &["2 values", "wavelength_nm"]),
        (wrapped(json!(1.5)), "objects.tissue.surface.lambertian", &["1.5", "[0, 1]"]),
        (wrapped(json!("half")), "objects.tissue.surface.lambertian", &["`half`"]),
        (
            wrapped(json!({"stripe": {}})),
            "objects.tissue.surface.lambertian.stripe",
            &["unknown variant `stripe`", "stripes"],
        ),
        (
            wrapped(json!({"stripes": {"period": 2, "wide": 1}})),
            "objects.tissue.surface.lambertian.stripes.wide",
            &["unknown field `wide`"],
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
        (with("/objects/tissue/medium", json!("bone")), "objects.tissue.medium", &["`bone`", "known: healthy, scc"]),
        (with("/objects/tissue/medium", Value::Null), "objects.tissue.medium", &["has no medium"]),
        (
            with("/objects/tissue/slab/thickness", json!(0)),
            "objects.tissue.slab.thickness",
            &["thickness = 0 mm", "> 0"],
        ),
        (with("/objects/polyp/spheroid/diameters/2", json!(-80)), "objects.polyp.spheroid.diameters.2", &["-80 mm"]),
        (with("/objects/polyp/spheroid/diameters", json!([1, 2])), "objects.polyp.spheroid.diameters", &["length"]),
        (with("/objects/tissue/slab/center", json!([1, 2])), "objects.tissue.slab.center", &["infinite", "size"]),
        (with("/objects/tissue/slab", Value::Null), "objects.tissue", &["no shape", "spheroid"]),
        (
            with("/objects/tissue/sphere", json!({"diameter": 1, "center": [0, 0, 0]})),
            "objects.tissue",
            &["more than one shape"],
        ),
        (with("/objects/tissue/cone", json!({})), "objects.tissue.cone", &["unknown field `cone`"]),
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
        (light(json!({"moon": {}})), "lights.lamp", &["moon", "ambient"]),
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
        (with("/camera/projection", json!("wide")), "camera.projection", &["wide", "fisheye"]),
        (with("/camera/distortion", json!({"k4": 1})), "camera.distortion.k4", &["k4", "k3"]),
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
        (with("/camera/specular", json!("some")), "camera.specular", &["some", "exclude"]),
        (with("/projector/position", json!([100, 0, -1000])), "projector.position", &["inside the solid tissue"]),
        (with("/projector/power", json!(0)), "projector.power", &["power = 0 W", "> 0"]),
        (with("/projector/power", json!("5 mm")), "projector.power", &["dimension length", "power"]),
        (with("/projector/profile", json!("round")), "projector.profile", &["round", "uniform_intensity", "flat"]),
        (with("/projector/pixels", json!([0, 1])), "projector.pixels.0", &["pixels = 0"]),
        (with("/projector/look_at", json!([0, 35, 900])), "projector.look_at", &["lights nothing"]),
        (with("/media/healthy/n", json!(1.4)), "camera.specular", &["tissue has n != 1", "exclude"]),
    ];
    for (params, path, words) in table {
        let (mistakes, _) = check(&params);
        let found = mistakes.iter().find(|m| m.path == path);
        let Some(found) = found else { panic!("nothing at {path}, but {mistakes:?}") };
        let text = found.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{path}: `{text}` lacks one of {words:?}");
        let run = (StageRow::of::<SceneStage>().run)(&params, &NoInputs, Ctx::new(&MemoryHost::default()));
        assert!(matches!(run, Err(Error::Invalid(_))), "{path}: ran all the same");
    }
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

/// The sketch shows tissue and polyp in their colours, and is made only when wanted.
#[test]
fn the_sketch_shows_the_objects() {
    let ports = run(&carcinoma(), &["preview"]);
    assert_eq!(ports.iter().map(|p| p.0).collect::<Vec<_>>(), ["scene", "preview"]);
    let Artifact::Images(stack) = &ports[1].1 else { panic!("the preview is no image") };
    let names: Vec<&str> = stack.layers.iter().map(|l| l.info.name.as_str()).collect();
    assert_eq!(names, ["red", "green", "blue"]);
    let mut colours: Vec<[u32; 3]> = (0..stack.rows())
        .flat_map(|r| (0..stack.columns()).map(move |c| (r, c)))
        .map(|at| [0, 1, 2].map(|k| stack.layers[k].data[at].to_bits()))
        .collect();
    colours.sort_unstable();
    colours.dedup();
    // Paper, gap, the bar of the scale, camera, projector, two objects.
    assert_eq!(colours.len(), 7);
    let legend: Vec<&str> =
        stack.attributes["legend"].as_array().unwrap().iter().filter_map(|e| e["text"].as_str()).collect();
    assert_eq!(legend, ["polyp (scc)", "tissue (healthy)", "camera and what it sees", "projector and what it lights"]);
    // A margin of 5 % of 540 mm (the polyp's foot to the camera) on either side: 128 + 54 mm of field are seen from above,
    // 594 mm from the side, and a bar is the longest round length within a third of that.
    let labels = stack.attributes["labels"].as_array().unwrap();
    let labels: Vec<&str> = labels.iter().filter_map(|e| e["text"].as_str()).collect();
    assert_eq!(labels, ["from above", "50 mm", "from the side, cut", "100 mm"]);
    assert_eq!(run(&carcinoma(), &[]).len(), 1);
}

/// The schema is what editors and `turbid stages` show: every field of the grammar is in it.
#[test]
fn the_schema_names_every_field() {
    let schema = (StageRow::of::<SceneStage>().schema)().to_string();
    for field in [
        "A_rho",
        "mu_s_prime",
        "spheroid",
        "sphere_shell",
        "rotation_deg",
        "priority",
        "lambertian",
        "profile",
        "specular",
        "wavelength_nm",
    ] {
        assert!(schema.contains(field), "{field} is missing");
    }
}
