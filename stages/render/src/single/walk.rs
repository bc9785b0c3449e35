//! Paths walked side by side in f32.

use std::ops::Range;

use fearless_simd::dispatch;
use fearless_simd::prelude::*;

use super::frame::Frame;
use super::lane::{F, LANES, M, U, V, choose, hg_sample, ln, philox, spare, splat, unit, unit_short};
use super::look::{Looks, look, rarity};
use super::rows::Rows;
use super::start::Starts;
use crate::path::{Place, Walker};

/// Columns: r, w, what is left of life, what its rounding lost, weight, free path, mu_a, mu_s, g, window;
/// block of random numbers, sample, pixel, response, material, body.
pub type Paths = Rows<14, 6>;

/// Blocks of random numbers that lanes count to.
const MOST_BLOCKS: u64 = 1 << 31;

/// Walks the paths `samples` of the pixels `pixels` and leaves their responses in the walker, pixel by pixel.
pub fn walk(walker: &mut Walker<'_>, frame: &Frame, pixels: Range<usize>, samples: Range<u32>) {
    let paths = pixels.len() * samples.len();
    walker.clear_responses(paths);
    let mut responses = walker.take_single();
    dispatch!(walker.level(), simd => simd.vectorize(#[inline(always)] || {
        Flock::new(simd, frame).run(walker, Starts::new(pixels.clone(), samples.clone()), &mut responses);
    }));
    walker.gather();
    walker.add_single(responses);
}

/// One odd flight, and those after it until the path is in a medium again, scored ahead, where lanes can go on; false where it
/// has ended.
pub fn settles(walker: &mut Walker<'_>, frame: &Frame, place: &mut Place) -> bool {
    loop {
        if !walker.step(place) {
            return false;
        }
        if place.ahead && !place.wholly && place.number < MOST_BLOCKS && frame.body_at(walker, place).is_some() {
            return true;
        }
    }
}

/// The paths in flight.
struct Flock<'a, S: Simd> {
    simd: S,
    frame: &'a Frame,
    floats: [F<S>; 14],
    words: [U<S>; 6],
    /// By bits.
    alive: u64,
    looks: Looks,
    /// For what goes through memory.
    memory: Paths,
}

impl<'a, S: Simd> Flock<'a, S> {
    #[inline(always)]
    fn new(simd: S, frame: &'a Frame) -> Self {
        let (floats, words) = ([splat(simd, 0.0); 14], [U::splat(simd, 0); 6]);
        Self { simd, frame, floats, words, alive: 0, looks: Looks::default(), memory: Paths::default() }
    }

    #[inline(always)]
    fn run(mut self, walker: &mut Walker<'_>, mut starts: Starts, responses: &mut [f64]) {
        let simd = self.simd;
        let (key, high) = (walker.setting().key, walker.setting().channel << 16);
        let mut flights = 0;
        loop {
            let dead = !self.alive & 0xFFFF;
            if dead != 0 {
                let wanted = dead.count_ones() as usize;
                while starts.ready.len() < wanted && starts.more() {
                    starts.make(simd, walker, self.frame, &mut self.looks);
                    self.look_while(LANES, key, high, responses);
                }
                let mut filled = dead;
                while filled.count_ones() as usize > starts.ready.len() {
                    filled &= filled - 1;
                }
                starts.ready.unpack(simd, M::from_bitmask(simd, filled), &mut self.floats, &mut self.words);
                self.alive |= filled;
                if self.alive == 0 || walker.endless() {
                    break;
                }
            }
            flights += self.alive.count_ones() as usize;
            let (odd, looking) = self.fly(key, high);
            if looking != 0 && (self.frame.lamps || !self.frame.looks) {
                self.look_singly(walker, looking);
            }
            if odd != 0 {
                flights -= odd.count_ones() as usize;
                self.settle(walker, odd);
            }
            self.look_while(LANES, key, high, responses);
        }
        self.look_while(1, key, high, responses);
        walker.count_flights(flights);
    }

    /// Looks for light while so many wait.
    #[inline(always)]
    fn look_while(&mut self, many: usize, key: [u32; 2], high: u32, responses: &mut [f64]) {
        while self.looks.len() >= many {
            let (simd, looks, frame) = (self.simd, &self.looks, self.frame);
            simd.vectorize(
                #[inline(always)]
                || look(simd, looks, frame, key, high, responses),
            );
            self.looks.drop_first(simd);
        }
    }

