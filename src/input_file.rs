//! Files that the user names: regular ones of bounded size. Nothing else is opened, waited for or read.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;

use crate::digest::Digest;
use crate::regular::{self, NotOpened};

/// Read at a time where the content is not kept.
const BLOCK: usize = 1 << 20;

/// Why a file is not read.
#[derive(Debug)]
pub enum Refused {
    Io(io::Error),
    /// What stands there in place of a regular file: `a directory`.
    Odd(&'static str),
    /// It has, or grew to, more than `most` bytes.
    Larger {
        bytes: u64,
        most: u64,
    },
    /// It has another length than it said.
    Changed,
    NoMemory {
        bytes: u64,
    },
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => error.fmt(f),
            Self::Odd(what) => write!(f, "this is {what}, not a regular file"),
            Self::Larger { bytes, most } => {
                write!(f, "the file has {}, and at most {} are read", Size(*bytes), Size(*most))
            }
            Self::Changed => f.write_str("the file changed while it was read"),
            Self::NoMemory { bytes } => write!(f, "the file has {}, more than there is memory for", Size(*bytes)),
        }
    }
}

/// A number of bytes in the unit that suits it.
struct Size(u64);

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = (self.0 as f64, "bytes");
        for unit in ["kB", "MB", "GB", "TB"] {
            if shown.0 >= 999.5 {
                shown = (shown.0 / 1000.0, unit);
            }
        }
        match shown {
            (bytes, "bytes") => write!(f, "{bytes} bytes"),
            (size, unit) => write!(f, "{size:.2} {unit} ({} bytes)", self.0),
        }
    }
}

/// The content of a file of at most `most` bytes.
pub fn read(path: &Path, most: u64) -> Result<Arc<[u8]>, Refused> {
    let (mut file, size) = open(path, most)?;
    let none = Refused::NoMemory { bytes: size };
    let Ok(length) = usize::try_from(size) else { return Err(none) };
    // Asked for first: memory that is not there ends the process otherwise.
    if Vec::<u8>::new().try_reserve_exact(length).is_err() {
        return Err(none);
    }
    let mut bytes: Arc<[u8]> = std::iter::repeat_n(0, length).collect();
    let room = Arc::get_mut(&mut bytes).expect("it was just made");
    file.read_exact(room).map_err(|error| match error.kind() {
        io::ErrorKind::UnexpectedEof => Refused::Changed,
        _ => Refused::Io(error),
    })?;
    ends(&mut file, size, most)?;
    Ok(bytes)
}

/// The digest of a file of at most `most` bytes, and how many it has. Its content is not kept.
pub fn digest(path: &Path, most: u64) -> Result<(Digest, u64), Refused> {
    let (file, size) = open(path, most)?;
    let mut hasher = blake3::Hasher::new();
    let mut block = vec![0; BLOCK.min(size as usize)];
    let (mut bounded, mut left) = (file.take(size), size);
    while left > 0 {
        match bounded.read(&mut block) {
            Ok(0) => return Err(Refused::Changed),
            Ok(n) => {
                hasher.update(&block[..n]);
                left -= n as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(Refused::Io(error)),
        }
    }
    ends(&mut bounded.into_inner(), size, most)?;
    Ok((Digest(*hasher.finalize().as_bytes()), size))
}

/// Nothing follows the `size` bytes that were read.
fn ends(file: &mut File, size: u64, most: u64) -> Result<(), Refused> {
    // Not `read`: a signal may interrupt it.
    match file.read_exact(&mut [0]) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(()),
        Err(error) => Err(Refused::Io(error)),
        Ok(()) if size == most => Err(Refused::Larger { bytes: size + 1, most }),
        Ok(()) => Err(Refused::Changed),
    }
}

/// A regular file, or what a link leads to, with its size.
fn open(path: &Path, most: u64) -> Result<(File, u64), Refused> {
    let file = regular::open(path, OpenOptions::new().read(true)).map_err(|error| match error {
        NotOpened::Io(error) => Refused::Io(error),
        NotOpened::Odd(what) => Refused::Odd(what),
    })?;
    match file.metadata().map_err(Refused::Io)?.len() {
        bytes if bytes > most => Err(Refused::Larger { bytes, most }),
        size => Ok((file, size)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::Write;

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().expect("a folder for the test")
    }

    #[test]
    fn content_and_digest_are_those_of_the_file_and_of_what_a_link_leads_to() {
        let folder = folder();
        for size in [0, 1, BLOCK - 1, BLOCK, 2 * BLOCK + 7] {
            let bytes: Vec<u8> = (0..size).map(|i| (i % 251) as u8).collect();
            let path = folder.path().join("file");
            fs::write(&path, &bytes).unwrap();
            assert_eq!(&read(&path, size as u64).unwrap()[..], bytes, "{size}");
            assert_eq!(digest(&path, size as u64).unwrap(), (Digest::of(&bytes), size as u64), "{size}");
            if size > 0 {
                let said = [read(&path, size as u64 - 1).err(), digest(&path, size as u64 - 1).err()];
                assert!(said.iter().all(|e| matches!(e, Some(Refused::Larger { .. }))), "{size}: {said:?}");
            }
        }
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_regular_file_is_named_at_once() {
        let folder = folder();
        let fifo = folder.path().join("fifo");
        let made = crate::child::start(std::process::Command::new("mkfifo").arg(&fifo))
            .and_then(|mut child| child.wait())
            .expect("mkfifo is there");
        assert!(made.success());
        let socket = folder.path().join("socket");
        let _bound = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&fifo, &link).unwrap();
        for (path, what) in [
            (fifo.as_path(), "a pipe (FIFO)"),
            (&link, "a pipe (FIFO)"),
            (&socket, "a socket"),
            (folder.path(), "a directory"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            for refused in [read(path, 1 << 30).err(), digest(path, 1 << 30).err()] {
                assert!(matches!(refused, Some(Refused::Odd(said)) if said == what), "{what}: {refused:?}");
            }
        }
        let (real, link) = (folder.path().join("real"), folder.path().join("second"));
        fs::write(&real, "abc").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        assert_eq!(&read(&link, 3).unwrap()[..], b"abc");
    }

    /// A terabyte that is not there: refused by its size, and for want of memory where the limit lets it in.
    #[test]
    fn sizes_are_asked_before_memory_is() {
        let folder = folder();
        let path = folder.path().join("sparse");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let refused = read(&path, 1 << 30).unwrap_err().to_string();
        let said = "the file has 1.10 TB (1099511627776 bytes), and at most 1.07 GB (1073741824 bytes) are read";
        assert_eq!(refused, said);
        assert!(matches!(digest(&path, (1 << 40) - 1), Err(Refused::Larger { .. })));
    }

    /// The system's own files say that they have 0 bytes, and hold more: like one that grows while it is read.
    #[cfg(target_os = "linux")]
    #[test]
    fn files_that_are_longer_than_they_say_are_refused() {
        let path = Path::new("/proc/self/status");
        assert!(matches!(read(path, 1 << 20), Err(Refused::Changed)));
        assert!(matches!(digest(path, 0), Err(Refused::Larger { bytes: 1, most: 0 })));
        let folder = folder();
        let grown = folder.path().join("grown");
        fs::write(&grown, "abc").unwrap();
        let (mut file, size) = open(&grown, 10).unwrap();
        OpenOptions::new().append(true).open(&grown).unwrap().write_all(b"d").unwrap();
        let mut start = [0; 3];
        file.read_exact(&mut start).unwrap();
        assert!(matches!(ends(&mut file, size, 10), Err(Refused::Changed)));
    }
}
