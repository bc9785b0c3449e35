//! Every kind of mistake by what it is; and that what serde_json reads is read alike.

use std::collections::BTreeMap;
use std::num::NonZeroU32;

use serde::Deserialize;
use serde_json::json;

use super::*;
use crate::quantity::{Length, Ratio};

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Camera {
    position: [Length; 3],
    pixels: (u32, u32),
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Method {
    Path,
    Rte { order: u8 },
    Both(Vec<f64>),
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Params {
    #[serde(default)]
    camera: Option<Camera>,
    #[serde(default)]
    method: Option<Method>,
    #[serde(default)]
    f_x: Vec<f64>,
    #[serde(default)]
    g: Option<Ratio>,
    #[serde(default)]
    repeats: Option<NonZeroU32>,
    #[serde(default)]
    shift: Option<i8>,
    #[serde(default)]
    names: BTreeMap<String, bool>,
}

fn wrong(params: &Value) -> (String, ParamMistake) {
    let error = read_params::<Params>(params).expect_err("it is wrong");
    (error.path.join("."), error.mistake)
}

#[test]
fn what_serde_json_reads_is_read_alike() {
    for params in [
        json!({}),
        json!({"camera": {"position": [0, -1.5, "0.5 m"], "pixels": [3, 4]}, "g": "80 %", "repeats": 7, "shift": -3}),
        json!({"camera": null, "method": "path", "f_x": [0, 1e-3, -2], "names": {"a b": true}}),
        json!({"method": {"rte": {"order": 3}}}),
        json!({"method": {"both": [1, 2]}}),
        json!({"method": {"path": null}}),
    ] {
        let expected: Params = serde_json::from_value(params.clone()).expect("it is right");
        assert_eq!(read_params::<Params>(&params), Ok(expected), "{params}");
    }
}

#[test]
fn every_mistake_is_told_by_what_it_is() {
    let keys: &[&str] = &["position", "pixels"];
    let at = |params: Value| wrong(&params);
    assert_eq!(
        at(json!({"camera": {"pixles": 1}})),
        ("camera.pixles".into(), ParamMistake::UnknownKey { name: "pixles".into(), known: keys })
    );
    assert_eq!(at(json!({"camera": {}})), ("camera".into(), ParamMistake::Missing("position".into())));
    let choice = ParamMistake::UnknownChoice { name: "pth".into(), known: &["path", "rte", "both"] };
    assert_eq!(at(json!({"method": "pth"})), ("method".into(), choice));
    let pixels = |pixels: Value| wrong(&json!({"camera": {"position": [0, 0, 1], "pixels": pixels}})).1;
    assert_eq!(pixels(json!([1])), ParamMistake::Length { found: 1, wanted: 2 });
    assert_eq!(pixels(json!([1, 2, 3])), ParamMistake::Length { found: 3, wanted: 2 });
    assert_eq!(pixels(json!(12)), ParamMistake::Type { found: Found::Number(12.into()), wanted: Wanted::ListOf(2) });
    assert!(matches!(at(json!({"g": "3 mm"})).1, ParamMistake::Unit(_)));
    let (path, list) = at(json!({"camera": [[0, 0, 0], [1, 1]]}));
    assert_eq!((path.as_str(), list), ("camera", ParamMistake::Type { found: Found::List, wanted: Wanted::Map }));
}

/// The way out names the field or the word that was meant, or all there are.
#[test]
fn unknown_names_are_told_with_known_ones() {
    for (params, hint) in [
        (json!({"camera": {"pixles": 1}}), Some("did you mean `pixels`?")),
        (json!({"camera": {"lens": 1}}), Some("known: `position`, `pixels`")),
        (json!({"method": "pth"}), Some("did you mean `path`?")),
        (json!({"method": "magic"}), Some("known: `path`, `rte`, `both`")),
        (json!({"f_x": 3}), None),
    ] {
        assert_eq!(wrong(&params).1.hint().as_deref(), hint, "{params}");
    }
}

/// In plain words, with the limit of the type for those beyond it.
#[test]
fn rules_name_the_limit_that_is_broken() {
    for (params, says) in [
        (json!({"repeats": 1e12}), "1000000000000.0 stands where a whole number from 1 to 4294967295 is wanted"),
        (json!({"repeats": 0}), "0 stands where a whole number, 1 or more is wanted"),
        (json!({"shift": -200}), "-200 stands where a whole number from -128 to 127 is wanted"),
        (json!({"shift": 0.5}), "0.5 stands where a whole number is wanted"),
        (json!({"f_x": ["a"]}), "the text \"a\" stands where a number is wanted"),
        (json!({"names": {"a": 1}}), "1 stands where true or false is wanted"),
        (json!({"method": 3}), "3 stands where one of path, rte, both is wanted"),
        (json!({"g": null, "f_x": null}), "empty stands where a list is wanted"),
    ] {
        assert_eq!(wrong(&params).1.to_string(), says, "{params}");
    }
}
