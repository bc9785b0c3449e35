//! File systems whose locks are missing, keep nobody out, or hold within a machine only: no hang, the right results, and nothing is
//! removed. A library that the test compiles stands between the program and the system.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::space::{SMALL, Space, counts};

/// Answers every call for a lock itself.
const LOCKS: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>

static int answer(void) {
#ifdef HOLLOW
    return 0;
#else
    errno = ENOSYS;
    return -1;
#endif
}

int flock(int fd, int operation) { return answer(); }

static int passed(const char *name, int fd, int command, void *argument) {
    switch (command) {
    case F_GETLK: case F_SETLK: case F_SETLKW: case F_OFD_GETLK: case F_OFD_SETLK: case F_OFD_SETLKW:
        return answer();
    }
    int (*system)(int, int, ...) = (int (*)(int, int, ...))dlsym(RTLD_NEXT, name);
    return system(fd, command, argument);
}

#define PASSED(name) int name(int fd, int command, ...) { \
    va_list all; \
    va_start(all, command); \
    void *argument = va_arg(all, void *); \
    va_end(all); \
    return passed(#name, fd, command, argument); \
}
PASSED(fcntl)
PASSED(fcntl64)
"#;

/// Says that every folder lies on NFS.
const NETWORK: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/vfs.h>

int fstatfs(int fd, struct statfs *about) {
    int (*system)(int, struct statfs *) = (int (*)(int, struct statfs *))dlsym(RTLD_NEXT, "fstatfs");
    int done = system(fd, about);
    about->f_type = 0x6969;
    return done;
}
"#;

/// Compiles a library to be loaded before all others; `None` where there is no compiler for C.
fn library(space: &Space, name: &str, text: &str, options: &[&str]) -> Option<PathBuf> {
    space.write(&format!("{name}.c"), text);
    let (source, library) = (space.path().join(format!("{name}.c")), space.path().join(format!("{name}.so")));
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).args(options).arg(&source).arg("-ldl");
    match cc.output() {
        Ok(done) => {
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
            Some(library)
        }
        Err(error) => {
            eprintln!("left out: `cc` cannot be started ({error})");
            None
        }
    }
}

fn command(space: &Space, library: &PathBuf, arguments: &[&str]) -> Command {
    let mut command = space.command(arguments);
    command.env("LD_PRELOAD", library);
    command
}

/// Waits for runs that must end well; a hang ends them and the test.
fn wait(runs: &mut [Child]) {
    let began = Instant::now();
    while runs.iter_mut().any(|run| run.try_wait().expect("it was started").is_none()) {
        if began.elapsed() > Duration::from_secs(300) {
            runs.iter_mut().for_each(|run| drop(run.kill()));
            panic!("a run hangs");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(runs.iter_mut().all(|run| run.wait().expect("it has ended").success()));
}

/// Two runs at once on one store, with a `gc` beside them: right results, and the `gc` refuses. Then the same while packs vanish.
#[test]
fn without_locks_runs_end_and_gc_refuses() {
    let reference = Space::with(SMALL);
    counts(&reference, &[]);
    let digests = reference.digests();
    let cases =
        [("missing", &[][..], false), ("hollow", &["-DHOLLOW"][..], false), ("hollow", &["-DHOLLOW"][..], true)];
    for (name, options, vanish) in cases {
        let space = Space::with(SMALL);
        let Some(library) = library(&space, name, LOCKS, options) else { return };
        let run = || {
            command(&space, &library, &["run", "p.yaml", "-j", "2"]).stderr(Stdio::null()).stdout(Stdio::null()).spawn()
        };
        let mut runs = [run().expect("the program starts"), run().expect("the program starts")];
        for _ in 0..if vanish { 20 } else { 0 } {
            std::thread::sleep(Duration::from_millis(20));
            let packs = fs::read_dir(space.outputs().join("store/packs")).into_iter().flatten().flatten();
            packs.for_each(|pack| drop(fs::remove_file(pack.path())));
        }
        let gc = ["cache", "gc", "--max-size", "1kB"];
        for more in [&[][..], &["--exclusive"]] {
            let gc = command(&space, &library, &[&gc, more].concat()).output().expect("the program starts");
            let text = String::from_utf8_lossy(&gc.stderr);
            assert_eq!(gc.status.code(), Some(1), "{name}: {text}");
            assert!(text.contains("does not keep other processes out"), "{name}: {text}");
        }
        wait(&mut runs);
        // What vanished at the very end is made again.
        wait(&mut [run().expect("the program starts")]);
        assert_eq!(space.digests(), digests, "{name}");
        space.turbid(&["cache", "verify"]).ok();
    }
}

/// On a network file system runs work as ever; what needs the store alone wants the user's word.
#[test]
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
fn on_network_file_systems_gc_asks_for_a_word() {
    let space = Space::with(SMALL);
    let Some(library) = library(&space, "network", NETWORK, &[]) else { return };
    let done = command(&space, &library, &["run", "p.yaml", "tissue"]).output().expect("the program starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let gc = |more: &[&str]| {
        let arguments = [&["cache", "gc", "--max-size", "1kB"], more].concat();
        let done = command(&space, &library, &arguments).output().expect("the program starts");
        (done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned())
    };
    let (code, text) = gc(&[]);
    assert!(code == Some(1) && text.contains("network file system (NFS)") && text.contains("--exclusive"), "{text}");
    assert!(!space.digests().is_empty(), "nothing was removed");
    let (code, text) = gc(&["--exclusive"]);
    assert_eq!((code, text.trim()), (Some(0), ""));
    assert_eq!(space.digests().trim(), "");
}
