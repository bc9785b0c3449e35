//! Random numbers of a path: what a block of four is drawn for, and the Philox counter at which it stands.
//!
//! A counter is (number, word, sample, pixel). The number is that of a flight, or one more; the word holds the channel and a code of the purpose. Where an
//! index is beyond what the code holds, the block at a place of the flight's own is key and part of the counter of further ones: so every purpose has an
//! address, whatever the scene.

use turbid_optics::philox::{philox4x32, unit};

/// The vertex, near one of a path's flights, that is connected to a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum NeeSite {
    /// From where the flight ends.
    Here,
    /// One scattering ahead: in the n-th scattering segment of the way on from there.
    Next(usize),
    /// One scattering ahead: in the n-th segment of a medium that the flight came into.
    Entered(usize),
}

/// What a block is drawn for. Flights are known by their numbers: 0 is the camera, those after it are even; sources by `Source::place`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Purpose {
    /// Where a path begins in its pixel, and its absorption depth.
    Begin,
    /// The same on the lens.
    Lens,
    /// Where a photon begins: trial after trial.
    Start(u32),
    Flight(u64),
    /// Whether and where a light-directed branch goes from the end of a flight.
    LightBranch(u64),
    /// Whether a path whose weight is below its window goes on from the end of a flight, and the direction of its copies towards the light ...
    WeightWindow(u64),
    /// ... and what a copy has of its own.
    Copy(u64, u32),
    /// The walk among the facets of a rough interface at the end of a flight.
    Facets(u64),
    /// The point that is connected, and a direction to it.
    NeeSite(u64, NeeSite, usize),
    /// Whether connections other than the likeliest are tried there ...
    Whether(u64, NeeSite, usize),
    /// ... and which.
    Which(u64, NeeSite, usize),
}

/// Bit of the number of a light-directed branch's flight, beside the path's of the rest of it. Numbers of a path's own leave it out.
pub(crate) const LIGHT_BRANCH: u32 = 1 << 28;
/// Bit of the sample of a path's copy, whose other bits are drawn: samples of paths leave it out.
pub(crate) const COPY: u32 = 1 << 31;
/// The largest number of a flight, of a path that goes on for ever: some 9e8 flights.
pub(crate) const MOST_NUMBERS: u64 = 7 << 29;
/// Channels beyond that have no numbers.
pub(crate) const MOST_CHANNELS: usize = 1 << 15;

// Codes: in the lower half of the word.
/// Segments of the way on, of the projector: codes from 0.
const SEGMENTS: usize = 1 << 11;
/// Of what starts a light-directed branch.
pub(crate) const SENT: u32 = 1 << 11;
/// Of weight windows: codes from here, the copy's number behind it, fewer than 128.
pub(crate) const WINDOW: u32 = SENT | 128;
/// Segments that a flight came into, of the projector: codes from here, so many.
pub(crate) const ENTERED: u32 = 1 << 12;
const ENTRIES: usize = 1 << 12;
const LENS: u32 = 1 << 13;
const START: u32 = 1 << 14;
/// Lamps: codes from here, every other one.
const LAMPS: u32 = 1 << 15;
const MOST_LAMPS: usize = 1 << 13;
/// The same along the camera's ray.
const LAMPS_FIRST: u32 = 3 << 14;
/// Bit of the word: the code is source, place, purpose and whether the site is [`NeeSite::Here`], by four, four, seven bits and one.
const ASIDE: u32 = 1 << 31;
const SOURCES: usize = 16;
const PLACES: usize = 16;
const WHETHER: u32 = 1;
const WHICH: u32 = 2;
const BEYOND: u32 = 126;
const FACETS: u32 = 127;

/// Where a block stands: number and word, that without the channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Address {
    At([u32; 2]),
    /// Kind, source and place of one of those whose key stands there.
    Within([u32; 2], [u32; 3]),
}

impl NeeSite {
    /// The number of its blocks: of those beside one flight, estimates in entered segments have even ones.
    #[inline(always)]
    fn number(self, flight: u64) -> u32 {
        let number = flight as u32;
        if matches!(self, Self::Entered(_)) { number } else { number + 1 }
    }

