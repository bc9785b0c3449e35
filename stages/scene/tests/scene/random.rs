//! Bodies at random places, random skins, tubes along splines: what becomes of them, and what is refused.

use serde_json::{Value, json};
use turbid_contract::Artifact;
use turbid_contract::payload::Shape;

use crate::{carcinoma, check, run, scene, with};

/// The scene with bodies of the medium scc in its tissue.
fn spots(more: Value) -> Value {
    let mut scatter = json!({"count": 12, "within": {"rect": {"x": [-30, 30], "y": [-20, 20], "depth": {"uniform": [1, 5]}}}, "apart": 2});
    scatter.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    scatter.as_object_mut().unwrap().retain(|_, value| !value.is_null());
    with("/objects/polyp", json!({"scatter": scatter, "medium": "scc", "priority": 1}))
}

fn balls() -> Value {
    json!({"sphere": {"diameter": {"uniform": [1, 4]}}})
}

fn relief(more: Value) -> Value {
    let mut relief = json!({"size": [100, 100], "thickness": 20, "amplitude": 1.5, "correlation_length": 8, "top": 0});
    relief.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    with("/objects/tissue", json!({"relief": relief, "medium": "healthy"}))
}

fn path(points: Value, diameter: f64) -> Value {
    with("/objects/polyp", json!({"path": {"points": points, "diameter": diameter}, "medium": "scc", "priority": 1}))
}

/// Each body is an object of its own, in its depth, of a size that its distribution has; sizes and places are a function of the seed and the
/// object's name, and further bodies move none.
#[test]
fn scattered_bodies_are_objects() {
    let of = |params: &Value| scene(params).objects.clone();
    let objects = of(&spots(balls()));
    assert_eq!(objects.len(), 13);
    for i in 0..12 {
        let object = &objects[&format!("polyp_{i}")];
        let Shape::Sphere { diameter, center: [x, y, z] } = object.shape else { panic!("{:?}", object.shape) };
        assert!(
            (1.0..=4.0).contains(&diameter) && x.abs() <= 30.0 - 0.5 * diameter && y.abs() <= 20.0 - 0.5 * diameter
        );
        assert!((-5.0..=-1.0).contains(&(z + 0.5 * diameter)), "{z}");
        assert_eq!((object.medium.as_deref(), object.priority), (Some("scc"), 1));
    }
    let all = |more: Value| {
        let mut params = balls();
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        of(&spots(params))
    };
    let same =
        [json!({"seed": 0}), json!({"sphere": {"diameter": {"uniform": [1.0, 4.0]}}}), json!({"apart": "0.2 cm"})];
    for more in same {
        assert_eq!(all(more.clone()), objects, "{more}");
    }
    assert_ne!(all(json!({"seed": 4_294_967_295_u32}))["polyp_0"], objects["polyp_0"]);
    assert!(all(json!({"count": 20})).iter().filter(|(name, _)| objects.contains_key(*name)).eq(&objects));
    assert_eq!(all(json!({"count": 0})).len(), 1);
    let mut renamed = spots(balls());
    let object = renamed["objects"].as_object_mut().unwrap().remove("polyp").unwrap();
    renamed["objects"]["spots"] = object;
    assert_ne!(of(&renamed)["spots_0"].shape, objects["polyp_0"].shape);
    let rods = spots(json!({"cylinder": {"diameter": 1, "length": {"choice": [3, 6]}, "axis": "-x"}}));
    assert!(of(&rods).values().all(|o| match o.shape {
        Shape::Cylinder { length, axis, .. } => [3.0, 6.0].contains(&length) && axis == [1.0, 0.0, 0.0],
        _ => true,
    }));
    let spheroids = json!({"spheroid": {"diameters": [2, 2, {"normal": {"mean": 4, "sigma": 1, "within": [1, 6]}}],
        "rotation_deg": [{"uniform": [0, 180]}, 0, 0]}, "within": {"box": {"size": [60, 40, 30], "center": [0, 0, -20]}}});
    let turned = of(&spots(spheroids)).values().filter(|o| matches!(o.shape, Shape::Turned { .. })).count();
    assert_eq!(turned, 12);
}

