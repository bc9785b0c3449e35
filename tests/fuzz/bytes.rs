//! Mutations that know nothing of a format but that numbers stand in it.

use crate::random::Random;

/// What breaks length fields and offsets.
const NUMBERS: [u64; 16] = [
    0,
    1,
    2,
    3,
    0x7f,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    1 << 53,
    1 << 62,
    1 << 63,
    u64::MAX,
];

/// Changes something in `bytes`; `other` gives what is spliced in.
pub fn mutate(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    if bytes.is_empty() {
        bytes.extend_from_slice(&other[random.piece(other.len())]);
        return;
    }
    let length = bytes.len();
    match random.below(12) {
        0 | 1 => bytes[random.below(length)] ^= 1 << random.below(8),
        2 => bytes[random.below(length)] = random.next() as u8,
        3..=5 => number(bytes, random),
        6 => bytes.truncate(random.below(length)),
        7 => drop(bytes.drain(random.piece(length))),
        8 => {
            let copy = bytes[random.piece(length)].to_vec();
            insert(bytes, &copy, random);
        }
        9 => swap(bytes, random),
        10 => {
            let piece = other[random.piece(other.len())].to_vec();
            if random.one_in(2) { insert(bytes, &piece, random) } else { overwrite(bytes, &piece, random) }
        }
        _ => {
            let any = random.next() as u8;
            let same = vec![*random.pick(&[0, 0xff, b'A', any]); 1 + random.below(300)];
            overwrite(bytes, &same, random);
        }
    }
}

/// A number of 1, 2, 4 or 8 bytes, of either order, at a place that numbers mostly stand at.
fn number(bytes: &mut [u8], random: &mut Random) {
    let width = [1, 2, 4, 8][random.below(4)].min(bytes.len());
    let mut at = random.below(bytes.len() - width + 1);
    // Most formats align their numbers; heads hold most lengths.
    if random.one_in(2) {
        at -= at % width;
    }
    if random.one_in(3) {
        at %= 128;
    }
    let old = bytes[at..at + width].iter().rev().fold(0u64, |number, &b| number << 8 | u64::from(b));
    let new = match random.below(4) {
        0 => old.wrapping_add(1 + random.below(4) as u64),
        1 => old.wrapping_sub(1 + random.below(4) as u64),
        _ => *random.pick(&NUMBERS),
    };
    let mut new = new.to_le_bytes()[..width].to_vec();
    if random.one_in(2) {
        new.reverse();
    }
    bytes[at..at + width].copy_from_slice(&new);
}

fn insert(bytes: &mut Vec<u8>, piece: &[u8], random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    drop(bytes.splice(at..at, piece.iter().copied()));
}

fn overwrite(bytes: &mut [u8], piece: &[u8], random: &mut Random) {
    let at = random.below(bytes.len());
    for (byte, new) in bytes[at..].iter_mut().zip(piece) {
        *byte = *new;
    }
}

/// Two blocks of one size in each other's place.
fn swap(bytes: &mut [u8], random: &mut Random) {
    let half = bytes.len() / 2;
    if half == 0 {
        return;
    }
    let (first, second) = bytes.split_at_mut(half);
    let piece = random.piece(half);
    first[piece.clone()].swap_with_slice(&mut second[piece]);
}
