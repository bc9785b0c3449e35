//! Which bytes of packs are asked for in one request: what lies close together comes together.

use crate::digest::Digest;

use super::manifest::Spot;

/// So many bytes that nobody asked for take less time than another request.
const NEAR: u64 = 256 << 10;
/// A span ends with the frame that makes it as long as this.
const LONG: u64 = 8 << 20;

/// Some bytes of a pack, with the frames in it that are wanted.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Span<T> {
    pub pack: Digest,
    pub start: u64,
    pub end: u64,
    pub wanted: Vec<(Spot, T)>,
}

/// The spans in which the frames lie, by pack and place; each begins so many bytes earlier, for what is likely to be asked for next.
pub(super) fn spans<T>(mut frames: Vec<(Spot, T)>, lead: u64) -> Vec<Span<T>> {
    frames.sort_by_key(|(spot, _)| *spot);
    let mut spans: Vec<Span<T>> = Vec::new();
    for (spot, what) in frames {
        match spans.last_mut() {
            Some(span) if span.pack == spot.pack && spot.offset <= span.end + NEAR && span.end - span.start < LONG => {
                span.end = span.end.max(spot.end());
                span.wanted.push((spot, what));
            }
            _ => {
                let start = spot.offset.saturating_sub(lead);
                spans.push(Span { pack: spot.pack, start, end: spot.end(), wanted: vec![(spot, what)] });
            }
        }
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_comes_together() {
        let pack = |n: u8| Digest([n; 32]);
        let spot = |n, offset, length| (Spot { pack: pack(n), offset, length }, offset);
        let far = 100 + NEAR + 1;
        let found = spans(vec![spot(2, 0, 50), spot(1, far, 10), spot(1, 0, 100), spot(1, far + 10, 10)], 0);
        let ends: Vec<_> = found.iter().map(|s| (s.pack, s.start, s.end, s.wanted.len())).collect();
        assert_eq!(ends, [(pack(1), 0, 100, 1), (pack(1), far, far + 20, 2), (pack(2), 0, 50, 1)]);
        // A pack as a whole: every byte once, in pieces of bounded length.
        let whole = spans((0..1000).map(|i| spot(1, i * 50_000, 50_000)).collect(), 0);
        assert!(whole.iter().all(|span| span.end - span.start < LONG + 50_000) && whole.len() < 8);
        assert_eq!(whole.iter().map(|span| span.end - span.start).sum::<u64>(), 50_000_000);
        assert!(spans(Vec::<(Spot, ())>::new(), 9).is_empty());
        let early: Vec<_> = spans(vec![spot(1, 5, 1), spot(2, 100, 1)], 9).iter().map(|span| span.start).collect();
        assert_eq!(early, [0, 91]);
    }
}
