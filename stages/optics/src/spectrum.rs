//! A tabulated spectrum: values between wavelengths by linear interpolation, beyond them none.

/// Values at rising wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    wavelengths_nm: Vec<f64>,
    values: Vec<f64>,
}

impl Spectrum {
    /// `None` without a row, where wavelengths do not rise, or where a number is not finite.
    pub fn new(wavelengths_nm: Vec<f64>, values: Vec<f64>) -> Option<Self> {
        let rises = wavelengths_nm.windows(2).all(|pair| pair[0] < pair[1]);
        let finite = wavelengths_nm.iter().chain(&values).all(|v| v.is_finite());
        let whole = !values.is_empty() && values.len() == wavelengths_nm.len();
        (rises && finite && whole).then_some(Self { wavelengths_nm, values })
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> [f64; 2] {
        [self.wavelengths_nm[0], self.wavelengths_nm[self.wavelengths_nm.len() - 1]]
    }

    /// The value at a wavelength; `None` outside of the table, which is never extrapolated.
    pub fn at(&self, wavelength_nm: f64) -> Option<f64> {
        let [first, last] = self.range_nm();
        if !(wavelength_nm >= first && wavelength_nm <= last) {
            return None;
        }
        let above = self.wavelengths_nm.partition_point(|&w| w < wavelength_nm);
        if self.wavelengths_nm[above] == wavelength_nm {
            return Some(self.values[above]);
        }
        let [low, high] = [self.wavelengths_nm[above - 1], self.wavelengths_nm[above]];
        let share = (wavelength_nm - low) / (high - low);
        Some(self.values[above - 1] * (1.0 - share) + self.values[above] * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows are themselves, between them the line, beyond them nothing; what is no table is none.
    #[test]
    fn linear_between_rows_and_nothing_beyond() {
        let spectrum = Spectrum::new(vec![500.0, 510.0, 530.0], vec![1.0, 3.0, -1.0]).expect("it is a table");
        let known = [(500.0, 1.0), (505.0, 2.0), (510.0, 3.0), (525.0, 0.0), (530.0, -1.0)];
        assert!(known.iter().all(|&(w, value)| spectrum.at(w) == Some(value)));
        assert!([499.999, 530.001, f64::NAN, f64::INFINITY].iter().all(|&w| spectrum.at(w).is_none()));
        for (wavelengths, values) in [
            (vec![], vec![]),
            (vec![500.0], vec![1.0, 2.0]),
            (vec![500.0, 500.0], vec![1.0, 2.0]),
            (vec![510.0, 500.0], vec![1.0, 2.0]),
            (vec![500.0], vec![f64::NAN]),
        ] {
            assert_eq!(Spectrum::new(wavelengths, values), None);
        }
    }
}
