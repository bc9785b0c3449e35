//! What reaches a terminal, and what is said when nothing does.

use std::process::Stdio;

use serde_json::Value;

use crate::space::{SMALL, Space, counts};

/// Escape, delete, the escape of 8-bit terminals, and a character that turns the direction of writing.
const ODD: &str = "\u{1b}[2K\u{7f}\u{9b}1m\u{202e}";

/// Text from a pipeline file or a file's name that a terminal would carry out.
fn carried_out(text: &str) -> Option<char> {
    let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    text.chars().find(|&c| c != '\n' && c != '\t' && (c.is_control() || turns(c)))
}

/// An axis value, a file name and a folder with control characters: shown as codes by every command; JSON stays JSON of the same text.
#[cfg(unix)]
#[test]
fn control_characters_are_shown_and_not_sent() {
    let space = Space::new();
    let axis = "    use: scene\n    foreach: {v: [\"\\e[2K\\x7F\\x9B1m\\u202E\", \"z\"]}\n";
    let file = format!("p{ODD}.yaml");
    space.write(&file, &SMALL.replacen("    use: scene\n", axis, 1));
    space.write("wrong.yaml", "stages: {\"a\\e[2K\": {use: \"b\\x9B\"}}");
    let outputs = format!("o{ODD}");
    let place = ["--outputs", &outputs];
    let commands: [&[&str]; 17] = [
        &["plan", &file],
        &["check", &file],
        &["run", &file, "tissue"],
        &["run", &file, "tissue", "--json"],
        &["run", &file, "tissue"],
        &["run", &file, "tissue", "--json"],
        &["plan", &file, "--json"],
        &["show", &file, "tissue"],
        &["show", &file, "tissue", "--json"],
        &["explain", &file, "tissue"],
        &["explain", &file, "frames"],
        &["export", &file, "tissue.scene", "--to", "a.npz"],
        &["export", &file, "tissue[v=z].scene", "--to", ODD],
        &["cache", "stat"],
        &["check", "wrong.yaml"],
        &["check", "wrong.yaml", "--json"],
        &["graph", &file],
    ];
    let mut shown = 0;
    for arguments in commands {
        let done = space.turbid(&[arguments, &place].concat());
        for text in [&done.out, &done.err] {
            assert_eq!(carried_out(text), None, "{arguments:?}: {text:?}");
            shown += usize::from(text.contains("\\u{1b}"));
        }
        assert!(!done.err.contains("panicked") && !done.err.contains("internal error"), "{arguments:?}: {}", done.err);
        if arguments.contains(&"--json") {
            for line in done.out.lines() {
                let value: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {line}"));
                if value["event"] == "ran" && value["axes"]["v"] != "z" {
                    assert_eq!(value["axes"]["v"], ODD);
                }
            }
        }
    }
    assert!(shown >= 8, "{shown}");
    for arguments in [&["new", ODD][..], &["run", "p.yaml", ODD], &[ODD], &["stages", ODD], &["run", ODD, "--set", ODD]]
    {
        let message = space.turbid(arguments).fails(2);
        assert_eq!(carried_out(&message), None, "{arguments:?}: {message:?}");
    }
}

/// A full disk behind `>` is said, with exit code 1, by every command; what a run did is stored all the same.
#[cfg(target_os = "linux")]
#[test]
fn lost_output_is_an_error() {
    let space = Space::with(SMALL);
    let full = || std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    for arguments in [
        &["run", "p.yaml", "tissue", "--json"][..],
        &["run", "p.yaml", "tissue", "--json"],
        &["run", "p.yaml", "tissue"],
        &["plan", "p.yaml"],
        &["check", "p.yaml"],
        &["show", "p.yaml", "tissue", "--json"],
        &["graph", "p.yaml"],
        &["stages"],
        &["schema"],
        &["cache", "digests"],
        &["new", "mine"],
        &["--help"],
        &["--version"],
    ] {
        let done = space.command(arguments).stdout(full()).output().expect("it starts");
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.code() == Some(1) && said.contains("could not be written"), "{arguments:?}: {said}");
    }
    assert_eq!(counts(&space, &["tissue"]), (1, 0));
}

/// `turbid show | head`: whoever had enough is no error, and the work of a run goes on.
#[cfg(unix)]
#[test]
fn a_closed_pipe_is_a_quiet_end() {
    let space = Space::with(SMALL);
    for arguments in
        [&["run", "p.yaml", "tissue", "--json"][..], &["show", "p.yaml", "tissue"], &["schema"], &["stages"]]
    {
        let mut child =
            space.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        drop(child.stdout.take());
        let done = child.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.code() == Some(0) && said.is_empty(), "{arguments:?}: {:?} {said}", done.status);
    }
    assert_eq!(counts(&space, &["tissue"]), (1, 0));
}
