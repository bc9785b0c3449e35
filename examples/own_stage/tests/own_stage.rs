//! The stage by itself, and in a program with all others.

use std::path::PathBuf;
use std::process::Command;

use own_stage::{Depth, ModulationDepth};
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Modulation};
use turbid_contract::serde_json::{Value, from_slice, json};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};

/// 2 x 3 pixels at f_x = 0.1: M_DC 4, M_AC 1, standard errors 0.12 and 0.04 that are independent; the first pixel is background.
fn modulation() -> Modulation {
    let mut stack = ImageStack::new(2, 3);
    let of = |name: &str| LayerInfo::value(name, "W mm^-2 sr^-1").with_f_x(0.1);
    let plane = |value: f32| Array2::from_elem((2, 3), value);
    stack.push(of("m_dc"), plane(4.0));
    stack.push(of("m_ac"), plane(1.0));
    stack.push(of("m_dc").standard_error(), plane(0.12));
    stack.push(of("m_ac").standard_error(), plane(0.04));
    let pair = LayerInfo { pair: Some([0, 1]), ..LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2") };
    stack.push(pair, plane(0.0));
    let mut mask = plane(0.0);
    mask[(0, 0)] = MaskReason::Background.code();
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    Modulation(stack)
}

fn trial(params: Value) -> Trial {
    Trial::of::<ModulationDepth>(params).input("modulation", modulation())
}

/// 1 / 4 with 3 % and 4 % of noise: 0.25 with 5 %. What is masked stays masked for its reason, and counts in no mean: sqrt(5) 0.0125 / 5.
#[test]
fn depth_and_error_of_each_pixel() {
    let Depth(depth) = trial(json!({})).run().unwrap().get("depth");
    let of = |name: &str| depth.find(name, None).unwrap_or_else(|| panic!("no layer {name}"));
    let [d, se, mask] = ["modulation_depth", "modulation_depth_se", "mask"].map(of);
    assert_eq!([d.data[(0, 0)], se.data[(0, 0)], mask.data[(0, 0)]], [0.0, 0.0, MaskReason::Background.code()]);
    assert_eq!([d.data[(1, 2)], mask.data[(1, 2)]], [0.25, 0.0]);
    // f32 images hold seven digits.
    assert!((se.data[(1, 2)] / 0.0125 - 1.0).abs() < 1e-6, "{}", se.data[(1, 2)]);
    let mean_se = d.info.mean_se.expect("the errors are known");
    assert!((mean_se / (0.0125 / 5.0_f64.sqrt()) - 1.0).abs() < 1e-6, "{mean_se}");
}

#[test]
fn weak_pixels_and_unknown_errors_are_told() {
    let Depth(weak) = trial(json!({"least": "30 %"})).run().unwrap().get("depth");
    assert_eq!(weak.find("mask", None).unwrap().data[(1, 1)], MaskReason::LowSignal.code());
    let mut unknown = modulation();
    let info = unknown.0.layers[1].info.se_unknown();
    unknown.0.push(info, Array2::from_elem((2, 3), 1.0));
    let Depth(depth) = Trial::of::<ModulationDepth>(json!({})).input("modulation", unknown).run().unwrap().get("depth");
    let flags = &depth.find("modulation_depth_se_unknown", None).expect("flags are passed on").data;
    assert_eq!([flags[(0, 0)], flags[(1, 1)]], [0.0, 1.0]);
    assert_eq!(depth.find("modulation_depth", None).unwrap().info.mean_se, None);
    let mut bare = modulation();
    bare.0.layers.retain(|layer| layer.info.kind != LayerKind::Covariance);
    let made = Trial::of::<ModulationDepth>(json!({})).input("modulation", bare).run().unwrap();
    assert!(made.host.warned()[0].contains("no standard errors"), "{:?}", made.host.warned());
    assert!(made.get::<Depth>("depth").0.find("modulation_depth_se", None).is_none());
}

#[test]
fn it_keeps_the_rules_and_names_mistakes() {
    trial(json!({"least": 0.1})).keeps_the_rules();
    trial(json!({"least": 2})).refuses("least", "least = 2 must lie in [0, 1)");
    trial(json!({"last": 0.1})).refuses("last", "`last`");
    let mut flat = modulation();
    flat.0.layers.iter_mut().for_each(|layer| layer.info.f_x_per_mm = layer.info.f_x_per_mm.map(|_| 0.0));
    let flat = Trial::of::<ModulationDepth>(json!({})).input("modulation", flat);
    flat.refuses("in.modulation", "has no fringe of f_x > 0");
}

/// The program of `main.rs` in a folder of its own, with `depth.yaml`: exit code, stdout and stderr.
fn program(folder: &str, arguments: &[&str]) -> (Option<i32>, Vec<u8>, String) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder);
    std::fs::create_dir_all(&folder).expect("tests may write there");
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/depth.yaml"), folder.join("depth.yaml")).expect("it is there");
    let done = Command::new(env!("CARGO_BIN_EXE_own_stage")).args(arguments).current_dir(&folder).output();
    let done = done.expect("the program starts");
    (done.status.code(), done.stdout, String::from_utf8_lossy(&done.stderr).into_owned())
}

/// The whole pipeline through the program; the depth falls with f_x, and is known well enough to see it.
#[test]
fn the_program_runs_it_with_all_others() {
    let (code, _, error) = program("run", &["check", "depth.yaml"]);
    assert_eq!((code, error.contains("error")), (Some(0), false), "{error}");
    let (code, _, error) = program("run", &["run", "depth.yaml"]);
    assert_eq!(code, Some(0), "{error}");
    let (_, shown, error) = program("run", &["show", "depth.yaml", "depth", "--json"]);
    let shown: Value = from_slice(&shown).unwrap_or_else(|e| panic!("{e}: {error}"));
    let layers = shown["instances"][0]["ports"]["depth"]["layers"].as_array().expect("layers");
    let depths: Vec<[f64; 2]> = layers
        .iter()
        .filter(|layer| layer["name"] == "modulation_depth")
        .map(|layer| ["mean", "mean_se"].map(|field| layer[field].as_f64().expect("a number")))
        .collect();
    assert_eq!(depths.len(), 4, "{shown}");
    for pair in depths.windows(2) {
        let apart = pair[0][0] - pair[1][0];
        assert!(apart > 3.0 * (pair[0][1] + pair[1][1]), "{depths:?}");
    }
    let (code, _, error) = program("wrong", &["check", "depth.yaml", "--set", "stages.depth.with.least=150 %"]);
    assert!(code == Some(2) && error.contains("least = 1.5 must lie in [0, 1)"), "{error}");
}
