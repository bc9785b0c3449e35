//! Which way the radiance of a scene is found, and the images that come of it.

use turbid_contract::payload::Scene;
use turbid_contract::{Ctx, Error};

use crate::field::{Field, Sampled, Watched, relative_error};
use crate::fit::{Fitted, Lattice};
use crate::moments::Moments;
use crate::params::{Method, Params};
use crate::rig::Rig;
use crate::shown::Shown;
use crate::trace::{Task, trace};
use crate::uniform::obstacle;

/// The error target of a pixel-by-pixel image is first tested after this many paths per pixel.
const FIRST_TEST: u32 = 64;
/// That of a fitted one after this many paths in all.
const FIRST_TEST_OF_ALL: usize = 1 << 15;

/// The method taken for a scene, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum Taken {
    Path { because: Option<String> },
    Fit,
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
                because => Self::Path { because },
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
}

/// Traces what the method needs.
pub fn sums(taken: &Taken, params: &Params, rig: &Rig, shown: &Shown, ctx: Ctx<'_>) -> Result<Traced, Error> {
    let (camera, watched) = (&rig.camera, Watched::of(shown));
    if let Taken::Path { .. } = taken {
        let pixels: Vec<u32> = (0..camera.pixels() as u32).collect();
        let error = |channels: &[Moments], n: u32| {
            let paths = vec![n; camera.pixels()];
            let of = |moments| relative_error(&Sampled { moments, paths: &paths }, &watched);
            channels.iter().filter_map(of).max_by(f64::total_cmp)
        };
        let task = Task { params, rig, shown, pixels: &pixels, first_test: FIRST_TEST, error: &error };
        let (channels, n) = trace(&task, ctx)?;
        return Ok(Traced { channels, n, paths: vec![n; camera.pixels()], lattice: None });
    }
    let lattice = Lattice::over(camera.columns, camera.rows);
    let pixels = lattice.pixels(camera.columns);
    let error = |channels: &[Moments], n: u32| {
        let of = |moments| {
            Fitted::new(rig, &shown.carriers, &lattice, moments, n).and_then(|f| relative_error(&f, &watched))
        };
        channels.iter().filter_map(of).max_by(f64::total_cmp)
    };
    let first_test = FIRST_TEST_OF_ALL.div_ceil(pixels.len()).next_power_of_two().max(8) as u32;
    let task = Task { params, rig, shown, pixels: &pixels, first_test, error: &error };
    let (channels, n) = trace(&task, ctx)?;
    Ok(Traced { channels, n, paths: Vec::new(), lattice: Some(lattice) })
}

impl Traced {
    /// The fields of all channels.
    pub fn estimate(&self, rig: &Rig, shown: &Shown, ctx: Ctx<'_>) -> Result<Estimate<'_>, Error> {
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
}
