//! The stage `import_frames`.

use std::borrow::Cow;
use std::sync::Mutex;

use turbid_contract::canonical::canonical_value;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{CameraNoise, Frames, Transfer};
use turbid_contract::{
    At, Ctx, Error, FileUse, Form, Forms, ImageStack, Known, LayerInfo, Problem, Problems, Stage, StagePlan, in_ports,
    out_ports, serde_json,
};

use crate::correct::{Camera, Corrected, Field, Light};
use crate::decode::{self, Picture, pages};
use crate::form;
use crate::frame::{ByNumber, Frame, Planes};
use crate::names::base;
use crate::params::{Params, Shot};

in_ports! {
    pub struct In {
        /// Noise of the camera, in the place of full_well and read_noise.
        transfer: optional Transfer,
    }
}

out_ports! {
    pub struct Out {
        /// The frames as radiance (or in the unit 1), with standard errors where the camera's noise is known.
        frames: one Frames,
    }
}

/// `use: import_frames`
pub struct ImportFrames;

impl Stage for ImportFrames {
    const NAME: &'static str = "import_frames";
    const VERSION: u32 = 3;
    const ABOUT: &'static str =
        "measured frames from PNG, TIFF, EXR, BMP, PGM, NumPy and raw files, corrected by dark and flat field";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn files(params: &Params) -> Vec<FileUse> {
        let fields = [("dark", &params.dark), ("flat", &params.flat)];
        let fields = fields.into_iter().filter_map(|(at, path)| Some((at.to_owned(), path.clone()?)));
        let darks = params.darks.iter().enumerate().map(|(k, dark)| (format!("darks.{k}.file"), dark.file.clone()));
        let named = params.shots().into_iter().map(|s| (s.at, s.file)).chain(fields).chain(darks);
        named.map(|(at, path)| FileUse::new(at, path, params.max_file_mb)).collect()
    }

