//! The stage as the engine calls it: what it makes of good parameters, and what it says of wrong ones.

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Lamp, Motif, Outline, Payload, Scene, Shape, Surface, Texture};
use turbid_contract::{Artifact, Ctx, Error, Known, MemoryHost, Problem, Problems, StageRow};
use turbid_scene::SceneStage;

mod chromophores;
mod doubts;
mod mistakes;
mod random;
mod rig;

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
    assert_eq!((prepared.files()[0].at.as_str(), prepared.files()[0].path.as_str()), (at, "a/dots.png"));
    assert_eq!(
        prepared.canonical().unwrap().pointer("/objects/tissue/surface/lambertian/image/file"),
        Some(&json!("dots.png"))
    );
    let host = MemoryHost { files: [(at.to_owned(), DOT.into())].into(), ..MemoryHost::default() };
    let scene = Scene::from_artifact(row.run(&params, &Inputs::none(), Ctx::new(&host)).unwrap().remove(0).1).unwrap();
    let Surface::Textured(Texture { motif: Motif::Image { picture, size }, .. }) = &scene.objects["tissue"].surface
    else {
        panic!("an image")
    };
    assert_eq!((picture.grey.as_slice(), *size), (&[257 * 128][..], Some([4.0, 4.0])));
    assert_eq!(Scene::from_artifact(scene.clone().into_artifact()).unwrap(), scene);
    let host = MemoryHost { files: [(at.to_owned(), b"solid".as_slice().into())].into(), ..MemoryHost::default() };
    let Err(Error::Invalid(problem)) = row.run(&params, &Inputs::none(), Ctx::new(&host)) else { panic!("no PNG") };
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
    StageRow::of::<SceneStage>().check(params, &Known::default(), &mut problems);
    problems.into_parts()
}

