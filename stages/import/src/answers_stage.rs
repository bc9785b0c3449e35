//! The stages `import_maps`, `import_modulation` and `import_reflectance`.

use turbid_contract::canonical::canonical_value;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{CONDITIONS, Maps, MaskReason, Modulation, Reflectance, Rig};
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{
    Attributes, Ctx, Error, FileUse, Form, Forms, ImageStack, Known, LayerInfo, LayerKind, Problems, Stage, in_ports,
    out_ports, serde_json,
};

use crate::answers::{AnswerParams, Kind, Shown};
use crate::decode::{Picture, size};
use crate::names::base;

in_ports! {
    pub struct AnswerIn {}
}

macro_rules! answers {
    ($stage:ident, $out:ident, $port:ident, $payload:ident, $kind:expr, $name:literal, $about:literal, $doc:literal) => {
        out_ports! {
            pub struct $out {
                #[doc = $doc]
                $port: one $payload,
            }
        }

        #[doc = concat!("`use: ", $name, "`")]
        pub struct $stage;

        impl Stage for $stage {
            const NAME: &'static str = $name;
            const VERSION: u32 = 1;
            const ABOUT: &'static str = $about;

            type Params = AnswerParams;
            type In = AnswerIn<'static>;
            type Out = $out;

            fn files(params: &AnswerParams) -> Vec<FileUse> {
                files(params)
            }

            fn canonical(params: &AnswerParams) -> Result<serde_json::Value, String> {
                canonical(params)
            }

            fn check(params: &AnswerParams, known: &Known, problems: &mut Problems) {
                params.check($kind, problems);
                check_files(params, known, problems);
            }

            fn describe(params: &AnswerParams, known: &Known) -> Forms {
                Forms::from([(stringify!($port), form(params, $kind, known))])
            }

            fn run(params: &AnswerParams, _inputs: AnswerIn<'_>, ctx: Ctx<'_>) -> Result<$out, Error> {
                Ok($out { $port: $payload(stack(params, $kind, ctx)?) })
            }
        }
    };
}

answers!(
    ImportMaps,
    MapsOut,
    maps,
    Maps,
    Kind::Maps,
    "import_maps",
    "maps of mu_a, mu_s' or height that others found, from NumPy, MATLAB, TIFF and text files",
    "What was found, with standard errors where they are given."
);
answers!(
    ImportModulation,
    ModulationOut,
    modulation,
    Modulation,
    Kind::Modulation,
    "import_modulation",
    "M_DC and M_AC that others demodulated, from NumPy, MATLAB, TIFF and text files",
    "What was demodulated, with standard errors where they are given."
);
answers!(
    ImportReflectance,
    ReflectanceOut,
    reflectance,
    Reflectance,
    Kind::Reflectance,
    "import_reflectance",
    "R_d that others calibrated, from NumPy, MATLAB, TIFF and text files",
    "What was calibrated, with standard errors where they are given."
);

fn files(params: &AnswerParams) -> Vec<FileUse> {
    let layers = params.layers.iter().enumerate().map(|(k, layer)| (format!("layers.{k}.file"), layer.file.clone()));
    let mask = params.mask.iter().map(|mask| ("mask.file".to_owned(), mask.file.clone()));
    layers.chain(mask).map(|(at, path)| FileUse::new(at, path, params.max_file_mb)).collect()
}

fn canonical(params: &AnswerParams) -> Result<serde_json::Value, String> {
    let mut params = params.clone();
    params.layers.iter_mut().for_each(|layer| layer.file = base(&layer.file));
    params.mask.iter_mut().for_each(|mask| mask.file = base(&mask.file));
    canonical_value(&params)
}

/// Reports files that cannot be read, images of different sizes, and images without a number.
fn check_files(params: &AnswerParams, known: &Known, problems: &mut Problems) {
    let mut first: Option<(String, [usize; 2])> = None;
    for FileUse { at, path, .. } in files(params) {
        let Some(bytes) = known.files.get(&at) else { continue };
        let picture = match params.read(&at, &bytes) {
            Ok(picture) => picture,
            Err(what) => {
                problems.push(at, format!("`{path}`: {what}"));
                continue;
            }
        };
        let size = [picture.columns, picture.rows];
        match &first {
            None => first = Some((path.clone(), size)),
            Some((_, known)) if *known == size => {}
            Some((other, [c, r])) => {
                let [columns, rows] = size;
                problems.push(at.as_str(), format!("`{path}` has {columns} x {rows} pixels, `{other}` has {c} x {r}"));
            }
        }
        if picture.values.iter().all(|v| !v.is_finite()) {
            problems.push(at, format!("no pixel of `{path}` is a finite number"));
        }
    }
}

