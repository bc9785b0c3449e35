//! Which way the radiance of a scene is found, and the images that come of it.

use std::collections::BTreeSet;
use std::sync::Arc;

use turbid_contract::payload::Scene;
use turbid_contract::{Ctx, Error};

use crate::control_variate::{ControlVariates, control_variates, no_control};
use crate::controlled::{Controlled, Images};
use crate::field::{Field, Sampled, Watched};
use crate::fit::{FIT_PATHS, Fitted, Lattice};
use crate::fringes::Fringes;
use crate::light::Carrier;
use crate::moments::Moments;
use crate::params::{Allocate, Method, Params};
use crate::plane_wave::{Bound, PlaneWave, bounds, no_plane_wave};
use crate::projected::Projected;
use crate::regions::{Region, regions};
use crate::rig::Rig;
use crate::served::{Served, by_controls};
use crate::so_far::SoFar;
use crate::state::State;
use crate::stopping::{OfFit, OfPixels, OfSurfaces};
use crate::surfaces::{Surfaces, by_surfaces, no_surface};
use crate::tail::{brightness, expected_kurtosis, kurtosis};
use crate::trace::{Sums, Task, trace};
use crate::uniform::obstacle;
use crate::unsure::Unsure;
use crate::variance_smoothing::by_paths;

/// The error target of a pixel-by-pixel image is first tested after this many paths per pixel.
pub const FIRST_TEST: u32 = 64;
/// That of a fitted one after this many paths in all.
const FIRST_TEST_OF_ALL: usize = 1 << 15;
/// The method taken for a scene, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum Taken {
    Path {
        because: Option<String>,
    },
    Fit,
    /// Paths of every pixel, and a fit to them wherever what is seen is smooth.
    Surfaces {
        because: Option<String>,
    },
    /// The transport solver; the bound of the error of a frame.
    Rte {
        bound: f64,
    },
    /// Paths, beside those of laterally uniform control variates.
    ControlVariates {
        because: String,
    },
}

impl Taken {
    /// `patterned`: images are projected.
    pub fn of(params: &Params, scene: &Scene, patterned: bool) -> Self {
        match params.method {
            Method::Path => Self::Path { because: None },
            Method::Fit if patterned => Self::Surfaces { because: None },
            _ if patterned => Self::of_pixels(params, scene, ("images are projected".to_owned(), patterned)),
            Method::Fit => match obstacle(scene, params.target_error.map(|t| t.0)) {
                None => Self::Fit,
                Some(_) => Self::Surfaces { because: None },
            },
            Method::Rte => Self::Rte { bound: bound(params, scene).unwrap_or(f64::INFINITY) },
            Method::Auto => match obstacle(scene, params.target_error.map(|t| t.0)) {
                None => match (bound(params, scene), params.target_error) {
                    (Some(bound), Some(target)) if bound <= target.0 => Self::Rte { bound },
                    _ => Self::Fit,
                },
                Some(because) => Self::of_pixels(params, scene, (because, patterned)),
            },
        }
    }

    /// What `auto` takes where no function fits the whole image: of fits on surfaces and control variates what serves more pixels.
    ///
    /// Both are many times better than a pixel's own paths, and fits are the better ones; but they end before an edge, where control variates may go on. Over a lesion flush with
    /// the skin those serve every pixel, and its outline does not stand out by its noise; a dome has none.
    /// Images of control variates are those of sinusoids.
    fn of_pixels(params: &Params, scene: &Scene, (because, patterned): (String, bool)) -> Self {
        let target = params.target_error.map(|t| t.0);
        // A fit shares its error among all pixels: there is no pixel that needs more paths.
        let may_fit = params.allocate == Allocate::Even && no_surface(scene).is_none();
        let has_controls = !patterned && no_control(scene, target).is_none();
        let by_fits = if may_fit { Served::of(scene).by_fits } else { 0.0 };
        if by_fits > if has_controls { by_controls(scene, target) } else { 0.0 } {
            Self::Surfaces { because: Some(because) }
        } else if has_controls {
            Self::ControlVariates { because }
        } else {
            Self::Path { because: Some(because) }
        }
    }
}

/// The largest bound of a frame's error, where the transport solver can give the image.
pub fn bound(params: &Params, scene: &Scene) -> Option<f64> {
    if no_plane_wave(scene).is_some() {
        return None;
    }
    let bounds = bounds(scene, &params.carriers())?;
    Some(bounds.iter().map(Bound::whole).fold(0.0, f64::max))
}

