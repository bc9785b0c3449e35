//! Opening of regular files: folders, pipes, sockets and devices are never opened, and nothing is waited for.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io;
use std::path::Path;

/// Why a file is not opened.
#[derive(Debug)]
pub enum NotOpened {
    Io(io::Error),
    /// What stands there in place of a regular file: `a directory`.
    Odd(&'static str),
}

/// Opens a regular file, or the one that a link leads to, in the way that `options` say.
pub fn open(path: &Path, options: &mut OpenOptions) -> Result<File, NotOpened> {
    // Asked before it is opened: to open a pipe that nobody writes to waits for ever, and to open some devices does something.
    if let Ok(meta) = fs::metadata(path) {
        check(&meta)?;
    }
    // Regular files do not care; a pipe that took the place since is opened at once, and a terminal does not become ours.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NONBLOCK | libc::O_NOCTTY);
    let file = options.open(path).map_err(NotOpened::Io)?;
    // And afterwards: something else may stand there by now.
    check(&file.metadata().map_err(NotOpened::Io)?)?;
    Ok(file)
}

fn check(meta: &Metadata) -> Result<(), NotOpened> {
    let kind = meta.file_type();
    if kind.is_file() {
        return Ok(());
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Err(NotOpened::Odd("a pipe (FIFO)"));
        }
        if kind.is_socket() {
            return Err(NotOpened::Odd("a socket"));
        }
        if kind.is_char_device() || kind.is_block_device() {
            return Err(NotOpened::Odd("a device"));
        }
    }
    Err(NotOpened::Odd(if kind.is_dir() { "a directory" } else { "something else" }))
}
