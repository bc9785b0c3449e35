//! What is said of the outputs before a run, and scenes and patterns that do not fit.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use turbid_contract::payload::{
    Detector, Lamp, Medium, Motif, Outline, Pattern, Payload, PhaseFunction, Scene, Shape, Surface, Texture,
};
use turbid_contract::{Artifact, Axes, Ctx, Error, Form, InputSource, Known, LayerKind, Problems, StageRow};
use turbid_render::RenderStage;

use crate::patterns::sinusoids;
use crate::setup::*;

const ALL: [&str; 5] = ["frames", "covariance", "truth", "white", "power"];

struct Inputs(BTreeMap<&'static str, Artifact>);

impl InputSource for Inputs {
    fn one(&self, port: &str) -> Result<Option<Artifact>, Error> {
        Ok(self.0.get(port).cloned())
    }
    fn many(&self, _: &str) -> Vec<Axes> {
        Vec::new()
    }
    fn load(&self, port: &str, _: usize) -> Result<Artifact, Error> {
        Err(Error::failed(port))
    }
}

fn inputs(scene: &Scene, pattern: Option<&Pattern>) -> Inputs {
    let pattern = pattern.map(|pattern| ("pattern", pattern.clone().into_artifact()));
    Inputs([("scene", scene.clone().into_artifact())].into_iter().chain(pattern).collect())
}

fn known(Inputs(inputs): &Inputs, wanted: &[&str]) -> Known {
    let mut known = Known { wanted: wanted.iter().map(|&w| w.to_owned()).collect(), ..Known::default() };
    for (&port, artifact) in inputs {
        known.connected.push(port.into());
        known.forms.insert(port.into(), vec![Form::of(artifact).into()]);
        known.producers.insert(port.into(), format!("made.{port}"));
        known.extents.insert(port.into(), artifact.extent());
        if port == "scene" {
            known.insert(port, artifact.clone());
        }
    }
    known
}

fn assert_held(scene: &Scene, pattern: Option<&Pattern>, params: &Value) {
    let (inputs, row) = (inputs(scene, pattern), StageRow::of::<RenderStage>());
    let known = known(&inputs, &ALL);
    let mut problems = Problems::default();
    row.check(params, &known, &mut problems);
    assert!(problems.is_empty(), "{problems:?}");
    let job = (row.prepare)(params).unwrap();
    let forms = job.describe(&known);
    assert!(job.plan(&known).memory.is_some());
    let host = MemoryHost::new(1, &ALL, 2);
    let made = job.run(&inputs, Ctx::new(&host)).unwrap();
    assert_eq!(made.len(), ALL.len());
    for (port, artifact) in made {
        let form = &forms[port];
        let whole = form.pixels.is_some() && form.layers.is_some() || form.rows.is_some() && form.columns.is_some();
        assert!(whole, "{port}: {form:?}");
        assert_eq!(form.broken_by(&Form::of(&artifact)), None, "{port} of {params}");
    }
}

fn floor(wavelengths_nm: &[f64], change: &dyn Fn(&mut Medium)) -> Scene {
    let channels = wavelengths_nm.len().max(1);
    let mut medium = Medium {
        mu_a: vec![0.1; channels],
        mu_s: vec![4.0; channels],
        phase: PhaseFunction::HenyeyGreenstein(0.8),
        n: 1.0,
    };
    change(&mut medium);
    let mut scene = scene(&[("m", medium)], vec![object(FLOOR, "m", 0)], rig(200.0, 20.0, 16.0, 6, 60.0));
    scene.wavelengths_nm = wavelengths_nm.to_vec();
    scene.projector.as_mut().unwrap().power = vec![5.0; channels];
    scene
}

#[test]
fn what_is_said_is_made() {
    let few = |more: Value| {
        let mut params = json!({"f_x": [0, 0.1], "samples": 4, "photons": 100});
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    };
    let plain = floor(&[], &|_| {});
    let turned = json!({"f_x": [0.1, 0, 0.05], "phases": 4, "orientation_deg": [0, 90], "method": "path"});
    assert_held(&plain, None, &few(turned.clone()));
    assert_held(&plain, None, &few(json!({"method": "fit"})));
    assert_held(&plain, None, &few(json!({"method": "rte"})));
    assert_held(&floor(&[530.0, 635.0], &|_| {}), None, &few(turned));
    // Few paths know nothing of a narrow lobe: pixels are flagged, with the path and with a fit.
    let peaked = floor(&[530.0, 635.0], &|medium| {
        (medium.phase, medium.mu_s) = (PhaseFunction::HenyeyGreenstein(0.97), vec![130.0; 2]);
    });
    assert_held(&peaked, None, &few(json!({"method": "path"})));
    assert_held(&peaked, None, &few(json!({"method": "fit"})));
    // A ball on the slab, rough walls, textures, a steady light, detectors: a thickness that differs, and more rows of power.
    let mut mixed = floor(&[], &|medium| medium.n = 1.4);
    mixed.objects.get_mut("a").unwrap().surface = Surface::Rough(0.6);
    let ball = Shape::Sphere { diameter: 6.0, center: [0.0, 0.0, 3.2] };
    let motif = Motif::Sinusoid { period: 2.0, orientation_deg: 0.0 };
    let texture = Texture { low: 0.1, high: 0.9, origin: [0.0; 2], motif };
    let ball = turbid_contract::payload::Object {
        shape: ball,
        medium: None,
        priority: 0,
        surface: Surface::Textured(texture),
    };
    mixed.objects.insert("ball".into(), ball);
    mixed.lights = [("lamp".to_owned(), Lamp::Point { position: [20.0, 0.0, 90.0], power: vec![1.0] })].into();
    let outline = Outline::Disc { diameter: 9.0 };
    let detector = Detector {
        outline,
        position: [0.0, 0.0, 50.0],
        facing: [0.0, 0.0, -1.0],
        half_angle_deg: 90.0,
        absorbs: false,
    };
    mixed.detectors = [("eye".to_owned(), detector)].into();
    assert_held(&mixed, None, &few(json!({})));

    let shown = json!({"samples": 4, "photons": 100});
    let mut pattern = sinusoids(60.0, 40, 0.05);
    assert_held(&floor(&[530.0, 635.0], &|_| {}), Some(&pattern), &shown);
    pattern.0.attributes.insert("fringes_along".into(), "a".into());
    // Two phases fix no sinusoid: there is no covariance of such fringes.
    pattern.0.layers.remove(1);
    assert_held(&plain, Some(&pattern), &shown);
}

#[track_caller]
fn assert_told(known: &Known, params: &Value, parts: &[&str]) {
    let mut problems = Problems::default();
    StageRow::of::<RenderStage>().check(params, known, &mut problems);
    let found = problems.into_parts().0;
    assert_eq!(found.len(), 1, "{found:?}");
    let text = found[0].to_string();
    parts.iter().for_each(|part| assert!(text.contains(part), "`{part}` is missing in `{text}`"));
}

#[test]
fn wrong_joints_are_named() {
    let plain = floor(&[], &|_| {});
    let (shown, frames) = (json!({"samples": 64}), ["frames"]);
    let with = |scene: &Scene, pattern: &Pattern| known(&inputs(scene, Some(pattern)), &frames);
    let good = sinusoids(60.0, 40, 0.05);
    let of_pattern = "in.pattern: `made.pattern`: ";
    let mut fine = plain.clone();
    fine.projector.as_mut().unwrap().pixels = Some([80, 60]);
    let sizes = [of_pattern, "the pattern is 40 x 40 pixels, the projector has 80 x 60", "for this projector"];
    assert_told(&with(&fine, &good), &shown, &sizes);
    let mut empty = good.clone();
    empty.0.layers.iter_mut().for_each(|layer| layer.info.kind = LayerKind::Condition);
    assert_told(&with(&plain, &empty), &shown, &[of_pattern, "has no layers"]);
    let beyond =
        "f_x = 1.5 mm^-1 is beyond what the camera's pixels of 2.6666666666666665 x 2.6666666666666665 mm resolve";
    assert_told(&with(&plain, &sinusoids(60.0, 400, 1.5)), &shown, &[of_pattern, beyond]);
    let asks = json!({"samples": 64, "f_x": [0, 0.1]});
    let other = ["f_x: `made.pattern`: ", "f_x = 0.1 mm^-1 at 0 deg asks for 3 frames, the pattern has 0 such layers"];
    assert_told(&with(&plain, &good), &asks, &other);
    let mut unlit = plain.clone();
    unlit.projector = None;
    unlit.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![1.0] })].into();
    assert_told(&with(&unlit, &good), &shown, &[of_pattern, "no projector to show it"]);

    let alone = |scene: &Scene, wanted: &[&str]| known(&inputs(scene, None), wanted);
    let even = json!({"samples": 64, "f_x": [0]});
    assert_told(&alone(&unlit, &["frames", "power"]), &even, &["in.scene: `made.scene`: ", "ambient light has none"]);
    let mut blind = plain.clone();
    blind.camera = None;
    assert_told(&alone(&blind, &frames), &even, &["in.scene: ", "no camera"]);
    let mut dark = plain;
    dark.projector = None;
    assert_told(&alone(&dark, &frames), &even, &["in.scene: ", "no projector, so all would be dark"]);
}
