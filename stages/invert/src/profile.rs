//! Profile correction: what a flat reference does not know of a sample's shape, pixel by pixel.
//!
//! Calibrated by a flat reference a pixel reads R E / E_ref, E the irradiance on its surface and E_ref on the reference plane. Fringes of f_x have the frequency
//! f along the surface, and in a half-space only mu_a / mu_s' and f / mu_s' matter: R(mu_a, mu_s'; f) = R(s mu_a, s mu_s'; f_x) with s = f_x / f. So the
//! table at f_x holds for any f, and ln mu grows by ln(f / f_x).

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Relief, Scene};
use turbid_contract::{AngleDeg, Ctx, Error, ImageStack, Known, Layer, LayerInfo, LayerKind, Problems};
use turbid_geometry::{camera_view, normal_of, tangent};
use turbid_optics::elementary::{ln, sin_cos_turns};
use turbid_optics::view::View;

use crate::exposure::{Exposure, Lighting};
use crate::pass::{Shake, Solved};

/// How a sample's shape is taken into account.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Profile {
    /// Where the surface is turned further away from projector or camera it is masked, degrees.
    pub steepest_deg: AngleDeg,
    /// Side of the square of pixels whose heights make a normal, where normals are not given; odd.
    pub window: u32,
}

impl Default for Profile {
    fn default() -> Self {
        Self { steepest_deg: AngleDeg(60.0), window: 5 }
    }
}

/// The widest window: beyond it a normal is none of the pixel's.
const WIDEST_WINDOW: u32 = 101;

impl Profile {
    pub fn check(&self, problems: &mut Problems) {
        let AngleDeg(steepest) = self.steepest_deg;
        let holds = steepest > 0.0 && steepest < 90.0;
        problems.require(holds, "profile.steepest_deg", steepest, "deg", "lie in (0, 90)");
        let holds = (3..=WIDEST_WINDOW).contains(&self.window) && self.window % 2 == 1;
        problems.require(holds, "profile.window", f64::from(self.window), "px", "be odd and lie in [3, 101]");
    }
}

/// Light and view at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Irradiance over that on the reference plane.
    pub irradiance: f64,
    /// Spatial frequency along the surface over that of the pattern.
    pub stretch: f64,
    /// Cosines of the angles between the normal and the ways to projector and camera.
    pub cos: [f64; 2],
}

/// What is known of each pixel's shape.
pub struct Correction {
    pub sites: Vec<Result<Site, MaskReason>>,
    /// Where the shape has standard errors.
    pub shakes: Option<Vec<Shake>>,
    rows: usize,
    columns: usize,
}

/// What the correction needs, and what it cannot do.
pub fn check(profile: Option<&Profile>, known: &Known, problems: &mut Problems) {
    if let Some(profile) = profile {
        profile.check(problems);
    }
    let connected = |port: &str| known.connected.iter().any(|c| c == port);
    let (height, scene) = (connected("height"), connected("scene"));
    if !height {
        for (at, port, given) in
            [("profile", "profile", profile.is_some()), ("", "normals", connected("normals")), ("", "scene", scene)]
        {
            if given {
                let message = format!("`{port}` is given, but the input `height` is not: the shape is not known");
                let way_out = "in: {height: frames.truth}, or the height of a profilometry stage; or leave it out";
                problems.push_with_hint(at, message, way_out);
            }
        }
        return;
    }
    if !scene {
        let message = "the input `height` is connected, but not `scene`: where camera and projector stand is not known";
        problems.push_with_hint("", message, "in: {scene: the scene that was rendered or measured}");
    }
    if connected("sections") {
        let message = "the sections of a table already hold what distance and slope do: the shape cannot be corrected for once more";
        problems.push_with_hint("", message, "leave out `sections` with its table, or `height` and `scene`");
    }
    if let Some(scene) = known.get::<Scene>("scene") {
        if let Some((what, way_out)) = lacks(&scene) {
            problems.push_with_hint("", what, way_out);
        }
        if !scene.lights.is_empty() {
            let lights = scene.lights.keys().cloned().collect::<Vec<_>>().join(", ");
            problems.warn("", format!("only the projector's light is corrected for the shape, not that of {lights}"));
        }
    }
}

/// What the scene lacks, as a message and a way out.
fn lacks(scene: &Scene) -> Option<(&'static str, &'static str)> {
    if scene.camera.is_none() {
        return Some(("the scene has no camera: where a pixel looks is not known", "add `camera` to the scene"));
    }
    if scene.projector.is_none() {
        let what = "the scene has no projector: how much light falls on a slope is not known";
        return Some((what, "add `projector` to the scene"));
    }
    None
}

