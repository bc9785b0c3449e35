//! What is known of a run at a moment: what is done, what runs and how fast, how long the rest takes. Times are seconds since its start, and given.

use std::collections::{BTreeMap, HashMap};

use serde_json::{Value, json};

use crate::digest::Digest;
use crate::plan::{Id, InstanceId, Plan};
use crate::resolve::Survey;

use super::words::{duration, percent, rate};

/// CPU seconds that an instance of a stage without figures of its own counts for.
const UNKNOWN_S: f64 = 0.01;
/// Before so many seconds nothing is said of the rest.
const TOO_SOON_S: f64 = 2.0;
/// Reports closer to each other tell no rate.
const APART_S: f64 = 0.05;

/// The instances that are going to run.
#[derive(Clone, Debug, Default)]
pub struct Work {
    stages: Vec<String>,
    /// By label: the stage, and the CPU seconds that it foresees.
    instances: HashMap<Label, (u32, f64)>,
}

/// A label by its digest: of a million instances no million texts are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Label(u64);

impl Label {
    fn of(text: &str) -> Self {
        Self(Digest::of(text.as_bytes()).first_u64())
    }
}

impl Work {
    /// All that a survey found stale.
    pub fn of(plan: &Plan, survey: &Survey) -> Self {
        let stale = plan.needed_instances().filter(|id| survey.plans.contains_key(id));
        let seconds = |id: &InstanceId| match survey.twins.contains_key(id) {
            true => 0.0,
            false => survey.plans[id].seconds.unwrap_or(UNKNOWN_S).max(UNKNOWN_S),
        };
        let stage = |id: InstanceId| plan.stage_of(id).place() as u32;
        let instances = stale.map(|id| (Label::of(&plan.label(id)), (stage(id), seconds(&id)))).collect();
        Self { stages: plan.spec.stages.iter().map(|stage| stage.name.clone()).collect(), instances }
    }

    #[cfg(test)]
    pub fn test(instances: &[(&str, &str, f64)]) -> Self {
        let mut work = Self::default();
        for &(label, stage, s) in instances {
            let known = work.stages.iter().position(|name| name == stage);
            let at = known.unwrap_or_else(|| {
                work.stages.push(stage.to_owned());
                work.stages.len() - 1
            });
            work.instances.insert(Label::of(label), (at as u32, s));
        }
        work
    }

    /// How many instances of each stage run.
    pub fn counts(&self) -> HashMap<String, usize> {
        let mut counts = vec![0; self.stages.len()];
        self.instances.values().for_each(|(stage, _)| counts[*stage as usize] += 1);
        self.stages.iter().cloned().zip(counts).filter(|(_, count)| *count > 0).collect()
    }
}

/// The stage of a label.
pub fn stage_of(label: &str) -> &str {
    label.split('[').next().unwrap_or(label)
}

/// Instances of one stage, as CPU seconds that were foreseen and that they took.
#[derive(Default)]
struct Stage {
    foreseen: f64,
    /// Of those that are done.
    foreseen_done: f64,
    took: f64,
    /// The part of what is done that earlier runs did.
    resumed: f64,
}

/// An instance that runs.
pub struct Running {
    began: f64,
    /// The first report and the last: when, and how much was done.
    first: Option<(f64, f64)>,
    last: Option<(f64, f64)>,
    total: Option<f64>,
    unit: String,
}

impl Running {
    /// Units per second, between the first report and the last: what a checkpoint brought along is no work of this run.
    fn rate(&self) -> Option<f64> {
        let ((t0, done0), (t1, done1)) = (self.first?, self.last?);
        (t1 - t0 >= APART_S && done1 > done0).then(|| (done1 - done0) / (t1 - t0))
    }

    /// How much was done before this run.
    fn resumed(&self) -> f64 {
        let (Some(rate), Some((t0, done0))) = (self.rate(), self.first) else {
            return self.first.map_or(0.0, |(_, done)| done);
        };
        (done0 - rate * (t0 - self.began)).max(0.0)
    }

    /// The same as a part of all that it reported; 0 where that is not known.
    fn resumed_part(&self) -> f64 {
        let reported = self.last.map_or(0.0, |(_, done)| done);
        if self.rate().is_some() && reported > 0.0 { (self.resumed() / reported).min(1.0) } else { 0.0 }
    }

    /// Parts of the whole: what is done, and what of it earlier runs did.
    fn parts(&self) -> Option<(f64, f64)> {
        let (total, (_, done)) = (self.total.filter(|total| *total > 0.0)?, self.last?);
        Some(((done / total).min(1.0), (self.resumed().min(done) / total).min(1.0)))
    }

    /// Seconds until it is done.
    fn left(&self, now: f64) -> Option<f64> {
        let (total, (at, done), rate) = (self.total?, self.last?, self.rate()?);
        Some(((total - done) / rate - (now - at)).max(0.0))
    }

