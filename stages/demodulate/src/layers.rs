//! Which layers modulation and phase have, and in which order: what a form says before a run, and what the run makes.

use turbid_contract::{Form, LayerInfo, LayerKind, PerLength};

use crate::set::Channel;

/// Layers of a stack by kind; values come first, so that `pair` counts layers and value layers alike.
pub struct Group<T> {
    pub values: Vec<T>,
    pub errors: Vec<T>,
    pub covariances: Vec<T>,
    pub masks: Vec<T>,
    /// Flags of unknown errors, which are there where a pixel is flagged.
    pub unknown: Vec<T>,
}

impl<T> Default for Group<T> {
    fn default() -> Self {
        Self { values: Vec::new(), errors: Vec::new(), covariances: Vec::new(), masks: Vec::new(), unknown: Vec::new() }
    }
}

impl<T> Group<T> {
    pub fn into_iter_ordered(self) -> impl Iterator<Item = T> {
        self.values.into_iter().chain(self.errors).chain(self.covariances).chain(self.masks).chain(self.unknown)
    }
}

impl Group<LayerInfo> {
    /// Layers that all have a standard error, which may be unknown in pixels.
    pub fn add_errors(&mut self, values: &[LayerInfo], may_flag: bool) {
        self.errors.extend(values.iter().map(LayerInfo::standard_error));
        self.unknown.extend(values.iter().filter(|_| may_flag).map(LayerInfo::se_unknown));
    }

    /// The form of a stack of these layers.
    pub fn into_form(self, of: Form) -> Form {
        let Self { values, errors, covariances, masks, unknown } = self;
        Form { layers: Some([values, errors, covariances, masks].concat()), perhaps: unknown, ..of }
    }
}

/// What becomes of a channel of shifted sinusoids.
pub struct OfChannel {
    /// M_DC and M_AC of each fringe.
    pub values: Vec<LayerInfo>,
    /// Behind them, where frames at f_x = 0 have phases.
    pub ambient: Option<LayerInfo>,
    /// Where noise is known, for each of the channel's pairs.
    pub covariances: Vec<LayerInfo>,
    pub mask: LayerInfo,
    /// Of each fringe with f_x > 0.
    pub phases: Vec<LayerInfo>,
}

impl OfChannel {
    /// `first_value`: how many value layers stand before.
    pub fn new(channel: &Channel, first_value: usize) -> Self {
        let Channel { wavelength_nm, unit, fringes } = channel;
        let info = |name: &str, unit: &str, k: usize| {
            let mut info = LayerInfo::value(name, unit).with_f_x(fringes[k].f_x_per_mm);
            (info.orientation_deg, info.wavelength_nm) = (fringes[k].orientation_deg, *wavelength_nm);
            info
        };
        let fringed = (0..fringes.len()).filter(|&k| fringes[k].f_x_per_mm > 0.0);
        let pairs = channel.pairs().into_iter();
        Self {
            values: (0..2 * fringes.len()).map(|q| info(["m_dc", "m_ac"][q % 2], unit, q / 2)).collect(),
            ambient: crate::ambient::info(channel),
            covariances: pairs.map(|p| covariance(unit, p.map(|q| first_value + q), *wavelength_nm)).collect(),
            mask: mask(*wavelength_nm),
            phases: fringed.map(|k| info("phase", "rad", k)).collect(),
        }
    }
}

/// What becomes of a single shot.
pub struct OfShot {
    /// M_DC, and twice more for f_x = 0 where the shot stands in for a frame without fringes.
    pub means: Vec<LayerInfo>,
    pub m_ac: LayerInfo,
    /// Where noise is known: each with whether it is that of a mean and M_AC, not that of one number under two names.
    pub covariances: Vec<(LayerInfo, bool)>,
    pub mask: LayerInfo,
    pub phase: LayerInfo,
}

impl OfShot {
    /// `with_f_0`: whether it is the first of its wavelength; `first_value`: how many value layers stand before.
    pub fn new(shot: &LayerInfo, with_f_0: bool, first_value: usize) -> Self {
        let of = |name: &str| LayerInfo { name: name.into(), phase_rad: None, mean_se: None, ..shot.clone() };
        let mut means = Vec::new();
        if with_f_0 {
            // The same frame stands in for the one at f_x = 0.
            let f_0 = |name| LayerInfo { f_x_per_mm: Some(0.0), orientation_deg: None, ..of(name) };
            means.extend(["m_dc", "m_ac"].map(f_0));
        }
        means.push(of("m_dc"));
        let (count, light) = (means.len(), shot.wavelength_nm);
        let between = |i: usize, j: usize| (covariance(&shot.unit, [i, j].map(|k| first_value + k), light), j == count);
        let covariances = (0..count).flat_map(|i| (i + 1..=count).map(move |j| [i, j])).map(|[i, j]| between(i, j));
        Self {
            covariances: covariances.collect(),
            m_ac: of("m_ac"),
            mask: mask(light),
            phase: LayerInfo { unit: "rad".into(), ..of("phase") },
            means,
        }
    }
}

/// M_DC and M_AC of frames of one wavelength under speckle: of f_x = 0, then of each `f_x`.
pub fn of_speckle(frame: &LayerInfo, f_x: &[PerLength]) -> Vec<[LayerInfo; 2]> {
    let of = |f_x: f64| {
        ["m_dc", "m_ac"].map(|name| LayerInfo {
            wavelength_nm: frame.wavelength_nm,
            ..LayerInfo::value(name, &frame.unit).with_f_x(f_x)
        })
    };
    std::iter::once(0.0).chain(f_x.iter().map(|f| f.0)).map(of).collect()
}

pub fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

fn covariance(unit: &str, pair: [usize; 2], wavelength_nm: Option<f64>) -> LayerInfo {
    let pair = Some(pair.map(|q| q as u32));
    LayerInfo { pair, wavelength_nm, ..LayerInfo::new("cov", LayerKind::Covariance, format!("({unit})^2")) }
}