    /// One flight of every lane that lives. Those that meet a boundary, to be made by the scalar walker from where they stand;
    /// and those that look for light, queued where lanes can look.
    #[inline(always)]
    fn fly(&mut self, key: [u32; 2], high: u32) -> (u64, u64) {
        let (simd, frame) = (self.simd, self.frame);
        let [rx, ry, rz, wx, wy, wz, life, lost, weight, free_path, mu_a, mu_s, g, window] = self.floats;
        let [number, sample, pixel, path, material, body] = self.words;
        let (r, w) = (V { x: rx, y: ry, z: rz }, V { x: wx, y: wy, z: wz });
        let alive = M::from_bitmask(simd, self.alive);
        let [a, b, c, d] = philox(simd, number, high, sample, pixel, key);
        let s = -ln(unit(a)) * free_path;
        let end = r.plus(s, w);
        // Compensated: at high albedo each flight takes less than the last digit of what is left.
        let taken = -(mu_a * s) - lost;
        let left = life + taken;
        let lost = (left - life) - taken;
        let passage = frame.ground.pass(simd, body, r, w, s, end);
        let dies = left.simd_lt(0.0);
        let crosses = passage.crosses | end.dot(end).simd_gt(frame.range_squared) | number.simd_ge(MOST_BLOCKS as u32);
        let escapes = if frame.dark && (crosses & alive).any_true() {
            passage.crosses & self.escapes(body, r, w)
        } else {
            M::splat(simd, false)
        };
        let odd = alive & crosses & !escapes;
        let mut gone = (dies & !crosses) | escapes;
        let mut heavier = weight;
        if frame.windows {
            // Roulette of deep paths, for W/2 and above.
            let x = passage.clear * window + 1.0;
            let (x2, zero) = (x * x, splat(simd, 0.0));
            let deep = x2 * x2;
            let plays = weight.simd_lt(deep * 0.5) & window.simd_gt(zero);
            gone |= plays & (spare(b, c, d) * deep).simd_ge(weight) & !crosses;
            heavier = choose(plays, deep, weight);
        }
        let roulette = unit_short(d);
        let looks = (roulette * rarity(simd, (mu_a + mu_s) * passage.clear)).simd_lt(1.0);
        let goes_on = alive & !crosses & !gone;
        let looks = if frame.blind { M::splat(simd, false) } else { looks & goes_on };
        let e = hg_sample(g, w, unit_short(b), unit_short(c));
        if frame.looks && looks.any_true() {
            self.looks.pack(
                looks,
                &[end.x, end.y, end.z, wx, wy, wz, e.x, e.y, e.z, heavier, roulette, mu_a, mu_s, g],
                &[number + 1, sample, pixel, path, body],
            );
        }
        if (frame.lamps || !frame.looks) && looks.any_true() {
            // The scalar walker needs the direction in which the path came.
            let (mut floats, words) = (self.floats, self.words);
            (floats[0], floats[1], floats[2]) = (end.x, end.y, end.z);
            (floats[6], floats[7], floats[8]) = (e.x, e.y, e.z);
            floats[9] = heavier;
            floats[10] = roulette;
            self.memory.store(&floats, &words);
        }
        let step = |new: F<S>, old: F<S>| choose(goes_on, new, old);
        self.floats = [
            step(end.x, rx),
            step(end.y, ry),
            step(end.z, rz),
            step(e.x, wx),
            step(e.y, wy),
            step(e.z, wz),
            step(left, life),
            step(lost, self.floats[7]),
            step(heavier, weight),
            free_path,
            mu_a,
            mu_s,
            g,
            window,
        ];
        self.words = [goes_on.select(number + 2, number), sample, pixel, path, material, body];
        let odd = odd.to_bitmask();
        self.alive = goes_on.to_bitmask() | odd;
        (odd, looks.to_bitmask())
    }

    /// Whether rays that leave their body meet nothing more, where boundaries do not turn them.
    #[inline(always)]
    fn escapes(&self, body: U<S>, r: V<S>, w: V<S>) -> M<S> {
        let (simd, filled) = (self.simd, &self.frame.filled);
        let mut escapes = M::splat(simd, true);
        if filled.len() == 1 {
            return escapes;
        }
        let span = |j: usize| self.frame.ground.span(simd, j, r, w);
        let mut leaves = splat(simd, 0.0);
        for j in 0..filled.len() {
            leaves = choose(body.simd_eq(j as u32), span(j).leave, leaves);
        }
        for (j, &filled) in filled.iter().enumerate() {
            let span = span(j);
            let meets = span.enter.simd_lt(span.leave) & span.leave.simd_gt(0.0);
            // A void on the way through the own body: there is more of that behind it.
            let hides = if filled { meets } else { meets & span.enter.simd_lt(leaves) };
            escapes &= !hides | body.simd_eq(j as u32);
        }
        escapes
    }

    /// Looks that lanes cannot make.
    #[inline(never)]
    fn look_singly(&mut self, walker: &mut Walker<'_>, mut looking: u64) {
        while looking != 0 {
            let lane = looking.trailing_zeros() as usize;
            looking &= looking - 1;
            let (floats, words) = self.memory.get(lane);
            let mut place = self.frame.place(floats, words);
            (place.number, place.weight) = (place.number + 2, f64::from(floats[9]));
            let own = [floats[6], floats[7], floats[8]].map(f64::from).into();
            if self.frame.looks {
                walker.look_at_lamps(&place, own, f64::from(floats[10]));
            } else {
                walker.look_ahead(&mut place, own, f64::from(floats[10]));
            }
        }
    }

    /// Lets the scalar walker make odd flights.
    #[inline(never)]
    fn settle(&mut self, walker: &mut Walker<'_>, odd: u64) {
        self.memory.store(&self.floats, &self.words);
        let mut lanes = odd;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let (floats, words) = self.memory.get(lane);
            let mut place = self.frame.place(floats, words);
            if settles(walker, self.frame, &mut place) {
                let (floats, words) = self.frame.row(walker, &place);
                self.memory.set(lane, floats, words);
            } else {
                self.alive &= !(1 << lane);
            }
        }
        (self.floats, self.words) = self.memory.load(self.simd);
    }
}