    #[inline(always)]
    fn place(self) -> usize {
        match self {
            Self::Here => 0,
            Self::Next(place) | Self::Entered(place) => place,
        }
    }

    /// The site whose blocks have this number, at a place on its ray, and the flight beside which it is.
    pub(crate) fn of(number: u32, place: usize) -> (u64, Self) {
        if number % 2 == 1 {
            (u64::from(number - 1), Self::Next(place))
        } else {
            (u64::from(number), Self::Entered(place))
        }
    }
}

impl Purpose {
    #[inline(always)]
    fn address(self) -> Address {
        match self {
            Self::Begin => Address::At([0, 0]),
            Self::Lens => Address::At([0, LENS]),
            Self::Start(trial) => Address::At([trial, START]),
            Self::Flight(flight) => Address::At([flight as u32, 0]),
            Self::LightBranch(flight) => Address::At([flight as u32, SENT]),
            Self::WeightWindow(flight) => Address::At([flight as u32, WINDOW]),
            Self::Copy(flight, copy) => Address::At([flight as u32, WINDOW | copy]),
            Self::Facets(flight) => Address::At([flight as u32, aside(0, 0, FACETS, false)]),
            Self::NeeSite(flight, site, source) => at_site(flight, site, source),
            Self::Whether(flight, site, source) => other_than_site(flight, site, source, WHETHER),
            Self::Which(flight, site, source) => other_than_site(flight, site, source, WHICH),
        }
    }
}

#[inline(always)]
const fn aside(source: usize, place: usize, kind: u32, here: bool) -> u32 {
    ASIDE | ((source << 12 | place << 8) as u32) | kind << 1 | here as u32
}

#[inline(always)]
fn at_site(flight: u64, site: NeeSite, source: usize) -> Address {
    let (number, place) = (site.number(flight), site.place());
    match (source, site) {
        (0, NeeSite::Next(_)) if place < SEGMENTS => Address::At([number, place as u32]),
        (0, NeeSite::Entered(_)) if place < ENTRIES => Address::At([number, ENTERED + place as u32]),
        (1..=MOST_LAMPS, NeeSite::Next(_)) if flight == 0 => Address::At([index(place), first_of_lamp(source - 1)]),
        (1..=MOST_LAMPS, NeeSite::Next(0) | NeeSite::Entered(0)) => Address::At([number, of_lamp(source - 1)]),
        _ => within(flight, site, source, 0),
    }
}

#[inline(always)]
fn other_than_site(flight: u64, site: NeeSite, source: usize, kind: u32) -> Address {
    if source < SOURCES && site.place() < PLACES {
        Address::At([site.number(flight), aside(source, site.place(), kind, site == NeeSite::Here)])
    } else {
        within(flight, site, source, kind)
    }
}

fn within(flight: u64, site: NeeSite, source: usize, kind: u32) -> Address {
    let base = [site.number(flight), aside(0, 0, BEYOND, site == NeeSite::Here)];
    Address::Within(base, [kind, index(source), index(site.place())])
}

fn index(i: usize) -> u32 {
    u32::try_from(i).expect("memory does not hold so many")
}

/// Code of a lamp's estimates along the camera's ray; their number is the segment.
#[inline(always)]
pub(crate) fn first_of_lamp(lamp: usize) -> u32 {
    LAMPS_FIRST | (lamp as u32) << 1
}

/// Code of a lamp's estimates into the first segment, ahead and entered.
#[inline(always)]
pub(crate) fn of_lamp(lamp: usize) -> u32 {
    LAMPS | (lamp as u32) << 1
}

/// Lamps for which [`of_lamp`] and [`first_of_lamp`] hold.
pub(crate) const LAMPS_IN_LANES: usize = MOST_LAMPS;
/// Places on a ray for which lanes make the number of [`Purpose::Whether`] themselves, and segments whose code is their place.
pub(crate) const PLACES_IN_LANES: usize = PLACES;

