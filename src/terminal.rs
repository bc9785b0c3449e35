//! What goes to stdout and stderr: free of control characters whoever wrote the text, and told of where it cannot be written.

use std::borrow::Cow;
use std::io::{self, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Why something that was to be printed on stdout is lost; the first reason, and that of all that followed.
static LOST: Mutex<Option<io::Error>> = Mutex::new(None);

/// Whether a terminal would carry a character out instead of showing it: control characters but for line breaks and tabs, and those that turn
/// the direction of writing, so that a text reads as another one.
pub fn commands(c: char) -> bool {
    c.is_control() && c != '\n' && c != '\t'
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped<'a>(text: &'a str, wanted: impl Fn(char) -> bool, escape: impl Fn(&mut String, char)) -> Cow<'a, str> {
    if !text.contains(&wanted) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if wanted(c) { escape(&mut out, c) } else { out.push(c) }
    }
    out.into()
}

/// Text that may be shown: `\u{1b}` in place of what a terminal would carry out.
pub fn plain(text: &str) -> Cow<'_, str> {
    escaped(text, commands, |out, c| out.extend(c.escape_unicode()))
}

/// The same, and in one line.
pub fn plain_line(text: &str) -> Cow<'_, str> {
    escaped(text, |c| commands(c) || c == '\n' || c == '\t', |out, c| out.extend(c.escape_default()))
}

/// The same JSON text in characters that may be shown: what stands for others can only be inside of its strings.
pub fn plain_json(text: &str) -> Cow<'_, str> {
    // All of them are in the basic plane.
    escaped(text, commands, |out, c| out.push_str(&format!("\\u{:04x}", u32::from(c))))
}

/// Prints text for people on stdout, and a line break if there is none at its end.
pub fn print(text: &str) {
    write_out(&plain(text));
}

/// Prints JSON on stdout.
pub fn print_json(text: &str) {
    write_out(&plain_json(text));
}

/// Says something on stderr; where nobody can hear it the program goes on.
pub fn tell(text: &str) {
    tell_painted(&plain(text));
}

/// Says JSON on stderr.
pub fn tell_json(text: &str) {
    tell_painted(&plain_json(text));
}

/// The same for text that holds colours of ours, and what others wrote made [`plain`].
pub fn tell_painted(text: &str) {
    if text.is_empty() {
        return;
    }
    let newline = if text.ends_with('\n') { "" } else { "\n" };
    // In one piece: several threads speak.
    let _ = io::stderr().write_all(format!("{text}{newline}").as_bytes());
}

/// A panic elsewhere changes nothing of it.
fn lost_so_far() -> MutexGuard<'static, Option<io::Error>> {
    LOST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What was to be printed on stdout and could not be written, if anything. A reader who had enough (`turbid show | head`) loses nothing.
pub fn lost() -> Option<String> {
    let lost = lost_so_far();
    lost.as_ref().filter(|error| error.kind() != io::ErrorKind::BrokenPipe).map(io::Error::to_string)
}

/// Notes that a write to stdout failed.
pub fn note(written: io::Result<()>) {
    if let Err(error) = written {
        lost_so_far().get_or_insert(error);
    }
}

fn write_out(text: &str) {
    if lost_so_far().is_some() {
        return;
    }
    let newline = if text.ends_with('\n') { "" } else { "\n" };
    let mut out = io::stdout().lock();
    note(out.write_all(text.as_bytes()).and_then(|()| out.write_all(newline.as_bytes())).and_then(|()| out.flush()));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every character: shown as it is, or as its code; text, one line, JSON.
    #[test]
    fn no_character_commands_a_terminal() {
        for c in ('\0'..=char::MAX).filter(|c| c.is_ascii() || commands(*c) || u32::from(*c) % 97 == 0) {
            let text = format!("a{c}b");
            let shown = plain(&text).into_owned();
            assert!(!shown.contains(commands), "{c:?}: {shown:?}");
            assert_eq!(shown == text, !commands(c), "{c:?}");
            assert!(!plain_line(&text).contains(|c: char| commands(c) || c == '\n' || c == '\t'), "{c:?}");
            let json = serde_json::to_string(&text).unwrap();
            let shown = plain_json(&json);
            assert!(!shown.contains(commands), "{c:?}: {shown:?}");
            assert_eq!(serde_json::from_str::<String>(&shown).unwrap(), text, "{c:?}");
        }
        assert_eq!(plain("\u{1b}[2K\u{9b}1m\u{202e}\tz\n"), "\\u{1b}[2K\\u{9b}1m\\u{202e}\tz\n");
        assert_eq!(plain_line("a\nb"), "a\\nb");
    }
}
