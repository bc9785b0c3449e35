//! What photons leave behind: a score each, and the sums that give means and their errors.

/// How a photon's light ends, beside the detectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Absorbed in the sample or in the standard.
    Sample,
    /// Left through the sample's side faces.
    Sides,
    /// Left the sample beside the port, or passed beside the sample.
    Rim,
    Entrance,
    Exit,
    /// Absorbed by wall, neck or baffle.
    Wall,
    /// Fell into a detector that does not look where it came from.
    Unseen,
    /// Taken (or given, < 0) by roulette; 0 on average.
    Roulette,
}

/// Number of fates.
pub const FATES: usize = 8;

/// Light that fell on the sample, and what a plate without sides, behind a port without rim, would have sent back and on beyond what was
/// collected.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Entered {
    pub incident: f64,
    pub lost_r: f64,
    pub lost_t: f64,
}

/// One photon's score, in shares of its power.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// By the detectors of both spheres.
    pub detected: [f64; 2],
    /// Of the beam, before it met anything else.
    pub beam: Entered,
    /// Of all other light that fell on the sample.
    pub diffuse: Entered,
    pub fates: [f64; FATES],
}

impl Score {
    pub fn book(&mut self, fate: Fate, weight: f64) {
        self.fates[fate as usize] += weight;
    }

    fn entries(&self) -> [f64; TALLIED] {
        let Self { detected: [a, b], beam: c, diffuse: d, .. } = *self;
        [a, b, c.incident, c.lost_r, c.lost_t, d.incident, d.lost_r, d.lost_t]
    }
}

/// Number of tallied quantities.
pub const TALLIED: usize = 8;

/// Sums over photons, in the order of [`Score`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tally {
    pub photons: u64,
    sums: [f64; TALLIED],
    products: [[f64; TALLIED]; TALLIED],
    fates: [f64; FATES],
}

impl Default for Tally {
    fn default() -> Self {
        Self { photons: 0, sums: [0.0; TALLIED], products: [[0.0; TALLIED]; TALLIED], fates: [0.0; FATES] }
    }
}

impl Tally {
    pub fn add(&mut self, score: &Score) {
        self.photons += 1;
        let entries = score.entries();
        for i in 0..TALLIED {
            self.sums[i] += entries[i];
            for j in 0..=i {
                self.products[i][j] += entries[i] * entries[j];
            }
        }
        for (sum, fate) in self.fates.iter_mut().zip(score.fates) {
            *sum += fate;
        }
    }

    pub fn merge(&mut self, other: &Self) {
        self.photons += other.photons;
        for i in 0..TALLIED {
            self.sums[i] += other.sums[i];
            for j in 0..=i {
                self.products[i][j] += other.products[i][j];
            }
        }
        for (sum, fate) in self.fates.iter_mut().zip(other.fates) {
            *sum += fate;
        }
    }

    /// Mean of the quantity `i`.
    pub fn mean(&self, i: usize) -> f64 {
        if self.photons == 0 { 0.0 } else { self.sums[i] / self.photons as f64 }
    }

    /// Covariance of the means of `i` and `j`; 0 without two photons to tell.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        if self.photons < 2 {
            return 0.0;
        }
        let n = self.photons as f64;
        let product = self.products[i.max(j)][i.min(j)] / n - self.mean(i) * self.mean(j);
        product / (n - 1.0)
    }

    /// Mean share of the power that ended so.
    pub fn fate(&self, fate: Fate) -> f64 {
        if self.photons == 0 { 0.0 } else { self.fates[fate as usize] / self.photons as f64 }
    }

    /// Mean of `j` per `i` with its standard error; (0, 0) where nothing of `i` was met.
    pub fn ratio(&self, j: usize, i: usize) -> (f64, f64) {
        let below = self.mean(i);
        if below == 0.0 {
            return (0.0, 0.0);
        }
        let ratio = self.mean(j) / below;
        let variance =
            self.covariance(j, j) - 2.0 * ratio * self.covariance(i, j) + ratio * ratio * self.covariance(i, i);
        (ratio, variance.max(0.0).sqrt() / below)
    }
}