/// The word, without a channel, of [`Purpose::Whether`] for the projector: 0 as the place, which stands above the lower eight bits.
pub(crate) const WHETHER_PROJECTED: u32 = aside(0, 0, WHETHER, false);

/// The number of the flight before the one of `number`.
#[inline(always)]
pub(crate) fn before(number: u64, light_branch: bool) -> u64 {
    let before = number - 2;
    if !light_branch && before & u64::from(LIGHT_BRANCH) != 0 { before - u64::from(LIGHT_BRANCH) } else { before }
}

/// The number of the flight after the one of `number`.
#[inline(always)]
pub(crate) fn after(number: u64, light_branch: bool) -> u64 {
    let after = number + 2;
    if !light_branch && after & u64::from(LIGHT_BRANCH) != 0 { after + u64::from(LIGHT_BRANCH) } else { after }
}

/// Random numbers of one path in one channel.
#[derive(Clone, Copy)]
pub(crate) struct Stream {
    key: [u32; 2],
    pixel: u32,
    sample: u32,
    channel: u32,
}

impl Stream {
    pub(crate) fn new(key: [u32; 2], pixel: u32, sample: u32, channel: u32) -> Self {
        debug_assert!((channel as usize) < MOST_CHANNELS, "channel {channel}");
        Self { key, pixel, sample, channel }
    }

    #[inline(always)]
    pub(crate) fn block(&self, purpose: Purpose) -> [u32; 4] {
        let at = |[number, word]: [u32; 2]| {
            philox4x32([number, word | self.channel << 16, self.sample, self.pixel], self.key)
        };
        match purpose.address() {
            Address::At(place) => at(place),
            Address::Within(place, [kind, source, index]) => {
                let [a, b, c, _] = at(place);
                philox4x32([kind, source, index, c], [a, b])
            }
        }
    }

    /// As many numbers as are asked for, for what has one block.
    pub(crate) fn dice(&self, purpose: Purpose) -> Dice {
        Dice::of(self.block(purpose))
    }
}

/// Random numbers without an end: throw after throw, for each of any number of trials.
#[derive(Clone, Debug)]
pub(crate) struct Dice {
    key: [u32; 2],
    head: [u32; 2],
    trial: u32,
    throw: u32,
}

impl Dice {
    /// Of a block that is drawn for them.
    pub(crate) fn of([a, b, c, d]: [u32; 4]) -> Self {
        Self { key: [a, b], head: [c, d], trial: 0, throw: 0 }
    }

    /// From the first throw of a trial on.
    pub(crate) fn begin(&mut self, trial: u32) {
        (self.trial, self.throw) = (trial, 0);
    }

