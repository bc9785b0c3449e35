//! Which way the radiance of a scene is found, and the images that come of it.

use turbid_contract::payload::Scene;
use turbid_contract::{Ctx, Error, Seconds};

use crate::field::{Field, Sampled, Watched, relative_error};
use crate::fit::{Fitted, Lattice};
use crate::light::Carrier;
use crate::moments::Moments;
use crate::params::{Method, Params};
use crate::reference::{References, no_stand_in, references};
use crate::referenced::{Images, Referenced};
use crate::rig::Rig;
use crate::shown::Shown;
use crate::trace::{Task, trace};
use crate::uniform::obstacle;

/// The error target of a pixel-by-pixel image is first tested after this many paths per pixel.
const FIRST_TEST: u32 = 64;
/// That of a fitted one after this many paths in all.
const FIRST_TEST_OF_ALL: usize = 1 << 15;
/// So many times the paths of a pixel are spent on each traced pixel of a stand-in's image: its few terms have then less noise than
/// most differences.
const FIT_PATHS: u32 = 2;
/// Terms of a fit of the least order.
const TERMS: f64 = 6.0;

/// The method taken for a scene, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum Taken {
    Path {
        because: Option<String>,
    },
    Fit,
    /// Paths, beside those of laterally uniform stand-ins.
    Reference {
        because: String,
    },
}

impl Taken {
    /// `patterned`: images are projected.
    pub fn of(params: &Params, scene: &Scene, patterned: bool) -> Self {
        match params.method {
            Method::Path => Self::Path { because: None },
            _ if patterned => Self::Path { because: Some("images are projected".to_owned()) },
            Method::Fit => Self::Fit,
            Method::Auto | Method::Rte => match obstacle(scene, params.target_error.map(|t| t.0)) {
                None => Self::Fit,
                Some(because) => match no_stand_in(scene, params.target_error.map(|t| t.0)) {
                    None => Self::Reference { because },
                    Some(_) => Self::Path { because: Some(because) },
                },
            },
        }
    }
}

/// What was estimated: one field per channel.
pub struct Estimate<'a> {
    pub channels: Vec<Box<dyn Field + 'a>>,
    /// Paths per traced pixel.
    pub n: u32,
    pub sharing: Option<f64>,
}

/// The sums behind an [`Estimate`].
pub struct Traced {
    channels: Vec<Moments>,
    n: u32,
    /// `n` for every pixel.
    paths: Vec<u32>,
    lattice: Option<Lattice>,
    beside: Option<Beside>,
}

/// Stand-ins, and the sums behind their images.
struct Beside {
    stand_ins: References,
    images: Vec<Traced>,
}

/// Traces what the method needs.
pub fn sums(
    taken: &Taken,
    params: &Params,
    scene: &Scene,
    rig: &Rig,
    shown: &Shown,
    ctx: Ctx<'_>,
) -> Result<Traced, Error> {
    match taken {
        Taken::Path { .. } => pixels(params, rig, shown, None, ctx),
        Taken::Fit => fit(params, rig, shown, (0, true), ctx),
        Taken::Reference { .. } => {
            let stand_ins = references(scene, rig, params.target_error.map(|t| t.0))?;
            let Some(stand_ins) = stand_ins else { return pixels(params, rig, shown, None, ctx) };
            pixels(params, rig, shown, Some(stand_ins), ctx)
        }
    }
}

/// Every pixel by its own paths, perhaps beside stand-ins.
fn pixels(
    params: &Params,
    rig: &Rig,
    shown: &Shown,
    beside: Option<References>,
    ctx: Ctx<'_>,
) -> Result<Traced, Error> {
    let (camera, watched) = (&rig.camera, Watched::of(shown));
    let pixels: Vec<u32> = (0..camera.pixels() as u32).collect();
    let lattice = Lattice::over(camera.columns, camera.rows);
    let traced = lattice.columns.len() * lattice.rows.len();
    let expected = TERMS / (f64::from(FIT_PATHS) * traced as f64);
    let error = |channels: &[Moments], n: u32| {
        let paths = vec![n; camera.pixels()];
        let of = |channel: usize| {
            let direct = Sampled { moments: &channels[channel], paths: &paths };
            let Some(stand_ins) = &beside else { return relative_error(&direct, &watched) };
            let differences = Sampled { moments: &channels[rig.worlds.len() + channel], paths: &paths };
            let (images, of_pixel) = (Images::Expected(expected), &stand_ins.of_pixel);
            let field = Referenced::new(direct, differences, images, of_pixel, camera.columns, shown.layout);
            relative_error(&field, &watched)
        };
        (0..rig.worlds.len()).filter_map(of).max_by(f64::total_cmp)
    };
    // Some of the time is left for the stand-ins' images, which are made at last: how good they must be is known only then.
    let images = beside.as_ref().map_or(0, |b| b.references.len());
    let (scene, rest) = (2.0 * camera.pixels() as f64, f64::from(FIT_PATHS) * (images * traced) as f64);
    let max_seconds = params.max_seconds.map(|limit| Seconds(scene / (scene + rest) * limit.0));
    let limited = Params { max_seconds, ..params.clone() };
    let task = Task {
        params: &limited,
        rig,
        shown,
        pixels: &pixels,
        beside: beside.as_ref(),
        salt: 0,
        kept: true,
        first_test: FIRST_TEST,
        error: &error,
    };
    let (channels, n) = trace(&task, ctx)?;
    let beside = beside.map(|stand_ins| {
        let samples = Some(n.max(FIRST_TEST).saturating_mul(FIT_PATHS));
        let enough = Params { samples, target_error: None, max_seconds: None, ..params.clone() };
        let images = stand_ins.references.iter().zip(1..);
        let images = images.map(|(r, salt)| fit(&enough, &r.plain, shown, (salt, false), ctx));
        Ok::<_, Error>(Beside { images: images.collect::<Result<_, _>>()?, stand_ins })
    });
    Ok(Traced { channels, n, paths: vec![n; camera.pixels()], lattice: None, beside: beside.transpose()? })
}

