//! Layers by what they say of themselves: the same questions to a stack that is there and to the form of one that is not yet.

use crate::artifact::{ImageStack, LayerInfo, LayerKind};

impl ImageStack {
    /// What all layers say of themselves, in their order.
    pub fn infos(&self) -> Vec<LayerInfo> {
        self.layers.iter().map(|layer| layer.info.clone()).collect()
    }
}

/// The values of the quantity `name` (one for each f_x, phase, orientation and wavelength), with their places.
pub fn values<'a>(infos: &'a [LayerInfo], name: &'a str) -> impl Iterator<Item = (usize, &'a LayerInfo)> {
    infos.iter().enumerate().filter(move |(_, info)| info.kind == LayerKind::Value && info.name == name)
}

/// Wavelengths at which the quantity `name` is there, in the order of its layers.
pub fn wavelengths(infos: &[LayerInfo], name: &str) -> Vec<Option<f64>> {
    let mut found = Vec::new();
    for (_, info) in values(infos, name) {
        if !found.contains(&info.wavelength_nm) {
            found.push(info.wavelength_nm);
        }
    }
    found
}

/// The place of the standard error of the quantity `of`.
pub fn standard_error(infos: &[LayerInfo], of: &LayerInfo) -> Option<usize> {
    infos.iter().position(|info| info.is_standard_error_of(of))
}

/// `f_x = 0.1 mm^-1, 30 deg, 660 nm`: of what a layer is, for messages.
pub fn place(info: &LayerInfo) -> String {
    let mut text = format!("f_x = {} mm^-1", info.f_x_per_mm.unwrap_or(0.0));
    if let Some(orientation) = info.orientation_deg {
        text += &format!(", {orientation} deg");
    }
    if let Some(wavelength) = info.wavelength_nm {
        text += &format!(", {wavelength} nm");
    }
    text
}

/// `64 x 48 pixels`: columns by rows, of a size (rows, columns).
pub fn size([rows, columns]: [u64; 2]) -> String {
    format!("{columns} x {rows} pixels")
}

/// The unit of a product of two quantities in `unit`: `W^2 mm^-4 sr^-2` of `W mm^-2 sr^-1`.
pub fn squared(unit: &str) -> String {
    let factor = |factor: &str| match factor.split_once('^') {
        _ if factor == "1" => factor.to_owned(),
        None => format!("{factor}^2"),
        Some((base, power)) => match power.parse::<i32>() {
            Ok(power) => format!("{base}^{}", 2 * power),
            Err(_) => format!("({factor})^2"),
        },
    };
    unit.split_whitespace().map(factor).collect::<Vec<_>>().join(" ")
}

/// Whether `square` is the unit of a product of two quantities in `unit`, in either spelling: `W^2 mm^-4` or `(W mm^-2)^2`.
pub fn is_square(square: &str, unit: &str) -> bool {
    square == squared(unit) || square.strip_prefix('(').and_then(|rest| rest.strip_suffix(")^2")) == Some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_products() {
        for (unit, square) in [
            ("W mm^-2 sr^-1", "W^2 mm^-4 sr^-2"),
            ("1", "1"),
            ("mm^-1", "mm^-2"),
            ("counts", "counts^2"),
            ("", ""),
            ("m^a", "(m^a)^2"),
        ] {
            assert_eq!(squared(unit), square);
            assert!(is_square(square, unit) && is_square(&format!("({unit})^2"), unit), "{unit}");
        }
        assert!(!is_square("W^2 mm^-4 sr^-2", "1") && !is_square("mm^-1", "mm^-1"));
    }
}