    pub(crate) fn throw(&mut self) -> [f64; 4] {
        self.throw += 1;
        philox4x32([self.trial, self.throw, self.head[0], self.head[1]], self.key).map(unit)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::weight_window::MOST_COPIES;

    /// The first flights, the last that lanes make, those around the gap that light-directed branches' numbers leave, and the last; and light-directed branches beside some.
    fn flights() -> Vec<u64> {
        let light_branch = u64::from(LIGHT_BRANCH);
        let late = after(light_branch - 2, false);
        let own = [
            2,
            4,
            6,
            light_branch - 4,
            light_branch - 2,
            late,
            late + 2,
            3 * light_branch - 2,
            4 * light_branch,
            MOST_NUMBERS,
        ];
        let light_branches = own.iter().map(|flight| flight | light_branch);
        own.into_iter().chain(light_branches).collect()
    }

    /// Of a flight all that may be drawn: every index that has a code of its own, and some beyond.
    fn purposes(flight: u64) -> Vec<Purpose> {
        let places = |until: usize| (0..=until).chain([until + 1, 1 << 20]);
        let sources = || (0..=MOST_LAMPS + 1).chain([1 << 20]);
        let next_events = |until: usize| places(until).flat_map(|p| [NeeSite::Next(p), NeeSite::Entered(p)]);
        let mut all: Vec<Purpose> = next_events(ENTRIES).map(|site| Purpose::NeeSite(flight, site, 0)).collect();
        all.extend(sources().skip(1).flat_map(|s| next_events(2).map(move |site| Purpose::NeeSite(flight, site, s))));
        for source in (0..=SOURCES).chain([MOST_LAMPS + 1]) {
            for site in next_events(PLACES).chain([NeeSite::Here]) {
                all.extend([Purpose::Whether(flight, site, source), Purpose::Which(flight, site, source)]);
            }
        }
        // The camera makes no flight.
        if flight > 0 {
            all.extend([Purpose::Flight(flight), Purpose::Facets(flight), Purpose::WeightWindow(flight)]);
            all.extend((1..2 * MOST_COPIES).map(|copy| Purpose::Copy(flight, copy)));
        }
        if flight & u64::from(LIGHT_BRANCH) != 0 {
            all.push(Purpose::LightBranch(flight));
        }
        all
    }

    /// No two purposes share an address, at the ends of all ranges and for every index with a code of its own; and none reaches into the channel's bits.
    /// What lies between the flights here differs from them by the number alone.
    #[test]
    fn no_block_is_drawn_twice() {
        let mut seen: HashMap<Address, Purpose> = HashMap::new();
        let mut bases: HashMap<[u32; 2], ()> = HashMap::new();
        let once = [Purpose::Begin, Purpose::Lens].into_iter();
        let starts = [0, 1, u32::MAX].map(Purpose::Start);
        let all = flights().into_iter().chain([0]).flat_map(purposes);
        for purpose in once.chain(starts).chain(all) {
            let address = purpose.address();
            if let Some(other) = seen.insert(address, purpose) {
                panic!("{purpose:?} and {other:?} stand at {address:?}");
            }
            let (Address::At(at) | Address::Within(at, _)) = address;
            assert_eq!(at[1] & !ASIDE & 0xFFFF_0000, 0, "{purpose:?} has a channel");
            if let Address::Within(base, _) = address {
                bases.insert(base, ());
            }
        }
        for base in bases.keys() {
            assert!(!seen.contains_key(&Address::At(*base)), "the key at {base:?} is drawn, too");
        }
    }

    /// Numbers of flights go up and down the same way, never a light-directed branch's bit among a path's own, and fit the counter to the last.
    #[test]
    fn numbers_of_flights_leave_those_of_light_branches_out() {
        let light_branch = u64::from(LIGHT_BRANCH);
        for number in [
            2,
            4,
            light_branch - 4,
            light_branch - 2,
            2 * light_branch,
            3 * light_branch - 2,
            4 * light_branch,
            13 * light_branch - 2,
        ] {
            let next = after(number, false);
            assert_eq!(before(next, false), number);
            assert!(next > number && next & light_branch == 0 && next <= MOST_NUMBERS);
            let light_branches = number | light_branch;
            assert_eq!(before(after(light_branches, true), true), light_branches);
        }
        assert!(MOST_NUMBERS & light_branch == 0 && (MOST_NUMBERS | light_branch) < u64::from(u32::MAX));
    }

    /// Thousands of throws of one decision after the other, none twice: what has an end must not have it by repeating itself.
    #[test]
    fn throws_do_not_repeat() {
        let stream = Stream::new([5, 0], 7, 11, 13);
        let mut dice = stream.dice(Purpose::Which(2, NeeSite::Here, 1));
        let thrown: std::collections::HashSet<[u64; 4]> = (0..10_000).map(|_| dice.throw().map(f64::to_bits)).collect();
        assert_eq!(thrown.len(), 10_000);
        // Sources and places beyond the code differ, too.
        let many = (0..3).flat_map(|s| [0, 15, 16, 17, 5000].map(|p| (s * 40_000, p)));
        let drawn: std::collections::HashSet<[u32; 4]> = many
            .flat_map(|(s, p)| [NeeSite::Next(p), NeeSite::Entered(p)].map(|site| (s, site)))
            .flat_map(|(s, site)| {
                [Purpose::NeeSite(2, site, s), Purpose::Whether(2, site, s), Purpose::Which(2, site, s)]
            })
            .map(|purpose| stream.block(purpose))
            .collect();
        assert_eq!(drawn.len(), 3 * 5 * 2 * 3);
    }
}
