//! Colour maps: numbers in [0, 1] and categories to colours.

use super::canvas::Rgb;

/// How the colours of a panel run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourMap {
    /// Viridis: perceptually uniform, dark to bright.
    Sequential,
    /// Blue over white to red; white is zero.
    Diverging,
    /// Twilight: both ends have the same colour, as angles need.
    Cyclic,
}

impl ColourMap {
    /// Colour at `t`; ends hold outside [0, 1].
    pub fn colour(self, t: f64) -> Rgb {
        let t = t.clamp(0.0, 1.0);
        match self {
            Self::Sequential => colorous::VIRIDIS.eval_continuous(t).as_array(),
            Self::Diverging => colorous::RED_BLUE.eval_continuous(1.0 - t).as_array(),
            Self::Cyclic => {
                let at = t * (TWILIGHT.len() - 1) as f64;
                let i = (at as usize).min(TWILIGHT.len() - 2);
                let (a, b, s) = (TWILIGHT[i], TWILIGHT[i + 1], at - i as f64);
                std::array::from_fn(|c| (f64::from(a[c]) * (1.0 - s) + f64::from(b[c]) * s).round() as u8)
            }
        }
    }
}

/// Matplotlib's `twilight` (public domain, CC0) at every sixteenth.
const TWILIGHT: [Rgb; 17] = [
    [226, 217, 226],
    [196, 206, 212],
    [149, 181, 199],
    [114, 151, 193],
    [98, 118, 186],
    [94, 81, 173],
    [89, 42, 143],
    [69, 19, 92],
    [47, 20, 54],
    [74, 19, 66],
    [116, 30, 79],
    [152, 53, 80],
    [178, 86, 82],
    [194, 124, 99],
    [204, 163, 137],
    [216, 199, 190],
    [226, 217, 226],
];

/// Colours of categories that the colour-blind can tell apart (Okabe and Ito 2008), then six more; repeated
/// from there on.
pub fn category(index: usize) -> Rgb {
    const PALETTE: [Rgb; 16] = [
        [236, 236, 232],
        [0, 114, 178],
        [230, 159, 0],
        [0, 158, 115],
        [204, 121, 167],
        [86, 180, 233],
        [213, 94, 0],
        [240, 228, 66],
        [110, 110, 110],
        [0, 0, 0],
        [148, 103, 189],
        [140, 86, 75],
        [23, 190, 207],
        [154, 205, 50],
        [128, 0, 0],
        [0, 0, 128],
    ];
    PALETTE[index % PALETTE.len()]
}

/// Masked pixels: grey stripes, which no colour map holds. `x`, `y` in pixels of the picture.
pub fn hatch(x: i64, y: i64) -> Rgb {
    if (x + y).rem_euclid(6) < 2 { HATCH[1] } else { HATCH[0] }
}

/// The colour, which no map holds, of the stripes over pixels whose number is not what the title says.
pub const MARK: Rgb = [255, 0, 170];

/// The stripe over a pixel of the picture, where there is one: a third of the pixels, the rest shows the value.
pub fn stripe(x: i64, y: i64) -> Option<Rgb> {
    ((x - y).rem_euclid(3) == 0).then_some(MARK)
}

/// A trace of blue, which nobody sees, tells them from the greys of smooth text.
pub const HATCH: [Rgb; 2] = [[221, 222, 223], [175, 176, 177]];

#[cfg(test)]
mod tests {
    use super::*;

    fn luma(c: Rgb) -> f64 {
        0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
    }

    /// Viridis gets brighter all the way, the diverging map brightens to its middle and darkens behind it. Half a
    /// grey level is rounding.
    #[test]
    fn brightness_is_monotone() {
        for i in 0..1000 {
            let (a, b) = (f64::from(i) / 1000.0, f64::from(i + 1) / 1000.0);
            assert!(luma(ColourMap::Sequential.colour(b)) > luma(ColourMap::Sequential.colour(a)) - 0.8, "{a}");
            let rise = luma(ColourMap::Diverging.colour(b)) - luma(ColourMap::Diverging.colour(a));
            assert!(if b <= 0.5 { rise > -0.8 } else { a < 0.5 || rise < 0.8 }, "{a}: {rise}");
        }
        assert_eq!(ColourMap::Cyclic.colour(0.0), ColourMap::Cyclic.colour(1.0));
    }

    #[test]
    fn no_map_holds_the_hatch() {
        for map in [ColourMap::Sequential, ColourMap::Diverging, ColourMap::Cyclic] {
            for i in 0..=4096 {
                let colour = map.colour(f64::from(i) / 4096.0);
                assert!(!HATCH.contains(&colour), "{map:?} at {i}");
                // 80 of the 255 steps of some channel away: nobody takes one for the other.
                let apart = (0..3).map(|c| colour[c].abs_diff(MARK[c])).max();
                assert!(apart > Some(80), "{map:?} at {i} is {colour:?}");
            }
        }
        assert!((0..16).all(|i| !HATCH.contains(&category(i)) && category(i) != MARK));
    }
}
