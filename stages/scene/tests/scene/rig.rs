//! A scene that takes camera, projector and lights from another one.

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Lamp, Payload, Scene};
use turbid_contract::{Artifact, Ctx, Error, Known, MemoryHost, Problem, Problems, StageRow};
use turbid_scene::SceneStage;

use crate::{carcinoma, check, run, scene, with};

/// One scene on the port `rig`.
fn on_rig(rig: Scene) -> Inputs {
    Inputs::none().with("rig", rig)
}

/// The parameters of `carcinoma` in two: what lights and sees, and the rest.
fn parted(params: &Value) -> (Value, Value) {
    let (mut rig, mut rest) = (json!({}), params.clone());
    for key in ["camera", "projector", "lights", "wavelength_nm"] {
        if let Some(part) = rest.as_object_mut().unwrap().remove(key) {
            rig[key] = part;
        }
    }
    (rig, rest)
}

fn on(rig: &Value, params: &Value) -> Result<Scene, Error> {
    let made = StageRow::of::<SceneStage>().run(params, &on_rig(scene(rig)), Ctx::new(&MemoryHost::default()))?;
    Scene::from_artifact(made.into_iter().next().expect("the scene").1)
}

fn check_on(rig: Option<Scene>, params: &Value) -> (Vec<Problem>, Vec<Problem>) {
    let mut known = Known { connected: vec!["rig".to_owned()], ..Known::default() };
    if let Some(rig) = rig {
        known.insert("rig", rig.into_artifact());
        known.producers.insert("rig".to_owned(), "bench".to_owned());
    }
    let mut problems = Problems::default();
    StageRow::of::<SceneStage>().check(params, &known, &mut problems);
    problems.into_parts()
}

/// A scene on a rig is the scene that says all itself, to the last field; so is one on a whole scene, whose media and objects stay there.
#[test]
fn a_scene_on_a_rig_is_the_whole_scene() {
    let mut lit = carcinoma();
    lit["wavelength_nm"] = json!([530, 635]);
    lit["lights"] = json!({"lamp": {"point": {"position": [0, -100, 200], "power": [0.1, 0.2]}}});
    for whole in [carcinoma(), lit] {
        let (rig, rest) = parted(&whole);
        assert!(check(&rig).0.is_empty() && check(&rig).1.is_empty(), "{:?}", check(&rig));
        let found = check_on(Some(scene(&rig)), &rest);
        assert!(found.0.is_empty() && found.1.is_empty(), "{found:?}");
        assert_eq!(on(&rig, &rest).unwrap(), scene(&whole));
        let mut phantom = whole.clone();
        phantom["objects"]["polyp"] = Value::Null;
        phantom["objects"].as_object_mut().unwrap().remove("polyp");
        assert_eq!(on(&phantom, &rest).unwrap(), scene(&whole));
    }
}

/// What the rig lacks the scene may give; one power of a rig without wavelengths is that of all channels.
#[test]
fn a_rig_may_be_a_part() {
    let (mut rig, mut rest) = parted(&carcinoma());
    let camera = rig.as_object_mut().unwrap().remove("camera").unwrap();
    rig["lights"] = json!({"sky": {"ambient": {"radiance": 1e-6}}});
    rest["camera"] = camera;
    rest["wavelength_nm"] = json!([530, 635]);
    let made = on(&rig, &rest).unwrap();
    assert_eq!(made.projector.unwrap().power, [5.0, 5.0]);
    assert_eq!(made.lights["sky"], Lamp::Ambient { radiance: vec![1e-6, 1e-6] });
    assert_eq!(made.camera, scene(&carcinoma()).camera);
}

/// The record names its rig by a digest: the same whatever lies under the camera and wherever the rig was written, another for every part
/// of the rig.
#[test]
fn the_digest_is_that_of_the_rig() {
    let digest = |scene: Scene| match scene.into_artifact() {
        Artifact::Record(record) => record.fields["rig"].as_str().expect("a text").to_owned(),
        other => panic!("{other:?}"),
    };
    let whole = digest(scene(&carcinoma()));
    assert_eq!(whole.len(), 16);
    let (rig, rest) = parted(&carcinoma());
    assert_eq!((digest(scene(&rig)), digest(on(&rig, &rest).unwrap())), (whole.clone(), whole.clone()));
    for (pointer, value) in [
        ("/media/healthy/A_rho", json!(30)),
        ("/objects/tissue/slab/thickness", json!(100)),
        ("/objects/polyp", Value::Null),
        ("/detectors", json!({"eye": {"disc": {"position": [0, 0, 9], "look_at": [0, 0, 0], "diameter": 1}}})),
    ] {
        assert_eq!(digest(scene(&with(pointer, value))), whole, "{pointer}");
    }
    for (pointer, value) in [
        ("/projector/power", json!(6)),
        ("/projector/position", json!([0, 35, 501])),
        ("/camera/pixels", json!([32, 64])),
        ("/camera/specular", json!("exclude")),
        ("/lights", json!({"sky": {"ambient": {"radiance": 1e-6}}})),
        ("/wavelength_nm", json!([635])),
    ] {
        assert_ne!(digest(scene(&with(pointer, value))), whole, "{pointer}");
    }
}

