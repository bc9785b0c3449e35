//! A file of entries in the order of their digests: looked up without being read as a whole, and checked block by block.
//!
//! Blocks of up to 72 entries, then a foot. Numbers are little-endian. An entry has 56 bytes: digest (32), number of the pack in
//! the foot's list with what the digest names in its highest three bits (4), offset (4), length (4), last use (4), stamp (8). A block ends
//! with the file's id (8), its own number (8) and the first 16 bytes of the BLAKE3 of all before in it. The foot: id (8), number of
//! entries (8), dead bytes (8), whether a blob may have been released (8), number of packs (8), each with the length of its
//! name (8), name, where what is covered begins (8) and ends (8), check of its first frame (16). It ends with its
//! length (8), the magic (16), and the BLAKE3 of all before in it (32).

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::digest::Digest;
use crate::store::disk;
use crate::store::place::{Entry, Named, Place};

const MAGIC: &[u8; 16] = b"turbid index 4\n\0";
/// What all formats begin their magic with.
pub(super) const MAGIC_OF_ALL: &[u8] = b"turbid index ";
const ENTRY: usize = 56;
const PER_BLOCK: usize = 72;
/// Id, number and check.
const BLOCK_END: usize = 32;
const BLOCK: usize = PER_BLOCK * ENTRY + BLOCK_END;
/// Length, magic and check.
const FOOT_END: usize = 56;
/// Bytes of the longest foot: names of a million packs.
const LONGEST_FOOT: u64 = 1 << 26;
/// Blocks that are read at once where all are wanted.
const AT_ONCE: usize = 16;
/// So many guesses are made of where a digest is before what is left is halved.
const GUESSES: usize = 4;
const PACK_BITS: u32 = 29;
const PACK: u32 = (1 << PACK_BITS) - 1;

/// A part of a pack whose every frame is among the entries of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Covered {
    pub name: String,
    pub from: u64,
    pub to: u64,
    /// Tells the pack from another one of its name: the check of its first frame.
    pub first: [u8; 16],
}

/// What a file says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Foot {
    pub id: u64,
    pub packs: Vec<Covered>,
    /// Bytes of the packs that newer frames replace, as far as that was known.
    pub dead: i64,
    /// Whether a blob may have been released.
    pub releases: bool,
    /// Number of entries; given by what is written.
    pub count: u64,
}

/// An open file of sorted entries.
pub(super) struct Sorted {
    pub path: PathBuf,
    file: File,
    pub foot: Foot,
    /// Ids of the packs in the order of the foot.
    ids: Vec<u32>,
    /// Blocks that were looked into, checked.
    blocks: Vec<OnceLock<Box<[u8]>>>,
    hurt: AtomicBool,
}

impl Sorted {
    /// Opens a file; `None` where it is damaged at its end or of another format. Error: it cannot be read.
    pub fn open(path: &Path) -> io::Result<Option<Self>> {
        let file = disk::open_regular(path)?;
        let Some((foot, _)) = read_foot(&file)?.filter(|(_, known)| *known) else { return Ok(None) };
        let blocks = (0..blocks_of(foot.count)).map(|_| OnceLock::new()).collect();
        Ok(Some(Self { path: path.to_owned(), file, foot, ids: Vec::new(), blocks, hurt: AtomicBool::new(false) }))
    }

    /// Says what the packs that it covers are called in this process.
    pub fn set_ids(&mut self, ids: Vec<u32>) {
        debug_assert_eq!(ids.len(), self.foot.packs.len());
        self.ids = ids;
    }

    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// Number of entries.
    pub fn count(&self) -> u64 {
        self.foot.count
    }

    /// Whether something in it was found damaged or could not be read.
    pub fn is_hurt(&self) -> bool {
        self.hurt.load(Ordering::Relaxed)
    }

    /// The entry of a digest. Where it cannot be told, there is none, and the file is hurt from then on.
    pub fn find(&self, named: Named, digest: &Digest) -> Option<Place> {
        self.search(named, digest).unwrap_or_else(|_| {
            self.hurt.store(true, Ordering::Relaxed);
            None
        })
    }

