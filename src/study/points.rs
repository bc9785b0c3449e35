//! The points of a study.

use serde_json::Value;

use crate::spec::StudySpec;

/// One run of the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// In the order of the paths of the study.
    pub values: Vec<Value>,
    /// 0 is the file itself; others have other random numbers.
    pub repeat: u64,
}

impl Point {
    /// What `--set` would be given.
    pub fn overrides(&self, study: &StudySpec) -> Vec<String> {
        study.vary.iter().zip(&self.values).map(|((path, _), value)| format!("{path}={value}")).collect()
    }

    /// `samples = 64, repeat 1`: paths by their last names.
    pub fn label(&self, study: &StudySpec) -> String {
        let short = |path: &str| path.rsplit('.').next().unwrap_or(path).to_owned();
        let named =
            study.vary.iter().zip(&self.values).map(|((path, _), value)| format!("{} = {}", short(path), plain(value)));
        let repeat = (study.repeats > 1).then(|| format!("repeat {}", self.repeat));
        named.chain(repeat).collect::<Vec<_>>().join(", ")
    }
}

/// A text without its quotes.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// All points: the last path varies fastest, then come the repeats.
pub fn points(study: &StudySpec) -> Vec<Point> {
    let mut all: Vec<Vec<Value>> = vec![Vec::new()];
    for (_, values) in &study.vary {
        let longer = |first: &Vec<Value>| -> Vec<Vec<Value>> {
            values.iter().map(|value| first.iter().chain([value]).cloned().collect()).collect()
        };
        all = all.iter().flat_map(longer).collect();
    }
    let repeated = |values: &Vec<Value>| -> Vec<Point> {
        (0..study.repeats).map(|repeat| Point { values: values.clone(), repeat }).collect()
    };
    all.iter().flat_map(repeated).collect()
}

/// In which order they run: smaller numbers first, so that a longer run goes on from a shorter one.
pub fn order(points: &[Point]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    let key = |i: usize| -> Vec<f64> { points[i].values.iter().map(|v| v.as_f64().unwrap_or(0.0)).collect() };
    order.sort_by(|&a, &b| {
        let by_repeat = points[a].repeat.cmp(&points[b].repeat);
        by_repeat.then_with(|| {
            key(a).iter().zip(key(b)).map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne()).unwrap_or(a.cmp(&b))
        })
    });
    order
}

/// The path that makes a point cost more: the first whose values are all numbers. Points that differ in it alone are one series.
pub fn effort(study: &StudySpec) -> Option<usize> {
    study.vary.iter().position(|(_, values)| values.len() > 1 && values.iter().all(Value::is_number))
}

/// Places of the points of each series, in the order of the points.
pub fn series(study: &StudySpec, points: &[Point]) -> Vec<(String, Vec<usize>)> {
    let effort = effort(study);
    let short = |path: &str| path.rsplit('.').next().unwrap_or(path).to_owned();
    let name = |point: &Point| {
        let named = study.vary.iter().zip(&point.values).enumerate().filter(|(i, _)| Some(*i) != effort);
        let parts: Vec<String> = named
            .map(
                |(_, ((path, _), value))| {
                    if value.is_string() { plain(value) } else { format!("{} = {value}", short(path)) }
                },
            )
            .collect();
        parts.join(", ")
    };
    let mut all: Vec<(String, Vec<usize>)> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let name = name(point);
        match all.iter_mut().find(|(known, _)| *known == name) {
            Some((_, places)) => places.push(i),
            None => all.push((name, vec![i])),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn study() -> StudySpec {
        StudySpec {
            name: "s".to_owned(),
            about: None,
            vary: vec![
                ("stages.frames.with.method".to_owned(), vec![json!("path"), json!("auto")]),
                ("vars.samples".to_owned(), vec![json!(64), json!(16)]),
            ],
            repeats: 2,
            estimate: "frames.m_ac".to_owned(),
            truth: None,
            error: "rmse_percent".to_owned(),
            also: Vec::new(),
            reference: None,
        }
    }

    #[test]
    fn every_combination_is_a_point_and_cheap_ones_run_first() {
        let (study, all) = (study(), points(&study()));
        assert_eq!(all.len(), 8);
        assert_eq!(all[2].label(&study), "method = path, samples = 16, repeat 0");
        assert_eq!(all[2].overrides(&study), ["stages.frames.with.method=\"path\"", "vars.samples=16"]);
        let ran: Vec<(u64, String)> =
            order(&all).iter().map(|&i| (all[i].repeat, all[i].values[1].to_string())).collect();
        assert_eq!(ran.iter().map(|r| r.0).collect::<Vec<_>>(), [0, 0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(ran[..4].iter().map(|r| r.1.as_str()).collect::<Vec<_>>(), ["16", "16", "64", "64"]);
        let series = series(&study, &all);
        assert_eq!(series.iter().map(|s| s.0.as_str()).collect::<Vec<_>>(), ["path", "auto"]);
        assert_eq!(series[1].1, [4, 5, 6, 7]);
        assert_eq!(effort(&study), Some(1));
    }
}