/// Each mistake: the params on the rig of `carcinoma`, where it stands, and words that the message or the way out must have.
#[test]
fn mistakes_with_a_rig_are_named() {
    let (rig, rest) = parted(&carcinoma());
    let given = |key: &str, value: Value| {
        let mut params = rest.clone();
        params[key] = value;
        params
    };
    let mut lit = rig.clone();
    lit["wavelength_nm"] = json!([530, 635]);
    lit["lights"] = json!({"sky": {"ambient": {"radiance": 1e-6}}});
    let mut inside = rig.clone();
    inside["camera"]["position"] = json!([0, 0, -5]);
    let mut refracting = rest.clone();
    refracting["media"]["healthy"]["n"] = json!(1.4);
    let table: Vec<(&Value, Value, &str, &[&str])> = vec![
        (&rig, given("camera", rig["camera"].clone()), "camera", &["`camera` stands here", "`bench`", "remove one"]),
        (&rig, given("projector", rig["projector"].clone()), "projector", &["`projector`", "remove one"]),
        (&lit, given("wavelength_nm", json!([530, 635])), "wavelength_nm", &["`wavelength_nm`", "remove one"]),
        (&lit, given("lights", json!({"sky": {"ambient": {"radiance": 1}}})), "lights", &["`lights`", "remove one"]),
        (&rig, json!({}), "objects", &["no object"]),
        (&inside, rest.clone(), "rig", &["in.rig: camera.position of the rig `bench`", "inside the solid polyp"]),
        (&rig, refracting, "rig", &["in.rig: camera.specular of the rig `bench`", "tissue has n != 1"]),
        (
            &lit,
            given("media", json!({"scc": {"mu_a": [1, 2, 3], "mu_s": 1, "g": 0, "n": 1}})),
            "media.scc.mu_a",
            &["3 values for 2"],
        ),
    ];
    for (rig, params, path, words) in table {
        let (mistakes, _) = check_on(Some(scene(rig)), &params);
        let found = mistakes.iter().find(|m| m.path == path);
        let Some(found) = found else { panic!("nothing at {path}, but {mistakes:?}") };
        let text = found.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{path}: `{text}` lacks one of {words:?}");
        assert!(matches!(on(rig, &params), Err(Error::Invalid(_))), "{path}: ran all the same");
    }
    // A rig of nothing, and media that fill nothing.
    for params in [json!({}), with("/objects", json!({}))] {
        assert!(check(&params).0.iter().any(|m| m.message.contains("no object")), "{params}");
        let run = StageRow::of::<SceneStage>().run(&params, &Inputs::none(), Ctx::new(&MemoryHost::default()));
        assert!(matches!(run, Err(Error::Invalid(_))), "{params}");
    }
}

/// While the rig is not known (there is a mistake in it), mistakes here are named all the same, and nothing that only the rig can tell.
#[test]
fn an_unknown_rig_hides_no_mistake() {
    let (_, mut rest) = parted(&carcinoma());
    rest["media"]["healthy"] = json!({"mu_a": [0.1, 0.2], "mu_s": 5, "g": 0.8, "n": 1.4});
    assert_eq!(check_on(None, &rest).0, []);
    rest["media"]["healthy"]["g"] = json!(2);
    let (mistakes, _) = check_on(None, &rest);
    assert!(mistakes.len() == 1 && mistakes[0].path == "media.healthy.g", "{mistakes:?}");
}

/// A rig has a sketch, of camera, projector and lights alone.
#[test]
fn a_rig_is_sketched() {
    let (rig, _) = parted(&carcinoma());
    let sky = json!({"lights": {"sky": {"ambient": {"radiance": 1}}}});
    for (params, entry) in [(&rig, "camera and what it sees"), (&rig, "projector and what it lights"), (&sky, "lights")]
    {
        let ports = run(params, &["preview"]);
        let Artifact::Images(stack) = &ports[1].1 else { panic!("the sketch is no image") };
        assert!(stack.attributes["legend"].to_string().contains(entry), "{:?}", stack.attributes);
        assert!(stack.layers.iter().all(|layer| layer.data.iter().all(|v| (0.0..=1.0).contains(v))));
    }
}
