//! What a run tells while it goes: lines, JSON events, or a board of what runs, with a line for the whole.

mod beat;
mod board;
mod json;
mod lines;
mod people;
mod said;
mod terminal;
mod words;

use std::io::IsTerminal;

use crate::store::InstanceRecord;

pub use board::Work;
pub use json::Json;
pub use lines::Lines;
pub use terminal::Terminal;

/// Told by the scheduler and by running stages, from any thread.
pub trait Progress: Sync {
    fn started(&self, label: &str, reasons: &[String]);
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str);
    fn ran(&self, label: &str, record: &InstanceRecord);
    /// Another run made it meanwhile.
    fn found(&self, label: &str);
    fn failed(&self, label: &str, message: &str);
    fn warn(&self, label: &str, message: &str);
    /// Nothing runs any more: what was kept back is said.
    fn ended(&self) {}
}

/// The kind that fits where the output goes; `work` is what is going to run.
pub fn choose(json: bool, work: &Work) -> Box<dyn Progress> {
    if json {
        Box::new(Json::of(work))
    } else if std::io::stderr().is_terminal() {
        Box::new(Terminal::of(work))
    } else {
        Box::new(Lines::of(work))
    }
}
