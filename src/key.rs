//! What a result depends on. One walk over it yields the key, and the text that `explain` shows.

use std::fmt::Write;

use serde_json::Value;
use turbid_contract::Axes;
use turbid_contract::canonical::canonical_text;

use crate::digest::{Digest, PartHasher};
use crate::spec::SeedSpec;

/// Raised when the meaning of keys changes.
const KEY_FORMAT: &str = "turbid key 1";
const STATE_FORMAT: &str = "turbid state 1";
const SEED_FORMAT: &str = "turbid seed 1";

/// Content on one input port: axes and digest of each artifact, in order of the axes' values. The axes are empty where
/// the port takes a single artifact.
pub type InputContent = Vec<(Axes, Digest)>;

/// All that the bytes of an instance's outputs depend on.
///
/// Not in it, so that they never make anything stale: labels, paths, comments, YAML order, wanted ports, thread
/// count, vector width, time, host.
#[derive(Clone, Debug, PartialEq)]
pub struct Dependencies {
    pub use_name: String,
    pub version: u32,
    /// Canonical, defaults filled.
    pub params: Value,
    /// Sorted by port.
    pub inputs: Vec<(String, InputContent)>,
    /// Field that names the file, its name (not its folder), its content; sorted by field.
    pub files: Vec<(String, String, Digest)>,
    /// Only of stages that draw.
    pub seed: Option<u64>,
}

impl Dependencies {
    /// Walks over everything that the key covers, as (name, canonical text).
    fn walk(&self, mut visit: impl FnMut(&str, &str)) {
        visit("use", &self.use_name);
        visit("version", &self.version.to_string());
        visit("with", &canonical_text(&self.params));
        for (port, content) in &self.inputs {
            for (axes, digest) in content {
                visit(&input_name(port, axes), &digest.to_string());
            }
        }
        for (at, name, digest) in &self.files {
            visit(&format!("file.{at}"), &format!("{name} {digest}"));
        }
        if let Some(seed) = self.seed {
            visit("seed", &seed.to_string());
        }
    }

    pub fn key(&self) -> Digest {
        let mut parts = PartHasher::new(KEY_FORMAT);
        self.walk(|name, text| parts.add(name, text.as_bytes()));
        parts.finish()
    }

    /// The key of the state that shorter and longer runs share: the key without the params that only say when to stop.
    pub fn state_key(&self, stopping: &[&str]) -> Option<Digest> {
        if stopping.is_empty() {
            return None;
        }
        let mut shared = self.clone();
        if let Value::Object(params) = &mut shared.params {
            params.retain(|name, _| !stopping.contains(&name.as_str()));
        }
        let mut parts = PartHasher::new(STATE_FORMAT);
        shared.walk(|name, text| parts.add(name, text.as_bytes()));
        Some(parts.finish())
    }

    /// The lines that `explain` compares, with params opened up to single fields.
    pub fn lines(&self) -> Vec<(String, String)> {
        let mut lines = Vec::new();
        self.walk(|name, text| {
            if name != "with" {
                lines.push((name.to_owned(), text.to_owned()));
            }
        });
        flatten("with", &self.params, &mut lines);
        lines.sort();
        lines
    }
}

/// Seed of an instance's random streams (DESIGN: not the label, not the params, so that a longer render continues
/// the same streams and no two scenes share one). `axes` is the text of its axes. An explicit seed replaces the input digests, a common one the axes too.
pub fn instance_seed(
    pipeline_seed: u64,
    use_name: &str,
    axes: &str,
    inputs: &[(String, InputContent)],
    explicit: Option<SeedSpec>,
) -> u64 {
    let mut parts = PartHasher::new(SEED_FORMAT);
    parts.add("pipeline", &pipeline_seed.to_le_bytes());
    parts.add("use", use_name.as_bytes());
    if !matches!(explicit, Some(SeedSpec::Common(_))) {
        parts.add("axes", axes.as_bytes());
    }
    match explicit {
        Some(SeedSpec::Common(seed)) => parts.add("common", &seed.to_le_bytes()),
        Some(SeedSpec::PerInstance(seed)) => parts.add("explicit", &seed.to_le_bytes()),
        None => {
            for (port, content) in inputs {
                for (axes, digest) in content {
                    parts.add(&input_name(port, axes), &digest.0);
                }
            }
        }
    }
    parts.finish().first_u64()
}

fn input_name(port: &str, axes: &Axes) -> String {
    if axes.is_empty() { format!("in.{port}") } else { format!("in.{port}[{}]", axes_text(axes)) }
}

/// `A_rho=1,S_rho=5000`: one text for one point, whether a value was written 1 or 1.0.
pub fn axes_text<'a>(axes: impl IntoIterator<Item = (&'a String, &'a Value)>) -> String {
    let mut text = String::new();
    for (name, value) in axes {
        if !text.is_empty() {
            text.push(',');
        }
        text.push_str(name);
        text.push('=');
        push_value(&mut text, value);
    }
    text
}

/// Text of an axis value: numbers by value, text without quotes.
pub fn value_text(value: &Value) -> String {
    let mut text = String::new();
    push_value(&mut text, value);
    text
}

