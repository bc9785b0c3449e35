//! What absorbs in tissue, and how much of it absorbs how much; the power law of its scattering.
//!
//! mu_a(lambda) = sum_i c_i mu_i(lambda): c_i in uM of haemoglobin (the tetramer, with four haems), or as the share of the volume. All mu_i are
//! in mm^-1 for one unit and of log base e. Tables with their sources: `data/`.

use std::f64::consts::LN_10;
use std::sync::LazyLock;

use crate::spectrum::Spectrum;

/// An absorber of tissue of which the spectrum is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Chromophore {
    HbO2,
    Hb,
    Water,
    Lipid,
    Melanin,
}

/// mm^-1 per uM of log base e, of a molar extinction in cm^-1 / (mol/l) of log base 10: ln 10 for the base, 1e-6 for uM, 1/10 for mm.
pub const MOLAR_TO_MM: f64 = LN_10 * 1e-7;

/// Where the formula of melanin was fitted, nm.
const MELANIN_NM: [f64; 2] = [400.0, 1100.0];

/// Scattering is given at this wavelength, nm.
pub const SCATTERING_NM: f64 = 500.0;

impl Chromophore {
    pub const ALL: [Self; 5] = [Self::HbO2, Self::Hb, Self::Water, Self::Lipid, Self::Melanin];

    pub fn name(self) -> &'static str {
        match self {
            Self::HbO2 => "HbO2",
            Self::Hb => "Hb",
            Self::Water => "water",
            Self::Lipid => "lipid",
            Self::Melanin => "melanin",
        }
    }

    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }

    /// Of the concentration: uM, or 1 for a share of the volume.
    pub fn unit(self) -> &'static str {
        match self {
            Self::HbO2 | Self::Hb => "uM",
            Self::Water | Self::Lipid | Self::Melanin => "1",
        }
    }

    /// Wavelengths for which the absorption is known, nm.
    pub fn range_nm(self) -> [f64; 2] {
        self.table().map_or(MELANIN_NM, Spectrum::range_nm)
    }

    /// Absorption coefficient of one unit (1 uM, or the pure substance), mm^-1; `None` beyond [`range_nm`](Self::range_nm).
    ///
    /// Melanin is the inside of a melanosome, 1.70e12 (lambda / nm)^-3.48 cm^-1. Source: S. L. Jacques, Oregon Medical Laser Center (1998).
    pub fn mu_a_per_mm(self, wavelength_nm: f64) -> Option<f64> {
        if let Some(table) = self.table() {
            return table.at(wavelength_nm);
        }
        let [first, last] = MELANIN_NM;
        let known = wavelength_nm >= first && wavelength_nm <= last;
        known.then(|| 1.70e11 * libm::pow(wavelength_nm, -3.48))
    }

    fn table(self) -> Option<&'static Spectrum> {
        static TABLES: LazyLock<[Spectrum; 4]> = LazyLock::new(|| {
            let haemoglobin = include_str!("../data/haemoglobin.csv");
            [
                tabulated(haemoglobin, 1, MOLAR_TO_MM),
                tabulated(haemoglobin, 2, MOLAR_TO_MM),
                tabulated(include_str!("../data/water.csv"), 1, 0.1),
                tabulated(include_str!("../data/lipid.csv"), 1, 1e-3),
            ]
        });
        match self {
            Self::HbO2 => Some(&TABLES[0]),
            Self::Hb => Some(&TABLES[1]),
            Self::Water => Some(&TABLES[2]),
            Self::Lipid => Some(&TABLES[3]),
            Self::Melanin => None,
        }
    }
}

/// Reduced scattering coefficient a (lambda / 500 nm)^-b, in the unit of `a`.
pub fn reduced_scattering(a: f64, b: f64, wavelength_nm: f64) -> f64 {
    a * libm::pow(wavelength_nm / SCATTERING_NM, -b)
}

