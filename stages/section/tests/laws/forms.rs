//! What is said of sections before a run, and inputs that do not fit.

use std::marker::PhantomData;

use turbid_contract::payload::{Modulation, Payload, Truth};
use turbid_contract::{Ctx, Form, ImageStack, Known, MemoryHost, Problems, Stage};
use turbid_section::{In, Method, Params, SectionTube};

use crate::{tube, tube_of, with};

fn known(modulation: &ImageStack, truth: &ImageStack) -> Known {
    let mut known = Known::default();
    let ports = [
        ("modulation", Modulation(modulation.clone()).into_artifact()),
        ("truth", Truth(truth.clone()).into_artifact()),
    ];
    for (port, artifact) in ports {
        known.connected.push(port.into());
        known.forms.insert(port.into(), vec![Form::of(&artifact).into()]);
        known.extents.insert(port.into(), artifact.extent());
        known.producers.insert(port.into(), format!("tube.{port}"));
    }
    known
}

#[test]
fn what_is_said_is_made() {
    let (modulation, mut truth) = tube();
    for pitch in [None, Some(serde_json::json!([0.13, 0.13]))] {
        truth.attributes.extend(pitch.map(|pitch| ("pixel_pitch_mm".to_owned(), pitch)));
        for params in [with(Method::EqualLength, Some(3)), Params { blend: 0.0, ..with(Method::Optimal, Some(2)) }] {
            let known = known(&modulation, &truth);
            let form = SectionTube::describe(&params, &known).remove("sections").unwrap();
            assert!(form.pixels.is_some() && form.layers.is_some() && form.attribute("blend").is_some());
            assert!(SectionTube::plan(&params, &known).memory.is_some());
            let inputs =
                In { modulation: Modulation(modulation.clone()), truth: Truth(truth.clone()), source: PhantomData };
            let made = SectionTube::run(&params, inputs, Ctx::new(&MemoryHost::default())).unwrap();
            assert_eq!(form.broken_by(&Form::of(&made.sections.into_artifact())), None);
        }
    }
}

#[track_caller]
fn assert_told(params: &Params, (modulation, truth): &(ImageStack, ImageStack), parts: &[&str]) {
    let mut problems = Problems::default();
    SectionTube::check(params, &known(modulation, truth), &mut problems);
    let found = problems.into_parts().0;
    assert_eq!(found.len(), 1, "{found:?}");
    let text = found[0].to_string();
    parts.iter().for_each(|part| assert!(text.contains(part), "`{part}` is missing in `{text}`"));
}

#[test]
fn wrong_joints_are_named() {
    let fine = with(Method::EqualLength, Some(3));
    let small = (tube().0, tube_of(10).1);
    let sizes =
        ["in.truth: `tube.truth` does not belong to `tube.modulation`: ", "200 x 200 pixels, the truth 10 x 10"];
    assert_told(&fine, &small, &sizes);
    for name in ["height", "normal_z", "object"] {
        let mut without = tube();
        without.1.layers.retain(|layer| layer.info.name != name);
        assert_told(&fine, &without, &["in.truth: `tube.truth`: ", &format!("no layer `{name}`"), "of a render"]);
    }
    for name in ["m_dc", "m_ac"] {
        let mut without = tube();
        without.0.layers.retain(|layer| layer.info.name != name);
        assert_told(&fine, &without, &["in.modulation: `tube.modulation`: ", &format!("no layer `{name}`")]);
    }
    let other = Params { objects: Some(vec!["wall".into(), "bore".into()]), ..fine };
    assert_told(&other, &tube(), &["objects.1: `tube.truth`: the scene has no object `bore`; it has lamp, wall"]);
}