/// What they are, in one line: closed meshes in the record, another one for another seed.
#[test]
fn reliefs_and_paths_are_meshes() {
    let mesh = |params: &Value, name: &str| {
        let Shape::Mesh(mesh) = scene(params).objects[name].shape.clone() else { panic!("no mesh") };
        mesh
    };
    let skin = mesh(&relief(json!({})), "tissue");
    assert_eq!(skin.triangles.len(), 2 * 100 * 100 + 6 * 200);
    assert_eq!(mesh(&relief(json!({"seed": 0, "center": [0, -0.0]})), "tissue").vertices, skin.vertices);
    assert_ne!(mesh(&relief(json!({"seed": 1})), "tissue").vertices, skin.vertices);
    let moved = mesh(&relief(json!({"center": [16, 0], "top": 4})), "tissue");
    assert_eq!(moved.vertices[0], [skin.vertices[0][0] + 16.0, skin.vertices[0][1], skin.vertices[0][2] + 4.0]);
    let vessel = path(json!([[-20, 0, -2], [0, 4, -3], [20, 0, -2]]), 1.5);
    assert_eq!(mesh(&vessel, "polyp").triangles.len() % 64, 0);
    for params in [relief(json!({})), vessel] {
        let (mistakes, warnings) = check(&params);
        assert!(mistakes.is_empty() && warnings.is_empty(), "{mistakes:?} {warnings:?}");
    }
}

/// The bodies of one object share a colour and a line of the legend.
#[test]
fn the_sketch_names_bodies_once() {
    let ports = run(&spots(balls()), &["preview"]);
    let Artifact::Images(stack) = &ports[1].1 else { panic!("the sketch is no image") };
    let legend: Vec<&str> =
        stack.attributes["legend"].as_array().unwrap().iter().filter_map(|e| e["text"].as_str()).collect();
    assert_eq!(legend[..2], ["polyp (scc)", "tissue (healthy)"]);
    assert_eq!(legend.iter().filter(|text| text.starts_with("polyp")).count(), 1);
}

