//! What a longer render continues from: the sums after some whole batches, as bytes.

use std::borrow::Cow;
use std::io::{self, Read, Write};

use crate::allocation::{doubling, share};
use crate::moments::Moments;
use crate::params::Allocate;
use crate::response::Layout;

const MAGIC: &[u8; 8] = b"turbidR3";

/// The sums of all channels after `samples` paths per pixel on average.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// A multiple of the batch.
    pub samples: u32,
    /// Of the paths that every pixel has.
    pub channels: Vec<Moments>,
    /// (samples, relative error) wherever the error target was tested: a longer run must stop where a fresh one would.
    pub history: Vec<(u32, f64)>,
    /// In the scene, and in control variates with it.
    pub flights: [u64; 2],
    /// Where pixels have control variates: whether their paths are walked there, too. `None` before that is decided.
    pub with_control: Option<Vec<bool>>,
    /// Where paths go to where the error is.
    pub more: Option<More>,
    /// False while a round is at work whose first part it holds already: then it is no state to go on from.
    pub is_whole: bool,
}

/// Paths beside those that every pixel has.
#[derive(Clone, Debug, PartialEq)]
pub struct More {
    pub channels: Vec<Moments>,
    /// Batches of each pixel until the last doubling ...
    pub before: Vec<u32>,
    /// ... and those from there to the next one; empty before they are planned.
    pub planned: Vec<u32>,
}

impl State {
    /// Of `fields` sums for each of `pixels` pixels.
    pub fn new(fields: usize, pixels: usize, layout: Layout, allocate: Allocate) -> Self {
        // One by one, not as copies of the first: the system hands out pages of zeros when they are first written.
        let zeros = || (0..fields).map(|_| Moments::new(pixels, layout.width()).with_steady(layout.steady)).collect();
        let channels = zeros();
        let more = || More { channels: zeros(), before: vec![0; pixels], planned: Vec::new() };
        Self {
            samples: 0,
            channels,
            history: Vec::new(),
            flights: [0; 2],
            with_control: None,
            more: (allocate == Allocate::Adaptive).then(more),
            is_whole: true,
        }
    }

    /// The sums of all paths.
    pub fn sums(&self) -> Cow<'_, [Moments]> {
        let Some(more) = &self.more else { return Cow::Borrowed(&self.channels) };
        let mut sums = self.channels.clone();
        sums.iter_mut().zip(&more.channels).for_each(|(sum, more)| sum.fold(0, more));
        Cow::Owned(sums)
    }

    /// The sums of all paths; the state is gone, for two of them would not fit where one does.
    pub fn into_sums(self) -> Vec<Moments> {
        let Some(more) = self.more else { return self.channels };
        let mut sums = self.channels;
        sums.iter_mut().zip(&more.channels).for_each(|(sum, more)| sum.fold(0, more));
        sums
    }

    /// Writes the state, piece by piece.
    ///
    /// Error: that of `to`.
    pub fn write_to(&self, to: &mut dyn Write) -> io::Result<()> {
        let with_control = self.with_control.as_deref().unwrap_or_default();
        let planned = self.more.as_ref().map_or(0, |more| more.planned.len());
        to.write_all(MAGIC)?;
        for number in [self.samples as usize, self.history.len(), with_control.len(), planned] {
            to.write_all(&(number as u32).to_le_bytes())?;
        }
        for number in self.flights {
            to.write_all(&number.to_le_bytes())?;
        }
        for (samples, error) in &self.history {
            to.write_all(&samples.to_le_bytes())?;
            to.write_all(&error.to_le_bytes())?;
        }
        to.write_all(&with_control.iter().map(|&b| u8::from(b)).collect::<Vec<_>>())?;
        write_sums(&self.channels, to)?;
        let Some(more) = &self.more else { return Ok(()) };
        write_sums(&more.channels, to)?;
        let batches: Vec<u8> = more.before.iter().chain(&more.planned).flat_map(|n| n.to_le_bytes()).collect();
        to.write_all(&batches)
    }

    /// `None` where what is read is not a state like `empty`, of some paths.
    pub fn read_from(from: &mut dyn Read, empty: Self) -> Option<Self> {
        let mut rest = Bytes(from);
        if rest.bytes::<8>()? != *MAGIC {
            return None;
        }
        let [samples, history, with_control, planned] = [rest.u32()?, rest.u32()?, rest.u32()?, rest.u32()?];
        let mut state = Self { samples, flights: [rest.u64()?, rest.u64()?], ..empty };
        state.history =
            (0..history).map(|_| Some((rest.u32()?, f64::from_bits(rest.u64()?)))).collect::<Option<_>>()?;
        let pixels = state.pixels();
        if ![0, pixels].contains(&(with_control as usize)) || ![0, pixels].contains(&(planned as usize)) {
            return None;
        }
        let with_control = rest.take(with_control as usize)?.into_iter().map(|b| b == 1).collect::<Vec<_>>();
        state.with_control = (!with_control.is_empty()).then_some(with_control);
        rest.sums(&mut state.channels)?;
        if let Some(more) = &mut state.more {
            rest.sums(&mut more.channels)?;
            more.before = (0..pixels).map(|_| rest.u32()).collect::<Option<_>>()?;
            more.planned = (0..planned).map(|_| rest.u32()).collect::<Option<_>>()?;
        } else if planned != 0 {
            return None;
        }
        rest.is_at_end().then_some(state)
    }

    fn pixels(&self) -> usize {
        self.channels.first().map_or(0, |channel| channel.sums().len() / channel.stride())
    }
}

