//! `STAGE[axis=value,…][.PORT]`: which instances and port a command is about.

use crate::key::value_text;
use crate::plan::{InstanceId, Plan, StageId};

use crate::spec::{Diagnostic, Kind, Mistake};

use super::Failure;

/// A parsed selector.
#[derive(Debug, Default, PartialEq)]
pub struct Selector {
    pub stage: String,
    pub axes: Vec<(String, String)>,
    /// The axes as they were written: a label of an instance is taken as it is printed, whatever its values hold.
    pub label: String,
    pub port: Option<String>,
}

impl Selector {
    pub fn parse(text: &str) -> Result<Self, Failure> {
        let wrong = || {
            Failure::Input(format!("`{text}` must look like STAGE, STAGE.PORT or STAGE[axis=value,axis=value].PORT"))
        };
        let (head, tail) = match text.split_once('[') {
            None => {
                return Ok(match text.split_once('.') {
                    Some((stage, port)) => Self { stage: stage.into(), port: Some(port.into()), ..Self::default() },
                    None => Self { stage: text.into(), ..Self::default() },
                });
            }
            Some((head, tail)) => (head, tail),
        };
        // Values may be lists; the name of a port holds no bracket.
        let (inside, rest) = tail.rsplit_once(']').ok_or_else(wrong)?;
        let axes: Option<Vec<(String, String)>> = pairs(inside)
            .into_iter()
            .map(|pair| pair.split_once('=').map(|(n, v)| (n.trim().to_owned(), v.trim().to_owned())))
            .collect();
        let port = match rest.strip_prefix('.') {
            Some(port) => Some(port.to_owned()),
            None if rest.is_empty() => None,
            None => return Err(wrong()),
        };
        Ok(Self { stage: head.into(), axes: axes.ok_or_else(wrong)?, label: inside.to_owned(), port })
    }

    /// The stage that it names; an error where there is none.
    pub fn stage(&self, plan: &Plan) -> Result<StageId, Failure> {
        plan.spec.stage(&self.stage).ok_or_else(|| {
            let names: Vec<&str> = plan.spec.stages.iter().map(|s| s.name.as_str()).collect();
            unknown(format!("there is no stage `{}`; the pipeline has {}", self.stage, names.join(", ")))
        })
    }

    /// The instances of the plan that it names; an error where there is none.
    pub fn instances(&self, plan: &Plan) -> Result<Vec<InstanceId>, Failure> {
        let stage = self.stage(plan)?;
        if let Some(port) = &self.port
            && !plan.outputs(stage).iter().any(|p| p.name == port)
        {
            let names: Vec<&str> = plan.outputs(stage).iter().map(|p| p.name).collect();
            return Err(unknown(format!("stage `{}` has no output `{port}`; it has {}", self.stage, names.join(", "))));
        }
        let fits = |id: &InstanceId| {
            self.axes.iter().all(|(name, wanted)| {
                plan.axis(*id, name).is_some_and(|value| {
                    let same_number = matches!((wanted.parse::<f64>(), value.as_f64()), (Ok(a), Some(b)) if a == b);
                    same_number || value_text(value) == *wanted
                })
            })
        };
        let own = |id: &InstanceId| !self.label.is_empty() && plan.axes_text(*id) == self.label;
        let found: Vec<InstanceId> = match plan.instances_of(stage).find(own) {
            Some(id) => vec![id],
            None => plan.instances_of(stage).filter(fits).collect(),
        };
        if found.is_empty() {
            let some: Vec<String> = plan.instances_of(stage).take(5).map(|id| plan.label(id)).collect();
            return Err(unknown(format!(
                "no instance of `{}` has these axes; there are {}",
                self.stage,
                some.join(", ")
            )));
        }
        Ok(found)
    }
}

/// A name or value that the plan has not.
fn unknown(message: String) -> Failure {
    Failure::Report(Diagnostic::nowhere(Mistake::new(Kind::UnknownName, message)).into())
}

/// What stands between commas that are in no list.
fn pairs(text: &str) -> Vec<&str> {
    let (mut pairs, mut start, mut depth) = (Vec::new(), 0, 0);
    for (at, c) in text.char_indices() {
        match c {
            '[' | '{' => depth += 1,
            ']' | '}' => depth -= 1,
            ',' if depth == 0 => {
                pairs.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    pairs.push(&text[start..]);
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selectors_read_stage_axes_and_port() {
        let parse = |t: &str| Selector::parse(t).ok();
        let axes = vec![("A".to_owned(), "1.5".to_owned()), ("b".to_owned(), "x".to_owned())];
        assert_eq!(parse("s").unwrap().stage, "s");
        assert_eq!(parse("s.frames").unwrap().port.as_deref(), Some("frames"));
        assert_eq!(
            parse("s[A=1.5,b=x].p"),
            Some(Selector { stage: "s".into(), axes: axes.clone(), label: "A=1.5,b=x".into(), port: Some("p".into()) })
        );
        assert_eq!(
            parse("s[A=1.5,b=x]"),
            Some(Selector { stage: "s".into(), axes, label: "A=1.5,b=x".into(), port: None })
        );
        let list = parse("s[f_x=[0,0.1],b=x].p").unwrap();
        assert_eq!(list.axes, [("f_x".to_owned(), "[0,0.1]".to_owned()), ("b".to_owned(), "x".to_owned())]);
        assert_eq!(list.port.as_deref(), Some("p"));
        assert_eq!(parse("s[A]"), None);
        assert_eq!(parse("s[A=1"), None);
        assert_eq!(parse("s[A=1]x"), None);
    }
}
