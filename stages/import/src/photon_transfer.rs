//! The stage `photon_transfer`: electrons per number and read noise of a camera, from frames of a scene that does not change.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{CameraNoise, Transfer};
use turbid_contract::{
    Cells, Ctx, Error, FileUse, Form, Forms, Known, MaxFile, Problems, Stage, Table, in_ports, out_ports, serde_json,
};

use crate::decode::{Channel, Picture, Raw, Wanted, decode, pages};
use crate::names::base;
use crate::transfer::{Burst, Line, Point, ROUNDING};

/// Params of `photon_transfer`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransferParams {
    /// Frames of one scene under one light that do not differ but by noise, two or more each: frames of all levels of the camera are best, of one scene with
    /// dark and bright parts, or several of different exposure.
    pub bursts: Vec<BurstParams>,
    /// The same without light: gives the black level, and the read noise by itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dark: Option<BurstParams>,
    /// What the camera reads without light, in the numbers of the file, where no burst tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<f64>,
    /// Of the camera, where its numbers fill only part of the file's, or are counts in floating-point files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// Share of the highest number from which on a pixel is left out.
    pub saturation: f64,
    /// Which channel of coloured files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// Name of the array in files of NumPy (.npz) and MATLAB that hold several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Part of each picture, px: left, top, width, height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// Files without a header: what they hold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub raw: Option<Raw>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(skip_serializing)]
    pub max_file_mb: MaxFile,
}

/// Frames of one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BurstParams {
    /// Relative to the pipeline file; of a file with several pictures each is a frame.
    pub files: Vec<String>,
}

impl Default for TransferParams {
    fn default() -> Self {
        Self {
            bursts: Vec::new(),
            dark: None,
            black_level: None,
            bits: None,
            saturation: 0.98,
            channel: None,
            variable: None,
            crop: None,
            raw: None,
            max_file_mb: MaxFile::default(),
        }
    }
}

in_ports! {
    pub struct TransferIn {}
}

out_ports! {
    pub struct TransferOut {
        /// Variance over level, with the line through it; import_frames takes the noise of its camera from there.
        transfer: one Transfer,
    }
}

/// `use: photon_transfer`
pub struct PhotonTransfer;

impl Stage for PhotonTransfer {
    const NAME: &'static str = "photon_transfer";
    const VERSION: u32 = 1;
    const ABOUT: &'static str =
        "electrons per number and read noise of a camera, from frames that differ by noise alone";

    type Params = TransferParams;
    type In = TransferIn<'static>;
    type Out = TransferOut;

    fn files(params: &TransferParams) -> Vec<FileUse> {
        params.named().map(|(at, path)| FileUse::new(at, path, params.max_file_mb)).collect()
    }

    fn canonical(params: &TransferParams) -> Result<serde_json::Value, String> {
        let mut params = params.clone();
        params
            .bursts
            .iter_mut()
            .chain(&mut params.dark)
            .flat_map(|burst| &mut burst.files)
            .for_each(|path| *path = base(path));
        canonical_value(&params)
    }

    fn check(params: &TransferParams, known: &Known, problems: &mut Problems) {
        params.check(problems);
        if !problems.is_empty() {
            return;
        }
        let mut size: Option<[usize; 2]> = None;
        for (at, burst) in params.bursts() {
            let mut frames = 0;
            let mut complete = true;
            for (k, path) in burst.files.iter().enumerate() {
                let field = format!("{at}.files.{k}");
                let Some(bytes) = known.files.get(&field) else {
                    complete = false;
                    continue;
                };
                match params.frames(&bytes) {
                    Err(what) => {
                        complete = false;
                        problems.push(field, format!("`{path}`: {what}"));
                    }
                    Ok(pictures) => {
                        frames += pictures.len();
                        let own = pictures.first().map(|p| [p.columns, p.rows]);
                        let differs = size.zip(own).filter(|(size, own)| size != own);
                        if let Some(([c, r], [columns, rows])) = differs {
                            let message = format!("`{path}` has {columns} x {rows} pixels, others {c} x {r}");
                            problems.push(field, message);
                        }
                        size = size.or(own);
                    }
                }
            }
            if complete && frames < 2 {
                let hint = "noise is what differs between frames of the same: name two or more, or a file with pages";
                problems.push_with_hint(format!("{at}.files"), format!("a burst of {frames} frames"), hint);
            }
        }
    }

