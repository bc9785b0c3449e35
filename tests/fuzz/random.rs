//! Random numbers that a seed, a reader's name and an index fix (SplitMix64; Steele, Lea and Flood, OOPSLA 2014).

pub struct Random(u64);

impl Random {
    pub fn new(seed: u64, name: &str, index: u64) -> Self {
        let mut random = Self(seed);
        for part in name.bytes().map(u64::from).chain([index]) {
            random.0 = random.next() ^ part;
        }
        random
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `n`, which must not be 0; its bias of n / 2^64 does not matter here.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }

    /// A short piece within `length`, more often small than large.
    pub fn piece(&mut self, length: usize) -> std::ops::Range<usize> {
        let most = [1, 8, 64, 1024, usize::MAX][self.below(5)].min(length);
        let size = if most == 0 { 0 } else { 1 + self.below(most) };
        let start = self.below(length - size + 1);
        start..start + size
    }
}
