//! What is said of patterns and frequency maps before a run.

use std::marker::PhantomData;

use turbid_contract::payload::{Payload, Scene};
use turbid_contract::{AngleDeg, Ctx, Form, Known, Length, MemoryHost, PerLength, Problems, Ratio, Stage};
use turbid_pattern::image::Image;
use turbid_pattern::speckle::Speckle;
use turbid_pattern::{Method, PatternIn, PatternParams, PatternStage, Predistort, PredistortIn, PredistortParams};

use crate::pictures::{pictures, png_of};
use crate::{along_wall, fringes, host, tube};

fn known(scene: &Scene, host: &MemoryHost) -> Known {
    let mut known = Known { connected: vec!["scene".into()], files: host.files.clone(), ..Known::default() };
    known.insert("scene", scene.clone().into_artifact());
    known.producers.insert("scene".into(), "rig.scene".into());
    known
}

#[track_caller]
fn assert_held(form: &Form, made: impl Payload) {
    assert!(form.pixels.is_some() && form.layers.is_some(), "{form:?}");
    assert_eq!(form.broken_by(&Form::of(&made.into_artifact())), None);
}

fn assert_pattern(params: &PatternParams, scene: &Scene, host: &MemoryHost) {
    let known = known(scene, host);
    let mut problems = Problems::default();
    PatternStage::check(params, &known, &mut problems);
    assert!(problems.is_empty(), "{problems:?}");
    let forms = PatternStage::describe(params, &known);
    assert!(PatternStage::plan(params, &known).memory.is_some());
    let input = PatternIn { scene: scene.clone(), source: PhantomData };
    let out = PatternStage::run(params, input, Ctx::new(host)).unwrap();
    assert_held(&forms["pattern"], out.pattern);
    assert_held(&forms["surface_frequency"], out.surface_frequency.unwrap());
}

#[test]
fn what_is_said_of_patterns_is_made() {
    let scene = tube(24);
    assert_pattern(&fringes(&[0.0, 0.1, 0.05], &[0.0, 90.0]), &scene, &host());
    let speckle = Speckle { correlation_length: Length(3.0), contrast: Ratio(0.5), count: 2 };
    assert_pattern(&PatternParams { speckle: Some(speckle), ..fringes(&[], &[0.0]) }, &scene, &host());
    let mut free = scene.clone();
    free.projector.as_mut().unwrap().pixels = None;
    assert_pattern(&PatternParams { pixels: Some([20, 12]), ..fringes(&[0.1], &[0.0]) }, &free, &host());
    let mut host = host();
    host.files = (0..3).map(|k| (format!("image.files.{k}"), png_of(24, |i| (7 * i) as u16).into())).collect();
    for f_x in [None, Some(PerLength(0.1))] {
        let mut params = pictures(3);
        params.image = params.image.map(|image| Image { f_x, orientation_deg: AngleDeg(90.0), ..image });
        assert_pattern(&params, &scene, &host);
        assert_pattern(&params, &free, &host);
    }
}

#[test]
fn what_is_said_of_bent_patterns_is_made() {
    let scene = tube(24);
    for params in [along_wall(Method::Analytic, &[0.02, 0.0]), along_wall(Method::Trace, &[0.02, 0.03])] {
        let known = known(&scene, &host());
        let forms = Predistort::describe(&params, &known);
        assert!(forms["pattern"].attribute("fringes_along").is_some());
        assert!(Predistort::plan(&params, &known).memory.is_some());
        let input = PredistortIn { scene: scene.clone(), source: PhantomData };
        let out = Predistort::run(&params, input, Ctx::new(&host())).unwrap();
        assert_held(&forms["pattern"], out.pattern);
        assert_held(&forms["surface_frequency"], out.surface_frequency.unwrap());
    }
}

/// A scene without a projector is told at the port, with who makes it.
#[test]
fn scenes_without_a_projector_are_named() {
    let mut scene = tube(24);
    scene.projector = None;
    let told = |check: &dyn Fn(&Known, &mut Problems)| {
        let mut problems = Problems::default();
        check(&known(&scene, &host()), &mut problems);
        problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let said =
        ["in.scene: `rig.scene`: the scene has no projector that could show a pattern (add `projector` to the scene)"];
    assert_eq!(told(&|known, problems| PatternStage::check(&fringes(&[0.1], &[0.0]), known, problems)), said);
    let bent: PredistortParams = along_wall(Method::Trace, &[0.1]);
    assert_eq!(told(&|known, problems| Predistort::check(&bent, known, problems)), said);
}
