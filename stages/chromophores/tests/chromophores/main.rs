//! What maps of several wavelengths are made of: closed forms, optimality, errors that are as large as stated, and what is refused.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Maps;
use turbid_contract::{ImageStack, LayerInfo};
use turbid_optics::philox::{key, philox4x32, unit};

mod coverage;
mod design;
mod laws;
mod mistakes;
mod stage;

/// Random numbers of a fixed seed.
pub struct Random {
    key: [u32; 2],
    drawn: u32,
}

impl Random {
    pub fn new(seed: u64) -> Self {
        Self { key: key(seed), drawn: 0 }
    }

    /// In (0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.drawn += 1;
        unit(philox4x32([self.drawn, 0, 0, 0], self.key)[0])
    }

    /// Of mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        self.drawn += 1;
        let bits = philox4x32([self.drawn, 1, 0, 0], self.key);
        let radius = (-2.0 * libm::log(unit(bits[0]))).sqrt();
        radius * libm::cos(std::f64::consts::TAU * unit(bits[1]))
    }
}

/// A quantity of maps at a wavelength.
pub fn at(name: &str, wavelength_nm: f64) -> LayerInfo {
    LayerInfo { wavelength_nm: Some(wavelength_nm), ..LayerInfo::value(name, "mm^-1") }
}

/// A value with its standard error, where it has one.
pub type Stated = (f64, Option<f64>);

/// Maps of one row: `value(quantity, number of the wavelength, pixel)`.
pub fn maps(
    pixels: usize,
    wavelengths: &[f64],
    quantities: &[&str],
    value: &mut dyn FnMut(&str, usize, usize) -> Stated,
) -> Maps {
    let mut stack = ImageStack::new(1, pixels);
    let mut errors = Vec::new();
    for (k, &nm) in wavelengths.iter().enumerate() {
        for &name in quantities {
            let all: Vec<Stated> = (0..pixels).map(|pixel| value(name, k, pixel)).collect();
            let image = |of: &dyn Fn(&Stated) -> f64| {
                Array2::from_shape_vec((1, pixels), all.iter().map(|v| of(v) as f32).collect()).expect("one row")
            };
            let info = at(name, nm);
            if all[0].1.is_some() {
                errors.push((info.standard_error(), image(&|v| v.1.expect("all have one"))));
            }
            stack.push(info, image(&|v| v.0));
        }
    }
    errors.into_iter().for_each(|(info, data)| stack.push(info, data));
    Maps(stack)
}