    /// Digests are uniform: where one is can be guessed from the first bytes of those around it.
    fn search(&self, named: Named, digest: &Digest) -> io::Result<Option<Place>> {
        let wanted = (digest.0, named as u8);
        let (mut low, mut high) = (0, self.blocks.len());
        let (mut least, mut most) = (0, u64::MAX);
        let mut guesses = 0;
        while low < high {
            let span = (high - low) as u128;
            let part = u128::from(first(&digest.0).clamp(least, most) - least) * span / (u128::from(most - least) + 1);
            let guess = if guesses < GUESSES { low + part as usize } else { low + (high - low) / 2 };
            guesses += 1;
            let entries = self.block(guess)?;
            let key = |n: usize| key_of(&entries[n * ENTRY..]);
            let count = entries.len() / ENTRY;
            if wanted < key(0) {
                (high, most) = (guess, first(&key(0).0).max(least));
            } else if wanted > key(count - 1) {
                (low, least) = (guess + 1, first(&key(count - 1).0).min(most));
            } else {
                let at = partition(count, |n| key(n) < wanted);
                if key(at) != wanted {
                    return Ok(None);
                }
                return self.decode(&entries[at * ENTRY..]).map(|entry| Some(entry.place));
            }
        }
        Ok(None)
    }

    /// The entries of a block, from memory or from the file.
    fn block(&self, number: usize) -> io::Result<&[u8]> {
        if let Some(block) = self.blocks[number].get() {
            return Ok(block);
        }
        let length = block_length(self.foot.count, number);
        let mut block = disk::read_at(&self.file, (number * BLOCK) as u64, length)?;
        check_block(&block, self.foot.id, number)?;
        block.truncate(length - BLOCK_END);
        Ok(self.blocks[number].get_or_init(|| block.into_boxed_slice()))
    }

    fn decode(&self, bytes: &[u8]) -> io::Result<Entry> {
        let mut entry = decode(bytes)?;
        if entry.place.is_here() && !self.ids.is_empty() {
            entry.place.pack = *self.ids.get(entry.place.pack as usize).ok_or_else(damaged)?;
        }
        Ok(entry)
    }

    /// All entries in their order. Packs have their numbers in the foot as long as no ids were set. An error ends it, and the file is hurt from then on.
    pub fn entries(&self) -> impl Iterator<Item = io::Result<Entry>> + '_ {
        let hurt = |error| {
            self.hurt.store(true, Ordering::Relaxed);
            error
        };
        Blocks { file: &self.file, foot: &self.foot, next: 0, bytes: Vec::new(), at: 0, last: None }
            .map(move |entry| entry.and_then(|bytes| self.decode(&bytes)).map_err(hurt))
    }
}

/// Reads the entries of a file, checking blocks and order.
struct Blocks<'a> {
    file: &'a File,
    foot: &'a Foot,
    /// Number of the next block to read.
    next: usize,
    /// Entries of the blocks that were read last.
    bytes: Vec<u8>,
    at: usize,
    last: Option<([u8; 32], u8)>,
}

impl Blocks<'_> {
    fn read(&mut self) -> io::Result<()> {
        let end = blocks_of(self.foot.count).min(self.next + AT_ONCE);
        let lengths: Vec<usize> = (self.next..end).map(|number| block_length(self.foot.count, number)).collect();
        let bytes = disk::read_at(self.file, (self.next * BLOCK) as u64, lengths.iter().sum())?;
        self.bytes.clear();
        self.at = 0;
        let mut rest = &bytes[..];
        for length in lengths {
            let (block, behind) = rest.split_at(length);
            check_block(block, self.foot.id, self.next)?;
            self.bytes.extend_from_slice(&block[..length - BLOCK_END]);
            (rest, self.next) = (behind, self.next + 1);
        }
        Ok(())
    }
}

impl Iterator for Blocks<'_> {
    type Item = io::Result<[u8; ENTRY]>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at == self.bytes.len() {
            if self.next == blocks_of(self.foot.count) {
                return None;
            }
            if let Err(error) = self.read() {
                // Nothing follows.
                (self.next, self.at) = (blocks_of(self.foot.count), self.bytes.len());
                return Some(Err(error));
            }
        }
        let entry: [u8; ENTRY] = self.bytes[self.at..self.at + ENTRY].try_into().expect("whole entries");
        self.at += ENTRY;
        let key = key_of(&entry);
        if self.last.replace(key).is_some_and(|last| last >= key) {
            (self.next, self.at) = (blocks_of(self.foot.count), self.bytes.len());
            return Some(Err(damaged()));
        }
        Some(Ok(entry))
    }
}

