//! Checksums made right again after a mutation, so that it gets past them: chunks of PNG, entries of packs, whole files.

use turbid::digest::Digest;

/// The CRC-32 of each chunk of a PNG (kind and data; PNG specification, section 5.3).
pub fn png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes(*head.first_chunk().expect("8 bytes")) as usize;
        let Some(end) = at.checked_add(8 + length).filter(|end| end + 4 <= bytes.len()) else { return };
        let crc = crc32fast::hash(&bytes[at + 4..end]);
        bytes[end..end + 4].copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}

/// The checks of each entry of a pack (docs/store.md): that of a record's head, of the payload, of the entry's header.
pub fn pack(bytes: &mut [u8]) {
    const HEADER: usize = 88;
    let mut at = 0;
    while let Some(found) = bytes[at..].windows(4).position(|w| w == b"TFr1") {
        at += found;
        let Some(header) = bytes.get(at..at + HEADER) else { return };
        let length = u64::from_le_bytes(*header[16..].first_chunk().expect("8 bytes"));
        let start = at + HEADER;
        let end = usize::try_from(length).ok().and_then(|n| start.checked_add(n)).filter(|&end| end <= bytes.len());
        if let Some(end) = end {
            if bytes[at + 4] == 1 {
                record(&mut bytes[start..end]);
            }
            let check = Digest::of(&bytes[start..end]);
            bytes[at + 56..at + 72].copy_from_slice(&check.0[..16]);
        }
        let check = Digest::of(&bytes[at..at + 72]);
        bytes[at + 72..at + 88].copy_from_slice(&check.0[..16]);
        at = end.unwrap_or(start);
    }
}

/// Length (4), check of the head (16), head.
fn record(payload: &mut [u8]) {
    let Some(length) = payload.first_chunk().map(|n| u32::from_le_bytes(*n) as usize) else { return };
    if let Some(head) = length.checked_add(20).and_then(|end| payload.get(20..end)) {
        let check = Digest::of(head);
        payload[4..20].copy_from_slice(&check.0[..16]);
    }
}

/// The checks of a file of the index: that of each block, as long as the foot counts entries, and that of the foot.
pub fn index(bytes: &mut [u8]) {
    const ENTRY: usize = 56;
    const PER_BLOCK: usize = 72;
    const BLOCK_END: usize = 32;
    const FOOT_END: usize = 56;
    let Some(end) = bytes.len().checked_sub(FOOT_END) else { return };
    let number = |at: usize| usize::try_from(u64::from_le_bytes(*bytes[at..].first_chunk().expect("8 bytes"))).ok();
    let Some(begin) = number(end).and_then(|length| end.checked_sub(length)).filter(|at| at + 16 <= end) else {
        return;
    };
    let mut left = number(begin + 8).unwrap_or(0);
    let check = Digest::of(&bytes[begin..bytes.len() - 32]);
    let tail = bytes.len() - 32;
    bytes[tail..].copy_from_slice(&check.0);
    let mut at = 0;
    while left > 0 {
        let count = left.min(PER_BLOCK);
        let Some(block) = bytes[..begin].get_mut(at..at + count * ENTRY + BLOCK_END) else { return };
        let (body, check) = block.split_at_mut(block.len() - 16);
        check.copy_from_slice(&Digest::of(body).0[..16]);
        (at, left) = (at + block.len(), left - count);
    }
}

/// The last 32 bytes, which are the digest of those before (memos).
pub fn tail(bytes: &mut [u8]) {
    if let Some(body) = bytes.len().checked_sub(32) {
        let check = Digest::of(&bytes[..body]);
        bytes[body..].copy_from_slice(&check.0);
    }
}

/// What is made right is taken by those who check it.
pub fn test() {
    let mut png_bytes = crate::readers::pictures::png_of(3, 2, png::BitDepth::Eight, png::ColorType::Grayscale);
    let good = png_bytes.clone();
    let last = png_bytes.len() - 1;
    png_bytes[last] ^= 1;
    png(&mut png_bytes);
    assert_eq!(png_bytes, good, "the encoder's own checksum");
}
