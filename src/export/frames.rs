//! Frames as a camera writes them: a TIFF of whole numbers for each, named by what it shows. `import_frames` reads them back.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use turbid_contract::{Artifact, ImageStack, Layer, LayerInfo, LayerKind};

use super::{ExportError, Format, publish, tiff};

/// Writes each value layer to a file of its own and tells their names: `to` with {f_x}, {phase} (its number among those of the same
/// fringes, from 0) and {wavelength} replaced.
///
/// Errors: not a .tiff; `bits` other than 8 or 16; numbers that are not whole or need more bits; one name for two layers; what [`super::export`] says.
pub fn export_frames(artifact: &Artifact, to: &Path, bits: u32) -> Result<Vec<PathBuf>, ExportError> {
    let format = Format::of(to, artifact.kind())?;
    let (Format::Tiff, Artifact::Images(stack)) = (format, artifact) else {
        return Err(ExportError::BitsOfTiff { to: to.to_owned() });
    };
    if bits != 8 && bits != 16 {
        return Err(ExportError::Bits { bits });
    }
    let layers: Vec<&Layer> = stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value).collect();
    let names: Vec<PathBuf> = layers.iter().map(|layer| named(to, stack, &layer.info)).collect();
    if names.iter().collect::<BTreeSet<_>>().len() < names.len() {
        return Err(ExportError::SameName { to: to.to_owned(), count: names.len() });
    }
    // All of them are looked at before one is written.
    let numbers = layers.iter().map(|layer| whole(layer, bits)).collect::<Result<Vec<_>, _>>()?;
    for ((layer, numbers), to) in layers.iter().zip(&numbers).zip(&names) {
        publish(to, format, |file| tiff::encode_numbers(layer, numbers, bits == 8, stack.pixel_pitch_mm(), file))?;
    }
    Ok(names)
}

fn whole(layer: &Layer, bits: u32) -> Result<Vec<u16>, ExportError> {
    let highest = f32::from(if bits == 8 { u16::from(u8::MAX) } else { u16::MAX });
    let number = |&v: &f32| {
        let fits = (0.0..=highest).contains(&v) && v.fract() == 0.0;
        fits.then_some(v as u16).ok_or_else(|| ExportError::NotWhole { layer: layer.info.name.clone(), value: v, bits })
    };
    layer.data.iter().map(number).collect()
}

fn named(to: &Path, stack: &ImageStack, info: &LayerInfo) -> PathBuf {
    let same = |other: &&LayerInfo| {
        other.kind == LayerKind::Value
            && other.f_x_per_mm == info.f_x_per_mm
            && other.orientation_deg == info.orientation_deg
            && other.wavelength_nm == info.wavelength_nm
    };
    let phase = stack.layers.iter().map(|l| &l.info).filter(same).take_while(|other| *other != info).count();
    let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    let text = to.to_string_lossy();
    let text = text.replace("{f_x}", &number(info.f_x_per_mm)).replace("{phase}", &phase.to_string());
    text.replace("{wavelength}", &number(info.wavelength_nm)).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn stack(value: f32) -> Artifact {
        let mut stack = ImageStack::new(2, 3);
        for (f_x, phase) in [(0.0, None), (0.1, Some(0.0)), (0.1, Some(2.0))] {
            let mut info = LayerInfo::value("radiance", "1").with_f_x(f_x);
            info.phase_rad = phase;
            stack.push(info.clone(), array![[0.0, 1.0, 255.0], [4.0, value, 6.0]]);
            stack.push(info.standard_error(), ndarray::Array2::from_elem((2, 3), 0.5));
        }
        Artifact::Images(stack)
    }

    /// A file for each frame, of as many bytes as its bits say, with the layer's description behind them; errors write nothing.
    #[test]
    fn each_frame_has_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let to = |name: &str| folder.path().join(name);
        for (bits, pixels) in [(8, vec![0, 1, 255, 4, 5, 6]), (16, vec![0, 0, 1, 0, 255, 0, 4, 0, 5, 0, 6, 0])] {
            let written = export_frames(&stack(5.0), &to("a_{f_x}_{phase}.tif"), bits).unwrap();
            assert_eq!(written, ["a_0_0.tif", "a_0.1_0.tif", "a_0.1_1.tif"].map(to));
            let bytes = std::fs::read(&written[2]).unwrap();
            assert_eq!(bytes[8..8 + pixels.len()], pixels);
            assert!(bytes.windows(15).any(|w| w == b"\"phase_rad\":2.0"));
        }
        let errors = [
            (stack(5.0), "x_{phase}.tif", 16, "names 3 frames alike"),
            (stack(5.5), "x_{f_x}_{phase}.tif", 16, "5.5"),
            (stack(256.0), "x_{f_x}_{phase}.tif", 8, "256"),
            (stack(f32::NAN), "x_{f_x}_{phase}.tif", 8, "NaN"),
            (stack(5.0), "x_{f_x}_{phase}.tif", 12, "8 or 16"),
            (stack(5.0), "x_{f_x}_{phase}.npz", 16, ".tiff"),
        ];
        for (artifact, name, bits, message) in errors {
            let error = export_frames(&artifact, &to(name), bits).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