/// The same at the end of another text.
pub fn push_value(text: &mut String, value: &Value) {
    let written = match value {
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(integer), _) => write!(text, "{integer}"),
            (None, Some(float)) if float.fract() == 0.0 && float.abs() < 1e15 => write!(text, "{float:.0}"),
            _ => write!(text, "{number}"),
        },
        Value::String(word) => text.write_str(word),
        other => text.write_str(&canonical_text(other)),
    };
    written.expect("a String takes every text");
}

fn flatten(path: &str, value: &Value, lines: &mut Vec<(String, String)>) {
    match value {
        Value::Object(map) if !map.is_empty() => {
            for (name, child) in map {
                flatten(&format!("{path}.{name}"), child, lines);
            }
        }
        Value::Array(items) if items.iter().any(|i| i.is_object() || i.is_array()) => {
            for (index, child) in items.iter().enumerate() {
                flatten(&format!("{path}.{index}"), child, lines);
            }
        }
        other => lines.push((path.to_owned(), canonical_text(other))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn dependencies() -> Dependencies {
        Dependencies {
            use_name: "render".into(),
            version: 1,
            params: json!({"samples": 64, "f_x": [0.0, 0.1]}),
            inputs: vec![("scene".into(), vec![(Axes::new(), Digest::of(b"scene"))])],
            files: Vec::new(),
            seed: Some(7),
        }
    }

    /// Every part of the dependencies moves the key; each alone.
    #[test]
    fn every_dependency_is_in_the_key() {
        let base = dependencies();
        let mut variants = vec![base.clone(); 6];
        variants[0].use_name = "rende".into();
        variants[1].version = 2;
        variants[2].params = json!({"samples": 65, "f_x": [0.0, 0.1]});
        variants[3].inputs[0].1 = vec![(Axes::new(), Digest::of(b"other"))];
        variants[4].files.push(("file".into(), "a.stl".into(), Digest::of(b"")));
        variants[5].seed = None;
        let mut keys: Vec<Digest> = variants.iter().map(Dependencies::key).collect();
        keys.push(base.key());
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), 7);
    }

    #[test]
    fn stopping_params_are_not_in_the_state_key() {
        let short = dependencies();
        let mut long = short.clone();
        long.params["samples"] = json!(256);
        assert_ne!(short.key(), long.key());
        assert_eq!(short.state_key(&["samples"]), long.state_key(&["samples"]));
        let mut other = short.clone();
        other.params["f_x"] = json!([0.0, 0.2]);
        assert_ne!(short.state_key(&["samples"]), other.state_key(&["samples"]));
        assert_eq!(short.state_key(&[]), None);
    }

    #[test]
    fn axes_read_the_same_as_integer_and_float() {
        let axes = |v: Value| -> Axes { [("A_rho".to_owned(), v)].into() };
        assert_eq!(axes_text(&axes(json!(1))), axes_text(&axes(json!(1.0))));
        assert_eq!(axes_text(&axes(json!(0.1))), "A_rho=0.1");
    }

    /// What tells two streams apart: inputs and axes; with an explicit seed that and the axes; with a common one that alone.
    #[test]
    fn an_explicit_seed_ignores_the_inputs_and_a_common_one_the_axes_too() {
        use SeedSpec::{Common, PerInstance};
        let seed = |use_name: &str, input: &[u8], mu_a: f64, explicit| {
            let inputs = [("scene".to_owned(), vec![(Axes::new(), Digest::of(input))])];
            instance_seed(1, use_name, &format!("mu_a={mu_a}"), &inputs, explicit)
        };
        let render = |input: &[u8], mu_a, explicit| seed("render", input, mu_a, explicit);
        assert_ne!(render(b"a", 1.0, None), render(b"b", 1.0, None));
        for explicit in [PerInstance(3), Common(3)].map(Some) {
            assert_eq!(render(b"a", 1.0, explicit), render(b"b", 1.0, explicit));
        }
        assert_ne!(render(b"a", 1.0, Some(PerInstance(3))), render(b"a", 2.0, Some(PerInstance(3))));
        assert_eq!(render(b"a", 1.0, Some(Common(3))), render(b"a", 2.0, Some(Common(3))));
        let apart = [None, Some(PerInstance(3)), Some(PerInstance(4)), Some(Common(3)), Some(Common(4))];
        let mut seeds: Vec<u64> = apart.iter().map(|&e| render(b"a", 1.0, e)).collect();
        seeds.push(seed("sensor", b"a", 1.0, Some(Common(3))));
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 6);
    }

    /// Streams of files that are in use: a format that moved them would make every render stale.
    #[test]
    fn seeds_are_what_they_were() {
        let inputs = [("scene".to_owned(), vec![(Axes::new(), Digest::of(b"scene"))])];
        let seed = |explicit| instance_seed(1, "render", "mu_a=0.1", &inputs, explicit);
        assert_eq!(
            [None, Some(SeedSpec::PerInstance(7))].map(seed),
            [6_428_100_788_515_178_958, 17_550_958_084_679_957_646]
        );
    }
}