    /// `45 %  15.3 paths per pixel/s  12 min left`.
    pub fn text(&self, now: f64) -> String {
        let part = self.parts().map(|(done, _)| percent(done));
        let rate = self.rate().map(|per_second| rate(per_second, &self.unit));
        let left = self.left(now).map(|left| format!("{} left", duration(left)));
        let known: Vec<String> = [part, rate, left].into_iter().flatten().collect();
        if known.is_empty() { duration(now - self.began) } else { known.join("  ") }
    }

    fn json(&self, label: &str, now: f64) -> Value {
        json!({
            "instance": label, "seconds": now - self.began, "done": self.last.map(|(_, done)| done),
            "total": self.total, "unit": self.unit, "per_second": self.rate(), "seconds_left": self.left(now),
        })
    }
}

/// The whole run.
#[derive(Default)]
pub struct Board {
    work: Work,
    stages: Vec<Stage>,
    running: BTreeMap<String, Running>,
    done: usize,
}

impl Board {
    pub fn of(work: &Work) -> Self {
        let mut stages: Vec<Stage> = work.stages.iter().map(|_| Stage::default()).collect();
        for (stage, seconds) in work.instances.values() {
            stages[*stage as usize].foreseen += seconds;
        }
        Self { work: work.clone(), stages, ..Self::default() }
    }

    pub fn started(&mut self, label: &str, now: f64) {
        let fresh = Running { began: now, first: None, last: None, total: None, unit: String::new() };
        self.running.insert(label.to_owned(), fresh);
    }

    pub fn advanced(&mut self, label: &str, now: f64, done: f64, total: Option<f64>, unit: &str) {
        let Some(running) = self.running.get_mut(label) else { return };
        running.first.get_or_insert((now, done));
        running.last = Some((now, done));
        running.total = total;
        if running.unit != unit {
            running.unit = unit.to_owned();
        }
    }

    /// `cpu_s`: what it took, where it ran.
    pub fn ended(&mut self, label: &str, cpu_s: Option<f64>) {
        let ran = self.running.remove(label);
        let Some((stage, foreseen)) = self.work.instances.remove(&Label::of(label)) else { return };
        self.done += 1;
        let stage = &mut self.stages[stage as usize];
        stage.foreseen_done += foreseen;
        stage.took += cpu_s.unwrap_or(foreseen);
        stage.resumed += foreseen * ran.map_or(0.0, |ran| ran.resumed_part());
    }

    pub fn running(&self) -> impl ExactSizeIterator<Item = (&String, &Running)> {
        self.running.iter()
    }

    /// Instances that are done, and all.
    pub fn instances(&self) -> (usize, usize) {
        (self.done, self.done + self.work.instances.len())
    }

    /// The part of the work that is done, and seconds until all is; by what stages foresaw, as far as it is not known better by now.
    pub fn whole(&self, now: f64) -> (f64, Option<f64>) {
        let sums = self.stages.iter().filter(|stage| stage.foreseen_done > 0.0);
        let (took, foreseen) = sums.fold((0.0, 0.0), |sum, s| (sum.0 + s.took, sum.1 + s.foreseen_done));
        // A stage that was off by a factor will be so for its other instances too; of one that is not known, that of all.
        let usual = if took > 0.0 && foreseen > 0.0 { took / foreseen } else { 1.0 };
        let factor = |stage: &Stage| {
            if stage.took > 0.0 && stage.foreseen_done > 0.0 { stage.took / stage.foreseen_done } else { usual }
        };
        let (mut all, mut done, mut resumed) = (0.0, 0.0, 0.0);
        for stage in &self.stages {
            all += factor(stage) * stage.foreseen;
            done += factor(stage) * stage.foreseen_done;
            resumed += factor(stage) * stage.resumed;
        }
        for (label, running) in &self.running {
            if let (Some((stage, foreseen)), Some((part, before))) =
                (self.work.instances.get(&Label::of(label)), running.parts())
            {
                let weight = factor(&self.stages[*stage as usize]) * foreseen;
                done += weight * part;
                resumed += weight * before;
            }
        }
        if all <= 0.0 {
            return (0.0, None);
        }
        let here = done - resumed;
        let known = now >= TOO_SOON_S && here > 1e-3 * all;
        ((done / all).min(1.0), known.then(|| (all - done).max(0.0) * now / here))
    }

    /// `31 %  120 of 600 instances  2:05 h gone  4:10 h left`.
    pub fn text(&self, now: f64) -> String {
        let ((done, all), (part, left)) = (self.instances(), self.whole(now));
        let left = left.map_or_else(String::new, |left| format!("  {} left", duration(left)));
        format!("{}  {done} of {all} instances  {} gone{left}", percent(part), duration(now))
    }

