//! Channels: how many values a list may have.

use turbid_contract::Problems;

use turbid_contract::PerChannel;

/// The channels of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One for each wavelength that the scene, or its rig, names.
    Named(usize),
    /// No wavelengths are named: there is one.
    Single,
    /// The rig that may name wavelengths is not known yet: lists may have any length.
    Open,
}

impl Channels {
    pub fn of(wavelengths: usize) -> Self {
        if wavelengths == 0 { Self::Single } else { Self::Named(wavelengths) }
    }

    /// At least 1.
    pub fn count(self) -> usize {
        match self {
            Self::Named(count) => count,
            Self::Single | Self::Open => 1,
        }
    }

    /// A list has one value per channel.
    pub fn check_length(self, path: &str, given: usize, problems: &mut Problems) {
        let name = path.rsplit('.').next().unwrap_or(path);
        match self {
            Self::Single if given != 1 => problems.push_with_hint(
                path,
                format!("{name} lists {given} values, but the scene names no wavelengths"),
                "add `wavelength_nm: [..]` beside `media`, or give one number",
            ),
            Self::Named(channels) if given != channels => problems.push_with_hint(
                path,
                format!("{name} lists {given} values for {channels} wavelengths"),
                "give one value per wavelength, or one number for all",
            ),
            _ => {}
        }
    }

    /// One value per channel, each tested by `rule`; a list must have as many values as there are channels.
    pub fn values<T>(
        self,
        path: &str,
        given: &PerChannel<T>,
        number: impl Fn(&T) -> f64,
        problems: &mut Problems,
        rule: impl Fn(String, f64, &mut Problems),
    ) -> Vec<f64> {
        match given {
            PerChannel::One(value) => {
                rule(path.to_owned(), number(value), problems);
                vec![number(value); self.count()]
            }
            PerChannel::Each(values) => {
                for (i, value) in values.iter().enumerate() {
                    rule(format!("{path}.{i}"), number(value), problems);
                }
                self.check_length(path, values.len(), problems);
                values.iter().map(number).collect()
            }
        }
    }
}