fn said(params: &AnswerParams, kind: Kind) -> Attributes {
    let mut attributes = Attributes::new();
    if let Some(pixel) = params.pixel_mm {
        attributes.insert(PIXEL_PITCH_MM.to_owned(), vec![pixel.0; 2].into());
    }
    if let Some(name) = params.rig.as_deref().map(str::trim).filter(|name| !name.is_empty()) {
        Rig::named(name).insert_into(&mut attributes);
    }
    if let Some(conditions) = &params.conditions {
        conditions.said().insert_into(&mut attributes, CONDITIONS);
        if kind == Kind::Reflectance {
            let own = [("g", conditions.g), ("n", conditions.n)];
            attributes.extend(own.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?.0.into()))));
        }
    }
    if let Some(convention) = params.convention {
        let value = serde_json::to_value(convention).expect("a word is a JSON value");
        attributes.insert("convention".to_owned(), value);
    }
    attributes
}

/// The size is that of the first file; it is open where its header cannot be read.
fn form(params: &AnswerParams, kind: Kind, known: &Known) -> Form {
    let shown = params.shown(kind);
    let mut perhaps: Vec<LayerInfo> = Vec::new();
    for mask in shown.iter().map(|s| mask(s.info.wavelength_nm)) {
        if !perhaps.contains(&mask) {
            perhaps.push(mask);
        }
    }
    let first =
        params.layers.first().and_then(|layer| Some((layer.variable.as_deref(), known.files.get("layers.0.file")?)));
    let whole = first.and_then(|(variable, bytes)| size(&bytes, variable, None).ok());
    let pixels = whole.map(|(columns, rows)| {
        let (columns, rows) = params.crop.map_or((columns, rows), |[_, _, w, h]| (w as usize, h as usize));
        [rows as u64, columns as u64]
    });
    let layers = Some(shown.into_iter().map(|s| s.info).collect());
    Form { pixels, layers, perhaps, ..Form::said(said(params, kind)) }
}

/// The mask of a wavelength: there where a pixel is bad.
fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

fn stack(params: &AnswerParams, kind: Kind, ctx: Ctx<'_>) -> Result<ImageStack, Error> {
    let shown = params.shown(kind);
    let load = |at: &str, path: &str| -> Result<Picture, Error> {
        let bytes = ctx.file(at).ok_or_else(|| Error::failed(format!("`{path}` was not read")))?;
        params.read(at, &bytes).map_err(|what| Error::invalid(at, format!("`{path}`: {what}")))
    };
    let read = |k: usize| load(&format!("layers.{k}.file"), &params.layers[k].file);
    let pictures: Vec<Picture> = ctx.map_tiles(params.layers.len(), read)?.into_iter().collect::<Result<_, _>>()?;
    let Some(first) = pictures.first() else { return Err(Error::failed("no layer is named")) };
    let (rows, columns) = (first.rows, first.columns);
    let outside = params.mask.as_ref().map(|mask| load("mask.file", &mask.file)).transpose()?;
    if pictures.iter().chain(&outside).any(|p| (p.rows, p.columns) != (rows, columns)) {
        return Err(Error::failed("the images differ in size"));
    }
    let mut masks: Vec<(Option<f64>, Vec<f32>)> = Vec::new();
    for Shown { info, of, factor } in &shown {
        let at = masks.iter().position(|(w, _)| *w == info.wavelength_nm).unwrap_or_else(|| {
            let outside = |i: usize| outside.as_ref().is_some_and(|o| o.values.at(i) != 0.0);
            let reason = |i: usize| if outside(i) { MaskReason::Background } else { MaskReason::Good };
            masks.push((info.wavelength_nm, (0..rows * columns).map(|i| reason(i).code()).collect()));
            masks.len() - 1
        });
        let finite = |i: usize| ((pictures[*of].values.at(i) * factor) as f32).is_finite();
        masks[at]
            .1
            .iter_mut()
            .enumerate()
            .filter(|(i, m)| **m == 0.0 && !finite(*i))
            .for_each(|(_, m)| *m = MaskReason::NotFinite.code());
    }
    let mut stack = ImageStack::new(rows, columns);
    stack.attributes = said(params, kind);
    for own in &shown {
        let mut info = own.info.clone();
        let mask = &masks.iter().find(|(w, _)| *w == info.wavelength_nm).expect("one for each wavelength").1;
        let value = |s: &Shown, i: usize| if mask[i] == 0.0 { pictures[s.of].values.at(i) * s.factor } else { 0.0 };
        let se = shown.iter().find(|s| info.kind == LayerKind::Value && s.info == info.standard_error());
        let good = mask.iter().filter(|m| **m == 0.0).count() as f64;
        info.mean_se = se.filter(|_| good > 0.0).map(|se| {
            let variance: f64 = (0..mask.len()).map(|i| value(se, i)).map(|se| se * se).sum();
            variance.sqrt() / good
        });
        let pixels = (0..rows * columns).map(|i| value(own, i) as f32).collect();
        stack.push(info, Array2::from_shape_vec((rows, columns), pixels).expect("checked: one size"));
    }
    ctx.measure_masked(masks.iter().flat_map(|(_, mask)| mask.iter().copied()));
    for (wavelength_nm, pixels) in masks {
        if pixels.iter().any(|&reason| reason != 0.0) {
            let plane = Array2::from_shape_vec((rows, columns), pixels).expect("checked: one size");
            stack.push(mask(wavelength_nm), plane);
        }
    }
    Ok(stack)
}
