//! Textures: albedos that vary over a surface.

use glam::{DVec2, Vec2Swizzles};
use turbid_contract::payload::{self, Motif, Picture};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::solid::Patch;

/// An albedo as a function of the place on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    low: f64,
    high: f64,
    origin: DVec2,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    /// Periods per mm along u and v.
    Sinusoid(DVec2),
    Stripes(DVec2),
    Checker {
        side: f64,
    },
    Image {
        picture: Picture,
        size: Option<DVec2>,
    },
}

impl Texture {
    pub fn of(texture: &payload::Texture) -> Self {
        let wave = |period: f64, orientation_deg: f64| {
            let (sin, cos) = sin_cos_turns(orientation_deg / 360.0);
            DVec2::new(cos, sin) / period
        };
        let kind = match texture.motif {
            Motif::Sinusoid { period, orientation_deg } => Kind::Sinusoid(wave(period, orientation_deg)),
            Motif::Stripes { period, orientation_deg } => Kind::Stripes(wave(period, orientation_deg)),
            Motif::Checker { side } => Kind::Checker { side },
            Motif::Image { ref picture, size } => Kind::Image { picture: picture.clone(), size: size.map(DVec2::from) },
        };
        Self { low: texture.low, high: texture.high, origin: texture.origin.into(), kind }
    }

    /// In [0, 1].
    pub fn albedo(&self, place: &Patch) -> f64 {
        let at = place.at - self.origin;
        let pattern = match &self.kind {
            Kind::Sinusoid(wave) => 0.5 * (1.0 + sin_cos_turns(wave.dot(at)).1),
            Kind::Stripes(wave) => f64::from(u8::from((wave.dot(at) + 0.25).rem_euclid(1.0) < 0.5)),
            Kind::Checker { side } => {
                let [column, row] = (at / side).floor().to_array().map(|i| i.rem_euclid(2.0));
                f64::from(u8::from(column == row))
            }
            Kind::Image { picture, size: Some(size) } => {
                let across = upright(at, place.is_round) / *size + 0.5;
                grey(picture, across.x.rem_euclid(1.0), across.y.rem_euclid(1.0), [true; 2])
            }
            Kind::Image { picture, size: None } => {
                let (from, to) = (upright(place.low, place.is_round), upright(place.high, place.is_round));
                let (low, high) = (from.min(to), from.max(to));
                let across = (upright(at, place.is_round) - low) / (high - low);
                let x = if place.is_round { across.x.rem_euclid(1.0) } else { across.x };
                grey(picture, x, across.y, [place.is_round, false])
            }
        };
        self.low + (self.high - self.low) * pattern
    }
}

/// To the right and downwards, for somebody who looks at it upright.
fn upright(at: DVec2, is_round: bool) -> DVec2 {
    if is_round { at.yx() } else { DVec2::new(at.x, -at.y) }
}

/// Value in [0, 1] at (x, y), (0, 0) the upper left corner and (1, 1) the lower right, linear between pixel centres. Sides that are
/// `joined` go on at the other end; beyond the outermost centres of others it is as there.
fn grey(picture: &Picture, x: f64, y: f64, joined: [bool; 2]) -> f64 {
    let (left, right, fx) = between(x, picture.columns as usize, joined[0]);
    let (above, below, fy) = between(y, picture.rows as usize, joined[1]);
    let value = |row: usize, column: usize| f64::from(picture.grey[row * picture.columns as usize + column]);
    let along = |row: usize| (1.0 - fx) * value(row, left) + fx * value(row, right);
    ((1.0 - fy) * along(above) + fy * along(below)) * (1.0 / 65535.0)
}