/// What was estimated: one field per channel.
pub struct Estimate<'a> {
    pub channels: Vec<Box<dyn Field + 'a>>,
    /// Paths per traced pixel.
    pub n: u32,
    pub design_effect: Option<f64>,
}

/// The sums behind an [`Estimate`].
pub struct Traced {
    channels: Vec<Moments>,
    /// Paths per traced pixel, on average.
    n: u32,
    /// Those of every pixel.
    paths: Vec<u32>,
    lattice: Option<Lattice>,
    /// What may be fitted, pixel by pixel.
    regions: Option<Vec<Region>>,
    controls: Option<ControlImages>,
    flights: u64,
    solved: Vec<PlaneWave>,
}

/// Control variates, and the sums behind their images.
struct ControlImages {
    controls: ControlVariates,
    images: Vec<Traced>,
}

/// Traces what the method needs.
pub fn sums(
    taken: &Taken,
    params: &Params,
    scene: &Scene,
    rig: &Rig,
    projected: &Projected,
    ctx: Ctx<'_>,
) -> Result<Traced, Error> {
    let so_far = SoFar { scene, rig, projected };
    match taken {
        Taken::Path { .. } => pixels(params, so_far, None, ctx),
        Taken::Fit => fit(params, rig, projected, (0, Some(so_far)), ctx),
        Taken::Surfaces { .. } => surfaces(params, so_far, ctx),
        Taken::Rte { bound } => {
            ctx.measure("bound of a frame's error", 100.0 * bound, "%");
            let solved = PlaneWave::all(scene, rig, &projected.carriers)?;
            Ok(Traced {
                channels: Vec::new(),
                n: 0,
                paths: Vec::new(),
                lattice: None,
                regions: None,
                controls: None,
                flights: 0,
                solved,
            })
        }
        Taken::ControlVariates { .. } => {
            let controls = control_variates(scene, rig, params.target_error.map(|t| t.0))?;
            let Some(controls) = controls else { return pixels(params, so_far, None, ctx) };
            pixels(params, so_far, Some(controls), ctx)
        }
    }
}

/// Every pixel by its own paths, perhaps with control variates.
fn pixels(
    params: &Params,
    so_far: SoFar<'_>,
    controls: Option<ControlVariates>,
    ctx: Ctx<'_>,
) -> Result<Traced, Error> {
    let SoFar { rig, projected, .. } = so_far;
    let pixels: Vec<u32> = (0..rig.camera.pixels() as u32).collect();
    let criterion = OfPixels::new(rig, projected, controls.as_ref(), params.allocate);
    let task = Task {
        params,
        rig,
        projected,
        pixels: &pixels,
        controls: controls.as_ref(),
        salt: 0,
        kept: true,
        first_test: FIRST_TEST,
        allocate: params.allocate,
        criterion: &criterion,
        so_far: Some(&|state: &State, paths: &[u32]| Some(so_far.of_pixels(state, paths))),
    };
    let Sums { mut channels, samples: n, paths, with_control: taken, flights } = trace(&task, ctx)?;
    let flights = flights.iter().sum();
    let controls = controls.map(|controls| controls.within(taken.as_deref()));
    let controls = controls.filter(|controls| controls.of_pixel.iter().any(Option::is_some));
    if controls.is_none() {
        // Differences that nobody needs.
        channels.truncate(rig.worlds.len());
    }
    let controls = controls.map(|controls| {
        let samples = Some(n.max(FIRST_TEST).saturating_mul(FIT_PATHS));
        let enough = Params { samples, target_error: None, max_seconds: None, ..params.clone() };
        let images = controls.variates.iter().zip(1..);
        let images = images.map(|(r, salt)| fit(&enough, &r.plain, projected, (salt, None), ctx));
        Ok::<_, Error>(ControlImages { images: images.collect::<Result<_, _>>()?, controls })
    });
    let controls = controls.transpose()?;
    Ok(Traced { channels, n, paths, lattice: None, regions: None, controls, flights, solved: Vec::new() })
}

