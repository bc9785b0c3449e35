//! All type mistakes of one stage's params at once, although serde stops at the first.
//!
//! After each mistake the field that it names is healed: taken out, or replaced by some value that is accepted, and
//! the params are read again. What is then wrong with a healed field or with the map around it follows from the first
//! mistake and is not reported.

use serde_json::{Value, json};
use turbid_contract::{Found, Job, ParamError, ParamMistake, StageRow, Wanted};

use super::mistake::{Kind, Mistake};
use super::{scalar, suggest};

/// Mistakes in one stage that are looked for.
const MAX_ROUNDS: usize = 40;

/// One mistake in the params of a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamProblem {
    /// Below `with`; empty for `with` itself.
    pub path: Vec<String>,
    pub mistake: Mistake,
}

/// Reads the params of an instance; without mistakes the result is there, else the mistakes are.
pub fn read_params(row: &StageRow, params: &Value) -> (Option<Box<dyn Job>>, Vec<ParamProblem>) {
    let mut error = match (row.prepare)(params) {
        Ok(job) => return (Some(job), Vec::new()),
        Err(error) => error,
    };
    let mut params = params.clone();
    let mut healed: Vec<Vec<String>> = Vec::new();
    let mut found: Vec<ParamProblem> = Vec::new();
    for _ in 0..MAX_ROUNDS {
        let (problem, meant) = describe(&error);
        let at = problem.path.clone();
        let follows = healed.iter().any(|h| h.starts_with(&at) || at.starts_with(h));
        if !follows {
            found.push(problem);
        }
        // A misspelt field is not also missing under its right name.
        healed.extend(meant.map(|name| [&at[..at.len().saturating_sub(1)], &[name]].concat()));
        match heal(row, &mut params, at, &mut healed) {
            Some(next) => error = next,
            None => break,
        }
    }
    (None, found)
}

/// Makes `params` acceptable at `at`, or else around it; the next mistake elsewhere.
fn heal(row: &StageRow, params: &mut Value, mut at: Vec<String>, healed: &mut Vec<Vec<String>>) -> Option<ParamError> {
    let fillers = [json!(1), json!([1, 1]), json!([1, 1, 1]), json!({}), json!([]), json!("1")];
    while !at.is_empty() {
        for filler in std::iter::once(None).chain(fillers.iter().map(Some)) {
            let mut tried = params.clone();
            if !replace(&mut tried, &at, filler) {
                continue;
            }
            let Err(error) = (row.prepare)(&tried) else { return None };
            if !describe(&error).0.path.starts_with(&at) {
                *params = tried;
                healed.push(at);
                return Some(error);
            }
        }
        at.pop();
    }
    None
}

/// Puts `filler` at `at`, or takes out what is there; whether that could be done.
fn replace(params: &mut Value, at: &[String], filler: Option<&Value>) -> bool {
    let Some((last, above)) = at.split_last() else { return false };
    let mut place = params;
    for step in above {
        let next = match place {
            Value::Object(map) => map.get_mut(step),
            Value::Array(items) => step.parse::<usize>().ok().and_then(|i| items.get_mut(i)),
            _ => None,
        };
        match next {
            Some(next) => place = next,
            None => return false,
        }
    }
    match (place, filler) {
        (Value::Object(map), Some(value)) => {
            map.insert(last.clone(), value.clone());
            true
        }
        (Value::Object(map), None) => map.remove(last).is_some(),
        (Value::Array(items), Some(value)) => match last.parse::<usize>().ok().and_then(|i| items.get_mut(i)) {
            Some(item) => {
                *item = value.clone();
                true
            }
            None => false,
        },
        // Taking out an item would change the meaning of those behind it.
        _ => false,
    }
}

/// The mistake in the words of a pipeline file, and the field that a misspelt one meant.
fn describe(error: &ParamError) -> (ParamProblem, Option<String>) {
    let mut path = error.path.clone();
    let field = path.iter().rev().find(|step| step.parse::<usize>().is_err());
    let field = field.map_or_else(|| "`with`".to_owned(), |name| format!("`{name}`"));
    let mut meant = None;
    let mistake = match &error.mistake {
        ParamMistake::Missing(name) => {
            // Always pushed: the path is that of the map, which may well have the name of its field.
            path.push(name.clone());
            Mistake::new(Kind::Missing, error.mistake.to_string())
        }
        ParamMistake::UnknownKey { name, known } => {
            if path.last() != Some(name) {
                path.push(name.clone());
            }
            meant = suggest::nearest(name, known.iter().copied()).map(str::to_owned);
            Mistake::new(Kind::UnknownKey, error.mistake.to_string()).hint(error.mistake.hint())
        }
        ParamMistake::UnknownChoice { .. } => {
            Mistake::new(Kind::UnknownName, error.mistake.to_string()).hint(error.mistake.hint())
        }
        ParamMistake::Type { found, wanted } => {
            let message = format!("{field} is {found}, but must be {}", wanted.rule(found));
            Mistake::new(Kind::WrongType, message).hint(written_otherwise(found, wanted))
        }
        ParamMistake::Length { found, wanted } => {
            Mistake::new(Kind::WrongType, format!("{field} has {found} values, but must have {wanted}"))
        }
        ParamMistake::Unit(text) => Mistake::new(Kind::WrongUnit, text.clone()),
        ParamMistake::Other(text) => Mistake::new(Kind::WrongValue, text.clone()),
    };
    (ParamProblem { path, mistake }, meant)
}