    fn describe(_params: &TransferParams, _known: &Known) -> Forms {
        Forms::from([("transfer", Form::table(None, &COLUMNS))])
    }

    fn run(params: &TransferParams, _inputs: TransferIn<'_>, ctx: Ctx<'_>) -> Result<TransferOut, Error> {
        let load = |at: &str, burst: &BurstParams| -> Result<(Burst, Option<f64>), Error> {
            let mut frames = Vec::new();
            let mut highest = None;
            for (k, path) in burst.files.iter().enumerate() {
                let field = format!("{at}.files.{k}");
                let bytes = ctx.file(&field).ok_or_else(|| Error::failed(format!("`{path}` was not read")))?;
                let wrong = |what: String| Error::invalid(field.as_str(), format!("`{path}`: {what}"));
                for picture in params.frames(&bytes).map_err(wrong)? {
                    highest = picture.highest;
                    let bright = picture.highest.map_or(f64::INFINITY, |highest| params.saturation * highest);
                    let usable = |v: f64| if v < bright { v } else { f64::NAN };
                    frames.push(picture.values.iter().map(usable).collect::<Vec<f64>>());
                }
            }
            let pixels = frames.first().map_or(0, Vec::len);
            if frames.iter().any(|frame| frame.len() != pixels) {
                return Err(Error::invalid(format!("{at}.files"), "the frames of the burst differ in size"));
            }
            Ok((Burst { frames }, highest))
        };
        let dark = params.dark.as_ref().map(|burst| load("dark", burst)).transpose()?;
        let of_dark = dark.as_ref().and_then(|(burst, _)| burst.mean());
        let black = params.black_level.or(of_dark).unwrap_or(0.0);
        let mut points: Vec<Point> = dark.iter().flat_map(|(burst, _)| burst.points(None, black)).collect();
        let mut highest = None;
        for (k, burst) in params.bursts.iter().enumerate() {
            let (burst, own) = load(&format!("bursts.{k}"), burst)?;
            highest = own;
            points.extend(burst.points(Some(k), black));
            ctx.checked()?;
        }
        let line = Line::through(&points).ok_or_else(|| {
            Error::failed_with_hint(
                "the variance of the frames does not rise with their level: no gain can be told",
                "take frames with dark and bright parts, or bursts of different exposure, of a scene and a light that do not change",
            )
        })?;
        said(params, &points, &line, ctx);
        let gain = 1.0 / line.slope;
        let read = (line.dark - ROUNDING).max(0.0).sqrt();
        let noise = CameraNoise {
            electrons_per_number: gain,
            electrons_per_number_se: gain * line.slope_se / line.slope,
            read_noise: gain * read,
            // Of a variance that is not above 0 the error is that of its upper end.
            read_noise_se: gain * if read > 0.0 { line.dark_se / (2.0 * read) } else { line.dark_se.sqrt() },
            black_level: black,
            highest,
            full_well: highest.map(|highest| gain * highest),
        };
        ctx.measure("electrons per number", noise.electrons_per_number, "1");
        ctx.measure("read noise", noise.read_noise, "electrons");
        noise
            .full_well
            .into_iter()
            .for_each(|full_well| ctx.measure("electrons at the highest number", full_well, "1"));
        let mut table = table(&points, &line);
        noise.insert_into(&mut table.attributes);
        Ok(TransferOut { transfer: Transfer(table) })
    }
}

