//! Programs of others: started, waited for up to a limit, and what they said.

use std::io::{self, Read, Seek, SeekFrom, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Bytes of an answer that are read; a list of 100,000 tasks takes 3 MB.
const MOST: u64 = 64 << 20;
/// An engine that has not answered after this is taken for one that does not answer.
const LIMIT: Duration = Duration::from_secs(60);

/// What a program said when it ended.
#[derive(Debug, Default)]
pub struct Said {
    /// Its exit status was 0.
    pub good: bool,
    pub out: String,
    pub err: String,
}

impl Said {
    /// Its last words: of stderr, or else of stdout.
    pub fn words(&self) -> &str {
        let words = if self.err.trim().is_empty() { &self.out } else { &self.err };
        words.trim()
    }
}

/// Why there is no answer.
#[derive(Debug)]
pub enum NotRun {
    /// There is no such program on PATH.
    Absent,
    /// It had not ended after so long, and was ended.
    TooLong(Duration),
    Io(io::Error),
}

/// Runs a program with `input` on its stdin.
///
/// Its output goes through files: what it leaves running in the background may keep these open, and nobody waits for it.
pub fn run(command: &mut Command, input: &str) -> Result<Said, NotRun> {
    run_within(command, input, LIMIT)
}

fn run_within(command: &mut Command, input: &str, limit: Duration) -> Result<Said, NotRun> {
    let file = || tempfile::tempfile().map_err(NotRun::Io);
    let (mut stdin, out, err) = (file()?, file()?, file()?);
    stdin.write_all(input.as_bytes()).and_then(|()| stdin.rewind()).map_err(NotRun::Io)?;
    let own = |file: &std::fs::File| file.try_clone().map(Stdio::from).map_err(NotRun::Io);
    command.stdin(stdin).stdout(own(&out)?).stderr(own(&err)?);
    let mut child = start(command).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => NotRun::Absent,
        _ => NotRun::Io(error),
    })?;
    let began = Instant::now();
    let mut pause = Duration::from_millis(2);
    let status = loop {
        if let Some(status) = child.try_wait().map_err(NotRun::Io)? {
            break status;
        }
        if began.elapsed() > limit {
            drop(child.kill().and_then(|()| child.wait()));
            return Err(NotRun::TooLong(limit));
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(50));
    };
    let text = |mut file: std::fs::File| -> Result<String, NotRun> {
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(0)).and_then(|_| file.take(MOST).read_to_end(&mut bytes)).map_err(NotRun::Io)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    Ok(Said { good: status.success(), out: text(out)?, err: text(err)? })
}

#[cfg(not(test))]
fn start(command: &mut Command) -> io::Result<std::process::Child> {
    command.spawn()
}

#[cfg(test)]
use crate::child::start;

/// The words of a line as a POSIX shell takes them: blanks part them, quotes and backslashes keep them together.
///
/// Error: a quote that is not closed.
pub fn words(line: &str) -> Result<Vec<String>, String> {
    let (mut words, mut word): (Vec<String>, Option<String>) = (Vec::new(), None);
    let mut quote = None;
    let mut chars = line.chars();
    while let Some(c) = chars.next() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, c) if c.is_whitespace() => words.extend(word.take()),
            (None | Some('"'), '\\') => word.get_or_insert_default().extend(chars.next()),
            (_, c) => word.get_or_insert_default().push(c),
        }
    }
    if let Some(open) = quote {
        return Err(format!("`{line}`: the quote {open} is not closed"));
    }
    words.extend(word);
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_a_shell() {
        let all = words(r#"--partition=long  --comment='two words' "a \" b" c\ d ''"#).unwrap();
        assert_eq!(all, ["--partition=long", "--comment=two words", "a \" b", "c d", ""]);
        assert_eq!(words("  "), Ok(Vec::new()));
        assert!(words("'a").unwrap_err().contains("not closed"));
    }

    #[cfg(unix)]
    #[test]
    fn answers_limits_and_absence_are_told_apart() {
        let shell = |text: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", text]);
            command
        };
        let said = run(&mut shell("cat; echo bad >&2; exit 3"), "in").unwrap();
        assert_eq!((said.good, said.out.as_str(), said.words()), (false, "in", "bad"));
        // What goes on in the background is not waited for.
        assert!(run(&mut shell("sleep 60 & echo on"), "").is_ok_and(|said| said.good && said.out == "on\n"));
        let late = run_within(&mut shell("exec sleep 60"), "", Duration::from_millis(20));
        assert!(matches!(late, Err(NotRun::TooLong(_))), "{late:?}");
        assert!(matches!(run(&mut Command::new("no-such-program-of-any"), ""), Err(NotRun::Absent)));
    }
}
