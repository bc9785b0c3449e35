//! Large image stacks: line by line between memory and disk, so that neither the encoded bytes nor a second copy of the pixels is ever held.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Mutex;

use turbid_contract::head::kept;
use turbid_contract::ndarray::Array2;
use turbid_contract::{ArtifactKind, Head, ImageStack, LayerInfo};

use crate::digest::{Digest, Hashing};
use crate::panics::lock;
use crate::store::backend::{Backend, Folder};
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::exr;
use crate::store::record::Blob;

/// Bytes from which on a stack goes line by line; smaller ones are encoded in memory, which is faster.
pub(super) const LARGE: u64 = 16 << 20;
/// Bytes of a head that are read at a time.
const BUFFER: usize = 1 << 16;

/// Whether the encoded stack has [`LARGE`] bytes at least: its masks, which are packed, do not count.
pub(super) fn is_large(stack: &ImageStack) -> bool {
    let plain = stack.layers.iter().filter(|l| l.info.kind != turbid_contract::LayerKind::Mask).count();
    (4 * stack.rows() * stack.columns() * plain) as u64 >= LARGE
}

/// What [`Store::put`](super::Store::put) does with a large stack; `root` is that of the store. Its digest is known with its last byte.
pub(super) fn put(root: &Path, folder: &Folder, stack: &ImageStack) -> Result<Blob, StoreError> {
    let tmp = root.join("tmp");
    let failed = |source| StoreError::io("write a blob", &tmp)(source);
    let mut file = disk::temporary(root).map_err(failed)?;
    let mut to = Hashing::new(disk::Passing(file.as_file_mut()));
    exr::encode_to(stack, &mut to)?;
    let (digest, bytes) = to.finish();
    let blob = Blob { digest, kind: ArtifactKind::Images, bytes };
    if bytes < LARGE {
        // Drawings shrink.
        let mut encoded = Vec::new();
        file.as_file_mut().seek(SeekFrom::Start(0)).map_err(failed)?;
        file.as_file_mut().read_to_end(&mut encoded).map_err(failed)?;
        folder.write(&blob, &encoded)?;
        return Ok(blob);
    }
    let path = folder.loose_path(&blob);
    match verified(folder, &blob) {
        Ok(_) => return Ok(blob),
        // What is there is wrong.
        Err(StoreError::Damaged { .. }) => folder.set_aside(&path)?,
        // Nothing, or what cannot be read, is replaced.
        Err(_) => {}
    }
    disk::publish_file(root, file, &path, true, true).map_err(StoreError::io("write a blob", &path))?;
    if let Ok(file) = disk::open_regular(&path) {
        folder.compared.note(&blob, &file);
    }
    Ok(blob)
}

/// The stack without its pixels, once its file was compared with its digest.
pub(super) fn open(folder: &Folder, blob: &Blob) -> Result<OpenedImages, StoreError> {
    let file = verified(folder, blob)?;
    let layout = exr::Layout::read(BufReader::with_capacity(BUFFER, &file))?;
    Ok(OpenedImages { head: exr::head(&layout.headers)?, from: Source::File(Mutex::new(file), Box::new(layout)) })
}

/// The file of a blob, at its start.
fn verified(folder: &Folder, blob: &Blob) -> Result<File, StoreError> {
    let (digest, path) = (blob.digest, folder.loose_path(blob));
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => StoreError::Missing { digest },
        // A folder or a pipe in its place is no blob.
        io::ErrorKind::InvalidInput => StoreError::Damaged { digest },
        _ => StoreError::io("read a blob", &path)(source),
    };
    let mut file = disk::open_regular(&path).map_err(failed)?;
    if folder.compared.holds(blob, &file) {
        return Ok(file);
    }
    if length(&file).map_err(failed)? != blob.bytes || Digest::of_reader(&mut file).map_err(failed)? != digest {
        return Err(StoreError::Damaged { digest });
    }
    folder.compared.note(blob, &file);
    file.seek(SeekFrom::Start(0)).map_err(failed)?;
    Ok(file)
}

/// An image stack whose layers are decoded when they are asked for.
pub struct OpenedImages {
    head: Head,
    from: Source,
}

enum Source {
    /// A small one.
    Memory(ImageStack),
    /// Open from when it was verified: whoever replaces or removes it changes nothing here.
    File(Mutex<File>, Box<exr::Layout>),
}

impl OpenedImages {
    pub(super) fn of(stack: ImageStack) -> Self {
        Self { head: Head::of(&stack), from: Source::Memory(stack) }
    }

    pub fn head(&self) -> &Head {
        &self.head
    }

