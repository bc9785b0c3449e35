//! A board that moves below the lines of a terminal: what runs, how far it is and how long it will take, and the whole.

use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use terminal_size::{Height, Width, terminal_size_of};
use unicode_width::UnicodeWidthStr;

use crate::panics::lock;
use crate::terminal::{plain, plain_line};

use super::beat::Beat;
use super::board::{Board, Work};
use super::people::Shown;
use super::said::Said;
use super::words::{fitted, line};

/// Reports come more often than eyes follow.
const REDRAW: Duration = Duration::from_millis(100);
/// Clocks go on where no report comes.
const TICK: Duration = Duration::from_secs(1);
/// Columns and rows where the terminal does not tell.
const USUAL: [usize; 2] = [80, 24];

pub struct Terminal {
    screen: Arc<Mutex<Screen>>,
    beat: Mutex<Option<Beat>>,
}

struct Screen {
    began: Instant,
    board: Board,
    said: Said,
    /// The lines of the board that are on the screen.
    drawn: Vec<String>,
    last: Option<Instant>,
}

impl Terminal {
    pub fn of(work: &Work) -> Self {
        let (board, said) = (Board::of(work), Said::of(work));
        let screen = Screen { began: Instant::now(), board, said, drawn: Vec::new(), last: None };
        Self { screen: Arc::new(Mutex::new(screen)), beat: Mutex::default() }
    }
}

impl Screen {
    /// The board anew, below a lasting line.
    fn draw(&mut self, lasting: Option<&str>) {
        let [columns, rows] = size();
        let mut text = erased(&self.drawn, columns);
        if let Some(line) = lasting {
            text.push_str(&plain(line));
            text.push('\n');
        }
        self.drawn = board(&self.board, self.began.elapsed().as_secs_f64(), [columns, rows]);
        self.drawn.iter().for_each(|line| text.extend([line, "\n"]));
        self.last = Some(Instant::now());
        let mut out = std::io::stderr();
        let _ = out.write_all(text.as_bytes());
        let _ = out.flush();
    }
}

fn size() -> [usize; 2] {
    match terminal_size_of(std::io::stderr()) {
        Some((Width(columns), Height(rows))) if columns > 0 && rows > 0 => [columns.into(), rows.into()],
        _ => USUAL,
    }
}

/// What takes lines from the screen: one that is wider than the terminal is by now stands in several rows of it.
fn erased(lines: &[String], columns: usize) -> String {
    let rows: usize = lines.iter().map(|line| line.width().div_ceil(columns).max(1)).sum();
    "\x1b[1A\x1b[2K".repeat(rows)
}

/// A line for each instance that runs, as many as fit, and one for the whole; none where nothing runs.
fn board(board: &Board, now: f64, [columns, rows]: [usize; 2]) -> Vec<String> {
    let count = board.running().len();
    if count == 0 {
        return Vec::new();
    }
    // A row stays free for the cursor, and one for what was said last.
    let room = rows.saturating_sub(3).max(1);
    // The last column is left free: some terminals break the line there.
    let width = columns.saturating_sub(1).max(1);
    let shown = if count <= room { count } else { room.saturating_sub(1) };
    let one = |(label, running): (&String, &super::board::Running)| line(&plain_line(label), &running.text(now), width);
    let mut lines: Vec<String> = board.running().take(shown).map(one).collect();
    if shown < count {
        lines.push(fitted(&format!("  and {} more", count - shown), width));
    }
    lines.push(fitted(&board.text(now), width));
    lines
}

impl Shown for Terminal {
    fn change(&self, change: impl FnOnce(&mut Board, &mut Said, f64) -> Option<String>) {
        let mut screen = lock(&self.screen);
        let now = screen.began.elapsed().as_secs_f64();
        let Screen { board, said, .. } = &mut *screen;
        let line = change(board, said, now);
        if line.is_some() || screen.last.is_none_or(|last| last.elapsed() >= REDRAW) {
            screen.draw(line.as_deref());
        }
    }

    fn beat(&self) {
        lock(&self.beat).get_or_insert_with(|| {
            let screen = self.screen.clone();
            Beat::every(TICK, move || lock(&screen).draw(None))
        });
    }

    fn close(&self) {
        drop(lock(&self.beat).take());
        let mut screen = lock(&self.screen);
        let rest = screen.said.rest();
        // Whatever ran is done, or was broken off.
        screen.board = Board::default();
        let text = (!rest.is_empty()).then(|| rest.join("\n"));
        screen.draw(text.as_deref());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty instances on terminals of many sizes: no line wraps, no more lines than rows, the whole comes last.
    #[test]
    fn the_board_fits_the_terminal() {
        let labels: Vec<String> = (0..20).map(|i| format!("frames[inner_diameter=12.{i},wavelength_nm=620]")).collect();
        let work: Vec<(&str, &str, f64)> = labels.iter().map(|label| (label.as_str(), "frames", 1.0)).collect();
        let mut state = Board::of(&Work::test(&work));
        assert!(board(&state, 0.0, [80, 24]).is_empty());
        for label in &labels {
            state.started(label, 0.0);
            for second in [1.0, 2.0] {
                state.advanced(label, second, 15.3 * second, Some(1e5), "paths per pixel");
            }
        }
        for columns in [20, 40, 80, 200] {
            for rows in [3, 10, 24, 60] {
                let lines = board(&state, 2.0, [columns, rows]);
                assert!(lines.len() < rows.max(4), "{columns} x {rows}: {lines:#?}");
                assert!(lines.iter().all(|line| line.width() < columns), "{columns} x {rows}: {lines:#?}");
                assert!(lines.last().is_some_and(|line| line.starts_with("0 %  0 of 20")), "{lines:#?}");
                let named = lines.iter().filter(|line| line.contains("frames")).count();
                assert!(
                    named == 20 || columns < 80 || lines.iter().any(|l| *l == format!("  and {} more", 20 - named))
                );
            }
        }
        let wide = board(&state, 2.0, [80, 24]);
        assert!(wide[0].ends_with("0 %  15.3 paths per pixel/s  1:49 h left"), "{wide:#?}");
    }

    /// Lines that a terminal has wrapped since, because somebody made it narrower, are taken away whole.
    #[test]
    fn wrapped_lines_are_erased() {
        let lines = ["x".repeat(79), String::new(), "組".repeat(20)];
        let rows = |columns| erased(&lines, columns).matches("\x1b[1A\x1b[2K").count();
        assert_eq!([80, 79, 40, 20].map(rows), [3, 3, 2 + 1 + 1, 4 + 1 + 2]);
    }
}
