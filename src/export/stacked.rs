//! Image stacks of many instances in one file, or of what fits into one: NumPy's as they come, MATLAB's in chunks.

use std::path::{Path, PathBuf};

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Axes, ImageStack};

use super::archive::{Archive, Kind};
use super::heads::{Heads, Stacked};
use super::names::Names;
use super::{ExportError, Format, Unwritten, json, mat, publish};

/// Bytes of pixels in one .mat file, about; MATLAB reads variables up to 2 GiB.
const CHUNK: usize = 256 << 20;

/// The stack of one instance, its label and the values of its axes.
pub struct Images {
    pub label: String,
    pub values: Axes,
    pub stack: ImageStack,
}

/// Image stacks that come one after another, so many of them.
pub struct Stacks<I> {
    pub count: usize,
    pub stacks: I,
}

impl<I, E> Stacks<I>
where
    I: Iterator<Item = Result<Images, E>>,
    E: From<ExportError>,
{
    /// Writes them to an .npz, or to as many .mat files as they need, and tells the names.
    ///
    /// Errors: those of the stacks; another format; stacks that differ in size or number of layers; those of [`super::export`].
    pub fn export(self, to: &Path) -> Result<Vec<PathBuf>, E> {
        match to.extension().map(|ending| ending.to_string_lossy().to_lowercase()).as_deref() {
            Some("npz") => self.export_npz(to).map(|()| vec![to.to_owned()]),
            Some("mat") => self.export_mat(to, CHUNK),
            _ => Err(ExportError::NotStacked { to: to.to_owned() }.into()),
        }
    }

    /// `images` (float32, [instance, layer, row, column]), `layers` (JSON text, [layer], or [instance, layer] where they differ), `mean_se`
    /// (float64, [instance, layer]), an array for each axis, `attributes` (JSON text, of all or [instance]), `pixel_pitch_mm`.
    fn export_npz(mut self, to: &Path) -> Result<(), E> {
        let mut failed = None;
        let written = publish(to, Format::Npz, |file| {
            let mut archive = Archive::new(file);
            let mut heads = Heads::default();
            for images in self.stacks.by_ref() {
                let added = images.and_then(|Images { label, values, stack }| {
                    heads.add(label, values, &stack)?;
                    Ok(stack)
                });
                let stack = match added {
                    Ok(stack) => stack,
                    Err(error) => {
                        failed = Some(error);
                        return Err(Unwritten::Io(std::io::ErrorKind::Interrupted.into()));
                    }
                };
                if heads.values.len() == 1 {
                    let [layers, rows, columns] = heads.shape();
                    archive.begin("images", Kind::F32, &[self.count, layers, rows, columns])?;
                }
                archive.go_on(stack.layers.iter().flat_map(|l| l.data.iter()).map(|v| v.to_le_bytes()))?;
            }
            Ok(write_heads(&heads, archive)?)
        });
        match failed {
            Some(error) => Err(error),
            None => Ok(written?),
        }
    }

    /// `chunk`: bytes of pixels in a file, about.
    fn export_mat(self, to: &Path, chunk: usize) -> Result<Vec<PathBuf>, E> {
        let (mut all, mut written) = (Stacked::default(), Vec::new());
        let mut each = self.count;
        let name = |number: usize, each: usize| match each < self.count {
            false => to.to_owned(),
            true => to.with_file_name(format!("{}_{number}.mat", to.file_stem().unwrap_or_default().to_string_lossy())),
        };
        let write = |all: &Stacked, to: &Path| {
            let encoded = mat::encode_stacked(all).map_err(Unwritten::from);
            publish(to, Format::Mat, |file| Ok(std::io::Write::write_all(file, &encoded?)?))
        };
        for images in self.stacks {
            let Images { label, values, stack } = images?;
            all.heads.add(label, values, &stack)?;
            all.pixels.extend(
                stack
                    .layers
                    .iter()
                    .flat_map(|l| l.data.t().into_iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()),
            );
            if all.first == 0 && all.heads.values.len() == 1 {
                each = (chunk / all.pixels.len()).max(1);
            }
            if all.heads.values.len() == each {
                written.push(name(written.len() + 1, each));
                write(&all, written.last().expect("it was pushed"))?;
                all = Stacked { first: all.first + each, ..Stacked::default() };
            }
        }
        if !all.heads.values.is_empty() {
            written.push(name(written.len() + 1, each));
            write(&all, written.last().expect("it was pushed"))?;
        }
        Ok(written)
    }
}

