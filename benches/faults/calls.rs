//! What a stopped thread is about to do to which file.

use std::fs;
use std::io::IoSliceMut;
use std::path::{Path, PathBuf};

use nix::libc;
use nix::sys::uio::{RemoteIoVec, process_vm_readv};
use nix::unistd::Pid;

/// A change of a file or of a name, or a look at it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Op {
    /// A file that was not there, or that is emptied.
    Create,
    /// `bytes` at `offset`.
    Write {
        offset: u64,
        bytes: u64,
    },
    Sync,
    Truncate {
        length: u64,
    },
    Mode,
    Rename {
        from: PathBuf,
    },
    Link {
        from: PathBuf,
    },
    Symlink {
        target: PathBuf,
    },
    Unlink,
    MakeFolder,
    RemoveFolder,
    /// A copy within the kernel: refused, so that the program reads and writes instead.
    Copy,
    /// So many bytes at most.
    Read {
        bytes: u64,
    },
    /// Opened as it is.
    Open,
    /// Listed, or asked what it is.
    Ask,
}

impl Op {
    /// Whether it changes nothing.
    pub fn only_reads(&self) -> bool {
        matches!(self, Op::Read { .. } | Op::Open | Op::Ask)
    }

    /// Whether it needs room on the disk.
    pub fn takes_room(&self) -> bool {
        let without =
            matches!(self, Op::Sync | Op::Truncate { .. } | Op::Mode | Op::Unlink | Op::RemoveFolder | Op::Copy);
        !without && !self.only_reads()
    }
}

/// An [`Op`] and the path that it changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call {
    pub op: Op,
    pub path: PathBuf,
}

impl Call {
    /// What the registers of a thread that is stopped before a system call say; `None` where it changes nothing.
    pub fn of(thread: Pid, r: &libc::user_regs_struct) -> Option<Self> {
        let (at, text) = (|fd: u64| of_descriptor(thread, fd), |address: u64| text(thread, address));
        let below = |folder: u64, address: u64| Some(base(thread, folder)?.join(text(address)?));
        let here = libc::AT_FDCWD as u64;
        let (path, op) = match r.orig_rax as i64 {
            libc::SYS_write => (at(r.rdi)?, Op::Write { offset: position(thread, r.rdi)?, bytes: r.rdx }),
            libc::SYS_pwrite64 => (at(r.rdi)?, Op::Write { offset: r.r10, bytes: r.rdx }),
            libc::SYS_writev => (
                at(r.rdi)?,
                Op::Write { offset: position(thread, r.rdi)?, bytes: pieces(thread, r).iter().map(|p| p.1).sum() },
            ),
            libc::SYS_pwritev => {
                (at(r.rdi)?, Op::Write { offset: r.r10, bytes: pieces(thread, r).iter().map(|p| p.1).sum() })
            }
            libc::SYS_fsync | libc::SYS_fdatasync => (at(r.rdi)?, Op::Sync),
            libc::SYS_ftruncate => (at(r.rdi)?, Op::Truncate { length: r.rsi }),
            libc::SYS_truncate => (below(here, r.rdi)?, Op::Truncate { length: r.rsi }),
            libc::SYS_fchmod => (at(r.rdi)?, Op::Mode),
            libc::SYS_chmod => (below(here, r.rdi)?, Op::Mode),
            libc::SYS_fchmodat => (below(r.rdi, r.rsi)?, Op::Mode),
            libc::SYS_rename => (below(here, r.rsi)?, Op::Rename { from: below(here, r.rdi)? }),
            libc::SYS_renameat | libc::SYS_renameat2 => {
                (below(r.rdx, r.r10)?, Op::Rename { from: below(r.rdi, r.rsi)? })
            }
            libc::SYS_link => (below(here, r.rsi)?, Op::Link { from: below(here, r.rdi)? }),
            libc::SYS_linkat => (below(r.rdx, r.r10)?, Op::Link { from: below(r.rdi, r.rsi)? }),
            libc::SYS_symlink => (below(here, r.rsi)?, Op::Symlink { target: text(r.rdi)? }),
            libc::SYS_symlinkat => (below(r.rsi, r.rdx)?, Op::Symlink { target: text(r.rdi)? }),
            libc::SYS_unlink => (below(here, r.rdi)?, Op::Unlink),
            libc::SYS_rmdir => (below(here, r.rdi)?, Op::RemoveFolder),
            libc::SYS_unlinkat if r.rdx & libc::AT_REMOVEDIR as u64 != 0 => (below(r.rdi, r.rsi)?, Op::RemoveFolder),
            libc::SYS_unlinkat => (below(r.rdi, r.rsi)?, Op::Unlink),
            libc::SYS_mkdir => (below(here, r.rdi)?, Op::MakeFolder),
            libc::SYS_mkdirat => (below(r.rdi, r.rsi)?, Op::MakeFolder),
            libc::SYS_creat => (below(here, r.rdi)?, Op::Create),
            libc::SYS_open => opened(below(here, r.rdi)?, r.rsi)?,
            libc::SYS_openat => opened(below(r.rdi, r.rsi)?, r.rdx)?,
            libc::SYS_read | libc::SYS_pread64 | libc::SYS_readv => (at(r.rdi)?, Op::Read { bytes: r.rdx }),
            libc::SYS_getdents64 | libc::SYS_fstat => (at(r.rdi)?, Op::Ask),
            libc::SYS_newfstatat | libc::SYS_statx if r.rsi == 0 || text(r.rsi)? == Path::new("") => {
                (at(r.rdi)?, Op::Ask)
            }
            libc::SYS_newfstatat | libc::SYS_statx => (below(r.rdi, r.rsi)?, Op::Ask),
            libc::SYS_copy_file_range | libc::SYS_splice => (at(r.rdx)?, Op::Copy),
            libc::SYS_sendfile | libc::SYS_fallocate => (at(r.rdi)?, Op::Copy),
            _ => return None,
        };
        let there = fs::symlink_metadata(&path).is_ok();
        let changes = match op {
            Op::MakeFolder => !there,
            Op::Unlink | Op::RemoveFolder => there,
            _ => true,
        };
        changes.then_some(Self { op, path })
    }
}