/// A lattice of pixels, to fit a smooth image to; `salt` and `kept` as in [`Task`].
fn fit(params: &Params, rig: &Rig, shown: &Shown, (salt, kept): (u64, bool), ctx: Ctx<'_>) -> Result<Traced, Error> {
    let (camera, watched) = (&rig.camera, Watched::of(shown));
    let lattice = Lattice::over(camera.columns, camera.rows);
    let pixels = lattice.pixels(camera.columns);
    let error = |channels: &[Moments], n: u32| {
        let of = |moments| {
            Fitted::new(rig, &shown.carriers, &lattice, moments, n).and_then(|f| relative_error(&f, &watched))
        };
        channels.iter().filter_map(of).max_by(f64::total_cmp)
    };
    let first_test = FIRST_TEST_OF_ALL.div_ceil(pixels.len()).next_power_of_two().max(8) as u32;
    let task = Task { params, rig, shown, pixels: &pixels, beside: None, salt, kept, first_test, error: &error };
    let (channels, n) = trace(&task, ctx)?;
    Ok(Traced { channels, n, paths: Vec::new(), lattice: Some(lattice), beside: None })
}

impl Traced {
    /// The fields of all channels.
    pub fn estimate(&self, rig: &Rig, shown: &Shown, ctx: Ctx<'_>) -> Result<Estimate<'_>, Error> {
        if let Some(beside) = &self.beside {
            return self.estimate_beside(beside, rig, shown, ctx);
        }
        let Some(lattice) = &self.lattice else {
            let field = |moments| -> Box<dyn Field> { Box::new(Sampled { moments, paths: &self.paths }) };
            return Ok(Estimate { channels: self.channels.iter().map(field).collect(), n: self.n, sharing: None });
        };
        let mut channels: Vec<Box<dyn Field>> = Vec::new();
        let (mut sharing, mut order) = (1.0_f64, 0);
        for moments in &self.channels {
            let fitted = Fitted::new(rig, &shown.carriers, lattice, moments, self.n)
                .ok_or_else(|| Error::failed("a pixel sees nothing, so no surface can be fitted"))?;
            if fitted.rough {
                ctx.warn("the image is not smooth enough for a fit of order 6; `method: path` renders every pixel");
            }
            (sharing, order) = (sharing.max(fitted.sharing()), order.max(fitted.order));
            channels.push(Box::new(fitted));
        }
        ctx.measure("order of the fit", order as f64, "1");
        Ok(Estimate { channels, n: self.n, sharing: Some(sharing) })
    }

    fn estimate_beside(&self, beside: &Beside, rig: &Rig, shown: &Shown, ctx: Ctx<'_>) -> Result<Estimate<'_>, Error> {
        let (count, watched) = (rig.worlds.len(), Watched::of(shown));
        let mut channels: Vec<Box<dyn Field>> = Vec::new();
        let (mut sharing, mut share) = (1.0_f64, 0.0_f64);
        for (channel, images) in beside.fitted(&shown.carriers)?.into_iter().enumerate() {
            let sampled = |moments| Sampled { moments, paths: &self.paths };
            let (direct, differences) = (sampled(&self.channels[channel]), sampled(&self.channels[count + channel]));
            let (images, of_pixel) = (Images::Known(images), &beside.stand_ins.of_pixel);
            let field = Referenced::new(direct, differences, images, of_pixel, rig.camera.columns, shown.layout);
            (sharing, share) = (sharing.max(field.sharing(&watched.dc)), share.max(field.share()));
            channels.push(Box::new(field));
        }
        ctx.measure("pixels by difference", 100.0 * share, "%");
        Ok(Estimate { channels, n: self.n, sharing: Some(sharing) })
    }
}

impl Beside {
    /// The images of all stand-ins, `[channel][stand-in]`.
    fn fitted(&self, carriers: &[Carrier]) -> Result<Vec<Vec<Fitted>>, Error> {
        let channels = self.images.first().map_or(0, |image| image.channels.len());
        let one = |channel: usize, k: usize| {
            let (image, rig) = (&self.images[k], &self.stand_ins.references[k].plain);
            let lattice = image.lattice.as_ref().expect("it was traced to be fitted");
            Fitted::new(rig, carriers, lattice, &image.channels[channel], image.n)
                .ok_or_else(|| Error::failed("a pixel sees nothing, so no surface can be fitted"))
        };
        (0..channels).map(|c| (0..self.images.len()).map(|k| one(c, k)).collect()).collect()
    }
}
