//! Values that are legal, but look as if they stood in another unit: `mu_a: 5` where 5 cm^-1 is meant.
//!
//! A value is suspect only if it lies outside of what tissue and phantoms usually have *and* comes to lie inside once it is read in the unit
//! that somebody may have had in mind. What is far from everything (a black absorber of 1e5 mm^-1) is meant so.

use crate::problem::Problems;

/// What a quantity usually is, and the units that it is mistaken in.
#[derive(Clone, Copy, Debug)]
pub struct Usual {
    pub name: &'static str,
    pub unit: &'static str,
    pub least: f64,
    pub most: f64,
    /// Names of units and what a number in them is in `unit`.
    pub others: &'static [(&'static str, f64)],
    /// Whose range it is: `tissue and phantoms have`.
    pub whose: &'static str,
}

/// What a coefficient in mm^-1 is mistaken in: textbooks have cm^-1, the paper's densities m^-1, Mie programs um^-1.
const PER_MM: &[(&str, f64)] = &[("cm^-1", 0.1), ("m^-1", 1e-3), ("um^-1", 1e3)];
/// What a density in m^-1 is mistaken in.
const PER_M: &[(&str, f64)] = &[("cm^-1", 100.0), ("mm^-1", 1e3)];

const MEDIA: &str = "tissue and phantoms have";

impl Usual {
    /// From dilute dye and milky silicone to melanin and blood outside of its Soret band.
    ///
    /// Source: Jacques, Phys. Med. Biol. 58, R37 (2013); phantoms: Pogue and Patterson, J. Biomed. Opt. 11, 041102 (2006).
    pub const MU_A: Self = Self { name: "mu_a", unit: "mm^-1", least: 3e-4, most: 1.0, others: PER_MM, whose: MEDIA };
    /// Skin at 400 nm has some 6 mm^-1, soft tissue in the near infrared 0.5 to 2 mm^-1. Source: as [`Self::MU_A`].
    pub const MU_S_PRIME: Self =
        Self { name: "mu_s_prime", unit: "mm^-1", least: 0.1, most: 8.0, others: PER_MM, whose: MEDIA };
    /// 10 times mu_s' at g = 0.9 and some, since g is a choice where mu_s is not measured.
    pub const MU_S: Self = Self { name: "mu_s", unit: "mm^-1", least: 0.1, most: 150.0, others: PER_MM, whose: MEDIA };
    /// mu_a = A_rho / 1000.
    pub const A_RHO: Self = Self { name: "A_rho", unit: "m^-1", least: 0.3, most: 1000.0, others: PER_M, whose: MEDIA };
    /// mu_s = S_rho / 1000.
    pub const S_RHO: Self =
        Self { name: "S_rho", unit: "m^-1", least: 100.0, most: 150_000.0, others: PER_M, whose: MEDIA };
    /// Of the pattern: from one fringe in 200 mm to five times what tells phase functions apart, 0.05 to 0.5 mm^-1 in Kanick et al.,
    /// Biomed. Opt. Express 5, 3376 (2014).
    pub const F_X: Self =
        Self { name: "f_x", unit: "mm^-1", least: 5e-3, most: 2.5, others: PER_MM, whose: "fringes on tissue have" };
    /// Of one light.
    pub const POWER: Self = Self {
        name: "power",
        unit: "W",
        least: 1e-4,
        most: 200.0,
        others: &[("mW", 1e-3)],
        whose: "lights of imaging systems have",
    };
    /// From the ultraviolet to where water absorbs all.
    pub const WAVELENGTH: Self = Self {
        name: "wavelength_nm",
        unit: "nm",
        least: 200.0,
        most: 2500.0,
        others: &[("um", 1e3), ("mm", 1e6), ("m", 1e9)],
        whose: "tissue is imaged at",
    };

    /// The units in which `value` would be usual; none if it is usual as it stands, or in no unit.
    pub fn meant(&self, value: f64) -> Vec<&'static str> {
        if !value.is_finite() || value <= 0.0 || self.holds(value) {
            return Vec::new();
        }
        self.others.iter().filter(|(_, factor)| self.holds(value * factor)).map(|(unit, _)| *unit).collect()
    }

    /// A warning and its way out, if `value` looks as if it stood in another unit.
    pub fn doubt(&self, value: f64) -> Option<(String, String)> {
        let meant = self.meant(value);
        if meant.is_empty() {
            return None;
        }
        let Self { name, unit, least, most, whose, .. } = self;
        let message = format!("{name} = {value} {unit} is unusual: {whose} {least} to {most} {unit}");
        let written: Vec<String> = meant.iter().map(|unit| format!("`{value} {unit}`")).collect();
        Some((message, format!("if another unit is meant, write it: {}", written.join(" or "))))
    }

    /// How far a value lies outside of the range, as a factor: of a sweep the worst is told.
    pub fn off(&self, value: f64) -> f64 {
        (value / self.most).max(self.least / value)
    }

    fn holds(&self, value: f64) -> bool {
        value >= self.least && value <= self.most
    }
}

impl Problems {
    /// Warns where `value`, which stands at `path`, looks as if it stood in another unit.
    pub fn doubt(&mut self, usual: &Usual, path: impl Into<String>, value: f64) {
        if let Some((message, hint)) = usual.doubt(value) {
            self.warn_ranked(usual.off(value), path, message, hint);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_value_that_another_unit_makes_usual_is_doubted() {
        for (usual, value, meant) in [
            (Usual::MU_A, 0.5, vec![]),
            (Usual::MU_A, 0.0, vec![]),
            (Usual::MU_A, 5.0, vec!["cm^-1", "m^-1"]),
            (Usual::MU_A, 20.0, vec!["m^-1"]),
            (Usual::MU_A, 1e5, vec![]),
            (Usual::MU_A, f64::NAN, vec![]),
            (Usual::MU_S_PRIME, 10.0, vec!["cm^-1"]),
            (Usual::MU_S_PRIME, 1000.0, vec!["m^-1"]),
            (Usual::MU_S_PRIME, 1e-3, vec!["um^-1"]),
            (Usual::A_RHO, 0.1, vec!["cm^-1", "mm^-1"]),
            (Usual::S_RHO, 5.0, vec!["cm^-1", "mm^-1"]),
            (Usual::POWER, 5000.0, vec!["mW"]),
            (Usual::WAVELENGTH, 0.65, vec!["um"]),
            (Usual::F_X, 100.0, vec!["m^-1"]),
        ] {
            assert_eq!(usual.meant(value), meant, "{} = {value}", usual.name);
            let mut problems = Problems::default();
            problems.doubt(&usual, "field", value);
            assert_eq!(problems.into_parts().1.len(), usize::from(!meant.is_empty()));
        }
    }
}
