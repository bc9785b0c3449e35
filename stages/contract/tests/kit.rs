//! The kit finds what breaks a rule, and nothing in a stage that keeps them.

use std::panic::{AssertUnwindSafe, catch_unwind};

use serde_json::{Value, json};
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Maps, Preview};
use turbid_contract::{Ctx, Error, Form, Forms, ImageStack, Known, LayerInfo, Problems, Stage, in_ports, out_ports};

/// Params of `scale`.
#[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
struct Params {
    factor: f64,
    /// The rule to break.
    #[serde(default)]
    breaks: String,
}

in_ports! {
    struct In {
        maps: one Maps,
        others: many Maps,
    }
}

out_ports! {
    struct Out {
        maps: one Maps,
        picture: preview Preview,
    }
}

/// Maps times a factor.
struct Scale;

impl Stage for Scale {
    const NAME: &'static str = "scale";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "maps times a factor";
    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        problems.require(params.factor > 0.0, "factor", params.factor, "", "be > 0");
        if known.fact("maps").get("n") == Some(&json!(2)) {
            problems.warn("factor", "glass");
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        let mut form = known.form("maps").cloned().unwrap_or_default();
        if params.breaks == "form" {
            form.pixels = Some([3, 2]);
        }
        form.layers = form.layers.filter(|_| params.breaks.is_empty());
        Forms::from([("maps", Form { attributes: Default::default(), ..form })])
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let breaks = |rule: &str| params.breaks == rule;
        let mut stack = ImageStack::new(2, 3);
        for layer in &inputs.maps.0.layers {
            let mut data = layer.data.mapv(|v| v * params.factor as f32 + inputs.others.axes().len() as f32);
            if breaks("threads") {
                data[(0, 0)] = ctx.threads() as f32;
            }
            if breaks("optional") && ctx.wants("picture") {
                data[(0, 0)] += 1.0;
            }
            if breaks("finite") {
                data[(1, 2)] = f32::NAN;
            }
            let mut info = layer.info.clone();
            if breaks("declared") {
                info.name = "mu_b".to_owned();
            }
            if breaks("twice") {
                stack.push(info.clone(), data.clone());
            }
            stack.push(info, data);
        }
        let wanted = ctx.wants("picture") && !breaks("wanted");
        Ok(Out { maps: Maps(stack.clone()), picture: wanted.then_some(Preview(stack)) })
    }
}

fn maps() -> Maps {
    let mut stack = ImageStack::new(2, 3);
    stack.push(LayerInfo::value("mu_a", "mm^-1"), Array2::from_elem((2, 3), 0.1));
    Maps(stack)
}

fn trial(params: Value) -> Trial {
    Trial::of::<Scale>(params).input("maps", maps()).wants("picture")
}

/// The message of a panic.
fn panics(work: impl FnOnce()) -> String {
    let panic = catch_unwind(AssertUnwindSafe(work)).expect_err("a rule is broken");
    panic.downcast_ref::<String>().cloned().or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap()
}

#[test]
fn a_good_stage_keeps_the_rules() {
    let good = trial(json!({"factor": 2}));
    good.passes();
    good.keeps_the_rules();
    let many = good.input_at("others", [("A".to_owned(), json!(1))].into(), maps());
    let made: Maps = many.run().unwrap().get("maps");
    // f32 holds 0.1 to 7 digits.
    assert!((made.0.layers[0].data[(0, 0)] - 1.2).abs() < 1e-6);
}

#[test]
fn each_broken_rule_is_named() {
    for (breaks, told) in [
        ("threads", "three threads give other outputs than one"),
        ("optional", "`maps` depends on which optional ports are wanted"),
        ("form", "output `maps` has 3 x 2 pixels instead of 2 x 3 pixels"),
        ("finite", "layer `mu_a` is NaN at row 1, column 2"),
        ("declared", "output `maps` has a layer mu_b (mm^-1), which maps does not declare"),
        ("twice", "two layers say the same"),
        ("wanted", "whether `picture` is made and wanted"),
    ] {
        let message = panics(|| trial(json!({"factor": 2, "breaks": breaks})).keeps_the_rules());
        assert!(message.contains(told), "{breaks}: {message}");
    }
}

#[test]
fn mistakes_are_found_as_the_engine_finds_them() {
    trial(json!({"factor": -1})).refuses("factor", "factor = -1 must be > 0");
    trial(json!({"factor": 1, "b": 2})).refuses("b", "there is no key `b` here (known: `factor`, `breaks`)");
    let message = panics(|| trial(json!({"factor": 1})).refuses("factor", "be > 0"));
    assert!(message.contains("one mistake is expected"), "{message}");
    let mut glass = maps();
    glass.0.attributes.insert("n".into(), json!(2));
    let warned = panics(|| Trial::of::<Scale>(json!({"factor": 1})).input("maps", glass).passes());
    assert!(warned.contains("glass"), "{warned}");
    let Err(error) = trial(json!({"factor": 0})).run() else { panic!("0 is not above 0") };
    assert_eq!(error.to_string(), "factor: factor = 0 must be > 0");
}

#[test]
fn ports_that_are_not_there_are_named() {
    assert!(panics(|| drop(trial(json!({})).input("map", maps()))).contains("`scale` has no input `map`"));
    assert!(panics(|| drop(trial(json!({})).input("others", Preview(maps().0)))).contains("takes maps, not preview"));
    assert!(panics(|| drop(trial(json!({})).input("maps", maps()))).contains("takes one artifact"));
    assert!(panics(|| drop(trial(json!({})).wants("maps"))).contains("no optional output `maps`"));
}
