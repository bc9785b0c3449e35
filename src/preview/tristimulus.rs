//! Frames of three wavelengths, a red, a green and a blue one, as the colour picture that they are.

use turbid_contract::{ImageStack, Layer, LayerInfo, LayerKind};

use super::canvas::{Canvas, Rgb};
use super::notation::{base, particulars, quantity, unit};
use super::number::{number, plain};
use super::panel::{Note, Panel};
use super::pixels::{Pixels, Reduce, fit};
use super::text::Text;

/// Where red, green and blue lie, nm: the bands of the three kinds of sensor of a camera, without gaps.
const BANDS: [(f64, f64); 3] = [(580.0, 750.0), (490.0, 580.0), (380.0, 490.0)];

/// White is the brightest value of any colour but this part of the pixels.
const CLIPPED: f64 = 0.005;

/// Places of the layers that [`panels`] reads.
pub fn read(layers: &[LayerInfo]) -> Vec<usize> {
    let alike = |info: &LayerInfo| layers.iter().filter(|other| is_shown(other) && same_shot(other, info)).count();
    (0..layers.len()).filter(|&k| is_shown(&layers[k]) && alike(&layers[k]) == BANDS.len()).collect()
}

/// Of the phases of a fringe the first.
fn is_shown(info: &LayerInfo) -> bool {
    info.kind == LayerKind::Value && info.name == "radiance" && info.phase_rad.unwrap_or(0.0) == 0.0
}

/// One panel for each set of layers that differ in their wavelength only and have one in each band, and no fourth. Intensities have one
/// scale in all three colours, and are coded as screens decode them (sRGB).
pub fn panels(stack: &ImageStack, side: usize) -> Vec<Panel> {
    let values: Vec<&Layer> = stack.layers.iter().filter(|l| is_shown(&l.info)).collect();
    let mut firsts: Vec<&LayerInfo> = Vec::new();
    for layer in &values {
        if !firsts.iter().any(|first| same_shot(first, &layer.info)) {
            firsts.push(&layer.info);
        }
    }
    let of = |first: &LayerInfo| {
        let layers: Vec<&Layer> = values.iter().copied().filter(|l| same_shot(&l.info, first)).collect();
        let in_band = |(from, to): (f64, f64)| {
            layers.iter().copied().find(|l| l.info.wavelength_nm.is_some_and(|w| w >= from && w < to))
        };
        let [red, green, blue] = BANDS.map(in_band);
        (layers.len() == 3).then_some([red?, green?, blue?]).and_then(|colours| panel(colours, side))
    };
    firsts.into_iter().filter_map(of).collect()
}

/// Whether two layers are one shot in two channels.
fn same_shot(a: &LayerInfo, b: &LayerInfo) -> bool {
    LayerInfo { wavelength_nm: None, mean_se: None, ..a.clone() }
        == LayerInfo { wavelength_nm: None, mean_se: None, ..b.clone() }
}

fn panel(colours: [&Layer; 3], side: usize) -> Option<Panel> {
    let white = white(colours)?;
    let shown = colours.map(|l| fit(&l.data, &l.data.mapv(f32::is_finite), side, Reduce::Mean));
    let info = &colours[0].info;
    let wavelengths = colours.map(|l| plain(l.info.wavelength_nm.unwrap_or_default())).join(", ");
    let unwaved = LayerInfo { wavelength_nm: None, ..info.clone() };
    let note = |text: Text| Note { swatch: None, text };
    Some(Panel {
        title: quantity(base(&info.name)).then(" in colours"),
        subtitle: particulars(&unwaved),
        image: picture(&shown, white),
        bar: None,
        axes: None,
        notes: vec![
            note(Text::plain(format!("red, green, blue: {wavelengths} nm"))),
            note(Text::plain("white: ").join(number(white, 3)).then(" ").join(unit(&info.unit))),
        ],
    })
}

/// The brightest value that is shown; `None` where all is dark.
fn white(colours: [&Layer; 3]) -> Option<f64> {
    let mut values: Vec<f32> = colours.iter().flat_map(|l| l.data.iter().copied()).filter(|v| v.is_finite()).collect();
    let last = values.len().checked_sub(1)?;
    let rank = last - (values.len() as f64 * CLIPPED) as usize;
    let white = f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1);
    (white > 0.0).then_some(white)
}

fn picture(colours: &[Pixels; 3], white: f64) -> Canvas {
    let Pixels { rows, columns, zoom, .. } = colours[0];
    let zoom = zoom as i64;
    let mut canvas = Canvas::new(columns as i64 * zoom, rows as i64 * zoom);
    for i in 0..rows * columns {
        let (x, y) = ((i % columns) as i64 * zoom, (i / columns) as i64 * zoom);
        let colour: Rgb = std::array::from_fn(|c| byte(colours[c].cells[i].unwrap_or(0.0) / white));
        canvas.fill(x, y, zoom, zoom, colour);
    }
    canvas
}

/// A linear intensity as sRGB (IEC 61966-2-1).
fn byte(intensity: f64) -> u8 {
    let x = intensity.clamp(0.0, 1.0);
    let coded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 };
    (coded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    fn stack(wavelengths: &[f64]) -> ImageStack {
        let mut stack = ImageStack::new(10, 10);
        for phase in [0.0, 1.0] {
            for (i, &w) in wavelengths.iter().enumerate() {
                let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(0.1);
                (info.phase_rad, info.wavelength_nm, info.mean_se) = (Some(phase), Some(w), Some(i as f64));
                stack.push(info, Array2::from_elem((10, 10), [1.0, 0.5, 0.0][i % 3]));
            }
        }
        stack
    }

    /// In the order of the bands, whatever that of the channels; halves are 188 of 255. Other sets of channels are no colours.
    #[test]
    fn three_channels_are_red_green_and_blue() {
        for (wavelengths, expected) in [([630.0, 530.0, 460.0], [255, 188, 0]), ([460.0, 630.0, 530.0], [188, 0, 255])]
        {
            let panels = panels(&stack(&wavelengths), 20);
            assert_eq!(panels.len(), 1, "the first phase");
            assert_eq!(panels[0].image.get(3, 3), Some(expected), "{wavelengths:?}");
        }
        for wavelengths in
            [&[630.0, 530.0][..], &[630.0, 620.0, 460.0], &[630.0, 530.0, 460.0, 470.0], &[630.0, 530.0, 900.0]]
        {
            assert!(panels(&stack(wavelengths), 20).is_empty(), "{wavelengths:?}");
        }
        let mut dark = stack(&[630.0, 530.0, 460.0]);
        dark.layers.iter_mut().for_each(|l| l.data.fill(0.0));
        assert!(panels(&dark, 20).is_empty());
    }
}
