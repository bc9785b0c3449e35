//! What others made of their frames: maps, modulation or reflectance, a file (or an array in one) for each layer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::layers::place;
use turbid_contract::payload::Convention;
use turbid_contract::{AngleDeg, LayerInfo, Length, MaxFile, PerLength, Problems};

use crate::conditions::ConditionsParams;
use crate::decode::{Channel, Picture, Wanted, decode};
use crate::names::place_in;

/// Params of `import_maps`, `import_modulation` and `import_reflectance`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AnswerParams {
    /// What was found, an image each.
    pub layers: Vec<AnswerLayer>,
    /// An image that is not 0 where nothing is to be read from the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<ImageFile>,
    /// Part of each image, px: left, top, width, height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// Of reflectance: what it means. Published tables, and what was read by them, are mostly hemispherical_incident.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub convention: Option<Convention>,
    /// How it was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conditions: Option<ConditionsParams>,
    /// Name of the bench that took the frames, with all its settings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rig: Option<String>,
    /// Size of a pixel on the sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_mm: Option<Length>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(skip_serializing)]
    pub max_file_mb: MaxFile,
}

/// One image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnswerLayer {
    /// mu_a, mu_s_prime or height of maps, m_dc or m_ac of modulation, r_d of reflectance; with `_se` behind it the standard error of it.
    pub quantity: String,
    /// Relative to the pipeline file: .npy, .npz, .mat, TIFF, EXR, PNG, or numbers in text.
    pub file: String,
    /// Name of its array, where the file holds several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Of several images in the file or array: its number, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
    /// Of coloured files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// Of the numbers; left out: mm^-1 of coefficients, mm of heights, 1 of the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<AnswerUnit>,
    /// Each number times this is in the unit: images of whole numbers.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
    /// Of modulation and reflectance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_x: Option<PerLength>,
    /// Direction of the fringes; 0 where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<AngleDeg>,
    /// Of the light, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

/// An image by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageFile {
    /// Relative to the pipeline file.
    pub file: String,
    /// Name of its array, where the file holds several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Of several images in the file or array: its number, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
}

/// Unit of the numbers of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum AnswerUnit {
    #[serde(rename = "mm^-1")]
    PerMm,
    #[serde(rename = "cm^-1")]
    PerCm,
    #[serde(rename = "m^-1")]
    PerM,
    #[serde(rename = "mm")]
    Mm,
    #[serde(rename = "cm")]
    Cm,
    #[serde(rename = "m")]
    M,
    #[serde(rename = "um")]
    Um,
    #[serde(rename = "1")]
    One,
    #[serde(rename = "%")]
    Percent,
}

impl AnswerUnit {
    /// The unit of the layer, and how many of it one of the file's is.
    fn of_layer(self) -> (&'static str, f64) {
        match self {
            Self::PerMm => ("mm^-1", 1.0),
            Self::PerCm => ("mm^-1", 0.1),
            Self::PerM => ("mm^-1", 0.001),
            Self::Mm => ("mm", 1.0),
            Self::Cm => ("mm", 10.0),
            Self::M => ("mm", 1000.0),
            Self::Um => ("mm", 0.001),
            Self::One => ("1", 1.0),
            Self::Percent => ("1", 0.01),
        }
    }
}

fn one() -> f64 {
    1.0
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_one(x: &f64) -> bool {
    *x == 1.0
}

/// What a stage imports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Maps,
    Modulation,
    Reflectance,
}

impl Kind {
    /// Names of its quantities, with their units.
    fn quantities(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Maps => &[("mu_a", "mm^-1"), ("mu_s_prime", "mm^-1"), ("height", "mm")],
            Self::Modulation => &[("m_dc", "1"), ("m_ac", "1")],
            Self::Reflectance => &[("r_d", "1")],
        }
    }

    /// Whether each is of a spatial frequency.
    fn has_f_x(self) -> bool {
        self != Self::Maps
    }

    /// The quantity of this name and its unit, and whether its standard error is meant.
    fn quantity(self, name: &str) -> Option<(&'static str, &'static str, bool)> {
        let (own, error) = name.strip_suffix("_se").map_or((name, false), |own| (own, true));
        self.quantities().iter().find(|(known, _)| *known == own).map(|(known, unit)| (*known, *unit, error))
    }
}

/// A layer of the result and the file of it.
#[derive(Clone, Debug)]
pub struct Shown {
    pub info: LayerInfo,
    /// Index in `layers`.
    pub of: usize,
    /// What a number of the file is multiplied by.
    pub factor: f64,
}

impl AnswerParams {
    /// Values, then standard errors. At f_x = 0 M_DC is M_AC too, where that is not given.
    pub fn shown(&self, kind: Kind) -> Vec<Shown> {
        let mut shown: Vec<Shown> =
            self.layers.iter().enumerate().filter_map(|(k, layer)| layer.shown(kind, k)).collect();
        if kind == Kind::Modulation {
            let twin = |s: &Shown| {
                let name = s.info.name.strip_prefix("m_dc").map(|rest| format!("m_ac{rest}"))?;
                Some(Shown { info: LayerInfo { name, ..s.info.clone() }, ..s.clone() })
            };
            let even = shown.iter().filter(|s| s.info.f_x_per_mm == Some(0.0)).filter_map(twin);
            let twins: Vec<Shown> = even.filter(|twin| shown.iter().all(|s| s.info != twin.info)).collect();
            shown.extend(twins);
        }
        let is_error = |s: &Shown| s.info.name.ends_with("_se");
        shown.sort_by_key(is_error);
        shown
    }