    /// One line for a log: the whole, and what runs.
    pub fn beat(&self, now: f64) -> String {
        const NAMED: usize = 3;
        let one = |(label, running): (&String, &Running)| format!("{label} {}", running.text(now));
        let mut named: Vec<String> = self.running().take(NAMED).map(one).collect();
        if self.running.len() > NAMED {
            named.push(format!("and {} more", self.running.len() - NAMED));
        }
        let named = if named.is_empty() { String::new() } else { format!("; {}", named.join("; ")) };
        format!("going {}{named}", self.text(now)).replace("  ", ", ")
    }

    /// The same for programs.
    pub fn event(&self, now: f64) -> Value {
        let ((done, all), (part, left)) = (self.instances(), self.whole(now));
        json!({
            "event": "heartbeat", "seconds": now, "done": done, "instances": all, "part": part, "seconds_left": left,
            "running": self.running.iter().map(|(label, running)| running.json(label, now)).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work() -> Work {
        Work::test(&[("a[x=1]", "a", 10.0), ("a[x=2]", "a", 10.0), ("a[x=3]", "a", 20.0), ("b", "b", 0.01)])
    }

    /// Rates and the time left are those of this run from the start and after a checkpoint alike: 16 of 1000 paths a second.
    #[test]
    fn a_resumed_run_has_the_rate_of_this_run() {
        for (resumed, expected) in [(0.0, "16 %  16 paths/s  52 s left"), (600.0, "76 %  16 paths/s  15 s left")] {
            let mut board = Board::of(&Work::test(&[("a", "a", 1.0)]));
            board.started("a", 0.0);
            for second in 1..=10 {
                let now = f64::from(second);
                board.advanced("a", now, resumed + 16.0 * now, Some(1000.0), "paths");
            }
            let (_, running) = board.running().next().unwrap();
            assert_eq!(running.text(10.0), expected);
            // The whole is that instance.
            let (part, left) = board.whole(10.0);
            let rest = (1000.0 - resumed - 160.0) / 16.0;
            assert!(
                (part - (resumed + 160.0) / 1000.0).abs() < 1e-9 && (left.unwrap() - rest).abs() < 1e-6,
                "{left:?}"
            );
        }
    }

    /// After one report alone nothing is known of the rate: it may be all of a checkpoint.
    #[test]
    fn one_report_tells_no_rate() {
        let mut board = Board::of(&Work::test(&[("a", "a", 1.0)]));
        board.started("a", 0.0);
        assert_eq!(board.running().next().unwrap().1.text(3.0), "3.0 s");
        board.advanced("a", 4.0, 590.0, Some(1000.0), "paths");
        assert_eq!(board.running().next().unwrap().1.text(4.0), "59 %");
        assert_eq!(board.whole(4.0), (0.59, None));
    }

    /// The rest by what is known of the stages: they foresaw 40 s, and the first two instances took half as long as foreseen.
    #[test]
    fn the_rest_is_reckoned_by_what_was_foreseen_and_what_it_took() {
        let mut board = Board::of(&work());
        assert_eq!((board.instances(), board.whole(0.0)), ((0, 4), (0.0, None)));
        for label in ["a[x=1]", "a[x=2]"] {
            board.started(label, 0.0);
            board.ended(label, Some(5.0));
        }
        board.started("a[x=3]", 10.0);
        let (part, left) = board.whole(10.0);
        // 10 of 20.005 CPU s in 10 s.
        assert!((part - 10.0 / 20.005).abs() < 1e-9 && (left.unwrap() - 10.005).abs() < 1e-9, "{part} {left:?}");
        assert_eq!(board.text(10.0), "49 %  2 of 4 instances  10 s gone  10 s left");
        board.advanced("a[x=3]", 12.0, 4.0, Some(20.0), "rows");
        board.advanced("a[x=3]", 14.0, 8.0, Some(20.0), "rows");
        assert_eq!(board.running().next().unwrap().1.text(14.0), "40 %  2 rows/s  6.0 s left");
        assert_eq!(
            board.beat(14.0),
            "going 69 %, 2 of 4 instances, 14 s gone, 6.0 s left; a[x=3] 40 %, 2 rows/s, 6.0 s left"
        );
        let event = board.event(14.0);
        assert_eq!(event["running"][0]["per_second"], 2.0);
        assert_eq!((event["done"].as_u64(), event["instances"].as_u64()), (Some(2), Some(4)));
        board.ended("a[x=3]", Some(10.0));
        board.ended("b", None);
        assert_eq!(board.whole(20.0), (1.0, Some(0.0)));
        // What nobody foresaw, such as an instance that is made again, is no part of the whole.
        board.started("c", 20.0);
        board.ended("c", Some(1.0));
        assert_eq!(board.instances(), (4, 4));
    }
}