/// Every pixel by its own paths, to be fitted where it can be. All have as many: errors of a fit are shared.
fn surfaces(params: &Params, so_far: SoFar<'_>, ctx: Ctx<'_>) -> Result<Traced, Error> {
    let SoFar { scene, rig, projected } = so_far;
    let pixels: Vec<u32> = (0..rig.camera.pixels() as u32).collect();
    let regions = match Fringes::of(projected) {
        Ok(fringes) => regions(scene, rig, projected, &Arc::new(fringes)),
        Err(reason) => {
            if params.method == Method::Fit {
                ctx.warn(format!("{reason}: no surface is fitted"));
            }
            Vec::new()
        }
    };
    let task = Task {
        params,
        rig,
        projected,
        pixels: &pixels,
        controls: None,
        salt: 0,
        kept: true,
        first_test: FIRST_TEST,
        allocate: Allocate::Even,
        criterion: &OfSurfaces { ctx, rig, projected, regions: &regions },
        so_far: Some(&|state: &State, paths: &[u32]| Some(so_far.of_pixels(state, paths))),
    };
    let Sums { channels, samples: n, paths, flights, .. } = trace(&task, ctx)?;
    let flights = flights.iter().sum();
    Ok(Traced {
        channels,
        n,
        paths,
        lattice: None,
        regions: Some(regions),
        controls: None,
        flights,
        solved: Vec::new(),
    })
}