    fn canonical(params: &Params) -> Result<serde_json::Value, String> {
        let mut params = params.clone();
        params.frames.iter_mut().for_each(|f| f.file = base(&f.file));
        params.darks.iter_mut().for_each(|d| d.file = base(&d.file));
        for path in [&mut params.pattern, &mut params.dark, &mut params.flat].into_iter().flatten() {
            *path = base(path);
        }
        canonical_value(&params)
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        params.check(problems);
        params.check_meaning(problems);
        if known.is_connected("transfer") {
            params.check_transfer(problems);
        }
        let shots = params.shots();
        let decoded = |at: &str, path: &str| {
            let picture = params.read_at(&shots, at, &known.files.get(at)?);
            Some(picture.map_err(|what| Error::invalid(at, format!("`{path}`: {what}"))))
        };
        // Pictures of dark and flat field that cannot be read are named with the others.
        let absent = || Error::failed("it was not read");
        let load = |at: &str, path: &str| decoded(at, path).unwrap_or_else(|| Err(absent()));
        let fields = if problems.is_empty() { Fields::of(params, &params.camera(None), load) } else { Err(absent()) };
        unread_pages(params, &shots, known, problems);
        let mut first: Option<(String, [usize; 2])> = None;
        for FileUse { at, path, .. } in Self::files(params) {
            let picture = match decoded(&at, &path) {
                None => continue,
                Some(Err(error)) => {
                    push(error, problems);
                    continue;
                }
                Some(Ok(picture)) => picture,
            };
            let size = [picture.columns, picture.rows];
            odd_numbers(&at, &path, &picture, problems);
            match &first {
                None => first = Some((path, size)),
                Some((_, known)) if *known == size => {}
                Some((other, [c, r])) => {
                    let [columns, rows] = size;
                    problems.push(at, format!("`{path}` has {columns} x {rows} pixels, `{other}` has {c} x {r}"));
                    continue;
                }
            }
            match (&fields, shots.iter().find(|shot| shot.at == at)) {
                (Ok(fields), Some(shot)) if fields.fit(&picture) => {
                    if let Err(error) = usable(shot, fields.light(params, &params.camera(None), shot, &picture)) {
                        push(error, problems);
                    }
                }
                _ => {}
            }
        }
        if let Err(error @ Error::Invalid(_)) = fields
            && problems.is_empty()
        {
            push(error, problems);
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let parts = [
            ("dark field", params.dark.is_some() || !params.darks.is_empty()),
            ("flat field", params.flat.is_some()),
            ("gamma", params.gamma != 1.0),
            ("standard errors (full_well, or transfer)", params.full_well.is_some() || known.is_connected("transfer")),
        ];
        let named = |on: bool| parts.iter().filter(|p| p.1 == on).map(|p| p.0.to_owned()).collect::<Vec<String>>();
        let mut left_out = named(false);
        let even = params.f_x.iter().any(|f_x| f_x.0 == 0.0);
        if params.pattern.is_some() && params.phases > 1 && params.phases_at_0 == 1 && even {
            left_out.push("phases at f_x = 0 but number 0 (phases_at_0 reads them)".to_owned());
        }
        StagePlan { needs: named(true), left_out, memory: memory(params, known), ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let shots = params.shots();
        if shots.is_empty() {
            return Err(Error::failed("no files of frames are named, or too many"));
        }
        let load = |at: &str, path: &str| -> Result<Picture, Error> {
            let bytes = ctx.file(at).ok_or_else(|| Error::failed(format!("`{path}` was not read")))?;
            params.read_at(&shots, at, &bytes).map_err(|what| Error::invalid(at, format!("`{path}`: {what}")))
        };
        let noise = inputs.transfer.as_ref().map(|Transfer(table)| CameraNoise::of(&table.attributes)).transpose()?;
        let camera = params.camera(noise.as_ref());
        let fields = Fields::of(params, &camera, load)?;
        let read = |k: usize| -> Result<Seen, Error> {
            let picture = load(&shots[k].at, &shots[k].file)?;
            let size = (picture.rows, picture.columns);
            if params.bin == 1 {
                return Ok(Seen { size, frame: fields.frame(params, &camera, &shots[k], picture) });
            }
            let corrected = fields.correct(params, &camera, &shots[k], &picture);
            let (size, corrected) = corrected.binned(size, params.bin as usize);
            Ok(Seen { size, frame: Frame::Pixels(corrected) })
        };
        let mut frames: Option<Stacked> = None;
        for channel in channels(&shots) {
            let seen: Vec<Seen> =
                ctx.map_tiles(channel.len(), |i| read(channel[i]))?.into_iter().collect::<Result<_, _>>()?;
            for (&k, seen) in channel.iter().zip(&seen) {
                usable(&shots[k], seen.frame.light())?;
            }
            let (rows, columns) = seen[0].size;
            let frames = frames.get_or_insert_with(|| Stacked::new(params, &shots, rows, columns));
            frames.add(&channel, seen, ctx)?;
        }
        let frames = frames.expect("there are shots").finish(ctx);
        Ok(Out { frames: Frames(frames) })
    }
}

/// Bytes that the run holds at the most; `None` where the size of the pictures is not known.
///
/// Beside the frames there are the masks of all wavelengths, the frames of one as they are read (2 bytes a pixel and no more than 4 while they are, where all pixels
/// are alike; else value, variance and reason), and the fields.
fn memory(params: &Params, known: &Known) -> Option<u64> {
    let form = form::describe(params, known).remove("frames")?;
    let made = Form { perhaps: Vec::new(), ..form.clone() }.extent()?;
    let shots = params.shots();
    let most = channels(&shots).iter().map(Vec::len).max().unwrap_or(0) as u64;
    let fields = params.darks.len() as u64 + u64::from(params.dark.is_some()) + u64::from(params.flat.is_some());
    let alike = fields == 0 && params.bin == 1;
    let of_pixel = if alike { 6 } else { 24 };
    let read = made.pixels() * u64::from(params.bin * params.bin);
    Some(made.bytes() + 4 * made.pixels() * form.perhaps.len() as u64 + read * (of_pixel * most + 8 * fields))
}

/// The shots of each wavelength, by their places.
fn channels(shots: &[Shot]) -> Vec<Vec<usize>> {
    let mut channels: Vec<Vec<usize>> = Vec::new();
    for (k, shot) in shots.iter().enumerate() {
        match channels.iter_mut().find(|channel| shots[channel[0]].wavelength_nm == shot.wavelength_nm) {
            Some(channel) => channel.push(k),
            None => channels.push(vec![k]),
        }
    }
    channels
}

/// Reports pages that no frame is: files of pictures one does not know of.
fn unread_pages(params: &Params, shots: &[Shot], known: &Known, problems: &mut Problems) {
    for (k, shot) in shots.iter().enumerate().filter(|(_, shot)| shot.page.is_some()) {
        if shots[..k].iter().any(|other| other.file == shot.file) {
            continue;
        }
        let Some(Ok(there)) =
            known.files.get(&shot.at).map(|bytes| pages(&bytes, shot.variable.as_deref(), params.raw))
        else {
            continue;
        };
        let read = |page: &usize| shots.iter().any(|other| other.file == shot.file && other.page == Some(*page));
        let unread: Vec<String> = (0..there).filter(|page| !read(page)).map(|page| (page + 1).to_string()).collect();
        if !unread.is_empty() {
            let message = format!("`{}` has {there} pages, and no frame is page {}", shot.file, unread.join(", "));
            problems.push_with_hint(shot.at.as_str(), message, "name it, or save the file without it");
        }
    }
}

/// Floating-point files say no highest number: shares of full scale they should hold, but may hold anything.
fn odd_numbers(at: &str, path: &str, picture: &Picture, problems: &mut Problems) {
    /// Light beyond full scale by more than this is no light.
    const MOST: f64 = 10.0;
    if picture.values.highest().is_some() {
        return;
    }
    let odd = picture.values.iter().filter(|v| !v.is_finite()).count();
    if odd > 0 {
        problems.warn(
            at,
            format!("`{path}`: {odd} of {} pixels are no finite numbers; they are masked", picture.values.len()),
        );
    }
    let largest = picture.values.iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
    if picture.highest.is_none() && largest > MOST {
        problems.push_with_hint(
            at,
            format!("`{path}` holds floating-point numbers up to {largest}, and does not say which is the highest of the camera"),
            "bits: 16, for counts of up to 65535; without it 1 is full scale",
        );
    }
}

fn push(error: Error, problems: &mut Problems) {
    if let Error::Invalid(Problem { path, message, hint, .. }) = error {
        match hint {
            Some(hint) => problems.push_with_hint(path, message, hint),
            None => problems.push(path, message),
        }
    }
}

/// Dark levels and response of the pixels, where there are pictures of them.
struct Fields {
    /// In the order of `darks`, or the one `dark`.
    darks: Vec<Field>,
    response: Option<Field>,
}

impl Fields {
    /// Error: a picture that cannot be read, a flat field without light.
    fn of(
        params: &Params,
        camera: &Camera,
        load: impl Fn(&str, &str) -> Result<Picture, Error>,
    ) -> Result<Self, Error> {
        let of_one = params.dark.iter().map(|path| load("dark", path));
        let of_many = params.darks.iter().enumerate().map(|(k, d)| load(&format!("darks.{k}.file"), &d.file));
        let darks: Vec<Picture> = of_one.chain(of_many).collect::<Result<_, _>>()?;
        let flat = params.flat.as_ref().map(|path| load("flat", path)).transpose()?;
        let pixels = darks.iter().chain(&flat).map(|picture| picture.values.len());
        if pixels.clone().any(|n| Some(n) != pixels.clone().next()) {
            return Err(Error::failed("dark and flat field differ in size"));
        }
        let darks: Vec<Field> = darks.iter().map(|picture| camera.dark(picture)).collect();
        // Under which light and exposure the flat field was taken is not said: the mean of all serves.
        let dark = Field::mean(&darks.iter().collect::<Vec<_>>());
        let response = flat
            .map(|flat| camera.response(&flat, dark.as_ref()).map_err(|what| Error::invalid("flat", what)))
            .transpose()?;
        Ok(Self { darks, response })
    }

    /// The dark level of a frame's pixels.
    fn dark(&self, params: &Params, shot: &Shot) -> Option<Cow<'_, Field>> {
        let own = |k: usize| params.darks.get(k).is_none_or(|dark| dark.is_for(shot));
        let of_shot = self.darks.iter().enumerate().filter(|(k, _)| own(*k)).map(|(_, field)| field);
        match of_shot.collect::<Vec<_>>()[..] {
            [one] => Some(Cow::Borrowed(one)),
            ref several => Field::mean(several).map(Cow::Owned),
        }
    }

    /// Whether they have as many pixels as the frame.
    fn fit(&self, frame: &Picture) -> bool {
        self.darks.iter().chain(&self.response).all(|field| field.len() == frame.values.len())
    }

    fn light(&self, params: &Params, camera: &Camera, shot: &Shot, picture: &Picture) -> Light {
        camera.light(picture, self.dark(params, shot).as_deref(), self.response.as_ref(), shot.light())
    }

    fn frame(&self, params: &Params, camera: &Camera, shot: &Shot, picture: Picture) -> Frame {
        let dark = self.dark(params, shot);
        let of = camera.of_numbers(&picture, dark.as_deref(), self.response.as_ref(), shot.light());
        match (of.map(|(_, of)| ByNumber::of(&of)), picture.values) {
            (Some(of), decode::Numbers::U16(numbers)) => Frame::Numbers { numbers, of },
            (_, values) => Frame::Pixels(self.correct(params, camera, shot, &Picture { values, ..picture })),
        }
    }

    fn correct(&self, params: &Params, camera: &Camera, shot: &Shot, picture: &Picture) -> Corrected {
        camera.correct(picture, self.dark(params, shot).as_deref(), self.response.as_ref(), shot.light())
    }
}

/// A frame that shows nothing is a mistake of the set-up, not a dark tissue.
fn usable(shot: &Shot, light: Light) -> Result<(), Error> {
    if 2 * light.saturated > light.pixels {
        let share = 100.0 * light.saturated as f64 / light.pixels as f64;
        return Err(Error::Invalid(Problem {
            at: At::With,
            path: shot.at.clone(),
            message: format!("{share:.0} % of the pixels of `{}` are saturated", shot.file),
            hint: Some("take it with less light, or raise `saturation` if the range goes further".into()),
        }));
    }
    if light.bright == 0 {
        let message = format!("no pixel of `{}` is brighter than darkness", shot.file);
        return Err(Error::invalid(shot.at.as_str(), message));
    }
    Ok(())
}

/// A frame, and its rows and columns.
struct Seen {
    size: (usize, usize),
    frame: Frame,
}

/// The layers that are made: wavelength by wavelength, so that no more than the frames of one are held beside them.
struct Stacked<'a> {
    params: &'a Params,
    shots: &'a [Shot],
    rows: usize,
    columns: usize,
    /// In the order of the shots.
    values: Vec<Option<(LayerInfo, Array2<f32>)>>,
    errors: Vec<Option<(LayerInfo, Array2<f32>)>>,
    masks: Vec<(Option<f64>, Vec<f32>)>,
}

