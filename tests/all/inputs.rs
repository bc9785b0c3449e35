//! Input files from outside: what is no regular file, what is too large, and what only grows when it is read.

use std::process::{Child, Command};
use std::time::{Duration, Instant};

use crate::space::{Done, Space, counts};

/// A stage of each kind that names a file, and the path of the field.
const STAGES: [(&str, &str); 4] = [
    ("{use: import_frames, with: {frames: [{file: \"odd.dat\", f_x: 0}]}}", "stages.it.with.frames.0.file"),
    ("{use: calibrate_iad, with: {file: \"odd.csv\", n: 1.4, g: 0.8, thickness: 1}}", "stages.it.with.file"),
    (
        "{use: scene, with: {media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}}, objects: {o: {mesh: {file: \"odd.dat\"}, medium: m}}}}",
        "stages.it.with.objects.o.mesh.file",
    ),
    (
        "{use: scene, with: {media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}}, objects: {o: {slab: {thickness: 1, top: 0}, medium: m, \
         surface: {lambertian: {image: {file: \"odd.dat\", size: [1, 1]}}}}}}}",
        "stages.it.with.objects.o.surface.lambertian.image.file",
    ),
];

fn pipeline(stage: &str) -> String {
    format!("pipeline: p\nstages:\n  it: {stage}\n")
}