/// The bytes that a stopped call is going to write.
pub fn data(thread: Pid, r: &libc::user_regs_struct) -> Vec<u8> {
    let pieces = match r.orig_rax as i64 {
        libc::SYS_write | libc::SYS_pwrite64 => vec![(r.rsi, r.rdx)],
        libc::SYS_writev | libc::SYS_pwritev => pieces(thread, r),
        _ => Vec::new(),
    };
    pieces.into_iter().flat_map(|(address, length)| memory(thread, address, length as usize)).collect()
}

/// (address, length) of what a vectored write writes.
fn pieces(thread: Pid, r: &libc::user_regs_struct) -> Vec<(u64, u64)> {
    let number = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().expect("8 bytes"));
    let listed = memory(thread, r.rsi, 16 * r.rdx as usize);
    listed.chunks_exact(16).map(|piece| (number(&piece[..8]), number(&piece[8..]))).collect()
}

fn memory(thread: Pid, address: u64, length: usize) -> Vec<u8> {
    let mut bytes = vec![0; length];
    let there = [RemoteIoVec { base: address as usize, len: length }];
    let read = process_vm_readv(thread, &mut [IoSliceMut::new(&mut bytes)], &there).unwrap_or(0);
    bytes.truncate(read);
    bytes
}

/// A text that ends with 0; read in pieces that do not cross a page, which may be the last.
fn text(thread: Pid, address: u64) -> Option<PathBuf> {
    use std::os::unix::ffi::OsStringExt;
    let mut all = Vec::new();
    while all.len() <= libc::PATH_MAX as usize {
        let from = address + all.len() as u64;
        let piece = memory(thread, from, 256 - (from % 256) as usize);
        if let Some(end) = piece.iter().position(|&b| b == 0) {
            all.extend(&piece[..end]);
            return Some(std::ffi::OsString::from_vec(all).into());
        }
        if piece.is_empty() {
            return None;
        }
        all.extend(piece);
    }
    None
}

fn of_descriptor(thread: Pid, fd: u64) -> Option<PathBuf> {
    fs::read_link(format!("/proc/{thread}/fd/{}", fd as i32)).ok()
}

/// The folder that relative paths begin at.
fn base(thread: Pid, fd: u64) -> Option<PathBuf> {
    if fd as i32 == libc::AT_FDCWD {
        fs::read_link(format!("/proc/{thread}/cwd")).ok()
    } else {
        of_descriptor(thread, fd).or_else(|| Some(PathBuf::from("/")))
    }
}

/// Where a plain write lands.
fn position(thread: Pid, fd: u64) -> Option<u64> {
    let about = fs::read_to_string(format!("/proc/{thread}/fdinfo/{}", fd as i32)).ok()?;
    let field = |name: &str| about.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
    let flags = i32::from_str_radix(field("flags:")?, 8).ok()?;
    if flags & libc::O_APPEND != 0 {
        return fs::metadata(format!("/proc/{thread}/fd/{}", fd as i32)).ok().map(|m| m.len());
    }
    field("pos:")?.parse().ok()
}

/// What opening with these flags does to the path.
fn opened(path: PathBuf, flags: u64) -> Option<(PathBuf, Op)> {
    let has = |flag: i32| flags & flag as u64 == flag as u64;
    let makes = has(libc::O_TRUNC) || has(libc::O_CREAT) && !Path::exists(&path);
    match () {
        () if has(libc::O_PATH) || has(libc::O_TMPFILE) => None,
        () if makes => Some((path, Op::Create)),
        () => Some((path, Op::Open)),
    }
}
