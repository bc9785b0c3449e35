//! Lasting lines: one for each instance of a stage that has few, one for the beginning and one for the end of a stage that has many.

use std::collections::{BTreeMap, HashMap};

use super::board::{Work, stage_of};
use super::words::duration;

/// Instances of a stage that have lines of their own.
const FEW: usize = 8;
/// So many failed instances of a stage are told one by one.
const FAILED: usize = 8;

/// Says what is new, and counts what repeats itself.
#[derive(Default)]
pub struct Said {
    crowds: HashMap<String, Crowd>,
    failed: BTreeMap<String, usize>,
    /// By stage and text, how many instances were warned after the first.
    warned: BTreeMap<(String, String), usize>,
}

/// A stage of many instances.
struct Crowd {
    instances: usize,
    done: usize,
    began: Option<f64>,
}

impl Said {
    pub fn of(work: &Work) -> Self {
        let many = work.counts().into_iter().filter(|(_, instances)| *instances > FEW);
        let crowd = |(stage, instances)| (stage, Crowd { instances, done: 0, began: None });
        Self { crowds: many.map(crowd).collect(), ..Self::default() }
    }

    pub fn started(&mut self, label: &str, reasons: &[String], now: f64) -> Option<String> {
        let reasons = reasons.join("; ");
        let Some(crowd) = self.crowds.get_mut(stage_of(label)) else {
            return Some(format!("run   {label}: {reasons}"));
        };
        if crowd.began.is_some() {
            return None;
        }
        crowd.began = Some(now);
        Some(format!("run   {}: {} instances; the first: {reasons}", stage_of(label), crowd.instances))
    }

    pub fn ran(&mut self, label: &str, seconds: f64, now: f64) -> Option<String> {
        self.done(label, now, || format!("done  {label} in {seconds:.2} s"))
    }

    pub fn found(&mut self, label: &str, now: f64) -> Option<String> {
        self.done(label, now, || format!("found {label}: another run made it"))
    }

    fn done(&mut self, label: &str, now: f64, own: impl FnOnce() -> String) -> Option<String> {
        let Some(crowd) = self.crowds.get_mut(stage_of(label)) else { return Some(own()) };
        crowd.done += 1;
        let took = duration(now - crowd.began.unwrap_or(now));
        (crowd.done == crowd.instances)
            .then(|| format!("done  {}: {} instances in {took}", stage_of(label), crowd.instances))
    }

    pub fn failed(&mut self, label: &str, message: &str) -> Option<String> {
        let failed = self.failed.entry(stage_of(label).to_owned()).or_default();
        *failed += 1;
        (*failed <= FAILED).then(|| format!("error {label}: {message}"))
    }

    pub fn warned(&mut self, label: &str, message: &str) -> Option<String> {
        let key = (stage_of(label).to_owned(), message.to_owned());
        match self.warned.get_mut(&key) {
            Some(more) => {
                *more += 1;
                None
            }
            None => {
                self.warned.insert(key, 0);
                Some(format!("warning {label}: {message}"))
            }
        }
    }

    /// What was kept back.
    pub fn rest(&mut self) -> Vec<String> {
        let failed = std::mem::take(&mut self.failed).into_iter().filter(|(_, n)| *n > FAILED);
        let warned = std::mem::take(&mut self.warned).into_iter().filter(|(_, more)| *more > 0);
        let failed = failed.map(|(stage, n)| format!("error {stage}: {} more instances failed", n - FAILED));
        let warned = warned.map(|((stage, text), more)| format!("warning {stage}: {more} more instances: {text}"));
        failed.chain(warned).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(instances: usize) -> Vec<String> {
        let labels: Vec<String> = (0..instances).map(|i| format!("a[x={i}]")).collect();
        let work: Vec<(&str, &str, f64)> = labels.iter().map(|label| (label.as_str(), "a", 1.0)).collect();
        let mut said = Said::of(&Work::test(&work));
        let mut lines = Vec::new();
        for (i, label) in labels.iter().enumerate() {
            let now = i as f64;
            lines.extend(said.started(label, &["no earlier result".to_owned()], now));
            lines.extend(said.warned(label, "noisy"));
            lines.extend(said.ran(label, 0.5, now + 0.5));
        }
        lines.extend(said.rest());
        lines
    }

    /// Few instances are told one by one, 600 in a few lines; a warning that they share is told once, with how often it came.
    #[test]
    fn many_instances_take_few_lines() {
        assert_eq!(
            lines(2),
            [
                "run   a[x=0]: no earlier result",
                "warning a[x=0]: noisy",
                "done  a[x=0] in 0.50 s",
                "run   a[x=1]: no earlier result",
                "done  a[x=1] in 0.50 s",
                "warning a: 1 more instances: noisy",
            ]
        );
        assert_eq!(
            lines(600),
            [
                "run   a: 600 instances; the first: no earlier result",
                "warning a[x=0]: noisy",
                "done  a: 600 instances in 10 min",
                "warning a: 599 more instances: noisy",
            ]
        );
    }

    #[test]
    fn failures_are_told_and_counted() {
        let mut said = Said::default();
        let told = (0..20).filter_map(|i| said.failed(&format!("a[x={i}]"), "no light")).count();
        assert_eq!((told, said.rest()), (FAILED, vec!["error a: 12 more instances failed".to_owned()]));
    }
}
