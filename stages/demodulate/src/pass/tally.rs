//! What the pixels of a tile are together.

use turbid_contract::Ctx;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;

use crate::set::Channel;

/// Sums over pixels, added up in tile order.
pub struct Tally {
    pub(super) good: u64,
    pub(super) pixels: u64,
    /// Good pixels with a value that is not above 0.
    pub(super) uncertain: u64,
    /// Of each fringe: Rician bias, and M_AC that it belongs to.
    pub(super) rician: Vec<f64>,
    pub(super) m_ac: Vec<f64>,
}

impl Tally {
    pub fn new(channel: &Channel) -> Self {
        let n = channel.fringes.len();
        Self { good: 0, pixels: 0, uncertain: 0, rician: vec![0.0; n], m_ac: vec![0.0; n] }
    }

    pub fn add(&mut self, tile: &Self) {
        self.good += tile.good;
        self.pixels += tile.pixels;
        self.uncertain += tile.uncertain;
        let pairs = [(&mut self.rician, &tile.rician), (&mut self.m_ac, &tile.m_ac)];
        for (sum, part) in pairs {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }

    /// Takes away what [`Pass::drop_weak`](super::Pass::drop_weak) dropped.
    pub fn less(&mut self, dropped: &Self) {
        self.good -= dropped.good;
    }

    /// Whether no pixel is masked.
    pub fn all_good(&self) -> bool {
        self.good == self.pixels
    }

    /// Measures the Rician bias of the mean M_AC at the highest f_x, and warns where `mask` leaves nothing.
    pub fn report(&self, channel: &Channel, known: bool, mask: &Array2<f32>, ctx: Ctx<'_>) {
        let last = channel.fringes.len() - 1;
        if known && self.m_ac[last] > 0.0 {
            ctx.measure("rician_bias", 100.0 * self.rician[last] / self.m_ac[last], "%");
        }
        if self.good == 0 && self.pixels > 0 {
            let reasons = ctx.measure_masked(mask.iter().copied());
            ctx.warn(format!("all pixels{} are masked: {reasons}", of(channel.wavelength_nm)));
        } else if 2 * lost(mask) > self.pixels {
            let share = 100.0 * lost(mask) as f64 / self.pixels as f64;
            let reasons = ctx.measure_masked(mask.iter().copied());
            let light = of(channel.wavelength_nm);
            ctx.warn(format!("{share:.0} % of the pixels{light} are masked, more than half: {reasons}"));
        }
    }
}

/// Pixels that are masked and were meant to show something: background is not.
fn lost(mask: &Array2<f32>) -> u64 {
    let background = MaskReason::Background.code();
    mask.iter().filter(|&&reason| reason != 0.0 && reason != background).count() as u64
}

/// ` of 650 nm`, of frames that say their wavelength.
pub fn of(wavelength_nm: Option<f64>) -> String {
    wavelength_nm.map(|nm| format!(" of {nm} nm")).unwrap_or_default()
}