fn run(params: &Value, wanted: &[&str]) -> Vec<(&'static str, Artifact)> {
    let host = MemoryHost { wanted: wanted.iter().map(|&w| w.to_owned()).collect(), ..MemoryHost::default() };
    StageRow::of::<SceneStage>().run(params, &Inputs::none(), Ctx::new(&host)).unwrap()
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

/// Two terms stand in the place of g, in the record too; mu_s' is mu_s (1 - mean cosine), 0.95 x 0.9 - 0.05 x 0.3 = 0.84. A medium of one g keeps its record.
#[test]
fn two_terms_stand_in_the_place_of_g() {
    let terms = json!({"g_forward": 0.9, "g_backward": "-30 %", "forward": 0.95});
    let two =
        scene(&with("/media/scc", json!({"mu_a": 0.12, "mu_s_prime": 0.64, "phase": {"two_term": terms}, "n": 1})));
    assert!((two.media["scc"].mu_s[0] - 4.0).abs() < 1e-12, "{:?}", two.media["scc"]);
    assert_eq!(
        serde_json::to_value(&two.media["scc"]).unwrap(),
        json!({"mu_a": [0.12], "mu_s": [4.0], "two_term": {"g_forward": 0.9, "g_backward": -0.3, "forward": 0.95}, "n": 1.0})
    );
    assert_eq!(Scene::from_artifact(two.clone().into_artifact()).unwrap(), two);
    let one = serde_json::to_string(&scene(&carcinoma()).media["healthy"]).unwrap();
    assert_eq!(one, r#"{"mu_a":[0.025],"mu_s":[4.236],"g":0.8,"n":1.0}"#);
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

/// The sketch shows tissue and polyp in their colours, and is made only when wanted.
#[test]
fn the_sketch_shows_the_objects() {
    let ports = run(&carcinoma(), &["preview"]);
    assert_eq!(ports.iter().map(|p| p.0).collect::<Vec<_>>(), ["scene", "preview"]);
    let Artifact::Images(stack) = &ports[1].1 else { panic!("the sketch is no image") };
    let names: Vec<&str> = stack.layers.iter().map(|l| l.info.name.as_str()).collect();
    assert_eq!(names, ["red", "green", "blue"]);
    let mut colours: Vec<[u32; 3]> = (0..stack.rows())
        .flat_map(|r| (0..stack.columns()).map(move |c| (r, c)))
        .map(|at| [0, 1, 2].map(|k| stack.layers[k].data[at].to_bits()))
        .collect();
    colours.sort_unstable();
    colours.dedup();
    // White behind the titles, paper, gap, the bar of the scale, the line of the cut, camera, projector, two objects and their outlines.
    assert_eq!(colours.len(), 11);
    let said = |name: &str| -> Vec<String> {
        let entries = stack.attributes[name].as_array().unwrap();
        entries.iter().filter_map(|e| e["text"].as_str()).map(str::to_owned).collect()
    };
    assert_eq!(
        said("legend"),
        [
            "polyp (scc)",
            "tissue (healthy)",
            "camera and what it sees: 64 x 64 mm, 500 mm away",
            "projector and what it lights: 128 x 128 mm, 501.2 mm away",
            "dotted from above: the plane of the set-up",
            "dashed: outlines of what lies below the surface, or off the plane"
        ]
    );
    // The whole set-up (540 mm, from the polyp's foot to the camera), the field of the camera (64 mm) and that of the projector (128 mm) with a margin of
    // 5 % on either side; a bar is the longest round length within a third of that.
    assert_eq!(
        said("labels"),
        [
            "set-up to scale, along y (camera to projector), z up",
            "100 mm",
            "camera",
            "projector",
            "inset: the framed part of it",
            "20 mm",
            "healthy",
            "scc",
            "from above: x to the right, y up",
            "20 mm"
        ]
    );
    assert_eq!(run(&carcinoma(), &[]).len(), 1);
}

const SKETCH_PANEL: usize = 360;

/// The sketch of params as rows of colours, and its legend.
fn sketched(params: &Value) -> (Vec<Vec<[f32; 3]>>, String) {
    let ports = run(params, &["preview"]);
    let Artifact::Images(stack) = &ports[1].1 else { panic!("the sketch is no image") };
    let pixel = |r: usize, c: usize| [0, 1, 2].map(|k| stack.layers[k].data[(r, c)]);
    let rows = (stack.rows() - SKETCH_PANEL..stack.rows())
        .map(|r| (0..stack.columns()).map(|c| pixel(r, c)).collect())
        .collect();
    (rows, stack.attributes["legend"].to_string())
}

/// From above and in the inset a thing is as wide, in as many pixels as the bar says: the lesion of 30 x 30 x 10 mm under 128 and 64 mm of
/// field. It lies below the surface, so that dashes of its outline are all that is seen of it from above; in the inset they are around it.
#[test]
fn what_lies_below_the_surface_is_outlined() {
    let lesion = json!({"spheroid": {"diameters": [30, 30, 10], "center": [0, 0, -8]}, "medium": "scc", "priority": 1});
    let (rows, legend) = sketched(&with("/objects/polyp", lesion));
    assert!(legend.contains("dashed"), "{legend}");
    let (tissue, lesion) = ([0.60, 0.80, 0.93], [0.93, 0.75, 0.73]);
    let shade = lesion.map(|c: f32| 0.45 * c);
    let columns = |colour: [f32; 3], panel: usize| -> Vec<usize> {
        let left = panel * (SKETCH_PANEL + 8);
        let has = |&c: &usize| rows.iter().any(|row| row[left + c] == colour);
        (0..SKETCH_PANEL).filter(has).collect()
    };
    let width = |columns: &[usize]| columns[columns.len() - 1] - columns[0] + 1;
    // 140.8 and 70.4 mm on 360 pixels.
    let expected = 30.0 / 140.8 * 360.0;
    let (above, inset) = (columns(shade, 2), [columns(shade, 1), columns(lesion, 1)].concat());
    let inset = inset.iter().max().unwrap() - inset.iter().min().unwrap() + 1;
    assert!((inset as f64 - 2.0 * expected).abs() < 1.5, "{inset} of {} pixels", 2.0 * expected);
    // Dashes of 4 pixels may leave the outermost ones out.
    assert!((width(&above) as f64 - expected).abs() < 5.0, "{} of {expected} pixels", width(&above));
    assert!(columns(lesion, 2).is_empty() && columns(tissue, 2).len() == SKETCH_PANEL, "it is seen from above");
    let dashes = |panel: usize| {
        let of_row = |row: &Vec<[f32; 3]>| row[panel * (SKETCH_PANEL + 8)..][..SKETCH_PANEL].to_vec();
        rows.iter().flat_map(of_row).filter(|c| *c == shade).count() as f64
    };
    let outline = std::f64::consts::PI * expected;
    assert!(dashes(2) > 0.3 * outline && dashes(2) < 0.9 * outline, "{} pixels of an outline of {outline}", dashes(2));
    // Two pixels thick, of an ellipse of 30 x 10 mm.
    let outline = 2.0 * 66.8 / 70.4 * 360.0;
    assert!(dashes(1) > 0.3 * outline && dashes(1) < 0.9 * outline, "{} pixels of an outline of {outline}", dashes(1));
}

/// Camera and projector stand apart in the section wherever they stand around each other.
#[test]
fn the_section_holds_camera_and_projector() {
    let (camera, projector) = ([0.05, 0.25, 0.75], [0.85, 0.45, 0.0]);
    for position in [[0, 35, 500], [35, 0, 500], [-25, 25, 500]] {
        let (rows, _) = sketched(&with("/projector/position", json!(position)));
        // Crosses in the panel of the whole set-up: arms of 11 x 5 pixels.
        let middle = |colour: [f32; 3]| {
            let bar = |c: &usize| (0..60).any(|r| (0..11).all(|k| rows[r + k][*c] == colour));
            let columns: Vec<usize> = (0..SKETCH_PANEL).filter(bar).collect();
            assert!(!columns.is_empty(), "no cross of {colour:?} for {position:?}");
            columns.iter().sum::<usize>() as f64 / columns.len() as f64
        };
        let apart = (middle(projector) - middle(camera)).abs();
        // 35 mm at 594 mm on 360 pixels; one cross lies over the other's arm.
        assert!((apart - 35.2 / 594.0 * 360.0).abs() < 2.5, "{apart} pixels apart for {position:?}");
    }
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