/// Warnings: what keeps the line from being the camera's.
fn said(params: &TransferParams, points: &[Point], line: &Line, ctx: Ctx<'_>) {
    // The mean square of n deviations scatters by sqrt(2 / n).
    let freedom = (points.len() as f64 - 2.0).max(1.0);
    let most = 1.0 + 4.0 * (2.0 / freedom).sqrt();
    if line.chi2 > most.max(2.0) {
        ctx.warn(format!(
            "the variances are no straight line over the level (mean square deviation {:.1} standard errors squared): the scene or the light has changed between the frames, or the camera is not linear (gamma, a curve, packed files); the gain is that of the best line",
            line.chi2
        ));
    }
    if line.dark < ROUNDING {
        ctx.warn("the line ends below the variance of rounding: the read noise is smaller than what these frames can tell, and stands as 0");
    }
    if params.dark.is_none() && params.black_level.is_none() {
        ctx.warn("neither `dark` frames nor `black_level` are given: the black level is taken as 0, and what it truly is makes the read noise wrong");
    }
}

/// Columns of the table.
const COLUMNS: [(&str, &str); 6] =
    [("burst", "1"), ("level", "1"), ("variance", "1"), ("variance_se", "1"), ("fitted", "1"), ("pixels", "1")];

fn table(points: &[Point], line: &Line) -> Table {
    let number = |of: &dyn Fn(&Point) -> f64| Cells::F64(points.iter().map(of).collect());
    let cells = [
        Cells::I64(points.iter().map(|p| p.burst.map_or(0, |k| k as i64 + 1)).collect()),
        number(&|p| p.level),
        number(&|p| p.variance),
        number(&|p| p.variance * (2.0 / p.degrees).sqrt()),
        number(&|p| line.at(p.level)),
        Cells::I64(points.iter().map(|p| p.pixels as i64).collect()),
    ];
    let mut table = Table::default();
    COLUMNS.into_iter().zip(cells).for_each(|((name, unit), cells)| table.push(name, unit, cells));
    table
}

impl TransferParams {
    /// All bursts with the fields that name them.
    fn bursts(&self) -> impl Iterator<Item = (String, &BurstParams)> {
        let lit = self.bursts.iter().enumerate().map(|(k, burst)| (format!("bursts.{k}"), burst));
        lit.chain(self.dark.iter().map(|burst| ("dark".to_owned(), burst)))
    }

    fn named(&self) -> impl Iterator<Item = (String, String)> {
        let files = |(at, burst): (String, &BurstParams)| -> Vec<(String, String)> {
            let of = |(k, file): (usize, &String)| (format!("{at}.files.{k}"), file.clone());
            burst.files.iter().enumerate().map(of).collect()
        };
        self.bursts().flat_map(files)
    }

    /// Every picture of a file.
    fn frames(&self, bytes: &[u8]) -> Result<Vec<Picture>, String> {
        let variable = self.variable.as_deref();
        let read = |page: usize| {
            let wanted = Wanted { channel: self.channel, page: Some(page), variable, raw: self.raw };
            decode(bytes, wanted)?.of_bits(self.bits)?.cropped(self.crop)
        };
        (0..pages(bytes, variable, self.raw)?).map(read).collect()
    }

    fn check(&self, problems: &mut Problems) {
        if self.bursts.is_empty() {
            let hint = "bursts: [{files: [a1.tif, a2.tif]}], frames of one scene under one light";
            problems.push_with_hint("bursts", "no frames are named", hint);
        }
        if self.dark.is_some() && self.black_level.is_some() {
            problems.push("black_level", "the black level comes from `dark` and from `black_level`; give one of them");
        }
        if let Some(v) = self.black_level {
            problems.require(v.is_finite() && v >= 0.0, "black_level", v, "", "be a finite number >= 0");
        }
        if let Some(bits) = self.bits {
            problems.require((1..=32).contains(&bits), "bits", f64::from(bits), "bits", "lie in [1, 32]");
        }
        let saturation = self.saturation;
        problems.require(saturation > 0.0 && saturation <= 1.0, "saturation", saturation, "", "lie in (0, 1]");
        let mut seen: Vec<(String, String)> = Vec::new();
        for (at, file) in self.named() {
            if let Some((other, _)) = seen.iter().find(|(_, name)| *name == file) {
                problems
                    .push(at.as_str(), format!("`{file}` stands at {other} too: a frame has no noise against itself"));
            }
            seen.push((at, file));
        }
    }
}