/// A lattice of pixels, to fit a smooth image to; `salt` as in [`Task`]. What is there so far is shown, and kept for a longer run, where it is an image of
/// the scene itself.
fn fit(
    params: &Params,
    rig: &Rig,
    projected: &Projected,
    (salt, so_far): (u64, Option<SoFar<'_>>),
    ctx: Ctx<'_>,
) -> Result<Traced, Error> {
    let camera = &rig.camera;
    let lattice = Lattice::over(camera.columns, camera.rows);
    let pixels = lattice.pixels(camera.columns);
    let first_test = first_test_of_fit(pixels.len());
    let criterion = OfFit { rig, projected, lattice: &lattice };
    // Its error is that of a few coefficients, which all pixels share.
    let allocate = Allocate::Even;
    let kept = so_far.is_some();
    let preview = |state: &State, _: &[u32]| so_far.and_then(|so_far| so_far.of_fit(state, &lattice));
    let task = Task {
        params,
        rig,
        projected,
        pixels: &pixels,
        controls: None,
        salt,
        kept,
        first_test,
        allocate,
        criterion: &criterion,
        so_far: kept.then_some(&preview),
    };
    let Sums { channels, samples: n, flights, .. } = trace(&task, ctx)?;
    let flights = flights.iter().sum();
    Ok(Traced {
        channels,
        n,
        paths: Vec::new(),
        lattice: Some(lattice),
        regions: None,
        controls: None,
        flights,
        solved: Vec::new(),
    })
}

/// Paths of each of so many traced pixels after which the error of a fit is first tested.
pub fn first_test_of_fit(pixels: usize) -> u32 {
    FIRST_TEST_OF_ALL.div_ceil(pixels).next_power_of_two().max(8) as u32
}

impl Traced {
    /// All that were made for it.
    pub fn flights(&self) -> u64 {
        self.flights + self.controls.iter().flat_map(|b| &b.images).map(|image| image.flights).sum::<u64>()
    }

    /// The fields of all channels.
    pub fn estimate(
        &self,
        params: &Params,
        rig: &Rig,
        projected: &Projected,
        ctx: Ctx<'_>,
    ) -> Result<Estimate<'_>, Error> {
        if let Some(controls) = &self.controls {
            return self.estimate_with_control(controls, rig, projected, ctx);
        }
        if !self.solved.is_empty() {
            let field = |solved: &'_ PlaneWave| -> Box<dyn Field> { Box::new(solved.clone()) };
            let pixels = rig.camera.pixels() as f64;
            return Ok(Estimate {
                channels: self.solved.iter().map(field).collect(),
                n: 0,
                design_effect: Some(pixels),
            });
        }
        if let Some(regions) = &self.regions {
            let estimate = self.estimate_surfaces(regions, rig, projected, ctx);
            if estimate.design_effect.is_none() && params.method == Method::Fit {
                ctx.warn("nowhere is what is seen smooth enough for a fit: all pixels are by their own paths");
            }
            return Ok(estimate);
        }
        let Some(lattice) = &self.lattice else {
            let channels = by_paths(rig, &Watched::of(projected), &self.channels, &self.paths);
            return Ok(Estimate { channels, n: self.n, design_effect: None });
        };
        let mut channels: Vec<Box<dyn Field>> = Vec::new();
        let (mut design_effect, mut order) = (1.0_f64, 0);
        for moments in &self.channels {
            let fitted = Fitted::new(rig, &projected.carriers, lattice, moments, self.n)
                .ok_or_else(|| Error::failed("a pixel sees nothing, so no surface can be fitted"))?;
            if fitted.rough {
                ctx.warn("the image is not smooth enough for a fit of order 6; `method: path` renders every pixel");
            }
            (design_effect, order) = (design_effect.max(fitted.design_effect()), order.max(fitted.order));
            channels.push(Box::new(fitted));
        }
        ctx.measure("order of the fit", order as f64, "1");
        Ok(Estimate { channels, n: self.n, design_effect: Some(design_effect) })
    }

    fn estimate_surfaces<'a>(
        &'a self,
        regions: &'a [Region],
        rig: &Rig,
        projected: &Projected,
        ctx: Ctx<'_>,
    ) -> Estimate<'a> {
        let watched = Watched::of(projected);
        let fields = by_surfaces(ctx, rig, &watched, regions, &self.channels, &self.paths);
        let (mut channels, mut design_effect, mut fraction): (Vec<Box<dyn Field>>, f64, f64) = (Vec::new(), 1.0, 1.0);
        let of = |surfaces: &Surfaces<'_>| {
            surfaces.fits().map(|(name, order, chi2)| (name.to_owned(), order, chi2)).collect::<Vec<_>>()
        };
        let fits: Vec<(String, usize, f64)> = fields.iter().flat_map(of).collect();
        for field in fields {
            (design_effect, fraction) =
                (design_effect.max(field.design_effect(&watched.dc)), fraction.min(field.fraction()));
            channels.push(Box::new(field));
        }
        ctx.measure("pixels fitted", 100.0 * fraction, "%");
        for name in fits.iter().map(|fit| &fit.0).collect::<BTreeSet<_>>() {
            let of = || fits.iter().filter(|fit| fit.0 == *name);
            let (order, chi2) = (of().map(|fit| fit.1).max(), of().map(|fit| fit.2).fold(0.0, f64::max));
            ctx.measure(&format!("order of the fit: {name}"), order.unwrap_or_default() as f64, "1");
            ctx.measure(&format!("chi2 per degree of the fit: {name}"), chi2, "1");
        }
        Estimate { channels, n: self.n, design_effect: (fraction > 0.0).then_some(design_effect) }
    }

    fn estimate_with_control(
        &self,
        controls: &ControlImages,
        rig: &Rig,
        projected: &Projected,
        ctx: Ctx<'_>,
    ) -> Result<Estimate<'_>, Error> {
        let (count, watched) = (rig.worlds.len(), Watched::of(projected));
        let mut channels: Vec<Box<dyn Field>> = Vec::new();
        let (mut design_effect, mut fraction) = (1.0_f64, 0.0_f64);
        for (channel, images) in controls.fitted(&projected.carriers)?.into_iter().enumerate() {
            let sampled = |moments, spread| Sampled { moments, paths: &self.paths, spread };
            let seen = brightness(&self.channels[channel], &self.paths);
            let direct = sampled(&self.channels[channel], kurtosis(seen.iter().copied(), expected_kurtosis(rig)) - 1.0);
            // Variances of differences are pooled over pixels.
            let differences = sampled(&self.channels[count + channel], 0.0);
            let (images, of_pixel) = (Images::Known(images), &controls.controls.of_pixel);
            let field = Controlled::new(direct, differences, images, of_pixel, rig.camera.columns, projected.layout);
            (design_effect, fraction) =
                (design_effect.max(field.design_effect(&watched.dc)), fraction.max(field.fraction()));
            channels.push(Box::new(Unsure::of_tail(
                Box::new(field),
                &seen,
                expected_kurtosis(rig),
                rig.camera.columns,
            )));
        }
        ctx.measure("pixels by difference", 100.0 * fraction, "%");
        Ok(Estimate { channels, n: self.n, design_effect: Some(design_effect) })
    }
}

impl ControlImages {
    /// The images of all control variates, `[channel][stand-in]`.
    fn fitted(&self, carriers: &[Carrier]) -> Result<Vec<Vec<Fitted>>, Error> {
        let channels = self.images.first().map_or(0, |image| image.channels.len());
        let one = |channel: usize, k: usize| {
            let (image, rig) = (&self.images[k], &self.controls.variates[k].plain);
            let lattice = image.lattice.as_ref().expect("it was traced to be fitted");
            Fitted::new(rig, carriers, lattice, &image.channels[channel], image.n)
                .ok_or_else(|| Error::failed("a pixel sees nothing, so no surface can be fitted"))
        };
        (0..channels).map(|c| (0..self.images.len()).map(|k| one(c, k)).collect()).collect()
    }
}
