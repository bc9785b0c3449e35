//! Commands of which every call that may change or read a file stops for the tracer: the one place with `unsafe`.
//!
//! Invariant: between fork and exec only system calls are made, on data that was there before the fork and outlives the exec. No memory is
//! allocated and no lock taken, for another thread of the parent may have held one at the fork.

#![allow(unsafe_code, reason = "what runs between fork and exec is nowhere to be had without it")]

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

use nix::libc;

/// The calls that may change or read a file.
pub const CALLS: [i64; 37] = [
    libc::SYS_write,
    libc::SYS_writev,
    libc::SYS_pwrite64,
    libc::SYS_pwritev,
    libc::SYS_fsync,
    libc::SYS_fdatasync,
    libc::SYS_truncate,
    libc::SYS_ftruncate,
    libc::SYS_rename,
    libc::SYS_renameat,
    libc::SYS_renameat2,
    libc::SYS_link,
    libc::SYS_linkat,
    libc::SYS_symlink,
    libc::SYS_symlinkat,
    libc::SYS_unlink,
    libc::SYS_unlinkat,
    libc::SYS_rmdir,
    libc::SYS_mkdir,
    libc::SYS_mkdirat,
    libc::SYS_open,
    libc::SYS_openat,
    libc::SYS_creat,
    libc::SYS_chmod,
    libc::SYS_fchmod,
    libc::SYS_fchmodat,
    libc::SYS_copy_file_range,
    libc::SYS_sendfile,
    libc::SYS_splice,
    libc::SYS_fallocate,
    libc::SYS_read,
    libc::SYS_readv,
    libc::SYS_pread64,
    libc::SYS_getdents64,
    libc::SYS_statx,
    libc::SYS_newfstatat,
    libc::SYS_fstat,
];

/// A BPF program that stops at [`CALLS`] and lets all else pass.
pub fn filter() -> Vec<libc::sock_filter> {
    let one = |code: u32, jt: u8, k: u32| libc::sock_filter { code: code as u16, jt, jf: 0, k };
    // The number of the call is the first field of what the filter sees.
    let mut program = vec![one(libc::BPF_LD | libc::BPF_W | libc::BPF_ABS, 0, 0)];
    for (at, call) in CALLS.iter().enumerate() {
        let to_the_end = u8::try_from(CALLS.len() - at).expect("few calls");
        program.push(one(libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K, to_the_end, *call as u32));
    }
    program.push(one(libc::BPF_RET | libc::BPF_K, 0, libc::SECCOMP_RET_ALLOW));
    program.push(one(libc::BPF_RET | libc::BPF_K, 0, libc::SECCOMP_RET_TRACE));
    program
}

/// Makes `command` start stopped, as the leader of a process group and the tracee of the thread that spawns it, with at most `cpu_seconds` of CPU.
pub fn stopping(command: &mut Command, cpu_seconds: u64) {
    let program = filter();
    let prepare = move || {
        let ok = |result: libc::c_int| if result < 0 { Err(io::Error::last_os_error()) } else { Ok(()) };
        let cpu = libc::rlimit { rlim_cur: cpu_seconds, rlim_max: cpu_seconds };
        let no_dump = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
        let filter = libc::sock_fprog { len: program.len() as u16, filter: program.as_ptr().cast_mut() };
        // SAFETY: each is one system call; `cpu`, `no_dump` and `filter` (with `program`, which the closure owns) live until it returns.
        unsafe {
            ok(libc::setpgid(0, 0))?;
            ok(libc::setrlimit(libc::RLIMIT_CPU, &cpu))?;
            ok(libc::setrlimit(libc::RLIMIT_CORE, &no_dump))?;
            ok(libc::ptrace(libc::PTRACE_TRACEME, 0, 0, 0) as libc::c_int)?;
            ok(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))?;
            ok(libc::prctl(libc::PR_SET_SECCOMP, libc::SECCOMP_MODE_FILTER, &filter))
        }
    };
    // SAFETY: the closure keeps the invariant of this file: system calls alone, on what it owns.
    unsafe { command.pre_exec(prepare) };
}