/// All but the pixels.
fn write_heads<W: std::io::Write + std::io::Seek>(heads: &Heads, mut archive: Archive<W>) -> std::io::Result<()> {
    let (n, [layer_count, ..]) = (heads.values.len(), heads.shape());
    let mut names = Names::default();
    for own in ["images", "layers", "mean_se", "attributes", PIXEL_PITCH_MM] {
        names.file(own);
    }
    let text = |value: &Value| canonical_text(value);
    let layers: Vec<String> = match heads.same_layers() {
        true => heads.layers[0].iter().map(|info| text(&json(info))).collect(),
        false => heads.layers.iter().flatten().map(|info| text(&json(info))).collect(),
    };
    let shape = [n, layer_count];
    archive.texts("layers", if heads.same_layers() { &shape[1..] } else { &shape }, &layers)?;
    archive.add("mean_se", Kind::F64, &shape, heads.mean_se.iter().flatten().map(|v| v.to_le_bytes()))?;
    match heads.same_attributes() {
        true => archive.text("attributes", text(&json(&heads.attributes[0])))?,
        false => {
            let texts: Vec<String> = heads.attributes.iter().map(|own| text(&json(own))).collect();
            archive.texts("attributes", &[n], &texts)?;
        }
    }
    if let Some(pitches) = heads.pitches() {
        let shape = [pitches.len(), 2];
        let shape = if pitches.len() == 1 { &shape[1..] } else { &shape };
        archive.add(PIXEL_PITCH_MM, Kind::F64, shape, pitches.iter().flatten().map(|v| v.to_le_bytes()))?;
    }
    for (axis, cells) in heads.axes() {
        archive.column(&names.file(&axis), &cells)?;
    }
    archive.finish().map(drop)
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use serde_json::json;
    use turbid_contract::LayerInfo;
    use turbid_contract::ndarray::Array2;

    use super::*;

    fn stack(k: usize, rows: usize) -> Images {
        let mut stack = ImageStack::new(rows, 3);
        let pixel = |(r, c): (usize, usize)| (100 * k + 10 * r + c) as f32;
        stack.push(
            LayerInfo { mean_se: Some(k as f64), ..LayerInfo::value("mu_a", "mm^-1") },
            Array2::from_shape_fn((rows, 3), pixel),
        );
        stack.push(LayerInfo::value("mu_a", "mm^-1").with_f_x(0.1 * k.min(1) as f64), Array2::zeros((rows, 3)));
        stack.attributes.insert("g".into(), json!(0.8));
        stack.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 1]));
        let values = Axes::from([("mu_a".to_owned(), json!(k)), ("images".to_owned(), json!(format!("µ {k}")))]);
        Images { label: format!("maps[{k}]"), values, stack }
    }

    fn stacks(sizes: &[usize]) -> Stacks<impl Iterator<Item = Result<Images, ExportError>>> {
        let made: Vec<_> = sizes.iter().enumerate().map(|(k, &rows)| Ok(stack(k, rows))).collect();
        Stacks { count: sizes.len(), stacks: made.into_iter() }
    }

    /// An array of an archive: its description, and its bytes.
    fn array(path: &Path, name: &str) -> (String, Vec<u8>) {
        let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
        let mut bytes = Vec::new();
        archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
        let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        (String::from_utf8(bytes[10..end].to_vec()).unwrap(), bytes[end..].to_vec())
    }

    #[test]
    fn archives_hold_all_instances() {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().join("x.npz");
        assert_eq!(stacks(&[2, 2, 2]).export(&to).unwrap(), std::slice::from_ref(&to));
        let (head, bytes) = array(&to, "images");
        assert!(head.contains("(3, 2, 2, 3)"), "{head}");
        let third: Vec<u8> = stack(2, 2)
            .stack
            .layers
            .iter()
            .flat_map(|l| l.data.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
            .collect();
        assert_eq!(bytes[2 * third.len()..], third);
        // They differ in f_x, and agree in attributes and pitch; a name that is taken gets another one.
        for (name, shape) in [
            ("layers", "(3, 2)"),
            ("attributes", "()"),
            ("mean_se", "(3, 2)"),
            ("pixel_pitch_mm", "(2,)"),
            ("mu_a", "(3,)"),
            ("images_2", "(3,)"),
        ] {
            let (head, _) = array(&to, name);
            assert!(head.contains(&format!("'shape': {shape}")), "{name}: {head}");
        }
        assert_eq!(array(&to, "mu_a").1, [0_i64, 1, 2].map(i64::to_le_bytes).concat());
    }

    /// Files of MATLAB hold as many as fit; numbers say which. (Octave reads them in the tests of the Python module.)
    #[test]
    fn matlab_files_come_in_chunks() {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().join("x.mat");
        assert_eq!(stacks(&[2, 2, 2]).export(&to).unwrap(), std::slice::from_ref(&to));
        let bytes = 2 * 2 * 3 * 4;
        let written = stacks(&[2, 2, 2, 2, 2]).export_mat(&to, 2 * bytes + 1).unwrap();
        assert_eq!(written, ["x_1.mat", "x_2.mat", "x_3.mat"].map(|name| folder.path().join(name)));
        let numbers = |k: usize| std::fs::read(&written[k]).unwrap();
        for (k, range) in [[1.0_f64, 2.0], [3.0, 4.0], [5.0, 5.0]].into_iter().enumerate() {
            let range = range.map(f64::to_le_bytes).concat();
            assert!(numbers(k).windows(16).any(|w| w == range), "{k}");
            // The first column of pixels of the first instance in the file, and of no other file.
            let pixels = [0.0, 10.0].map(|v: f32| (200.0 * k as f32 + v).to_le_bytes()).concat();
            let holds = |k: usize| numbers(k).windows(8).any(|w| w == pixels);
            assert_eq!([0, 1, 2].map(holds), [0, 1, 2].map(|other| other == k));
        }
    }

    /// Nothing is left where an instance does not fit, or cannot be read.
    #[test]
    fn what_differs_is_named() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["x.npz", "x.mat"] {
            let error = stacks(&[2, 3]).export(&folder.path().join(name)).unwrap_err().to_string();
            assert!(error.contains("maps[1] has 2 layers of 3 x 3 pixels, not 2 of 2 x 3"), "{error}");
            let lost = ExportError::Bits { bits: 3 };
            let stacks = Stacks { count: 2, stacks: vec![Ok(stack(0, 2)), Err(lost)].into_iter() };
            assert!(matches!(stacks.export(&folder.path().join(name)), Err(ExportError::Bits { bits: 3 })));
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
