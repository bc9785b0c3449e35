//! What a longer render continues from: the sums after some whole batches, as bytes.

use crate::moments::Moments;

const MAGIC: &[u8; 8] = b"turbidR1";

/// The sums of all channels after `samples` paths per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// A multiple of the batch.
    pub samples: u32,
    pub channels: Vec<Moments>,
    /// (samples, relative error) wherever the error target was tested: a longer run must stop where a fresh one would.
    pub history: Vec<(u32, f64)>,
    pub flights: u64,
}

impl State {
    pub fn new(channels: usize, pixels: usize, q: usize) -> Self {
        Self { samples: 0, channels: vec![Moments::new(pixels, q); channels], history: Vec::new(), flights: 0 }
    }

    pub fn to_bytes(&self) -> Vec<u8> {
        let sums: usize = self.channels.iter().map(|c| c.sums().len()).sum();
        let mut bytes = Vec::with_capacity(32 + 12 * self.history.len() + 8 * sums);
        bytes.extend(MAGIC);
        bytes.extend(self.samples.to_le_bytes());
        bytes.extend((self.history.len() as u32).to_le_bytes());
        bytes.extend(self.flights.to_le_bytes());
        for (samples, error) in &self.history {
            bytes.extend(samples.to_le_bytes());
            bytes.extend(error.to_le_bytes());
        }
        for sum in self.channels.iter().flat_map(Moments::sums) {
            bytes.extend(sum.to_le_bytes());
        }
        bytes
    }

    /// `None` where the bytes are not such a state of that size.
    pub fn from_bytes(bytes: &[u8], channels: usize, pixels: usize, q: usize) -> Option<Self> {
        let (head, rest) = bytes.split_at_checked(24)?;
        let (magic, head) = head.split_at(8);
        if magic != MAGIC {
            return None;
        }
        let samples = u32::from_le_bytes(head[..4].try_into().ok()?);
        let n_history = u32::from_le_bytes(head[4..8].try_into().ok()?) as usize;
        let flights = u64::from_le_bytes(head[8..16].try_into().ok()?);
        let (history, sums) = rest.split_at_checked(n_history.checked_mul(12)?)?;
        let history = history.chunks_exact(12).map(|entry| {
            let (n, error) = entry.split_at(4);
            Some((u32::from_le_bytes(n.try_into().ok()?), f64::from_le_bytes(error.try_into().ok()?)))
        });
        let history = history.collect::<Option<Vec<_>>>()?;
        let per_channel = Moments::new(pixels, q).sums().len();
        if sums.len() != 8 * per_channel * channels {
            return None;
        }
        let sums = sums.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes")));
        let sums: Vec<f64> = sums.collect();
        let channels = sums.chunks(per_channel).map(|c| Moments::from_sums(q, c.to_vec())).collect();
        Some(Self { samples, channels, history, flights })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_trip_and_torn_ones_are_refused() {
        let mut state = State::new(2, 3, 3);
        state.samples = 64;
        state.flights = 1 << 40;
        state.history = vec![(64, 0.1)];
        state.channels[1].add(2, &[1.0, -0.5, 1e-300]);
        let bytes = state.to_bytes();
        assert_eq!(State::from_bytes(&bytes, 2, 3, 3), Some(state));
        assert_eq!(State::from_bytes(&bytes, 2, 4, 3), None);
        for torn in [0, 7, 23, 30, bytes.len() - 1] {
            assert_eq!(State::from_bytes(&bytes[..torn], 2, 3, 3), None, "{torn} bytes");
        }
    }
}
