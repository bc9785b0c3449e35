//! What is said of the outputs before a run, and inputs that do not fit.

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames};
use turbid_contract::{
    Artifact, Ctx, Form, ImageStack, Known, LayerInfo, LayerKind, MemoryHost, Payload, Problem, Problems, StageRow,
};
use turbid_sensor::Sensor;

use crate::{Inputs, N, PHASES, frames};

/// Frames in two colours, in which one pixel does not know its error and another is bad, with conditions.
fn coloured() -> Frames {
    let Frames(plain) = frames(1e-6, 2e-6, 1e-8);
    let mut stack = ImageStack::new(N, N);
    for w in [650.0, 532.0] {
        for layer in &plain.layers {
            let info = LayerInfo { wavelength_nm: Some(w), ..layer.info.clone() };
            if info.kind == LayerKind::Value && w == 532.0 {
                let flag = |(r, c): (usize, usize)| f32::from(u8::from(r < 9 && c < 9));
                stack.push(info.se_unknown(), Array2::from_shape_fn((N, N), flag));
            }
            stack.push(info, layer.data.clone());
        }
    }
    stack.push(LayerInfo::new("view_deg", LayerKind::Condition, "deg"), Array2::zeros((N, N)));
    stack.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 0.5]));
    Frames(stack)
}

fn known(inputs: &Inputs) -> Known {
    let wanted = ["frames", "covariance", "numbers"].map(str::to_owned).into();
    let mut known = Known { wanted, ..Known::default() };
    for (port, artifact) in inputs.each() {
        known.connected.push(port.into());
        known.forms.insert(port.into(), vec![Form::of(artifact).into()]);
        known.extents.insert(port.into(), artifact.extent());
        known.producers.insert(port.into(), format!("ideal.{port}"));
    }
    known
}

fn sensed(params: &Value, inputs: &Inputs) -> Vec<(&'static str, Artifact)> {
    let host = MemoryHost { wanted: vec!["covariance".into(), "numbers".into()], ..MemoryHost::default() };
    StageRow::of::<Sensor>().run(params, inputs, Ctx::new(&host)).unwrap()
}

#[test]
fn what_is_said_is_made() {
    let plain = |se: f32| frames(1e-6, 2e-6, se);
    // 1.2e-6 saturates some pixels and not others.
    for params in [json!({"full_scale": 1e-5, "bits": 8, "full_well": 10000}), json!({"full_scale": 1.2e-6})] {
        for ideal in [plain(0.0), plain(1e-8), coloured()] {
            let alone = Inputs::from(vec![("frames", ideal.into_artifact())]);
            let first = sensed(&params, &alone);
            let find = |port: &str| first.iter().find(|(name, _)| *name == port).unwrap().1.clone();
            // A camera behind a camera.
            let behind = Inputs::from(vec![("frames", find("frames")), ("covariance", find("covariance"))]);
            for inputs in [alone, behind] {
                let job = (StageRow::of::<Sensor>().prepare)(&params).unwrap();
                let known = known(&inputs);
                let mut problems = Problems::default();
                job.check(&known, &mut problems);
                assert!(problems.is_empty(), "{problems:?}");
                let forms = job.describe(&known);
                assert!(job.plan(&known).memory.is_some());
                for (port, artifact) in sensed(&params, &inputs) {
                    let form = &forms[port];
                    assert!(form.pixels.is_some() && form.layers.is_some(), "{port}: {form:?}");
                    assert_eq!(form.broken_by(&Form::of(&artifact)), None, "{port} of {params}");
                }
            }
        }
    }
}

fn told(known: &Known) -> Vec<Problem> {
    let mut problems = Problems::default();
    (StageRow::of::<Sensor>().prepare)(&json!({})).unwrap().check(known, &mut problems);
    problems.into_parts().0
}

