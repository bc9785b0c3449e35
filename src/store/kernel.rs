//! The three calls to the system and its library that the standard library does not have: locks of single bytes that belong to an opened
//! file, the kind of a file system, and what becomes of large memory that is given back. The only place of `unsafe` in the engine.

use std::fs::File;
use std::io;

/// A byte of a file to lock or to free. Locks belong to the opened file, as those of flock do: the same opening never refuses
/// itself, another one is refused, and all go with the opening, so that a killed process leaves none.
///
/// Whether it was locked; `false`: another opening holds it. Error: the file system or the system has no such locks.
pub(super) fn lock_byte(file: &File, offset: u64) -> io::Result<bool> {
    match linux::set_lock(file, offset, true) {
        Ok(()) => Ok(true),
        Err(error) if is_held(&error) => Ok(false),
        Err(error) => Err(error),
    }
}

/// Gives back what [`lock_byte`] took through the same opening. Nothing can be done about an error: the lock goes with the file.
pub(super) fn free_byte(file: &File, offset: u64) {
    let _ = linux::set_lock(file, offset, false);
}

/// A signal may come between; whoever asks asks again.
fn is_held(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::PermissionDenied | io::ErrorKind::Interrupted)
}

/// The number by which Linux tells the file system of an opened file; none elsewhere, or where it does not say.
pub(super) fn file_system(file: &File) -> Option<u32> {
    linux::file_system(file).ok()
}

/// Has planes of images go back to the system as soon as they are given back. Left to itself glibc begins to keep them, in pieces that no
/// other thread can use, and a run takes twice the memory of its largest stage. To be called once, before other threads are there.
pub fn return_large_memory() {
    linux::return_large_memory();
}

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod linux {
    #![allow(unsafe_code, reason = "the standard library has none of the calls, and no crate of the engine does")]

    use std::fs::File;
    use std::io;
    use std::mem::MaybeUninit;
    use std::os::fd::AsRawFd;

    pub fn set_lock(file: &File, offset: u64, lock: bool) -> io::Result<()> {
        let start = offset.try_into().map_err(|_| io::ErrorKind::InvalidInput)?;
        // SAFETY: a C struct of integers, for which all bits zero are a value.
        let mut request: libc::flock = unsafe { MaybeUninit::zeroed().assume_init() };
        request.l_type = if lock { libc::F_WRLCK as _ } else { libc::F_UNLCK as _ };
        request.l_whence = libc::SEEK_SET as _;
        (request.l_start, request.l_len) = (start, 1);
        // SAFETY: the descriptor is open as long as `file` is borrowed; F_OFD_SETLK reads one `flock` through the pointer, which
        // lives until the call returns, and keeps nothing of it.
        let done = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_OFD_SETLK, &raw const request) };
        if done == -1 { Err(io::Error::last_os_error()) } else { Ok(()) }
    }

    pub fn return_large_memory() {
        /// Bytes: 1024 x 1024 pixels.
        #[cfg(target_env = "gnu")]
        const LARGE: libc::c_int = 4 << 20;
        // SAFETY: it sets a number of the allocator; smaller pieces are served as before. Where it is refused, nothing changes.
        #[cfg(target_env = "gnu")]
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
        }
    }

    pub fn file_system(file: &File) -> io::Result<u32> {
        let mut about = MaybeUninit::<libc::statfs>::uninit();
        // SAFETY: the descriptor is open as long as `file` is borrowed; the call writes one `statfs` through the pointer.
        let done = unsafe { libc::fstatfs(file.as_raw_fd(), about.as_mut_ptr()) };
        if done == -1 {
            return Err(io::Error::last_os_error());
        }
        // SAFETY: the call succeeded, so it has filled the struct.
        let about = unsafe { about.assume_init() };
        // Numbers of 32 bits, in fields of other widths and signs by machine.
        Ok(about.f_type as u32)
    }
}

#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
mod linux {
    use std::fs::File;
    use std::io;

    pub fn return_large_memory() {}

    pub fn set_lock(_: &File, _: u64, _: bool) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    pub fn file_system(_: &File) -> io::Result<u32> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

#[cfg(all(test, target_os = "linux", target_pointer_width = "64"))]
mod tests {
    use super::*;

    const FAR: u64 = (1 << 62) - 1;

    /// A byte keeps out other openings, no other byte, and not itself; it is free when it is given back or its opening is closed.
    #[test]
    fn bytes_are_locked_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let open = || File::options().create(true).truncate(false).read(true).write(true).open(&path).unwrap();
        let (a, b) = (open(), open());
        for offset in [0, 7, FAR] {
            assert!(lock_byte(&a, offset).unwrap() && lock_byte(&a, offset).unwrap());
            assert!(!lock_byte(&b, offset).unwrap(), "{offset} is held");
            assert!(lock_byte(&b, offset ^ 1).unwrap(), "its neighbour is not");
        }
        free_byte(&a, 7);
        assert!(lock_byte(&b, 7).unwrap());
        assert!(!lock_byte(&b, 0).unwrap());
        drop(a);
        assert!(lock_byte(&b, 0).unwrap() && lock_byte(&b, FAR).unwrap());
        assert_eq!(path.metadata().unwrap().len(), 0, "locks take no room");
        assert!(lock_byte(&b, 1 << 63).is_err(), "beyond what a file can have");
    }

    #[test]
    fn file_systems_have_numbers() {
        assert!(file_system(&File::open("/proc/self/status").unwrap()) == Some(0x9fa0), "that of /proc");
    }
}