impl Correction {
    /// `size`: rows and columns of the reflectance; `orientation_deg` of its fringes.
    ///
    /// Errors: a scene without camera or projector, images of other sizes, heights that are none.
    pub fn new(
        profile: &Profile,
        scene: &Scene,
        relief: &Relief,
        normals: Option<&ImageStack>,
        size: (usize, usize),
        orientation_deg: f64,
        ctx: Ctx<'_>,
    ) -> Result<Self, Error> {
        if let Some((what, way_out)) = lacks(scene) {
            return Err(Error::failed_with_hint(what, way_out));
        }
        let (Some(camera), Some(projector)) = (&scene.camera, &scene.projector) else { unreachable!("checked above") };
        let (rows, columns) = size;
        let pixels = format!("{columns} x {rows}");
        let own = [("heights have", Some(&relief.0)), ("normals have", normals)];
        for (what, stack) in own.into_iter().filter_map(|(what, stack)| Some((what, stack?))) {
            if (stack.rows(), stack.columns()) != size {
                let has = format!("{} x {}", stack.columns(), stack.rows());
                let message = format!("the {what} {has} pixels, the reflectance {pixels}");
                return Err(Error::failed_with_hint(message, "both must be seen by the same camera"));
            }
        }
        let [camera_columns, camera_rows] = camera.pixels;
        if (camera_rows as usize, camera_columns as usize) != size {
            let message =
                format!("the scene's camera has {camera_columns} x {camera_rows} pixels, the reflectance {pixels}");
            return Err(Error::failed_with_hint(message, "connect the scene whose camera took the frames"));
        }
        let named = |what: &str| Error::failed(format!("the {what} of the scene is no view"));
        let view = camera_view(camera).map_err(|_| named("camera"))?;
        let lighting = Lighting::new(projector, orientation_deg).map_err(|_| named("projector"))?;
        let shape = Shape::of(&relief.0, normals, &view, (profile.window / 2) as usize)?;
        let (_, least_cos) = sin_cos_turns(profile.steepest_deg.0 / 360.0);
        let noisy = shape.height_se.is_some();
        let found = ctx.map_tiles(rows, |row| {
            let of = |column: usize| {
                let pixel = row * columns + column;
                let site = shape.site(pixel, &lighting, least_cos);
                let shake = match (&site, noisy) {
                    (Ok(_), true) => shape.shake(pixel, &lighting),
                    _ => [[0.0; 2]; 3],
                };
                (site, shake)
            };
            (0..columns).map(of).collect::<Vec<_>>()
        })?;
        let (sites, shakes): (Vec<_>, Vec<_>) = found.into_iter().flatten().unzip();
        Ok(Self { sites, shakes: noisy.then_some(shakes), rows, columns })
    }

    /// ln of the factor of mu.
    pub fn ln_stretch(&self, pixel: usize) -> f64 {
        self.sites[pixel].map_or(0.0, |site| ln(site.stretch))
    }

    /// From what the table at f_x says to what holds at f along the surface, the errors of the shape included.
    pub fn stretched(&self, pixel: usize, solved: Solved) -> Solved {
        let shift = self.ln_stretch(pixel);
        let noise = match &self.shakes {
            Some(shakes) => solved.noise.map(|spread| spread.shaken(&shakes[pixel])),
            None => solved.noise,
        };
        Solved { p: [solved.p[0] + shift, solved.p[1] + shift], noise, ..solved }
    }