impl More {
    /// Batches of each pixel at `batches` per pixel on average, not beyond the doubling after `from`.
    pub fn done(&self, from: u32, batches: u32) -> Vec<u32> {
        let planned = self.planned.iter().map(|&planned| share(planned, from, batches));
        self.before.iter().zip(planned.chain(std::iter::repeat(0))).map(|(before, due)| before + due).collect()
    }

    /// Closes what was planned where a round from `at` to `to` batches ends at a doubling.
    pub fn turn(&mut self, at: u32, to: u32) {
        if let Some(from) = doubling(at).filter(|&from| doubling(to) != Some(from)) {
            (self.before, self.planned) = (self.done(from, to), Vec::new());
        }
    }
}

/// Numbers that are written at a time.
const CHUNK: usize = 1 << 13;

fn write_sums(channels: &[Moments], to: &mut dyn Write) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(8 * CHUNK);
    for segment in channels.iter().flat_map(|channel| channel.sums().chunks(CHUNK)) {
        bytes.clear();
        bytes.extend(segment.iter().flat_map(|sum| sum.to_le_bytes()));
        to.write_all(&bytes)?;
    }
    Ok(())
}

/// What is left to read.
struct Bytes<'a>(&'a mut dyn Read);

impl Bytes<'_> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }

    fn take(&mut self, n: usize) -> Option<Vec<u8>> {
        let mut bytes = vec![0; n];
        self.0.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.bytes().map(u64::from_le_bytes)
    }

    /// Fills the sums of channels that have their size.
    fn sums(&mut self, channels: &mut [Moments]) -> Option<()> {
        let mut bytes = vec![0; 8 * CHUNK];
        for segment in channels.iter_mut().flat_map(|channel| channel.sums_mut().chunks_mut(CHUNK)) {
            let bytes = &mut bytes[..8 * segment.len()];
            self.0.read_exact(bytes).ok()?;
            let (numbers, _) = bytes.as_chunks::<8>();
            segment.iter_mut().zip(numbers).for_each(|(sum, number)| *sum = f64::from_le_bytes(*number));
        }
        Some(())
    }

    fn is_at_end(&mut self) -> bool {
        self.0.read(&mut [0]).is_ok_and(|n| n == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_trip_and_torn_ones_are_refused() {
        for (allocate, other) in [(Allocate::Even, Allocate::Adaptive), (Allocate::Adaptive, Allocate::Even)] {
            let layout = Layout { carriers: 1, projected_images: 0, steady: false };
            let empty = |pixels: usize| State::new(2, pixels, layout, allocate);
            let mut state = empty(3);
            state.samples = 64;
            state.flights = [1 << 40, 7];
            state.history = vec![(64, 0.1)];
            state.with_control = Some(vec![true, false, true]);
            state.channels[1].add(2, &[1.0, -0.5, 1e-300]);
            if let Some(more) = &mut state.more {
                (more.before, more.planned) = (vec![1, 2, 3], vec![4, 5, 6]);
                more.channels[0].add(1, &[0.5, 0.25, 3.0]);
            }
            let mut bytes = Vec::new();
            state.write_to(&mut bytes).expect("a vector takes whatever is written");
            assert_eq!(State::read_from(&mut bytes.as_slice(), empty(3)), Some(state));
            assert_eq!(State::read_from(&mut bytes.as_slice(), empty(4)), None);
            assert_eq!(State::read_from(&mut bytes.as_slice(), State::new(2, 3, layout, other)), None);
            for torn in [0, 7, 23, 30, bytes.len() - 1] {
                assert_eq!(State::read_from(&mut &bytes[..torn], empty(3)), None, "{torn} bytes");
            }
        }
    }
}
