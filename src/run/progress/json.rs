//! JSON lines on stdout: every event, and now and then how far the run is.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use serde_json::json;

use crate::panics::lock;
use crate::store::InstanceRecord;
use crate::terminal::print_json;

use super::Progress;
use super::beat::Beat;
use super::board::{Board, Work};
use super::lines::PAUSE;

pub struct Json {
    began: Instant,
    board: Arc<Mutex<Board>>,
    beat: Mutex<Option<Beat>>,
}

impl Json {
    pub fn of(work: &Work) -> Self {
        Self { began: Instant::now(), board: Arc::new(Mutex::new(Board::of(work))), beat: Mutex::default() }
    }

    pub fn event(value: serde_json::Value) {
        print_json(&value.to_string());
    }

    fn now(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }
}

impl Progress for Json {
    fn started(&self, label: &str, reasons: &[String]) {
        lock(&self.board).started(label, self.now());
        Self::event(json!({"event": "started", "instance": label, "reasons": reasons}));
        lock(&self.beat).get_or_insert_with(|| {
            let (board, began) = (self.board.clone(), self.began);
            Beat::every(PAUSE, move || {
                let event = lock(&board).event(began.elapsed().as_secs_f64());
                Self::event(event);
            })
        });
    }
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str) {
        lock(&self.board).advanced(label, self.now(), done, total, unit);
    }
    fn ran(&self, label: &str, record: &InstanceRecord) {
        lock(&self.board).ended(label, Some(record.cost.cpu_s));
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
        lock(&self.board).ended(label, None);
        Self::event(json!({"event": "found", "instance": label}));
    }
    fn failed(&self, label: &str, message: &str) {
        lock(&self.board).ended(label, None);
        Self::event(json!({"event": "failed", "instance": label, "message": message}));
    }
    fn warn(&self, label: &str, message: &str) {
        Self::event(json!({"event": "warning", "instance": label, "message": message}));
    }
    fn ended(&self) {
        drop(lock(&self.beat).take());
    }
}
