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

/// The last 32 bytes, which are the digest of those before (index, memos).
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