    /// The reflectance that the surface has, in place of that which a flat one would have; what cannot be corrected is masked.
    pub fn corrected(&self, reflectance: &ImageStack) -> ImageStack {
        let factors: Vec<f64> = self.sites.iter().map(|s| s.map_or(0.0, |site| 1.0 / site.irradiance)).collect();
        let mut stack = reflectance.clone();
        let has_mask = stack.layers.iter().any(|l| l.info.is_pixel_mask());
        if !has_mask {
            let good = Array2::zeros((self.rows, self.columns));
            stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), good);
        }
        for layer in &mut stack.layers {
            let (kind, name) = (layer.info.kind, layer.info.name.as_str());
            let power = match kind {
                LayerKind::Mask if !layer.info.is_pixel_mask() => continue,
                LayerKind::Mask => {
                    for (code, site) in layer.data.iter_mut().zip(&self.sites) {
                        if let (0.0, Err(reason)) = (*code, site) {
                            *code = reason.code();
                        }
                    }
                    continue;
                }
                LayerKind::Covariance => 2,
                _ if name.starts_with("r_d") => 1,
                _ => continue,
            };
            for (value, factor) in layer.data.iter_mut().zip(&factors) {
                let factor = if power == 2 { factor * factor } else { *factor };
                *value = (f64::from(*value) * factor) as f32;
            }
        }
        // Pixels share as much of their errors as before.
        for k in 0..stack.layers.len() {
            let info = &stack.layers[k].info;
            if info.kind != LayerKind::Value || info.mean_se.is_none() {
                continue;
            }
            let sharing = reflectance.sharing(&reflectance.layers[k].info);
            let Some(se) = stack.standard_error(info).map(Layer::pixels) else { continue };
            let mask = stack.mask(info.wavelength_nm).map(Layer::pixels);
            let of_mean = sharing.mean_se(&se, |i| mask.as_ref().is_none_or(|m| m[i] == 0.0));
            stack.layers[k].info.mean_se = of_mean;
        }
        stack
    }

    /// Light and view of each pixel, to look at; `f_x` are those of the fringes.
    pub fn image(&self, f_x: &[f64]) -> ImageStack {
        let mut stack = ImageStack::new(self.rows, self.columns);
        let plane = |value: &dyn Fn(&Site) -> f64| {
            let data = self.sites.iter().map(|s| s.as_ref().map_or(0.0, |site| value(site) as f32)).collect();
            Array2::from_shape_vec((self.rows, self.columns), data).expect("one value per pixel")
        };
        stack.push(LayerInfo::value("irradiance", "1"), plane(&|s| s.irradiance));
        for &f in f_x.iter().filter(|&&f| f > 0.0) {
            stack.push(LayerInfo::value("f_surface", "mm^-1").with_f_x(f), plane(&|s| f * s.stretch));
        }
        stack.push(LayerInfo::value("incidence", "rad"), plane(&|s| libm::acos(s.cos[0].min(1.0))));
        stack.push(LayerInfo::value("view", "rad"), plane(&|s| libm::acos(s.cos[1].min(1.0))));
        let codes = self.sites.iter().map(|s| s.err().unwrap_or(MaskReason::Good).code()).collect();
        let codes = Array2::from_shape_vec((self.rows, self.columns), codes);
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), codes.expect("one value per pixel"));
        stack
    }
}

/// The surface as the camera sees it.
struct Shape<'a> {
    view: &'a View,
    rows: usize,
    columns: usize,
    /// World z, or why there is none.
    heights: Vec<Result<f64, MaskReason>>,
    height_se: Option<Vec<f64>>,
    /// Where they are known; else they come from the heights.
    normals: Option<Vec<DVec3>>,
    points: Vec<Option<DVec3>>,
    reach: usize,
}

impl<'a> Shape<'a> {
    /// Errors: a layer is missing, or in another unit.
    fn of(relief: &ImageStack, normals: Option<&ImageStack>, view: &'a View, reach: usize) -> Result<Self, Error> {
        let (rows, columns) = (relief.rows(), relief.columns());
        let height = layer(relief, "height", "mm", "heights")?;
        let z = height.pixels();
        let mask = relief.mask(None).map(Layer::pixels);
        let reason = |i: usize| {
            let code = mask.as_ref().map_or(0.0, |m| m[i]);
            let named = MaskReason::ALL.into_iter().find(|r| r.code() == code).unwrap_or(MaskReason::NoHeight);
            match named {
                MaskReason::Good if !z[i].is_finite() => MaskReason::NotFinite,
                reason => reason,
            }
        };
        let height_at = |i: usize| match reason(i) {
            MaskReason::Good => Ok(f64::from(z[i])),
            reason => Err(reason),
        };
        let heights: Vec<_> = (0..rows * columns).map(height_at).collect();
        let height_se =
            relief.standard_error(&height.info).map(|l| l.pixels().iter().map(|&se| f64::from(se)).collect());
        let own = relief.find("normal_x", None).is_some();
        let normals = match normals.or(own.then_some(relief)) {
            None => None,
            Some(stack) => {
                let [x, y, z] = ["normal_x", "normal_y", "normal_z"].map(|name| layer(stack, name, "1", "normals"));
                let (x, y, z) = (x?.pixels(), y?.pixels(), z?.pixels());
                let normal = |i: usize| DVec3::new(f64::from(x[i]), f64::from(y[i]), f64::from(z[i]));
                // Rounded to f32 they are no unit vectors; one of length 0 stays none.
                Some((0..rows * columns).map(|i| normal(i).normalize_or_zero()).collect())
            }
        };
        let mut shape = Self { view, rows, columns, heights, height_se, normals, points: Vec::new(), reach };
        shape.points = (0..rows * columns).map(|i| shape.point(i, shape.heights[i].ok()?)).collect();
        Ok(shape)
    }

