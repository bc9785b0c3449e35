//! Textures: patterns wrapped around opaque surfaces.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// An albedo that varies over a surface: low + (high - low) x the pattern's value in [0, 1].
///
/// Places are the surface's own coordinates (u, v), mm, less `origin`; see docs/theory/scene.md.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    pub low: f64,
    pub high: f64,
    pub origin: [f64; 2],
    pub motif: Motif,
}

/// What is wrapped around.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motif {
    /// (1 + cos(2 pi s / period)) / 2, s along u turned by the orientation towards v.
    Sinusoid { period: f64, orientation_deg: f64 },
    /// 1 over the half of each period around s = 0, else 0.
    Stripes { period: f64, orientation_deg: f64 },
    /// Squares of this side, 1 where both u / side and v / side are between an even number and the next, or both are not, else 0.
    Checker { side: f64 },
    /// A picture, upright: its columns run along u and its rows against v on flat pieces, along v and u on round ones.
    Image {
        picture: Picture,
        /// mm, repeated side by side, one of them about the origin; without it the picture covers each piece of the surface once.
        size: Option<[f64; 2]>,
    },
}

/// Grey values, row after row, as fractions of 65535. In the record they are a text: base64 of little-endian numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    pub columns: u32,
    pub rows: u32,
    #[serde(serialize_with = "write_grey", deserialize_with = "read_grey")]
    pub grey: Vec<u16>,
}

fn write_grey<S: Serializer>(grey: &[u16], serializer: S) -> Result<S::Ok, S::Error> {
    let bytes: Vec<u8> = grey.iter().flat_map(|x| x.to_le_bytes()).collect();
    serializer.serialize_str(&STANDARD.encode(bytes))
}

fn read_grey<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u16>, D::Error> {
    let text = String::deserialize(deserializer)?;
    let bytes = STANDARD.decode(text).map_err(de::Error::custom)?;
    let (numbers, rest) = bytes.as_chunks::<2>();
    if rest.is_empty() {
        Ok(numbers.iter().map(|&bytes| u16::from_le_bytes(bytes)).collect())
    } else {
        Err(de::Error::custom(format!("{} bytes are no whole number of grey values", bytes.len())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_survives_the_record() {
        let picture = Picture { columns: 2, rows: 2, grey: vec![0, 1, 256, u16::MAX] };
        let motif = Motif::Image { picture, size: Some([3.0, 0.1]) };
        let texture = Texture { low: 0.1, high: 0.9, origin: [1.0, -2.0], motif };
        let text = serde_json::to_string(&texture).unwrap();
        assert_eq!(serde_json::from_str::<Texture>(&text).unwrap(), texture);
        let torn = text.replace("\"grey\":\"AA", "\"grey\":\"A");
        assert!(serde_json::from_str::<Texture>(&torn).is_err(), "{torn}");
    }
}
