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

    /// Covariance of the means of `i` and `j`; `None` without two photons to tell.
    pub fn covariance(&self, i: usize, j: usize) -> Option<f64> {
        if self.photons < 2 {
            return None;
        }
        let n = self.photons as f64;
        let product = self.products[i.max(j)][i.min(j)] / n - self.mean(i) * self.mean(j);
        Some(product / (n - 1.0))
    }

    /// Whether any photon scored in the quantity `i`: photons that all miss say nothing of how many would not.
    pub fn counted(&self, i: usize) -> bool {
        self.products[i][i] > 0.0
    }

    /// Mean share of the power that ended so.
    pub fn fate(&self, fate: Fate) -> f64 {
        if self.photons == 0 { 0.0 } else { self.fates[fate as usize] / self.photons as f64 }
    }

    /// Mean of `j` per `i` with its standard error; `None` where nothing of `i` was met. The error is not known where nothing of `j` was counted.
    pub fn ratio(&self, j: usize, i: usize) -> Option<(f64, Option<f64>)> {
        let below = self.mean(i);
        if below == 0.0 {
            return None;
        }
        let ratio = self.mean(j) / below;
        let variance = || {
            let [jj, ij, ii] = [self.covariance(j, j)?, self.covariance(i, j)?, self.covariance(i, i)?];
            Some(jj - 2.0 * ratio * ij + ratio * ratio * ii)
        };
        let se = variance().filter(|_| self.counted(j)).map(|variance| variance.max(0.0).sqrt() / below);
        Some((ratio, se))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(scores: &[Score]) -> Tally {
        let mut tally = Tally::default();
        scores.iter().for_each(|score| tally.add(score));
        tally
    }

    /// What photons do not tell is not 0: no variance from one of them, no error of what none of them showed, no share of light that was not met.
    #[test]
    fn what_photons_do_not_tell_is_not_known() {
        let read = |r: f64| Score { detected: [r, 0.0], ..Score::default() };
        assert_eq!(of(&[read(0.5)]).covariance(0, 0), None);
        let two = of(&[read(0.25), read(0.75)]);
        assert_eq!((two.mean(0), two.covariance(0, 0)), (0.5, Some(0.0625)));
        assert!(two.counted(0) && !two.counted(1));
        assert_eq!(two.ratio(3, 2), None, "no light fell on the sample");
        let met = |lost_r: f64| Score { beam: Entered { incident: 1.0, lost_r, lost_t: 0.0 }, ..Score::default() };
        let found = of(&[met(0.25), met(0.75)]);
        assert_eq!((found.ratio(3, 2), found.ratio(4, 2)), (Some((0.5, Some(0.25))), Some((0.0, None))));
        assert_eq!(of(&[met(0.25)]).ratio(3, 2), Some((0.25, None)));
    }
}