/// A column of one of our own tables, times `to_mm`.
fn tabulated(text: &str, column: usize, to_mm: f64) -> Spectrum {
    let rows = text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
    let number = |line: &str, k: usize| -> f64 {
        let cell = line.split(',').nth(k).expect("each row has all columns");
        cell.parse().expect("cells are numbers")
    };
    let (wavelengths, values) = rows.map(|line| (number(line, 0), to_mm * number(line, column))).unzip();
    Spectrum::new(wavelengths, values).expect("wavelengths rise")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the tables as published, in their own units.
    #[test]
    fn tables_hold_what_was_published() {
        let molar = |c: Chromophore, nm: f64| c.mu_a_per_mm(nm).expect("it is in the table") / MOLAR_TO_MM;
        let per_cm = |c: Chromophore, nm: f64| 10.0 * c.mu_a_per_mm(nm).expect("it is in the table");
        for (c, nm, value) in [
            (Chromophore::HbO2, 660.0, 319.6),
            (Chromophore::Hb, 660.0, 3226.56),
            (Chromophore::HbO2, 800.0, 816.0),
            (Chromophore::Hb, 800.0, 761.72),
            (Chromophore::HbO2, 940.0, 1214.0),
            (Chromophore::Hb, 940.0, 693.44),
            (Chromophore::HbO2, 542.0, 53_292.0),
            (Chromophore::Hb, 556.0, 54_540.0),
        ] {
            assert!((molar(c, nm) / value - 1.0).abs() < 1e-14, "{c:?} at {nm} nm: {}", molar(c, nm));
        }
        for (c, nm, value) in [
            (Chromophore::Water, 800.0, 0.022_462),
            (Chromophore::Water, 976.0, 0.486_689),
            (Chromophore::Water, 550.0, 0.000_588),
            (Chromophore::Lipid, 930.0, 0.131),
            // 1.70e12 x 694^-3.48
            (Chromophore::Melanin, 694.0, 220.0),
        ] {
            let is = per_cm(c, nm);
            let tolerance = if c == Chromophore::Melanin { 0.02 } else { 1e-12 };
            assert!((is / value - 1.0).abs() < tolerance, "{c:?} at {nm} nm: {is}");
        }
    }

    /// 150 g/l of blood, 150 / 64 500 mol/l: mu_a = 2.303 eps x g/l / 64 500, cm^-1.
    #[test]
    fn blood_is_as_dark_as_its_haemoglobin() {
        let um = 150.0 / 64_500.0 * 1e6;
        let mu_a = 10.0 * um * Chromophore::Hb.mu_a_per_mm(660.0).expect("it is in the table");
        assert!((mu_a / (2.303 * 3226.56 * 150.0 / 64_500.0) - 1.0).abs() < 2e-4, "{mu_a}");
    }

    /// HbO2 and Hb absorb alike once between 790 and 810 nm, near 797 nm.
    #[test]
    fn the_isosbestic_point_is_near_797_nm() {
        let more = |nm: f64| Chromophore::HbO2.mu_a_per_mm(nm) > Chromophore::Hb.mu_a_per_mm(nm);
        let crossing: Vec<u32> =
            (7900..8100).filter(|&k| more(f64::from(k) / 10.0) != more(f64::from(k + 1) / 10.0)).collect();
        assert!(matches!(crossing[..], [k] if (7955..7985).contains(&k)), "{crossing:?}");
    }

    /// Every table covers 450 to 1000 nm and holds no negative number; beyond its range there is none.
    #[test]
    fn tables_cover_the_visible_and_near_infrared() {
        for c in Chromophore::ALL {
            assert_eq!(Chromophore::named(c.name()), Some(c));
            let [first, last] = c.range_nm();
            assert!(first <= 450.0 && last >= 1000.0, "{c:?}: {first} to {last} nm");
            assert!((4500..=10_000).all(|k| c.mu_a_per_mm(f64::from(k) / 10.0).is_some_and(|mu_a| mu_a > 0.0)));
            assert!(c.mu_a_per_mm(first - 0.1).is_none() && c.mu_a_per_mm(last + 0.1).is_none());
        }
        assert_eq!(Chromophore::named("HbO"), None);
    }

    #[test]
    fn scattering_is_a_at_500_nm_and_falls_by_b() {
        assert_eq!(reduced_scattering(1.5, 1.2, 500.0), 1.5);
        let exponent = -libm::log(reduced_scattering(1.5, 1.2, 1000.0) / 1.5) / std::f64::consts::LN_2;
        assert!((exponent - 1.2).abs() < 1e-14);
    }
}