/// Whether a file is whole, or one of another format. Error: it cannot be read.
pub(super) fn is_sound(path: &Path) -> io::Result<bool> {
    let file = disk::open_regular(path)?;
    let Some((foot, known)) = read_foot(&file)? else { return Ok(false) };
    if !known {
        return Ok(true);
    }
    let mut blocks = Blocks { file: &file, foot: &foot, next: 0, bytes: Vec::new(), at: 0, last: None };
    let whole = blocks.try_for_each(|entry| {
        let place = decode(&entry?)?.place;
        let listed = !place.is_here() || (place.pack as usize) < foot.packs.len();
        if listed { Ok(()) } else { Err(damaged()) }
    });
    match whole {
        Err(error) if error.kind() == io::ErrorKind::InvalidData => Ok(false),
        whole => whole.map(|()| true),
    }
}

/// Writes entries that come in their order. `number` gives the place of a pack's id in the foot's list; what it does not know is
/// left out. `all`: no other file has entries, so that what none of these holds is dead.
pub(super) fn write(
    to: &mut dyn Write,
    mut foot: Foot,
    all: bool,
    entries: impl Iterator<Item = io::Result<Entry>>,
    number: impl Fn(u32) -> Option<u32>,
) -> io::Result<()> {
    let mut block = Vec::with_capacity(BLOCK);
    let (mut blocks, mut live) = (0, 0i64);
    (foot.count, foot.releases) = (0, false);
    for entry in entries {
        let entry = entry?;
        let pack = if entry.place.is_here() { number(entry.place.pack) } else { Some(entry.place.pack & PACK) };
        let Some(pack) = pack else { continue };
        encode(&entry, pack, &mut block);
        foot.count += 1;
        live = live.saturating_add(entry.room());
        foot.releases |= entry.place.is_released();
        if block.len() == PER_BLOCK * ENTRY {
            end_block(&mut block, foot.id, blocks, to)?;
            blocks += 1;
        }
    }
    if !block.is_empty() {
        end_block(&mut block, foot.id, blocks, to)?;
    }
    if all {
        let covered: u64 = foot.packs.iter().map(|part| part.to.saturating_sub(part.from)).sum();
        foot.dead = i64::try_from(covered).unwrap_or(i64::MAX) - live;
    }
    to.write_all(&foot.encode())
}

fn end_block(block: &mut Vec<u8>, id: u64, number: u64, to: &mut dyn Write) -> io::Result<()> {
    block.extend_from_slice(&id.to_le_bytes());
    block.extend_from_slice(&number.to_le_bytes());
    let check = Digest::of(block);
    block.extend_from_slice(&check.0[..16]);
    to.write_all(block)?;
    block.clear();
    Ok(())
}

fn check_block(block: &[u8], id: u64, number: usize) -> io::Result<()> {
    let (body, check) = block.split_at(block.len() - 16);
    let end = &body[body.len() - 16..];
    let own = end[..8] == id.to_le_bytes() && end[8..] == (number as u64).to_le_bytes();
    if own && Digest::of(body).0[..16] == *check { Ok(()) } else { Err(damaged()) }
}

fn damaged() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "the index is damaged")
}

fn blocks_of(count: u64) -> usize {
    count.div_ceil(PER_BLOCK as u64) as usize
}

fn block_length(count: u64, number: usize) -> usize {
    ((count as usize - number * PER_BLOCK).min(PER_BLOCK)) * ENTRY + BLOCK_END
}

/// Bytes of all blocks.
fn length_of(count: u64) -> Option<u64> {
    count.checked_mul(ENTRY as u64)?.checked_add(count.div_ceil(PER_BLOCK as u64).checked_mul(BLOCK_END as u64)?)
}

fn first(digest: &[u8; 32]) -> u64 {
    u64::from_be_bytes(*digest.first_chunk().expect("a digest has 32 bytes"))
}

/// By what entries are sorted.
fn key_of(entry: &[u8]) -> ([u8; 32], u8) {
    let word = u32::from_le_bytes(entry[32..36].try_into().expect("4 bytes"));
    (entry[..32].try_into().expect("32 bytes"), (word >> PACK_BITS) as u8)
}