    /// Where a pixel's ray meets the plane world z = `height`.
    fn point(&self, pixel: usize, height: f64) -> Option<DVec3> {
        let (origin, w) = self.ray(pixel);
        let t = (height - origin.z) / w.z;
        (t > 0.0 && t < f64::INFINITY).then(|| origin + t * w)
    }

    fn ray(&self, pixel: usize) -> (DVec3, DVec3) {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        self.view.ray((column + 0.5) / self.columns as f64, (row + 0.5) / self.rows as f64)
    }

    fn site(&self, pixel: usize, lighting: &Lighting, least_cos: f64) -> Result<Site, MaskReason> {
        let height = self.heights[pixel]?;
        let (_, w) = self.ray(pixel);
        let normal = match &self.normals {
            Some(normals) => normals[pixel],
            None => tangent(&self.points, self.columns, pixel, self.reach).ok_or(MaskReason::NoHeight)?.normal(-w),
        };
        if normal == DVec3::ZERO {
            return Err(MaskReason::NoHeight);
        }
        let view = -normal.dot(w);
        let (here, reference) = self.exposures(pixel, height, normal, lighting).ok_or(MaskReason::LowSignal)?;
        if !(here.cos >= least_cos && view >= least_cos) {
            return Err(MaskReason::TooSteep);
        }
        let (irradiance, stretch) = (here.irradiance / reference, here.stretch);
        if !(irradiance.is_finite() && irradiance > 0.0 && stretch.is_finite() && stretch > 0.0) {
            return Err(MaskReason::NotFinite);
        }
        Ok(Site { irradiance, stretch, cos: [here.cos, view] })
    }

    /// On the surface, and the irradiance of the reference plane where the pixel sees it.
    fn exposures(&self, pixel: usize, height: f64, normal: DVec3, lighting: &Lighting) -> Option<(Exposure, f64)> {
        let here = lighting.on(self.point(pixel, height)?, normal)?;
        let (_, w) = self.ray(pixel);
        let facing = DVec3::new(0.0, 0.0, -w.z.signum());
        let reference = lighting.on(self.point(pixel, lighting.plane())?, facing)?.irradiance;
        Some((here, reference))
    }

    /// First differences over half a standard error to either side, of the height and of the slopes along the axes of their covariance; a normal
    /// that is given counts as exact.
    fn shake(&self, pixel: usize, lighting: &Lighting) -> Shake {
        let none = [0.0; 2];
        let (Some(se), Ok(height)) = (self.height_se.as_ref().map(|se| se[pixel]), self.heights[pixel]) else {
            return [none; 3];
        };
        let (_, w) = self.ray(pixel);
        let tangent = match &self.normals {
            Some(_) => None,
            None => tangent(&self.points, self.columns, pixel, self.reach),
        };
        let at = |height: f64, slope: [f64; 2]| {
            let normal = match (&self.normals, tangent) {
                (None, Some(_)) => normal_of(slope, -w),
                (Some(normals), _) => normals[pixel],
                (None, None) => return None,
            };
            let (here, _) = self.exposures(pixel, height, normal, lighting)?;
            Some([ln(here.irradiance), ln(here.stretch)])
        };
        let slope = tangent.map_or([0.0; 2], |t| t.slope);
        let change = |dz: f64, [p, q]: [f64; 2]| {
            let side = |k: f64| at(height + k * dz, [slope[0] + k * p, slope[1] + k * q]);
            match (side(-0.5), side(0.5)) {
                (Some(a), Some(b)) => [b[0] - a[0], b[1] - a[1]],
                _ => none,
            }
        };
        // Cholesky's factor of the slopes' covariance.
        let [xx, xy, yy] = tangent.map_or([0.0; 3], |t| t.covariance);
        let first = xx.sqrt();
        let across = if first > 0.0 { xy / first } else { 0.0 };
        let second = (yy - across * across).max(0.0).sqrt();
        [change(se, none), change(0.0, [se * first, se * across]), change(0.0, [0.0, se * second])]
    }
}

fn layer<'s>(stack: &'s ImageStack, name: &str, unit: &str, of: &str) -> Result<&'s Layer, Error> {
    let found = stack.find(name, None).ok_or_else(|| {
        let what = format!("the {of} hold no layer `{name}`");
        Error::failed_with_hint(what, "connect `frames.truth` of render or the heights of a profilometry stage")
    })?;
    if found.info.unit == unit {
        return Ok(found);
    }
    Err(Error::failed(format!("`{name}` is given in {}, not in {unit}", found.info.unit)))
}
