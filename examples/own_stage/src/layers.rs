//! Which layers of a modulation make a depth, read from what the layers say of themselves, never from their order.

use turbid_contract::{LayerInfo, LayerKind};

/// A depth to compute, by the places of the layers that it is made of.
pub struct Fringe {
    /// What the layer of the depth will say.
    pub info: LayerInfo,
    pub m_dc: usize,
    pub m_ac: usize,
    /// Standard errors of M_DC and M_AC, and their covariance, where all three are there.
    pub noise: Option<[usize; 3]>,
    /// Flags of pixels whose standard error is unknown.
    pub unknown: Vec<usize>,
    /// The mask that holds for it.
    pub mask: Option<usize>,
}

/// The depths that these layers make: one for each fringe, f_x > 0, in their order.
pub fn fringes(layers: &[LayerInfo]) -> Vec<Fringe> {
    let place = |wanted: LayerInfo| {
        let same = |info: &LayerInfo| LayerInfo { mean_se: None, ..info.clone() } == wanted;
        layers.iter().position(same)
    };
    let fringe = |(m_ac, info): (usize, &LayerInfo)| {
        let of_ac = LayerInfo { mean_se: None, ..info.clone() };
        let of_dc = LayerInfo { name: "m_dc".to_owned(), ..of_ac.clone() };
        let m_dc = place(of_dc.clone())?;
        let pairs = [[m_dc as u32, m_ac as u32], [m_ac as u32, m_dc as u32]];
        let covariance = layers
            .iter()
            .position(|l| l.kind == LayerKind::Covariance && l.pair.is_some_and(|pair| pairs.contains(&pair)));
        let errors = (place(of_dc.standard_error()), place(of_ac.standard_error()), covariance);
        let holds = |l: &LayerInfo| l.wavelength_nm.is_none() || l.wavelength_nm == info.wavelength_nm;
        Some(Fringe {
            m_dc,
            m_ac,
            noise: if let (Some(dc), Some(ac), Some(pair)) = errors { Some([dc, ac, pair]) } else { None },
            unknown: [&of_dc, &of_ac].into_iter().filter_map(|of| place(of.se_unknown())).collect(),
            mask: layers.iter().position(|l| l.is_pixel_mask() && holds(l)),
            info: LayerInfo { name: "modulation_depth".to_owned(), unit: "1".to_owned(), ..of_ac },
        })
    };
    let is_fringe = |info: &LayerInfo| {
        info.kind == LayerKind::Value && info.name == "m_ac" && info.f_x_per_mm.is_some_and(|f_x| f_x > 0.0)
    };
    layers.iter().enumerate().filter(|(_, info)| is_fringe(info)).filter_map(fringe).collect()
}

/// The wavelengths of some depths, in their order.
pub fn wavelengths(of: &[Fringe]) -> Vec<Option<f64>> {
    let mut found = Vec::new();
    for fringe in of {
        if !found.contains(&fringe.info.wavelength_nm) {
            found.push(fringe.info.wavelength_nm);
        }
    }
    found
}

/// The mask of a wavelength.
pub fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}