/// How many of 0..n are before the first that is not.
fn partition(n: usize, is_before: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (0, n);
    while low < high {
        let middle = low + (high - low) / 2;
        if is_before(middle) { low = middle + 1 } else { high = middle }
    }
    low
}

fn encode(entry: &Entry, pack: u32, to: &mut Vec<u8>) {
    let Place { offset, length, used, stamp, .. } = entry.place;
    to.extend_from_slice(&entry.digest.0);
    for number in [pack | (entry.named as u32) << PACK_BITS, offset, length, used] {
        to.extend_from_slice(&number.to_le_bytes());
    }
    to.extend_from_slice(&stamp.to_le_bytes());
}

/// The pack is its number in the foot.
fn decode(bytes: &[u8]) -> io::Result<Entry> {
    let (digest, named) = key_of(bytes);
    let named = *Named::ALL.get(usize::from(named)).ok_or_else(damaged)?;
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
    let stamp = u64::from_le_bytes(bytes[48..56].try_into().expect("8 bytes"));
    let pack = word(32) & PACK;
    // The highest numbers stand for places in no pack.
    let pack = if pack >= Place::UNKNOWN & PACK { pack | !PACK } else { pack };
    let place = Place { pack, offset: word(36), length: word(40), used: word(44), stamp };
    Ok(Entry { digest: Digest(digest), named, place })
}

impl Foot {
    fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for number in [self.id, self.count, self.dead as u64, u64::from(self.releases), self.packs.len() as u64] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        for pack in &self.packs {
            bytes.extend_from_slice(&(pack.name.len() as u64).to_le_bytes());
            bytes.extend_from_slice(pack.name.as_bytes());
            bytes.extend_from_slice(&pack.from.to_le_bytes());
            bytes.extend_from_slice(&pack.to.to_le_bytes());
            bytes.extend_from_slice(&pack.first);
        }
        bytes.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        bytes.extend_from_slice(MAGIC);
        let check = Digest::of(&bytes);
        bytes.extend_from_slice(&check.0);
        bytes
    }

    fn decode(mut rest: &[u8]) -> Option<Self> {
        let rest = &mut rest;
        let (id, count, dead) = (number(rest)?, number(rest)?, number(rest)? as i64);
        let releases = number(rest)? != 0;
        let packs = (0..number(rest)?)
            .map(|_| {
                let length = usize::try_from(number(rest)?).ok()?;
                let name = std::str::from_utf8(take(rest, length)?).ok()?.to_owned();
                let (from, to) = (number(rest)?, number(rest)?);
                Some(Covered { name, from, to, first: take(rest, 16)?.try_into().ok()? })
            })
            .collect::<Option<Vec<_>>>()?;
        rest.is_empty().then_some(Self { id, packs, dead, releases, count })
    }
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (taken, left) = rest.split_at_checked(n)?;
    *rest = left;
    Some(taken)
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(take(rest, 8)?.try_into().ok()?))
}

/// The foot of a file, and whether it is of this format (an empty one otherwise); `None` where it is damaged.
fn read_foot(file: &File) -> io::Result<Option<(Foot, bool)>> {
    let length = file.metadata()?.len();
    let Some(end) = length.checked_sub(FOOT_END as u64) else { return Ok(None) };
    let last = disk::read_at(file, end, FOOT_END)?;
    let foot_length = number(&mut &last[..]).unwrap_or_default();
    let Some(begin) = end.checked_sub(foot_length).filter(|_| foot_length <= LONGEST_FOOT) else { return Ok(None) };
    let mut bytes = disk::read_at(file, begin, foot_length as usize)?;
    bytes.extend_from_slice(&last[..FOOT_END - 32]);
    if Digest::of(&bytes).0 != last[FOOT_END - 32..] {
        return Ok(None);
    }
    if last[8..24] != *MAGIC {
        return Ok(last[8..].starts_with(MAGIC_OF_ALL).then(|| (Foot::default(), false)));
    }
    let foot = Foot::decode(&bytes[..foot_length as usize]);
    Ok(foot.filter(|foot| length_of(foot.count) == Some(begin)).map(|foot| (foot, true)))
}
