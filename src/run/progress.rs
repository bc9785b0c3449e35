//! What a run tells while it goes: lines, JSON events, or one moving line per running stage.

use std::collections::HashMap;
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::panics::lock;
use crate::store::InstanceRecord;
use crate::terminal::{plain, plain_line, print_json, tell};

/// Told by the scheduler and by running stages, from any thread.
pub trait Progress: Sync {
    fn started(&self, label: &str, reasons: &[String]);
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str);
    fn ran(&self, label: &str, record: &InstanceRecord);
    /// Another run made it meanwhile.
    fn found(&self, label: &str);
    fn failed(&self, label: &str, message: &str);
    fn warn(&self, label: &str, message: &str);
}

/// The kind that fits where the output goes.
pub fn choose(json: bool) -> Box<dyn Progress> {
    if json {
        Box::new(Json)
    } else if std::io::stderr().is_terminal() {
        Box::new(Terminal::default())
    } else {
        Box::new(Lines::default())
    }
}

/// One line per event on stderr; of many instances of a stage only now and then one.
#[derive(Default)]
pub struct Lines {
    crowds: Mutex<HashMap<String, Crowd>>,
}

/// What has been said of the instances of one stage.
#[derive(Default)]
struct Crowd {
    done: usize,
    said: usize,
    last: Option<Instant>,
}

/// After so many lines of one stage, one in [`PAUSE`] is enough.
const FEW: usize = 16;
const PAUSE: Duration = Duration::from_secs(2);

impl Lines {
    fn crowd(&self, label: &str, done: bool, line: impl FnOnce(usize) -> String) {
        let stage = label.split('[').next().unwrap_or(label);
        let mut crowds = lock(&self.crowds);
        let crowd = crowds.entry(stage.to_owned()).or_default();
        crowd.done += usize::from(done);
        if crowd.said < FEW || crowd.last.is_some_and(|last| last.elapsed() > PAUSE) {
            (crowd.said, crowd.last) = (crowd.said + 1, Some(Instant::now()));
            tell(&line(crowd.done));
        }
    }
}

impl Progress for Lines {
    fn started(&self, label: &str, reasons: &[String]) {
        self.crowd(label, false, |_| format!("run   {label}: {}", reasons.join("; ")));
    }
    fn advanced(&self, _: &str, _: f64, _: Option<f64>, _: &str) {}
    fn ran(&self, label: &str, record: &InstanceRecord) {
        self.crowd(label, true, |done| {
            let of_many = if done > FEW { format!(" ({done} done)") } else { String::new() };
            format!("done  {label} in {:.2} s{of_many}", record.cost.wall_s)
        });
    }
    fn found(&self, label: &str) {
        tell(&format!("found {label}: another run made it"));
    }
    fn failed(&self, label: &str, message: &str) {
        tell(&format!("error {label}: {message}"));
    }
    fn warn(&self, label: &str, message: &str) {
        tell(&format!("warning {label}: {message}"));
    }
}

/// JSON lines on stdout.
pub struct Json;

impl Json {
    pub fn event(value: serde_json::Value) {
        print_json(&value.to_string());
    }
}

impl Progress for Json {
    fn started(&self, label: &str, reasons: &[String]) {
        Self::event(json!({"event": "started", "instance": label, "reasons": reasons}));
    }
    fn advanced(&self, _: &str, _: f64, _: Option<f64>, _: &str) {}
    fn ran(&self, label: &str, record: &InstanceRecord) {
        let measures: serde_json::Map<String, serde_json::Value> = record
            .measures
            .iter()
            .map(|(name, value, unit)| (name.clone(), json!({"value": value, "unit": unit})))
            .collect();
        Self::event(json!({
            "event": "ran", "instance": label, "stage": record.provenance.stage, "axes": record.provenance.axes,
            "seconds": record.cost.wall_s, "cpu_seconds": record.cost.cpu_s, "peak_bytes": record.cost.peak_bytes,
            "measures": measures,
        }));
    }
    fn found(&self, label: &str) {
        Self::event(json!({"event": "found", "instance": label}));
    }
    fn failed(&self, label: &str, message: &str) {
        Self::event(json!({"event": "failed", "instance": label, "message": message}));
    }
    fn warn(&self, label: &str, message: &str) {
        Self::event(json!({"event": "warning", "instance": label, "message": message}));
    }
}

/// One moving line that names what runs, how far it is and how long it will take.
#[derive(Default)]
pub struct Terminal {
    running: Mutex<Board>,
}

#[derive(Default)]
struct Board {
    stages: HashMap<String, Stage>,
    /// Lines of the board on the screen.
    drawn: usize,
    last: Option<Instant>,
}

struct Stage {
    began: Instant,
    text: String,
}

const REDRAW: Duration = Duration::from_millis(100);

impl Terminal {
    /// Writes a lasting line above the board.
    fn line(&self, change: impl FnOnce(&mut HashMap<String, Stage>), line: &str) {
        let mut board = lock(&self.running);
        let mut text = board.erase();
        change(&mut board.stages);
        text.push_str(&plain(line));
        text.push('\n');
        board.draw(&mut text);
    }
}

impl Board {
    fn erase(&mut self) -> String {
        let up = std::mem::take(&mut self.drawn);
        "\x1b[1A\x1b[2K".repeat(up)
    }

    fn draw(&mut self, text: &mut String) {
        let mut labels: Vec<&String> = self.stages.keys().collect();
        labels.sort();
        for label in labels {
            let stage = &self.stages[label];
            let label = plain_line(label);
            text.push_str(&format!("  {label} {} {:.0} s\n", stage.text, stage.began.elapsed().as_secs_f64()));
            self.drawn += 1;
        }
        self.last = Some(Instant::now());
        let mut out = std::io::stderr();
        let _ = out.write_all(text.as_bytes());
        let _ = out.flush();
    }
}

impl Progress for Terminal {
    fn started(&self, label: &str, reasons: &[String]) {
        let fresh = Stage { began: Instant::now(), text: String::new() };
        self.line(
            |stages| drop(stages.insert(label.to_owned(), fresh)),
            &format!("run   {label}: {}", reasons.join("; ")),
        );
    }
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str) {
        let mut board = lock(&self.running);
        let recent = board.last.is_some_and(|last| last.elapsed() < REDRAW);
        if let Some(stage) = board.stages.get_mut(label) {
            let rate = done / stage.began.elapsed().as_secs_f64().max(1e-3);
            stage.text = match total {
                Some(total) if done > 0.0 => {
                    format!("{:3.0} % ({rate:.3e} {unit}/s, {:.0} s left)", 100.0 * done / total, (total - done) / rate)
                }
                _ => format!("{done:.3e} {unit} ({rate:.3e} {unit}/s)"),
            };
        }
        if !recent {
            let mut text = board.erase();
            board.draw(&mut text);
        }
    }
    fn ran(&self, label: &str, record: &InstanceRecord) {
        self.line(|stages| drop(stages.remove(label)), &format!("done  {label} in {:.2} s", record.cost.wall_s));
    }
    fn found(&self, label: &str) {
        self.line(|stages| drop(stages.remove(label)), &format!("found {label}: another run made it"));
    }
    fn failed(&self, label: &str, message: &str) {
        self.line(|stages| drop(stages.remove(label)), &format!("error {label}: {message}"));
    }
    fn warn(&self, label: &str, message: &str) {
        self.line(|_| {}, &format!("warning {label}: {message}"));
    }
}
