//! Live pictures: what a render has so far, while it runs and no longer.

use std::path::PathBuf;
use std::process::Child;
use std::time::{Duration, Instant};

use crate::space::{SMALL, Space, counts};

/// Renders that are killed last longer than anybody waits.
const ENDLESS: &[&str] = &["run", "p.yaml", "frames", "--set", "vars.samples=500000000"];
const PATIENCE: Duration = Duration::from_secs(120);

fn partial(space: &Space) -> PathBuf {
    space.outputs().join("latest/small/frames/frames.partial.png")
}

/// Waits until the picture is there; its text that says how much it shows. `None` where the run ends before.
fn shown(space: &Space, child: &mut Child) -> Option<String> {
    let began = Instant::now();
    while child.try_wait().expect("it was started").is_none() {
        assert!(began.elapsed() < PATIENCE, "no picture");
        // It may be replaced at any moment, but is whole whenever it is there.
        if let Ok(bytes) = std::fs::read(partial(space)) {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("it is a PNG");
            let mut pixels = vec![0; reader.output_buffer_size().expect("it is small")];
            reader.next_frame(&mut pixels).expect("it is whole");
            let said = reader.info().utf8_text.iter().find(|text| text.keyword == "So far");
            return Some(said.expect("it says how much it shows").get_text().expect("UTF-8"));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    None
}

/// Whether nothing of a live picture is left, half written ones included.
fn is_gone(space: &Space) -> bool {
    let folder = std::fs::read_dir(space.outputs().join("latest/small/frames"));
    let names = folder.into_iter().flatten().flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.contains("partial")).count() == 0
}

#[cfg(unix)]
fn interrupt(child: &mut Child) -> Option<i32> {
    let sent = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.expect("kill is there").success());
    child.wait().expect("it was started").code()
}

/// A render that takes some seconds is to be seen meanwhile; at its end the picture is gone. Where it cannot be written the run goes on without, to
/// results of the same bytes.
#[test]
fn renders_are_seen_while_they_run() {
    let space = Space::with(SMALL);
    let began = Instant::now();
    counts(&space, &["frames", "--set", "vars.samples=65536"]);
    // On this machine some 10 s.
    let times = (10.0 / began.elapsed().as_secs_f64()).clamp(1.0, 1000.0);
    let samples = 65536 * (times as u64).next_power_of_two();
    let set = format!("vars.samples={samples}");
    let arguments = ["run", "p.yaml", "frames", "--set", &set];
    let seen = Space::with(SMALL);
    let mut child = seen.start(&arguments);
    let said = shown(&seen, &mut child).expect("there is time for a picture");
    assert!(said.ends_with(&format!(" of {samples} paths per pixel")), "{said}");
    assert!(child.wait().expect("it was started").success());
    assert!(is_gone(&seen));

    let blind = Space::with(SMALL);
    std::fs::create_dir_all(partial(&blind)).expect("the folder is ours");
    blind.turbid(&arguments).ok();
    assert!(partial(&blind).is_dir());
    assert_eq!(blind.digests(), seen.digests());
}

/// After Ctrl-C nothing is left, and of two runs that draw in one place each ends as if it were alone.
#[cfg(unix)]
#[test]
fn interrupted_renders_take_their_picture_along() {
    let space = Space::with(SMALL);
    let other = [ENDLESS, &["--set", "seed=8"]].concat();
    let mut runs = [space.start(ENDLESS), space.start(&other)];
    shown(&space, &mut runs[0]).expect("it runs on");
    for run in &mut runs {
        assert_eq!(interrupt(run), Some(130));
    }
    assert!(is_gone(&space));
}

/// What a killed process leaves goes with the next run that makes the frames, and with one that only finds them.
#[test]
fn pictures_of_killed_runs_go() {
    let space = Space::with(SMALL);
    let mut child = space.start(ENDLESS);
    shown(&space, &mut child).expect("it runs on");
    child.kill().and_then(|()| child.wait()).expect("it is ours");
    assert!(!is_gone(&space));
    counts(&space, &["frames"]);
    assert!(is_gone(&space));
    std::fs::write(partial(&space), "of a run that was killed").expect("the folder is ours");
    assert_eq!(counts(&space, &["frames", "phantom"]).1, 1);
    assert!(is_gone(&space));
}