/// How what stands there is written where something else is wanted.
fn written_otherwise(found: &Found, wanted: &Wanted) -> Option<String> {
    match (found, wanted) {
        (Found::Number(n), Wanted::List) => Some(format!("write `[{n}]`")),
        (Found::Number(n), Wanted::ListOf(count)) if *count <= 4 => {
            Some(format!("write `[{}]`", vec![n.to_string(); *count].join(", ")))
        }
        (Found::Text(text), Wanted::Bool) => scalar::look_alike(text, true),
        (Found::Text(text), Wanted::Whole { .. } | Wanted::Number | Wanted::Described(_)) => {
            scalar::look_alike(text, false)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::{Deserialize, Serialize};
    use turbid_contract::schemars::{self, JsonSchema};
    use turbid_contract::{Ctx, Error, InPorts, Known, Length, Problems, Stage, in_ports, out_ports};

    #[derive(Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Camera {
        position: [Length; 3],
        pixels: [u32; 2],
    }

    #[derive(Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    enum Method {
        Path,
        Rte,
    }

    #[derive(Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Params {
        camera: Camera,
        samples: u32,
        #[serde(default)]
        f_x: Vec<f64>,
        method: Option<Method>,
    }

    in_ports! {
        struct In {}
    }
    out_ports! {
        struct Out {}
    }
    struct Probe;
    impl Stage for Probe {
        const NAME: &'static str = "probe";
        const VERSION: u32 = 1;
        const ABOUT: &'static str = "Has params.";
        type Params = Params;
        type In = In<'static>;
        type Out = Out;
        fn check(_: &Params, _: &Known, _: &mut Problems) {}
        fn run(_: &Params, _: <In<'static> as InPorts>::Loaded<'_>, _: Ctx<'_>) -> Result<Out, Error> {
            Ok(Out {})
        }
    }

    fn problems(params: Value) -> Vec<String> {
        let (prepared, found) = read_params(&StageRow::of::<Probe>(), &params);
        assert_eq!(prepared.is_some(), found.is_empty());
        let line = |ParamProblem { path, mistake: m }: ParamProblem| {
            format!("{}: {} | {}", path.join("."), m.message, m.hint.unwrap_or_default())
        };
        found.into_iter().map(line).collect()
    }

    #[test]
    fn right_params_have_no_problems() {
        let camera = json!({"position": [0, 0, "0.5 m"], "pixels": [64, 64]});
        assert_eq!(problems(json!({"camera": camera, "samples": 16, "method": "rte"})), Vec::<String>::new());
    }

    #[test]
    fn all_mistakes_of_a_stage_come_at_once_and_nothing_that_follows_from_them() {
        let camera = json!({"position": [0, "4 deg"], "pixles": [64, 64]});
        let found = problems(json!({
            "camera": camera, "sampels": 3, "f_x": [0, "fast", true], "method": "pth", "colour": "red"
        }));
        let expected = [
            "camera.position.1: ",
            "camera.pixles: there is no key `pixles` here | did you mean `pixels`?",
            "sampels: there is no key `sampels` here | did you mean `samples`?",
            "f_x.1: `f_x` is the text \"fast\", but must be a number | ",
            "f_x.2: `f_x` is true, but must be a number | ",
            "method: there is no choice `pth` here | did you mean `path`?",
            "colour: there is no key `colour` here | ",
        ];
        for line in expected {
            assert_eq!(found.iter().filter(|f| f.starts_with(line)).count(), 1, "{line}\n{found:#?}");
        }
        assert_eq!(found.len(), expected.len(), "{found:#?}");
    }

    #[test]
    fn every_missing_field_is_named() {
        assert_eq!(
            problems(json!({"camera": {}})),
            [
                "camera.position: `position` is missing | ",
                "camera.pixels: `pixels` is missing | ",
                "samples: `samples` is missing | "
            ]
        );
    }

    #[test]
    fn wrong_kinds_are_said_in_plain_words() {
        for (params, says) in [
            (json!({"samples": -3}), "samples: `samples` is -3, but must be a whole number, 0 or more"),
            (
                json!({"samples": 1_000_000_000_000_u64}),
                "samples: `samples` is 1000000000000, but must be a whole number from 0 to 4294967295",
            ),
            (json!({"samples": 1e30}), "samples: `samples` is 1e+30, but must be a whole number from 0 to 4294967295"),
            (json!({"f_x": 90}), "f_x: `f_x` is 90, but must be a list | write `[90]`"),
            (
                json!({"camera": {"pixels": 32}}),
                "camera.pixels: `pixels` is 32, but must be a list of 2 values | write `[32, 32]`",
            ),
            (json!({"samples": 1.5}), "samples: `samples` is 1.5, but must be a whole number, 0 or more"),
            (json!({"camera": 3}), "camera: `camera` is 3, but must be a map"),
            (json!({"camera": {"pixels": [1]}}), "camera.pixels: `pixels` has 1 values, but must have 2"),
            (json!({"f_x": 0.1}), "f_x: `f_x` is 0.1, but must be a list"),
        ] {
            let found = problems(params);
            assert!(found.iter().any(|f| f.starts_with(says)), "{says}\n{found:#?}");
        }
    }
}
