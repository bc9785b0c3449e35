//! Which output port feeds which input port: names, payloads and arities, before any axis is looked at.

use turbid_contract::{Arity, InPort, OutPort};

use crate::spec::{Diagnostic, InputSpec, Section, SourceRef, Spec, nearest};

use super::StageInfo;

/// An input port with the sources that feed it.
#[derive(Debug)]
pub struct Link {
    pub port: InPort,
    pub sources: Vec<(SourceRef, SourcePort)>,
}

/// Stage (index into the pipeline's stages) and output port that a source names.
#[derive(Debug, Clone)]
pub struct SourcePort {
    pub stage: usize,
    pub port: OutPort,
}

/// Resolves the inputs of every stage, or reports every mistake in them.
pub fn link(spec: &Spec, stages: &[Option<StageInfo>], problems: &mut Vec<Diagnostic>) -> Vec<Vec<Link>> {
    spec.stages.iter().enumerate().map(|(at, _)| link_stage(spec, stages, at, problems)).collect()
}

fn link_stage(spec: &Spec, stages: &[Option<StageInfo>], at: usize, problems: &mut Vec<Diagnostic>) -> Vec<Link> {
    let Some(info) = &stages[at] else { return Vec::new() };
    let mut links = Vec::new();
    let mut misspelt = Vec::new();
    for input in &spec.stages[at].inputs {
        let Some(port) = info.inputs.iter().find(|p| p.name == input.port) else {
            let names: Vec<&str> = info.inputs.iter().map(|p| p.name).collect();
            let meant = nearest(&input.port, names.iter().copied());
            misspelt.extend(meant);
            let hint = meant.map(|name| format!("did you mean `{name}`?"));
            let has =
                if names.is_empty() { "it takes no inputs".to_owned() } else { format!("it has {}", names.join(", ")) };
            let message = format!("{} has no input `{}`; {has}", info.name, input.port);
            problems.push(spec.diagnostic(at, Section::In, &[input.port.as_str()], message, hint));
            continue;
        };
        if !matches!(port.arity, Arity::Many | Arity::Some) {
            if input.sources.len() > 1 {
                let message = format!("input `{}` takes one source, not {}", port.name, input.sources.len());
                problems.push(spec.diagnostic(at, Section::In, &[input.port.as_str()], message, None));
                continue;
            }
            if input.sources.iter().any(|s| s.over.is_some()) {
                let message =
                    format!("input `{}` takes one artifact; `over` is for inputs that gather many", port.name);
                problems.push(spec.diagnostic(at, Section::In, &[input.port.as_str(), "over"], message, None));
            }
        }
        let sources = input
            .sources
            .iter()
            .filter_map(|source| match find_source(spec, stages, at, port, source) {
                Ok(found) => found.map(|found| (source.clone(), found)),
                Err((message, hint)) => {
                    problems.push(spec.diagnostic(at, Section::In, &[input.port.as_str()], message, hint));
                    None
                }
            })
            .collect();
        links.push(Link { port: port.clone(), sources });
    }
    for port in info.inputs.iter().filter(|p| matches!(p.arity, Arity::One | Arity::Some)) {
        let given = spec.stages[at].inputs.iter().any(|i: &InputSpec| i.port == port.name);
        if !given && !misspelt.contains(&port.name) {
            let message = format!("{} needs the input `{}` ({})", info.name, port.name, port.payload);
            let hint = format!("add `in: {{{}: STAGE}}`", port.name);
            problems.push(spec.diagnostic(at, Section::In, &[] as &[&str], message, Some(hint)));
        }
    }
    links
}

type Mistake = (String, Option<String>);

/// `Ok(None)` where the source's own stage is broken and reported already.
fn find_source(
    spec: &Spec,
    stages: &[Option<StageInfo>],
    at: usize,
    wanted: &InPort,
    source: &SourceRef,
) -> Result<Option<SourcePort>, Mistake> {
    let Some(stage) = spec.stage(&source.stage) else {
        let names = spec.stages.iter().map(|s| s.name.as_str());
        let hint = nearest(&source.stage, names).map(|name| format!("did you mean `{name}`?"));
        return Err((format!("there is no stage `{}`", source.stage), hint));
    };
    let Some(info) = &stages[stage] else { return Ok(None) };
    let port = match &source.port {
        Some(name) => info.outputs.iter().find(|p| p.name == name).ok_or_else(|| {
            let names: Vec<&str> = info.outputs.iter().map(|p| p.name).collect();
            let hint = nearest(name, names.iter().copied()).map(|n| format!("did you mean `{}.{n}`?", source.stage));
            let message =
                format!("stage `{}` ({}) has no output `{name}`; it has {}", source.stage, info.name, names.join(", "));
            (message, hint)
        })?,
        None => default_port(&info.outputs, wanted.accepts)
            .ok_or_else(|| (format!("stage `{}` ({}) has no outputs", source.stage, info.name), None))?,
    };
    if !wanted.accepts.contains(&port.payload) {
        let message = format!(
            "stage `{}`: input `{}` wants {}, but {}.{} is {}",
            spec.stages[at].name, wanted.name, wanted.payload, source.stage, port.name, port.payload
        );
        let fitting = info.outputs.iter().find(|p| wanted.accepts.contains(&p.payload));
        return Err((message, fitting.map(|p| format!("did you mean `{}.{}`?", source.stage, p.name))));
    }
    Ok(Some(SourcePort { stage, port: port.clone() }))
}

/// The port that a bare stage name means: its first, or else the only one of an accepted payload.
fn default_port<'a>(outputs: &'a [OutPort], accepted: &[&str]) -> Option<&'a OutPort> {
    let first = outputs.first()?;
    if accepted.contains(&first.payload) {
        return Some(first);
    }
    let mut fitting = outputs.iter().filter(|p| accepted.contains(&p.payload));
    match (fitting.next(), fitting.next()) {
        (Some(only), None) => Some(only),
        _ => Some(first),
    }
}
