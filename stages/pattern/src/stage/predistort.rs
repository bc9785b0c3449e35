//! The stage `predistort`: the pattern whose sinusoid is uniform along a surface.

use turbid_contract::payload::{Pattern, Scene, SurfaceFrequency};
use turbid_contract::{
    Ctx, Error, Forms, ImageStack, Known, LayerInfo, Problems, Stage, StagePlan, in_ports, out_ports,
};
use turbid_geometry::{Bodies, camera_view};

use crate::analytic::Bore;
use crate::capture::{Picture, Tunnel};
use crate::form::{self, FRINGES_ALONG};
use crate::fringes::{self, Fringe, fringes};
use crate::params::predistort::{Method, Params};
use crate::sample::Sample;
use crate::screen::Screen;
use crate::stage::{Map, PER_VALUE, memory, plane, unfit_scene};
use crate::trace::trace;
use crate::wall::Wall;

in_ports! {
    pub struct In {
        /// The projector, and the surface that it shines on.
        scene: one Scene,
    }
}

out_ports! {
    pub struct Out {
        /// Layers for the port `pattern` of `render`.
        pattern: one Pattern,
        /// Spatial frequency that the fringes reach along the surface.
        surface_frequency: preview SurfaceFrequency,
    }
}

/// `use: predistort`
pub struct Predistort;