    /// The layers that `wanted` says yes to, by their place and what they are.
    ///
    /// Error: the file cannot be read any more.
    pub fn part(&self, wanted: &dyn Fn(usize, &LayerInfo) -> bool) -> Result<ImageStack, StoreError> {
        match &self.from {
            Source::Memory(stack) => Ok(kept(Cow::Borrowed(stack), wanted)),
            Source::File(file, layout) => {
                let mut part = ImageStack::new(self.head.rows, self.head.columns);
                part.attributes = self.head.attributes.clone();
                let mut file = lock(file);
                for (k, info) in self.head.layers.iter().enumerate().filter(|(k, info)| wanted(*k, info)) {
                    let mut data = Array2::zeros((self.head.rows, self.head.columns));
                    layout.part(k, &mut *file, data.as_slice_mut().expect("row-major"))?;
                    part.push(info.clone(), data);
                }
                Ok(part)
            }
        }
    }
}

fn length(file: &File) -> io::Result<u64> {
    file.metadata().map(|meta| meta.len())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use turbid_contract::ndarray::Array2;
    use turbid_contract::{Artifact, LayerInfo, LayerKind};

    use super::*;
    use crate::store::{Store, encode};

    /// 17 MB of values, and a mask of runs.
    fn stack() -> ImageStack {
        let (rows, columns) = (1500, 1450);
        let mut stack = ImageStack::new(rows, columns);
        for k in 0..2 {
            let value = |(r, c): (usize, usize)| (r * columns + c + k) as f32 * 0.25;
            stack.push(LayerInfo::value("m_ac", "1"), Array2::from_shape_fn((rows, columns), value));
        }
        let mask = Array2::from_shape_fn((rows, columns), |(r, _)| f32::from(u8::from(r % 7 == 0)));
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
        stack
    }

    /// The same bytes as in memory, the same stack back, once for twice; a flipped byte is damage, and what is damaged is written anew.
    #[test]
    fn line_by_line_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let stack = stack();
        assert!(is_large(&stack));
        let artifact = Artifact::Images(stack);
        let blob = store.put(&artifact).unwrap();
        let bytes = encode(&artifact).unwrap();
        assert_eq!((blob.digest, blob.bytes), (Digest::of(&bytes), bytes.len() as u64));
        assert!(store.get(&blob).unwrap() == artifact);
        assert_eq!(store.extent(&blob), Some(artifact.extent()));
        let opened = store.open_images(&blob).unwrap();
        let Artifact::Images(stack) = &artifact else { unreachable!("it is one") };
        assert_eq!(*opened.head(), Head::of(stack));
        for some in [vec![], vec![1], vec![0, 2], vec![0, 1, 2]] {
            let wanted = |k: usize, _: &LayerInfo| some.contains(&k);
            assert!(opened.part(&wanted).unwrap() == kept(Cow::Borrowed(stack), &wanted), "{some:?}");
        }
        assert_eq!(store.put(&artifact).unwrap(), blob);
        let path = store.file_of(&blob).expect("a file of its own");
        let mut wrong = bytes.clone();
        wrong[bytes.len() / 2] ^= 1;
        for damaged in [&wrong[..], &bytes[..bytes.len() - 1]] {
            fs::remove_file(&path).unwrap();
            fs::write(&path, damaged).unwrap();
            assert!(matches!(store.get(&blob), Err(StoreError::Damaged { .. })));
            assert!(matches!(store.get(&blob), Err(StoreError::Missing { .. })), "it was set aside");
            assert_eq!(store.put(&artifact).unwrap(), blob);
            assert!(store.get(&blob).unwrap() == artifact);
        }
        let left = fs::read_dir(folder.path().join("store/tmp")).unwrap().count();
        assert_eq!(left, 0, "temporary files");
    }

    /// A drawing of one colour is small once it is encoded, and lies with the small pieces.
    #[test]
    fn what_shrinks_is_small() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let mut drawing = ImageStack::new(2100, 2000);
        drawing.push(LayerInfo::value("grey", "1"), Array2::from_elem((2100, 2000), 0.5));
        assert!(is_large(&drawing));
        let artifact = Artifact::Images(drawing);
        let blob = store.put(&artifact).unwrap();
        assert!(blob.bytes < LARGE && store.get(&blob).unwrap() == artifact);
        assert_eq!(Digest::of(&encode(&artifact).unwrap()), blob.digest);
    }

    /// What cannot be stored is named, and leaves nothing behind; nor does a disk that runs full.
    #[test]
    fn what_fails_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let mut wrong = stack();
        wrong.layers[1].data[(2, 4)] = f32::NAN;
        let message = store.put(&Artifact::Images(wrong)).unwrap_err().to_string();
        assert!(message.starts_with("layer 1 `m_ac` has the value NaN at row 2, column 4"), "{message}");
        disk::quota::set(Some(5_000_000));
        let full = store.put(&Artifact::Images(stack()));
        disk::quota::set(None);
        assert!(full.unwrap_err().is_full());
        assert_eq!(fs::read_dir(folder.path().join("store/tmp")).unwrap().count(), 0, "temporary files");
        assert!(fs::read_dir(folder.path().join("store/blobs")).map_or(0, Iterator::count) == 0);
    }
}
