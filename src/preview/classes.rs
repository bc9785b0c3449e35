//! Layers whose numbers are names: reasons of masks, objects, sections.

use serde_json::Value;
use turbid_contract::payload::{MaskReason, Section};
use turbid_contract::{Attributes, LayerInfo, LayerKind};

use super::canvas::Rgb;
use super::colour::category;
use super::number::short;

/// What the numbers of a layer stand for.
pub struct Classes {
    /// The number of the first name.
    first: i64,
    names: Vec<String>,
    /// The class that steps back: good pixels should, an object should not.
    pale: Option<i64>,
}

impl Classes {
    /// None where the numbers of the layer are a quantity.
    pub fn of(info: &LayerInfo, attributes: &Attributes) -> Option<Self> {
        let reasons = |good: &str| {
            let name = |reason: MaskReason| if reason == MaskReason::Good { good } else { reason.text() }.to_owned();
            Self { first: 0, names: MaskReason::ALL.map(name).to_vec(), pale: Some(0) }
        };
        let plain = |first, names: &[&str], pale| {
            Some(Self { first, names: names.iter().map(|&n| n.to_owned()).collect(), pale })
        };
        if info.is_pixel_mask() {
            return Some(reasons("good"));
        }
        if info.kind == LayerKind::Mask {
            return plain(0, &["known", "unknown"], Some(0));
        }
        if info.kind != LayerKind::Value {
            return None;
        }
        match info.name.as_str() {
            "outside" => Some(reasons("inside the table")),
            "object" => {
                let name = |n: &Value| n.as_str().map_or_else(|| n.to_string(), str::to_owned);
                let names = attributes.get("objects")?.as_array()?.iter().map(name).collect();
                Some(Self { first: 0, names, pale: None })
            }
            "section" | "neighbour" => {
                let sections: Vec<Section> = serde_json::from_value(attributes.get("sections")?.clone()).ok()?;
                let name = |(k, s): (usize, &Section)| format!("{k}: {} to {} mm", short(s.from_mm), short(s.to_mm));
                Some(Self { first: 0, names: sections.iter().enumerate().map(name).collect(), pale: None })
            }
            name if name.starts_with("jacobian_sign") => plain(-1, &["negative", "zero", "positive"], Some(0)),
            _ => None,
        }
    }

    /// What a number stands for; the number itself where it has no name.
    pub fn name(&self, number: f64) -> String {
        let at = number - self.first as f64;
        let known = (at >= 0.0 && at.fract() == 0.0).then(|| self.names.get(at as usize)).flatten();
        known.cloned().unwrap_or_else(|| format!("{number}"))
    }

    /// The colour of a number: neighbouring ones differ.
    pub fn colour(&self, number: f64) -> Rgb {
        // Clamped by the cast; -128..128 are all that a legend could name.
        let number = number as i8;
        if self.pale == Some(i64::from(number)) {
            return category(0);
        }
        let from = if self.pale.is_some() && self.first == 0 { 1 } else { self.first };
        // The pale colour is no class's own.
        category(1 + (i64::from(number) - from).rem_euclid(15) as usize)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn classes(name: &str) -> Option<Classes> {
        let mut attributes = Attributes::new();
        let section = |from: f64, to: f64| json!({"from_mm": from, "to_mm": to, "pixels": 9, "m_dc": 1e-3});
        attributes.insert("sections".into(), json!([section(0.0, 12.25), section(12.25, 40.0)]));
        attributes.insert("objects".into(), json!(["slab", "polyp"]));
        let kind = if name == "mask" || name.ends_with("_se_unknown") { LayerKind::Mask } else { LayerKind::Value };
        Classes::of(&LayerInfo::new(name, kind, "1"), &attributes)
    }

    #[test]
    fn numbers_have_names_and_colours_of_their_own() {
        for (name, number, says) in [
            ("mask", 4.0, "darker than the table"),
            ("mask", 0.0, "good"),
            ("outside", 0.0, "inside the table"),
            ("outside", 5.0, "brighter than the table"),
            ("mu_a_se_unknown", 1.0, "unknown"),
            ("object", 1.0, "polyp"),
            ("section", 1.0, "1: 12.25 to 40 mm"),
            ("neighbour", 0.0, "0: 0 to 12.25 mm"),
            ("jacobian_sign", -1.0, "negative"),
            ("section", 7.0, "7"),
            ("section", 0.5, "0.5"),
        ] {
            assert_eq!(classes(name).unwrap().name(number), says, "{name} {number}");
        }
        for (name, numbers) in
            [("mask", 0..16), ("outside", 0..16), ("object", 0..15), ("section", 0..15), ("jacobian_sign", -1..2)]
        {
            let mut colours: Vec<Rgb> = numbers.clone().map(|n| classes(name).unwrap().colour(f64::from(n))).collect();
            colours.sort_unstable();
            colours.dedup();
            assert_eq!(colours.len(), numbers.len(), "{name}");
        }
        assert!(["weight", "mu_a", "arc_length"].iter().all(|name| classes(name).is_none()));
        assert_eq!(classes("mask").unwrap().colour(0.0), category(0), "good pixels step back");
    }
}
