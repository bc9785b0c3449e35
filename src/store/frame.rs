//! Frames: the entries of a pack. Every frame can be recognised and checked by itself, wherever it starts.
//!
//! 88 bytes of header, then the payload. Little-endian:
//! magic `TFr1` (4), kind (1), zero (3), stamp (8), payload length (8), key (32), first 16 bytes of the payload's
//! BLAKE3, first 16 bytes of the BLAKE3 of the 72 header bytes before.

use crate::digest::Digest;

const MAGIC: [u8; 4] = *b"TFr1";
pub(super) const HEADER: usize = 88;

/// What a frame says about its key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(super) enum Kind {
    /// The record of instance `key`.
    Record = 1,
    /// The blob with digest `key`.
    Blob = 2,
    /// What older frames say about record `key` no longer holds.
    ForgetRecord = 3,
    ForgetBlob = 4,
    /// Payload: (key, Unix time in s) pairs, 40 bytes each: when records were last used.
    Used = 5,
    /// Payload: digests of blobs, 32 bytes each, whose bytes were given back on purpose: older frames of them no longer hold.
    Release = 6,
}

impl Kind {
    fn of(byte: u8) -> Option<Self> {
        [Self::Record, Self::Blob, Self::ForgetRecord, Self::ForgetBlob, Self::Used, Self::Release]
            .into_iter()
            .find(|k| *k as u8 == byte)
    }
}

/// A frame, without its payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    pub kind: Kind,
    pub key: Digest,
    /// Orders the frames of one key: the higher stamp holds. Unix time in ns, raised where clocks go backwards.
    pub stamp: u64,
    /// Payload bytes.
    pub length: u64,
    check: [u8; 16],
}

fn check_of(bytes: &[u8]) -> [u8; 16] {
    Digest::of(bytes).0[..16].try_into().expect("a digest has 32 bytes")
}

/// The bytes of a frame.
pub(super) fn encode(kind: Kind, key: &Digest, stamp: u64, payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&[kind as u8, 0, 0, 0]);
    bytes.extend_from_slice(&stamp.to_le_bytes());
    bytes.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&key.0);
    bytes.extend_from_slice(&check_of(payload));
    let check = check_of(&bytes);
    bytes.extend_from_slice(&check);
    bytes.extend_from_slice(payload);
    bytes
}

/// The header at the start of `bytes`, if one is there and undamaged.
pub(super) fn header(bytes: &[u8]) -> Option<Frame> {
    let head = bytes.get(..HEADER)?;
    if head[..4] != MAGIC || head[72..] != check_of(&head[..72]) {
        return None;
    }
    let number = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().expect("8 bytes"));
    Some(Frame {
        kind: Kind::of(head[4])?,
        stamp: number(8),
        length: number(16),
        key: Digest(head[24..56].try_into().expect("32 bytes")),
        check: head[56..72].try_into().expect("16 bytes"),
    })
}

/// The frame that fills `bytes` exactly, with its payload; `None` where anything is damaged.
pub(super) fn decode(bytes: &[u8]) -> Option<(Frame, &[u8])> {
    let frame = header(bytes)?;
    let payload = &bytes[HEADER..];
    (payload.len() as u64 == frame.length && check_of(payload) == frame.check).then_some((frame, payload))
}

/// What a scan found.
pub(super) struct Scan {
    /// Undamaged frames with the offset of their header, in order.
    pub frames: Vec<(u64, Frame)>,
    /// End of the last undamaged frame.
    pub end: u64,
    /// Bytes before `end` that belong to no undamaged frame.
    pub garbage: u64,
}

/// Finds all undamaged frames in `bytes`.
///
/// After damage it looks for the next frame byte by byte: a write that was cut short (a crash, a full disk) or a
/// flipped bit hides nothing that comes later.
pub(super) fn scan(bytes: &[u8]) -> Scan {
    let mut scan = Scan { frames: Vec::new(), end: 0, garbage: 0 };
    let mut at = 0;
    while let Some(found) = bytes[at..].windows(4).position(|w| w == MAGIC) {
        at += found;
        let whole = header(&bytes[at..]).and_then(|frame| {
            let end = at.checked_add(HEADER)?.checked_add(usize::try_from(frame.length).ok()?)?;
            decode(bytes.get(at..end)?).map(|(frame, _)| (frame, end))
        });
        if let Some((frame, end)) = whole {
            scan.garbage += at as u64 - scan.end;
            scan.frames.push((at as u64, frame));
            scan.end = end as u64;
            at = end;
        } else {
            at += 1;
        }
    }
    scan
}

/// The (key, Unix time in s) pairs in the payload of a [`Kind::Used`] frame.
pub(super) fn used_pairs(payload: &[u8]) -> impl Iterator<Item = (Digest, u64)> {
    payload.chunks_exact(40).map(|pair| {
        let key = Digest(pair[..32].try_into().expect("32 bytes"));
        (key, u64::from_le_bytes(pair[32..].try_into().expect("8 bytes")))
    })
}

/// The digests in the payload of a [`Kind::Release`] frame.
pub(super) fn released(payload: &[u8]) -> impl Iterator<Item = Digest> {
    payload.chunks_exact(32).map(|digest| Digest(digest.try_into().expect("32 bytes")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pack() -> (Vec<u8>, Vec<u64>) {
        let (mut bytes, mut ends) = (Vec::new(), vec![0]);
        for (i, payload) in [&b"first"[..], b"", b"TFr1 in a payload", &[7; 300]].iter().enumerate() {
            bytes.extend(encode(Kind::Blob, &Digest::of(payload), i as u64, payload));
            ends.push(bytes.len() as u64);
        }
        (bytes, ends)
    }

    /// A pack cut anywhere gives exactly the frames that are whole.
    #[test]
    fn a_torn_tail_hides_nothing_before_it() {
        let (bytes, ends) = pack();
        for cut in 0..=bytes.len() {
            let scan = scan(&bytes[..cut]);
            let whole = ends.iter().filter(|&&end| end > 0 && end <= cut as u64).count();
            assert_eq!(scan.frames.len(), whole, "cut at {cut}");
            assert_eq!(scan.end, ends[whole], "cut at {cut}");
            assert_eq!(scan.garbage, 0, "cut at {cut}");
        }
    }

    /// A frame that was cut short anywhere, with more frames behind it, hides nothing behind it.
    #[test]
    fn a_torn_frame_hides_nothing_after_it() {
        let (bytes, ends) = pack();
        let torn = encode(Kind::Record, &Digest::of(b"k"), 9, &[1; 200]);
        for cut in 1..torn.len() {
            let mixed = [&torn[..cut], &bytes].concat();
            let scan = scan(&mixed);
            assert_eq!(scan.frames.len(), ends.len() - 1, "torn after {cut} bytes");
            assert_eq!((scan.garbage, scan.end), (cut as u64, mixed.len() as u64));
        }
    }

    /// A flipped bit costs exactly the frame that it is in.
    #[test]
    fn a_flipped_bit_costs_one_frame() {
        let (bytes, ends) = pack();
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let hit = ends.iter().filter(|&&end| end <= bit as u64 / 8).count() - 1;
            let found: Vec<u64> = scan(&flipped).frames.iter().map(|(_, frame)| frame.stamp).collect();
            let wanted: Vec<u64> = (0..4).filter(|&i| i != hit as u64).collect();
            assert_eq!(found, wanted, "bit {bit}");
        }
    }
}
