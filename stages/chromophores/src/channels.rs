//! Which layers of maps are read: mu_a and mu_s' of each wavelength, found by what they say of themselves.

use turbid_contract::layers::{standard_error, values};
use turbid_contract::{Error, LayerInfo, LayerKind};

/// A quantity at each wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Places of its layers, by wavelength.
    pub layers: Vec<usize>,
    /// Those of its standard errors; none where one of them is missing.
    pub errors: Option<Vec<usize>>,
    /// Places of covariance layers, with the two wavelengths (by their number) that each is of.
    pub covariances: Vec<([usize; 2], usize)>,
}

/// What is read of maps.
#[derive(Clone, Debug, PartialEq)]
pub struct Channels {
    /// In the order of the layers.
    pub wavelengths_nm: Vec<f64>,
    pub mu_a: Quantity,
    /// Only where scattering is fitted.
    pub mu_s_prime: Option<Quantity>,
}

impl Channels {
    /// Of the wavelengths `only`, or of all where it is empty.
    ///
    /// Errors: no `mu_a`, layers that name no wavelength, one twice, one that is wanted and not there, fewer than two, mu_s' of other wavelengths.
    pub fn of(layers: &[LayerInfo], only: &[f64], scattering: bool) -> Result<Self, Error> {
        let found: Vec<(usize, &LayerInfo)> = values(layers, "mu_a").collect();
        if found.is_empty() {
            let what = "there is no layer `mu_a`: maps of optical properties are wanted";
            return Err(Error::failed_with_hint(what, "connect the maps of a stage `invert`"));
        }
        let mut all: Vec<(f64, usize)> = Vec::new();
        for (place, info) in found {
            let Some(nm) = info.wavelength_nm else {
                let what = "the layer `mu_a` names no wavelength, and what absorbs depends on it";
                return Err(Error::failed_with_hint(
                    what,
                    "name the wavelengths where the frames come from: `wavelength_nm: [..]`",
                ));
            };
            if all.iter().any(|(other, _)| *other == nm) {
                return Err(Error::failed(format!("there are two layers `mu_a` at {nm} nm")));
            }
            all.push((nm, place));
        }
        let has = all.iter().map(|(nm, _)| nm.to_string()).collect::<Vec<_>>().join(", ");
        if let Some(absent) = only.iter().find(|&&nm| all.iter().all(|(other, _)| *other != nm)) {
            let what = format!("there is no mu_a at {absent} nm; there is at {has} nm");
            return Err(Error::failed_with_hint(what, "name wavelengths that the maps have in `wavelength_nm`"));
        }
        all.retain(|(nm, _)| only.is_empty() || only.contains(nm));
        let (wavelengths_nm, places): (Vec<f64>, Vec<usize>) = all.into_iter().unzip();
        if wavelengths_nm.len() < 2 {
            let what =
                format!("there is one wavelength, {} nm: what absorbs is told by two or more", wavelengths_nm[0]);
            return Err(Error::failed_with_hint(what, "measure or render at several wavelengths"));
        }
        let mu_s_prime = if scattering { Some(reduced_scattering(layers, &wavelengths_nm)?) } else { None };
        Ok(Self { mu_a: Quantity::of(layers, places), mu_s_prime, wavelengths_nm })
    }
}

impl Channels {
    /// Places of all layers that are read.
    pub fn places(&self) -> impl Iterator<Item = usize> {
        let of = |q: &Quantity| {
            let covariances = q.covariances.iter().map(|(_, place)| *place);
            q.layers.iter().chain(q.errors.iter().flatten()).copied().chain(covariances).collect::<Vec<_>>()
        };
        std::iter::once(&self.mu_a).chain(&self.mu_s_prime).flat_map(of)
    }

    /// The same in a part of the maps: `kept` are the places in the whole of what it holds, in their order.
    #[must_use]
    pub fn within(self, kept: &[usize]) -> Self {
        let at = |place: usize| kept.iter().position(|&kept| kept == place).expect("what is read is kept");
        let of = |q: Quantity| Quantity {
            layers: q.layers.into_iter().map(at).collect(),
            errors: q.errors.map(|errors| errors.into_iter().map(at).collect()),
            covariances: q.covariances.into_iter().map(|(pair, place)| (pair, at(place))).collect(),
        };
        Self { wavelengths_nm: self.wavelengths_nm, mu_a: of(self.mu_a), mu_s_prime: self.mu_s_prime.map(of) }
    }
}

fn reduced_scattering(layers: &[LayerInfo], wavelengths_nm: &[f64]) -> Result<Quantity, Error> {
    let at = |nm: &f64| {
        let place =
            values(layers, "mu_s_prime").find(|(_, info)| info.wavelength_nm == Some(*nm)).map(|(place, _)| place);
        place.ok_or_else(|| {
            let what = format!("there is no layer `mu_s_prime` at {nm} nm, to which a power law is to be fitted");
            Error::failed_with_hint(what, "leave `scattering` out, or connect maps that have it")
        })
    };
    Ok(Quantity::of(layers, wavelengths_nm.iter().map(at).collect::<Result<_, _>>()?))
}

impl Quantity {
    fn of(layers: &[LayerInfo], places: Vec<usize>) -> Self {
        let errors = places.iter().map(|&k| standard_error(layers, &layers[k])).collect();
        let channel = |layer: u32| places.iter().position(|&place| place == layer as usize);
        let pair = |(place, info): (usize, &LayerInfo)| {
            let [a, b] = info.pair.filter(|_| info.kind == LayerKind::Covariance)?;
            Some(([channel(a)?, channel(b)?], place))
        };
        let covariances = layers.iter().enumerate().filter_map(pair).filter(|([a, b], _)| a != b).collect();
        Self { layers: places, errors, covariances }
    }
}

/// `660, 850`
pub fn listed(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}