impl Stage for Predistort {
    const NAME: &'static str = "predistort";
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "The pattern whose fringes are uniform along a surface, such as the inside of a tube";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        fringes::check(&params.f_x, &[params.orientation_deg], params.phases, problems);
        if params.f_x.is_empty() {
            problems.push_with_hint(
                "f_x",
                "f_x is empty: nothing would be shown",
                "list at least one, such as [0, 0.1]",
            );
        }
        let rays = f64::from(params.rays);
        problems.require((1.0..=64.0).contains(&rays), "rays", rays, "", "lie in [1, 64]");
        let finest = params.pixels_per_period;
        let rule = "be >= 2: what is finer no pixels can show";
        problems.require(finest >= 2.0 && finest.is_finite(), "pixels_per_period", finest, "", rule);
        if let Some(most) = params.flatten {
            problems.require(most.0 >= 1.0, "flatten", most.0, "", "be >= 1");
            if params.method == Method::Capture {
                let hint = "use `method: trace`";
                problems.push_with_hint("flatten", "a picture is stretched to the full range, not flattened", hint);
            }
        }
        let lamps = f64::from(params.lamps);
        problems.require((1.0..=10_000.0).contains(&lamps), "lamps", lamps, "", "lie in [1, 10000]");
        if let Some(scene) = known.get::<Scene>("scene") {
            check_scene(params, &scene, known, problems);
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::of_predistort(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let left_out = if params.flatten.is_none() { vec!["flattening of the irradiance".into()] } else { Vec::new() };
        // Measured inside a tube: a pixel whose light is traced onto the surface, or looked up in a picture, and its values.
        let per_pixel = match params.method {
            Method::Trace | Method::Capture => 4.3e-6,
            Method::Analytic => 0.0,
        };
        let layers = form::of_predistort(params, known).get("pattern").and_then(|pattern| pattern.extent());
        let seconds = layers.map(|all| all.pixels() as f64 * (per_pixel + PER_VALUE * all.layers() as f64));
        let memory = layers.map(memory);
        let method = Some(params.method.name().into());
        StagePlan { method, left_out, seconds, memory, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let scene = &inputs.scene;
        let screen = Screen::of(scene, params.pixels).map_err(|(_, what, hint)| Error::failed_with_hint(what, hint))?;
        let bodies = Bodies::of(scene);
        let wall = Wall::of(scene, &bodies, &params.surface, params.orientation_deg.0)
            .map_err(|(what, hint)| Error::failed_with_hint(what, hint))?;
        let shown = fringes(&params.f_x, &[params.orientation_deg], params.phases);
        let made = match params.method {
            Method::Trace | Method::Analytic => directly(params, &screen, &wall, &shown, ctx)?,
            Method::Capture => captured(params, scene, &screen, &wall, &shown, ctx)?,
        };
        if made.coordinate.iter().all(Option::is_none) {
            return Err(Error::failed_with_hint(
                format!("no light of the projector meets `{}` first", params.surface),
                "turn the projector towards it, or widen its field",
            ));
        }
        let surface_frequency =
            if ctx.wants("surface_frequency") { Some(made.map(params, &screen, &wall, ctx)?) } else { None };
        let mut stack = ImageStack::new(screen.rows, screen.columns);
        // f_x is along this surface, not in the plane of the pattern: frames say so on, and who corrects for a slope must know.
        stack.attributes.insert(FRINGES_ALONG.to_owned(), params.surface.clone().into());
        made.layers.into_iter().for_each(|(info, values)| stack.push(info, plane(&screen, values)));
        Ok(Out { pattern: Pattern(stack), surface_frequency })
    }
}

fn check_scene(params: &Params, scene: &Scene, known: &Known, problems: &mut Problems) {
    let screen = match Screen::of(scene, params.pixels) {
        Ok(screen) => screen,
        Err(lack) => return unfit_scene(lack, known, problems),
    };
    let bodies = Bodies::of(scene);
    let wall = match Wall::of(scene, &bodies, &params.surface, params.orientation_deg.0) {
        Ok(wall) => wall,
        Err((what, hint)) => return problems.push_with_hint("surface", what, hint),
    };
    let hint = "use `method: trace`";
    match params.method {
        Method::Trace => {}
        Method::Analytic => {
            if let Err(what) = Bore::of(wall.solid(), &screen) {
                problems.push_with_hint("method", what, hint);
            }
        }
        Method::Capture => {
            if let Err(what) = tunnel(params, &wall) {
                problems.push_with_hint("method", what, hint);
            }
            match &scene.camera {
                None => problems.push_with_hint("method", "the scene has no camera that could take the picture", hint),
                Some(camera) if camera.pixels.map(|n| n as usize) != [screen.columns, screen.rows] => {
                    let [columns, rows] = camera.pixels;
                    problems.push_with_hint(
                        "method",
                        format!(
                            "the camera takes {columns} x {rows} pixels, the projector shows {} x {}: the picture is the pattern",
                            screen.columns, screen.rows
                        ),
                        "give both the same number of pixels",
                    );
                }
                Some(_) => {}
            }
        }
    }
}

/// Layers, and what is known of the pixels.
struct Made {
    layers: Vec<(LayerInfo, Vec<f32>)>,
    /// Along the surface, at the pixel's centre or near it; `None` where its light does not meet the surface.
    coordinate: Vec<Option<f64>>,
    /// Where the highest f_x was left flat.
    finer: Vec<bool>,
    /// Where an edge of the surface cuts the pixel: its value is that of the part that is there.
    cut: Vec<bool>,
}

impl Made {
    fn map(&self, params: &Params, screen: &Screen, wall: &Wall<'_>, ctx: Ctx<'_>) -> Result<SurfaceFrequency, Error> {
        let hit = |pixel: usize| {
            let (origin, w) = screen.ray(pixel, 0.5, 0.5);
            wall.meet(origin, w).map(|met| met.hit).filter(|_| !self.cut[pixel])
        };
        let shown: Vec<(f64, f64, Vec<&[f32]>)> = params
            .f_x
            .iter()
            .filter(|f| f.0 > 0.0)
            .map(|f| {
                let own = self.layers.iter().filter(|(info, _)| info.f_x_per_mm == Some(f.0));
                (f.0, params.orientation_deg.0, own.map(|(_, values)| values.as_slice()).collect())
            })
            .collect();
        let coordinate = self.coordinate.iter().map(|s| s.map_or(0.0, |s| s as f32)).collect();
        let map = Map { screen, hit: &hit, most_cycles: 1.0 / params.pixels_per_period };
        map.of(&shown, Some(coordinate), &self.finer, ctx)
    }
}

/// By rays or by the formula.
fn directly(params: &Params, screen: &Screen, wall: &Wall<'_>, shown: &[Fringe], ctx: Ctx<'_>) -> Result<Made, Error> {
    let f_x: Vec<f64> = params.f_x.iter().map(|f| f.0).collect();
    let samples: Vec<Option<Sample>> = if params.method == Method::Trace {
        trace(screen, wall, &f_x, params.rays, ctx)?
    } else {
        let bore = Bore::of(wall.solid(), screen).map_err(Error::failed)?;
        (0..screen.pixels()).map(|pixel| bore.sample(screen, &f_x, pixel)).collect()
    };
    let dimmed = dimming(params, &samples);
    let resolved = |sample: &Sample, f: f64| sample.cycles(f) * params.pixels_per_period <= 1.0;
    let layer = |fringe: &Fringe| {
        let k = f_x.iter().position(|&f| f == fringe.f_x).expect("fringes are made of f_x");
        let (sin, cos) = turbid_optics::elementary::sin_cos_turns(fringe.turns);
        let value = |(sample, dimmed): (&Option<Sample>, &f64)| {
            let Some(sample) = sample else { return 0.0 };
            let (c, s) = sample.phasors[k];
            let modulation = if fringe.f_x > 0.0 && resolved(sample, fringe.f_x) { c * cos - s * sin } else { 0.0 };
            // f32 rounds to within [0, 1].
            (dimmed * (0.5 + 0.5 * modulation)).clamp(0.0, 1.0) as f32
        };
        (fringe.info(), samples.iter().zip(&dimmed).map(value).collect())
    };
    let layers = shown.iter().map(layer).collect();
    let highest = f_x.iter().copied().fold(0.0, f64::max);
    let coordinate = samples.iter().map(|s| s.as_ref().map(|s| s.s)).collect();
    let finer = samples.iter().map(|s| s.as_ref().is_some_and(|s| !resolved(s, highest))).collect();
    let cut = samples.iter().map(|s| s.as_ref().is_some_and(|s| !s.whole)).collect();
    Ok(Made { layers, coordinate, finer, cut })
}

/// What the pattern's values are multiplied with.
fn dimming(params: &Params, samples: &[Option<Sample>]) -> Vec<f64> {
    let Some(most) = params.flatten else { return vec![1.0; samples.len()] };
    let lit = || samples.iter().flatten().map(|s| s.irradiance);
    let (least, highest) = (lit().fold(f64::INFINITY, f64::min), lit().fold(0.0, f64::max));
    let wanted = least.max(highest / most.0);
    let factor = |s: &Option<Sample>| s.as_ref().map_or(1.0, |s| (wanted / s.irradiance).min(1.0));
    samples.iter().map(factor).collect()
}

/// Rings per period, and the fewest.
const RINGS: (f64, f64) = (32.0, 500.0);
/// So many rings are solved in seconds.
const MOST_RINGS: f64 = 5000.0;

/// The bore, cut into rings that are fine enough for the fringes.
fn tunnel(params: &Params, wall: &Wall<'_>) -> Result<Tunnel, String> {
    let (radius, length) =
        wall.bore().ok_or("the white tube is lit by rings: the surface must be the bore of a straight tube")?;
    let highest = params.f_x.iter().map(|f| f.0).fold(0.0, f64::max);
    let rings = (RINGS.0 * highest * length).max(RINGS.1).ceil();
    if rings > MOST_RINGS {
        return Err(format!("{:.0} periods along the tube are too many rings to solve", highest * length));
    }
    Ok(Tunnel { radius, length, rings: rings as usize })
}

/// By the picture of the painted tube.
fn captured(
    params: &Params,
    scene: &Scene,
    screen: &Screen,
    wall: &Wall<'_>,
    shown: &[Fringe],
    ctx: Ctx<'_>,
) -> Result<Made, Error> {
    let camera = scene.camera.as_ref().ok_or_else(|| Error::failed("the scene has no camera"))?;
    let view = camera_view(camera).map_err(|e| Error::failed(format!("the camera of the scene is no view: {e:?}")))?;
    let [columns, rows] = camera.pixels.map(|n| n as usize);
    let tunnel = tunnel(params, wall).map_err(Error::failed)?;
    let picture = Picture { camera: &view, columns, rows, wall, tunnel, side: params.rays };
    let textures: Vec<(f64, f64)> = shown.iter().filter(|f| f.f_x > 0.0).map(|f| (f.f_x, f.turns)).collect();
    let mut taken = picture.take(&textures, params.lamps, ctx)?.into_iter();
    let coordinate = |pixel: usize| {
        let (origin, w) = screen.ray(pixel, 0.5, 0.5);
        wall.meet(origin, w).map(|met| met.s)
    };
    let coordinate: Vec<Option<f64>> = (0..screen.pixels()).map(coordinate).collect();
    let mut layers = Vec::new();
    for fringe in shown {
        let values = if fringe.f_x > 0.0 {
            taken.next().ok_or_else(|| Error::failed("the camera does not see the wall of the tube"))?
        } else {
            coordinate.iter().map(|s| if s.is_some() { 0.5 } else { 0.0 }).collect()
        };
        layers.push((fringe.info(), values));
    }
    Ok(Made { layers, coordinate, finer: vec![false; screen.pixels()], cut: vec![false; screen.pixels()] })
}