/// The two pixels around a place, and the share of the second.
fn between(x: f64, pixels: usize, joined: bool) -> (usize, usize, f64) {
    let (at, last) = (x * pixels as f64 - 0.5, pixels - 1);
    if !joined {
        let at = at.clamp(0.0, last as f64);
        let first = at as usize;
        return (first, (first + 1).min(last), at - first as f64);
    }
    let first = at.floor();
    // From -1, left of the first centre, to the last.
    let left = if first < 0.0 { last } else { (first as usize).min(last) };
    (left, (left + 1) % pixels, at - first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(u: f64, v: f64) -> Patch {
        Patch { at: DVec2::new(u, v), low: DVec2::new(-2.0, -1.0), high: DVec2::new(2.0, 1.0), is_round: false }
    }

    fn texture(motif: Motif) -> Texture {
        Texture::of(&payload::Texture { low: 0.1, high: 0.9, origin: [0.25, -0.5], motif })
    }

    fn picture(columns: u32, rows: u32, value: impl Fn(u32, u32) -> u16) -> Picture {
        let grey = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        Picture { columns, rows, grey: grey.map(|(row, column)| value(row, column)).collect() }
    }

    /// Over whole periods each motif has the mean of its values: of the midpoint rule a sinusoid loses nothing, and squares and
    /// stripes whose edges lie between midpoints neither.
    #[test]
    fn means_over_periods() {
        let image =
            Motif::Image { picture: picture(3, 2, |r, c| (20_000 * r + 9_000 * c) as u16), size: Some([4.0, 2.0]) };
        let motifs = [
            (Motif::Sinusoid { period: 2.0, orientation_deg: 90.0 }, 0.5),
            (Motif::Sinusoid { period: 1.0, orientation_deg: 180.0 }, 0.5),
            (Motif::Stripes { period: 2.0, orientation_deg: 0.0 }, 0.5),
            (Motif::Checker { side: 0.5 }, 0.5),
            (image, (10_000.0 + 9_000.0) / 65535.0),
        ];
        for (motif, mean) in motifs {
            let texture = texture(motif);
            let n = 384;
            let at = |i: u32, side: f64| side * ((f64::from(i) + 0.5) / f64::from(n) - 0.5);
            let cells = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
            let sum: f64 = cells.map(|(i, j)| texture.albedo(&place(at(i, 4.0), at(j, 2.0)))).sum();
            let found = sum / f64::from(n * n);
            assert!((found - (0.1 + 0.8 * mean)).abs() < 1e-12, "{texture:?}: {found}");
        }
    }

    /// Where each motif is high, counted from its origin.
    #[test]
    fn motifs_lie_where_they_are_said_to_lie() {
        let high = |motif: &Motif, u: f64, v: f64| texture(motif.clone()).albedo(&place(0.25 + u, -0.5 + v));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let wave = Motif::Sinusoid { period: 0.8, orientation_deg: 90.0 };
        assert!(
            near(high(&wave, 3.0, 0.0), 0.9) && near(high(&wave, 0.0, 0.4), 0.1) && near(high(&wave, 0.0, 0.2), 0.5)
        );
        let stripes = Motif::Stripes { period: 1.0, orientation_deg: 0.0 };
        let found = [-0.26, -0.24, 0.24, 0.26, 0.76].map(|u| high(&stripes, u, 7.0));
        assert_eq!(found, [0.1, 0.9, 0.9, 0.1, 0.9]);
        let checker = Motif::Checker { side: 1.0 };
        let found = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (2.5, 1.5)].map(|(u, v)| high(&checker, u, v));
        assert_eq!(found, [0.9, 0.1, 0.9, 0.1]);
        // A bright upper right pixel of 2 x 2, its centre a quarter of the side from the middle.
        let corner = picture(2, 2, |row, column| if (row, column) == (0, 1) { u16::MAX } else { 0 });
        let tile = Motif::Image { picture: corner.clone(), size: Some([1.0, 1.0]) };
        for (u, v) in [(0.25, 0.25), (1.25, 0.25), (-0.75, -0.75)] {
            assert!(near(high(&tile, u, v), 0.9), "{u} {v}");
        }
        assert!(near(high(&tile, 0.0, 0.25), 0.5) && near(high(&tile, 0.5, 0.25), 0.5), "between two of them");
        assert!(near(high(&tile, -0.25, 0.25), 0.1));
        // Once around a piece of 2 mm, the second coordinate to the right and the first down: joined at the seam, at its ends as at the
        // last centres.
        let once = Texture { origin: DVec2::ZERO, ..texture(Motif::Image { picture: corner, size: None }) };
        let around = |along: f64, around: f64| {
            let (low, high) = (DVec2::new(0.0, -2.0), DVec2::new(2.0, 2.0));
            once.albedo(&Patch { at: DVec2::new(along, around), low, high, is_round: true })
        };
        assert!(near(around(0.5, 1.0), 0.9) && near(around(0.0, 1.0), 0.9) && near(around(1.0, 1.0), 0.5));
        assert!(near(around(0.5, 2.0), 0.5) && near(around(0.5, -2.0), 0.5) && near(around(2.0, 1.0), 0.1));
        // The same on a flat piece, where it is not joined.
        let flat = |u: f64, v: f64| once.albedo(&place(u, v));
        assert!(near(flat(1.0, 0.5), 0.9) && near(flat(2.0, 1.0), 0.9) && near(flat(-2.0, 0.5), 0.1));
    }
}