/// Each mistake: where it stands, and words that the message or the way out must have.
#[test]
fn mistakes_of_random_objects_are_named() {
    let of_balls = |more: Value| {
        let mut params = balls();
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        spots(params)
    };
    let sized = |diameter: Value| spots(json!({"sphere": {"diameter": diameter}}));
    let at = "objects.polyp.scatter.";
    let same_priority = {
        let mut params = spots(balls());
        params["objects"]["polyp"]["priority"] = json!(0);
        params
    };
    let twice = {
        let mut params = spots(balls());
        params["objects"]["polyp_3"] = json!({"sphere": {"diameter": 1, "center": [0, 0, 9]}, "medium": "scc"});
        params
    };
    let table: Vec<(Value, String, &[&str])> = vec![
        (of_balls(json!({"count": 5000})), format!("{at}count"), &["count = 5000", "at most 1000"]),
        (of_balls(json!({"count": -1})), format!("{at}count"), &["-1"]),
        (of_balls(json!({"count": 600})), format!("{at}count"), &["count = 600", "were placed", "`apart`", "`within`"]),
        (of_balls(json!({"apart": -1})), format!("{at}apart"), &["apart = -1 mm", ">= 0"]),
        (sized(json!(0)), format!("{at}sphere.diameter"), &["diameter = 0 mm", "> 0"]),
        (sized(json!(50)), format!("{at}count"), &["0 were placed", "50.0000", "even alone"]),
        (sized(json!({"uniform": [-1, 4]})), format!("{at}sphere.diameter"), &["drawn as -0.99", "within"]),
        (
            sized(json!({"normal": {"mean": 3, "sigma": 1}})),
            format!("{at}sphere.diameter"),
            &["drawn as", "> 0", "within"],
        ),
        (sized(json!({"uniform": [4, 1]})), format!("{at}sphere.diameter.uniform"), &["first < last"]),
        (sized(json!({"uniform": [1, "wide"]})), format!("{at}sphere.diameter"), &["`wide`", "${wide}"]),
        (sized(json!({"unifrom": [1, 4]})), format!("{at}sphere.diameter.unifrom"), &["unifrom", "uniform"]),
        (sized(json!({"choice": ["small", "large"]})), format!("{at}sphere.diameter"), &["text"]),
        (sized(json!({"choice": [-2, -1]})), format!("{at}sphere.diameter"), &["drawn as -2", "> 0"]),
        (spots(json!({})), "objects.polyp.scatter".into(), &["no kind of body", "spheroid"]),
        (
            of_balls(json!({"cylinder": {"diameter": 1, "length": 2}})),
            "objects.polyp.scatter".into(),
            &["more than one kind"],
        ),
        (
            of_balls(json!({"within": {"rect": {"x": [3, -3], "y": [0, 1]}}})),
            format!("{at}within.rect.x"),
            &["[3, -3] mm", "rise"],
        ),
        (
            of_balls(json!({"within": {"box": {"size": [1, 0, 1], "center": [0, 0, 0]}}})),
            format!("{at}within.box.size.1"),
            &["size = 0 mm", "> 0"],
        ),
        (of_balls(json!({"within": {"disc": 3}})), format!("{at}within"), &["disc"]),
        (same_priority, "objects.tissue".into(), &["polyp_0 and tissue overlap", "priority"]),
        (twice, "objects.polyp_3".into(), &["polyp", "another name"]),
        (relief(json!({"amplitude": -1})), "objects.tissue.relief.amplitude".into(), &["amplitude = -1 mm", ">= 0"]),
        (relief(json!({"size": [0, 9]})), "objects.tissue.relief.size.0".into(), &["size = 0 mm", "> 0"]),
        (
            relief(json!({"correlation_length": 0.5})),
            "objects.tissue.relief.correlation_length".into(),
            &["100 x 100 mm", "triangles", "make it 1.13 mm or more"],
        ),
        (
            relief(json!({"thickness": 1})),
            "objects.tissue.relief.thickness".into(),
            &["thickness = 1 mm", "lowest point", "six amplitudes"],
        ),
        (path(json!([[0, 0, 0]]), 1.0), "objects.polyp.path.points".into(), &["points has 1", "2 to 1000"]),
        (
            path(json!([[0, 0, 0], [1, 0, 0], [1, 0, 0]]), 1.0),
            "objects.polyp.path.points.2".into(),
            &["(1.0000, 0.0000"],
        ),
        (path(json!([[0, 0, 0], [9, 0, 0]]), 0.0), "objects.polyp.path.diameter".into(), &["diameter = 0 mm"]),
        (
            path(json!([[-20, 0, -9], [0, 3, -9], [-20, 4, -9]]), 4.0),
            "objects.polyp.path.points".into(),
            &["bends with a radius of", "the tube's is 2 mm", "diameter"],
        ),
        (
            path(json!([[-20, 0, -9], [10, 0, -9], [20, 10, -9], [10, 20, -9], [0, 10, -9], [0, -20, -9]]), 4.0),
            "objects.polyp.path.points".into(),
            &["runs through itself at"],
        ),
    ];
    for (params, path, words) in table {
        let (mistakes, _) = check(&params);
        let text: Vec<String> = mistakes.iter().map(ToString::to_string).collect();
        let found = mistakes.iter().find(|m| m.path.starts_with(&path)).map(ToString::to_string);
        let found = found.unwrap_or_else(|| panic!("{path}: {text:?}"));
        assert!(words.iter().all(|word| found.contains(word)), "{words:?}: {found}");
        assert_eq!(mistakes.len(), 1, "{path}: {text:?}");
    }
    let (_, warnings) = check(&relief(json!({"amplitude": 9, "thickness": 90})));
    assert!(warnings.iter().any(|w| w.path.ends_with("amplitude") && w.message.contains("66 degrees")), "{warnings:?}");
    assert!(check(&carcinoma()).1.is_empty());
}