impl<'a> Stacked<'a> {
    fn new(params: &'a Params, shots: &'a [Shot], rows: usize, columns: usize) -> Self {
        let none = || shots.iter().map(|_| None).collect();
        Self { params, shots, rows, columns, values: none(), errors: none(), masks: Vec::new() }
    }

    /// The frames of one wavelength, which have one mask. Error: the run was cancelled.
    fn add(&mut self, channel: &[usize], seen: Vec<Seen>, ctx: Ctx<'_>) -> Result<(), Error> {
        let (rows, columns) = (self.rows, self.columns);
        let plane = |pixels: Vec<f32>| Array2::from_shape_vec((rows, columns), pixels).expect("checked: one size");
        let mut mask = vec![0.0; rows * columns];
        seen.iter().for_each(|seen| seen.frame.mask(&mut mask));
        let good = mask.iter().filter(|&&m| m == 0.0).count() as f64;
        let frames: Vec<Mutex<Option<Frame>>> = seen.into_iter().map(|seen| Mutex::new(Some(seen.frame))).collect();
        let made = ctx.map_tiles(frames.len(), |i| {
            let frame = frames[i].lock().ok().and_then(|mut frame| frame.take());
            frame.expect("each frame is taken once").planes(&mask)
        })?;
        for (&k, Planes { value, errors }) in channel.iter().zip(made) {
            let mut info = form::layer(self.params, &self.shots[k]);
            if let Some((se, sum)) = errors {
                info.mean_se = (good > 0.0).then(|| sum.sqrt() / good);
                self.errors[k] = Some((info.standard_error(), plane(se)));
            }
            self.values[k] = Some((info, plane(value)));
        }
        self.masks.push((self.shots[channel[0]].wavelength_nm, mask));
        Ok(())
    }

    fn finish(self, ctx: Ctx<'_>) -> ImageStack {
        let (rows, columns) = (self.rows, self.columns);
        let mut stack = ImageStack::new(rows, columns);
        stack.attributes = form::said(self.params);
        let layers = self.values.into_iter().chain(self.errors).flatten();
        layers.for_each(|(info, data)| stack.push(info, data));
        ctx.measure_masked(self.masks.iter().flat_map(|(_, mask)| mask.iter().copied()));
        for (wavelength_nm, mask) in self.masks {
            if mask.iter().any(|&reason| reason != 0.0) {
                let mask = Array2::from_shape_vec((rows, columns), mask).expect("as many as pixels");
                stack.push(form::mask(wavelength_nm), mask);
            }
        }
        stack
    }
}