    /// The image of a field that names a file.
    ///
    /// Error: what is wrong with it.
    pub fn read(&self, at: &str, bytes: &[u8]) -> Result<Picture, String> {
        let page = |page: Option<u32>| page.map(|page| page.saturating_sub(1) as usize);
        let wanted = match (place_in(at, "layers").and_then(|k| self.layers.get(k)), &self.mask) {
            (Some(layer), _) => Wanted {
                channel: layer.channel,
                page: page(layer.page),
                variable: layer.variable.as_deref(),
                raw: None,
            },
            (None, Some(mask)) => {
                Wanted { page: page(mask.page), variable: mask.variable.as_deref(), ..Wanted::default() }
            }
            (None, None) => Wanted::default(),
        };
        decode(bytes, wanted)?.cropped(self.crop)
    }

    /// Reports every mistake that can be seen without the files.
    pub fn check(&self, kind: Kind, problems: &mut Problems) {
        if self.layers.is_empty() {
            let names: Vec<&str> = kind.quantities().iter().map(|(name, _)| *name).collect();
            let hint = format!("layers: [{{quantity: {}, file: NAME}}]; known: {}", names[0], names.join(", "));
            problems.push_with_hint("layers", "no layer is named", hint);
        }
        for (k, layer) in self.layers.iter().enumerate() {
            layer.check(kind, k, problems);
        }
        let shown: Vec<Shown> = self.layers.iter().enumerate().filter_map(|(k, layer)| layer.shown(kind, k)).collect();
        for (k, one) in shown.iter().enumerate() {
            let Shown { info, of, .. } = one;
            if let Some(other) = shown[..k].iter().find(|other| other.info == *info) {
                problems.push(
                    format!("layers.{of}.quantity"),
                    format!("{} ({}) stands twice: at layers.{} too", info.name, place(info), other.of),
                );
            }
            let value = info.name.strip_suffix("_se");
            if value.is_some_and(|value| {
                shown.iter().all(|s| LayerInfo { name: value.to_owned(), kind: s.info.kind, ..info.clone() } != s.info)
            }) {
                let message = format!(
                    "{} ({}) is the standard error of nothing: {} is not named",
                    info.name,
                    place(info),
                    value.unwrap_or_default()
                );
                problems.push(format!("layers.{of}.quantity"), message);
            }
        }
        if let Some([_, _, width, height]) = self.crop {
            let least = f64::from(width.min(height));
            problems.require(least > 0.0, "crop", least, "px", "be a width and a height > 0");
        }
        if let Some(Length(v)) = self.pixel_mm {
            problems.require(v > 0.0 && v.is_finite(), "pixel_mm", v, "mm", "be a finite number > 0");
        }
        if let Some(conditions) = &self.conditions {
            conditions.check(problems);
        }
        match (kind, self.convention) {
            (Kind::Reflectance, None) => problems.warn(
                "",
                "the reflectance states no convention, and tables of another are up to 49 % off: say `convention` (published tables are mostly hemispherical_incident; a camera sees `camera`)",
            ),
            (Kind::Maps | Kind::Modulation, Some(_)) => {
                problems.push("convention", "only reflectance has a convention: leave it out");
            }
            _ => {}
        }
    }
}

impl AnswerLayer {
    fn shown(&self, kind: Kind, k: usize) -> Option<Shown> {
        let (name, unit, error) = kind.quantity(&self.quantity)?;
        let mut info = LayerInfo::value(name, unit);
        info.f_x_per_mm = self.f_x.map(|f_x| f_x.0);
        // As demodulate says it: even light has no direction.
        let fringes = self.f_x.is_some_and(|f_x| f_x.0 > 0.0);
        info.orientation_deg = fringes.then(|| self.orientation_deg.map_or(0.0, |angle| angle.0));
        info.wavelength_nm = self.wavelength_nm;
        let info = if error { info.standard_error() } else { info };
        let factor = self.scale * self.unit.map_or(1.0, |unit| unit.of_layer().1);
        Some(Shown { info, of: k, factor })
    }

    fn check(&self, kind: Kind, k: usize, problems: &mut Problems) {
        let at = |field: &str| format!("layers.{k}.{field}");
        let Some((name, unit, _)) = kind.quantity(&self.quantity) else {
            let known: Vec<&str> = kind.quantities().iter().map(|(name, _)| *name).collect();
            let message = format!("`{}` is none of {}", self.quantity, known.join(", "));
            return problems.push_with_hint(
                at("quantity"),
                message,
                "with `_se` behind it the standard error is meant",
            );
        };
        if let Some(own) = self.unit.filter(|own| own.of_layer().0 != unit) {
            let (own, _) = own.of_layer();
            let own = if own == "1" { "no unit" } else { own };
            problems.push(at("unit"), format!("{name} is in {unit}, or what can be turned into it, not in {own}"));
        }
        let scale = self.scale;
        problems.require(scale.is_finite() && scale != 0.0, at("scale"), scale, "", "be a finite number other than 0");
        if self.page == Some(0) {
            problems.push(at("page"), "pages are counted from 1");
        }
        match (kind.has_f_x(), self.f_x) {
            (true, None) => problems.push_with_hint(
                at("f_x"),
                format!("{name} needs the f_x that it is of"),
                "f_x: 0 is even light",
            ),
            (false, Some(_)) => problems.push(at("f_x"), format!("{name} is of no spatial frequency: leave f_x out")),
            (_, Some(PerLength(f_x))) => {
                problems.require(f_x >= 0.0 && f_x.is_finite(), at("f_x"), f_x, "mm^-1", "be >= 0");
            }
            _ => {}
        }
    }
}