/// Ends a program that hangs, so that the test fails and does not hang too.
fn within(mut child: Child, limit: Duration) -> Option<i32> {
    let began = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("it is our child") {
            return status.code();
        }
        if began.elapsed() > limit {
            let _ = child.kill();
            let _ = child.wait();
            return None;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A pipe that nobody writes to, a device without end, a socket and a folder are named at once, with their place.
#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_refused_before_it_is_opened() {
    let fifo = |path: &std::path::Path| assert!(Command::new("mkfifo").arg(path).status().expect("mkfifo").success());
    let device = |path: &std::path::Path| std::os::unix::fs::symlink("/dev/zero", path).expect("a link");
    let folder = |path: &std::path::Path| std::fs::create_dir(path).expect("a folder");
    type Kind<'a> = (&'a str, &'a dyn Fn(&std::path::Path));
    let kinds: [Kind; 3] = [("a pipe (FIFO)", &fifo), ("a device", &device), ("a directory", &folder)];
    for (what, make) in kinds {
        for (stage, at) in STAGES {
            let space = Space::with(&pipeline(stage));
            make(&space.path().join("odd.dat"));
            make(&space.path().join("odd.csv"));
            assert_eq!(within(space.start(&["check", "p.yaml"]), Duration::from_secs(60)), Some(2), "{what}: {stage}");
            let said = space.turbid(&["check", "p.yaml"]).fails(2);
            assert!(said.starts_with("p.yaml:3:") && said.contains(at), "{said}");
            assert!(said.contains(&format!("this is {what}, not a regular file")), "{said}");
        }
        let spaces = ["foreach: {csv: odd.csv}, ", ""].map(|foreach| {
            let text = pipeline(&STAGES[0].0.replace("use:", &format!("{foreach}use:")));
            let space = Space::with(&if foreach.is_empty() { format!("include: odd.dat\n{text}") } else { text });
            make(&space.path().join("odd.dat"));
            make(&space.path().join("odd.csv"));
            space
        });
        for space in spaces {
            assert_eq!(within(space.start(&["check", "p.yaml"]), Duration::from_secs(60)), Some(2), "{what}");
            assert!(space.turbid(&["check", "p.yaml"]).fails(2).contains(&format!("this is {what}, not a ")));
        }
    }
}

/// A file that says a terabyte is not read; the way out is a param that raises the limit, and no key knows of it.
#[test]
fn large_files_are_refused_with_the_param_that_lets_them_in() {
    for (stage, _) in STAGES {
        let space = Space::with(&pipeline(stage));
        for name in ["odd.dat", "odd.csv"] {
            std::fs::File::create(space.path().join(name)).and_then(|f| f.set_len(1 << 40)).expect("a sparse file");
        }
        let said = space.turbid(&["check", "p.yaml"]).fails(2);
        assert!(said.contains("the file has 1.10 TB (1099511627776 bytes), and at most 1.07 GB"), "{said}");
        assert!(said.contains("`max_file_mb: 1099512` among the params lets it in"), "{said}");
    }
    let read = |more: &str| {
        format!(
            "pipeline: p\nstages:\n  it: {{use: calibrate_iad, with: {{file: a.csv, n: 1.4, g: 0.8, thickness: 1, N: 8{more}}}}}\n"
        )
    };
    let space = Space::with(&read(""));
    space.write("a.csv", &format!("m_r,m_t\n0.3,0.2\n#{}\n", " ".repeat(1_000_000)));
    assert_eq!(counts(&space, &[]), (0, 1));
    for more in [", max_file_mb: 2", ", max_file_mb: 3e3", ", max_file_mb: null"] {
        space.write("p.yaml", &read(more));
        assert_eq!(counts(&space, &[]), (1, 0), "{more} changes no key");
    }
    space.write("p.yaml", &read(", max_file_mb: 1"));
    let said = space.turbid(&["run", "p.yaml"]).fails(2);
    assert!(
        said.contains("the file has 1.00 MB (1000018 bytes), and at most 1.00 MB (1000000 bytes) are read"),
        "{said}"
    );
    space.write("p.yaml", &read(", max_file_mb: 0"));
    assert!(space.turbid(&["check", "p.yaml"]).fails(2).contains("max_file_mb"));
}

/// Few lines that would make gigabytes of values or texts: refused in a moment, by the rule that they break.
#[test]
fn what_only_grows_when_it_is_read_is_refused() {
    let with = |foreach: &str| pipeline(&STAGES[0].0.replace("use:", &format!("foreach: {{{foreach}}}, use:")));
    let axes = |n: usize, one: &str| (0..n).map(|i| format!("a{i}: {one}")).collect::<Vec<_>>().join(", ");
    let names = (0..90).map(|i| format!("a{i}")).collect::<Vec<_>>().join(", ");
    let range = "{range: [0, 999999]}";
    let long = "x".repeat(1 << 20);
    let many = vec!["\"${t}\""; 100_000].join(", ");
    let frames = "{use: import_frames, with: {frames: [LIST]}}";
    let cases = [
        ("a grid", with(&axes(8, range)), "instances (999999 a0 x 999999 a1"),
        ("paired axes", with(&format!("{}, zip: [[{names}]]", axes(90, range))), "the axes have 89999910 values"),
        (
            "instances with many axes",
            with(&format!("{}, b: {range}", axes(99, "[1]"))),
            "have more than 4000000 values",
        ),
        (
            "texts of vars",
            format!("vars: {{t: {long}}}\n{}", pipeline(&frames.replace("LIST", &many))),
            "64 bytes of a text",
        ),
        (
            "texts of axes",
            pipeline(&frames.replace("LIST", &many).replace("use:", &format!("foreach: {{t: [{long}]}}, use:"))),
            "the texts of this stage grow beyond 16 MiB",
        ),
        (
            "copies of a text",
            format!("vars: {{t: &t {long}, all: [{}]}}\n{}", vec!["*t"; 50_000].join(", "), pipeline(STAGES[0].0)),
            "more than 500000 values",
        ),
    ];
    for (name, text, rule) in cases {
        let space = Space::with(&text);
        let began = Instant::now();
        let said = limited(&space, &["check", "p.yaml"]).fails(2);
        assert!(said.contains(rule), "{name}: {}", said.chars().take(400).collect::<String>());
        assert!(began.elapsed() < Duration::from_secs(60), "{name}: {:?}", began.elapsed());
    }
}

/// The program with 1.5 GB of address space.
fn limited(space: &Space, arguments: &[&str]) -> Done {
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -v 1500000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_turbid")]).args(arguments);
    command.current_dir(space.path()).env_remove("TURBID_OUTPUTS");
    Done::from(command.output().expect("the program starts"), arguments)
}