#[track_caller]
fn assert_told(known: &Known, parts: &[&str]) {
    let found = told(known);
    assert_eq!(found.len(), 1, "{found:?}");
    let text = found[0].to_string();
    parts.iter().for_each(|part| assert!(text.contains(part), "`{part}` is missing in `{text}`"));
}

#[test]
fn wrong_joints_are_named() {
    let Frames(three) = frames(1e-6, 2e-6, 1e-8);
    let with = |change: &dyn Fn(&mut LayerInfo)| {
        let mut stack = three.clone();
        stack.layers.iter_mut().for_each(|layer| change(&mut layer.info));
        Frames(stack)
    };
    let alone = |frames: Frames| known(&Inputs::from(vec![("frames", frames.into_artifact())]));
    let silent = alone(with(&|info| info.f_x_per_mm = None));
    assert_told(&silent, &["in.frames: `ideal.frames`: ", "does not say its f_x"]);
    let silent = alone(with(&|info| info.phase_rad = None));
    assert_told(&silent, &["in.frames", "does not say its phase"]);
    let two = alone(Frames({
        let mut stack = three.clone();
        let last = stack.layers.iter().rposition(|l| l.info.kind == LayerKind::Value).unwrap();
        stack.layers.remove(last);
        stack
    }));
    assert_told(&two, &["in.frames", &format!("{} phases at f_x = 0.1 mm^-1", PHASES - 1)]);
    // Nobody asks for a covariance: such frames go through.
    assert!(told(&Known { wanted: vec!["frames".into()], ..two }).is_empty());

    let covariance = |frames: Frames| {
        let inputs = Inputs::from(vec![("frames", frames.into_artifact())]);
        let made = sensed(&json!({"full_scale": 1e-5}), &inputs);
        Covariance::from_artifact(made.into_iter().find(|(port, _)| *port == "covariance").unwrap().1).unwrap()
    };
    let beside = |frames: Frames, covariance: Covariance| {
        known(&Inputs::from(vec![("frames", frames.into_artifact()), ("covariance", covariance.into_artifact())]))
    };
    let finer = with(&|info| info.f_x_per_mm = info.f_x_per_mm.map(|f| 2.0 * f));
    let both = "in.covariance: `ideal.covariance` does not belong to `ideal.frames`: ";
    let other = beside(Frames(three.clone()), covariance(finer));
    assert_told(&other, &[both, "lacks `re` at f_x = 0.1 mm^-1: it has it at 0.2 mm^-1"]);
    let red = with(&|info| info.wavelength_nm = Some(650.0));
    let other = beside(Frames(three.clone()), covariance(red));
    assert_told(&other, &[both, "lacks `dc` at f_x = 0 mm^-1: it has it at 0 mm^-1 of 650 nm"]);
    let mut small = beside(Frames(three.clone()), covariance(Frames(three.clone())));
    let form = &mut small.forms.get_mut("covariance").unwrap()[0];
    *form = Form { pixels: Some([4, 8]), ..(**form).clone() }.into();
    assert_told(&small, &[both, "8 x 4 pixels, the frames are 64 x 64"]);
    // The covariance of counts is in counts^2; beside it frames in W mm^-2 sr^-1 have no noise that is known.
    let counts = covariance(with(&|info| info.unit = "counts".into()));
    assert!(counts.0.layers.iter().all(|layer| layer.info.unit == "counts^2"));
    let other = beside(Frames(three.clone()), counts.clone());
    assert_told(&other, &[both, "in counts^2, but the frames are in W mm^-2 sr^-1", "W^2 mm^-4 sr^-2"]);
    let inputs = Inputs::from(vec![("frames", Frames(three).into_artifact()), ("covariance", counts.into_artifact())]);
    let host = MemoryHost { wanted: vec!["covariance".into()], ..MemoryHost::default() };
    let error = StageRow::of::<Sensor>().run(&json!({}), &inputs, Ctx::new(&host)).expect_err("it is refused");
    assert!(error.to_string().contains("the covariance is in counts^2"), "{error}");
}
