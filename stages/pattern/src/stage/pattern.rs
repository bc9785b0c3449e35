//! The stage `pattern`: what a projector shows, pixel by pixel.

use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{Pattern, Picture, Scene, SurfaceFrequency};
use turbid_contract::{
    Ctx, Error, FileUse, Forms, ImageStack, Known, LayerInfo, Problems, Stage, StagePlan, in_ports, out_ports,
    serde_json,
};
use turbid_geometry::{Bodies, picture};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::philox;

use crate::dither::dither;
use crate::form;
use crate::fringes::{self, Fringe, fringes};
use crate::image;
use crate::params::pattern::{Params, Wave};
use crate::screen::Screen;
use crate::speckle::{Speckle, speckle};
use crate::stage::{Map, PER_VALUE, memory, plane, unfit_scene};

in_ports! {
    pub struct In {
        /// The projector, and what it shines on.
        scene: one Scene,
    }
}

out_ports! {
    pub struct Out {
        /// Layers for the port `pattern` of `render`.
        pattern: one Pattern,
        /// Spatial frequency that the fringes reach on the surfaces of the scene.
        surface_frequency: preview SurfaceFrequency,
    }
}

/// `use: pattern`
pub struct PatternStage;

impl Stage for PatternStage {
    const NAME: &'static str = "pattern";
    const VERSION: u32 = 1;
    const ABOUT: &'static str =
        "What a projector shows: sinusoids, square waves, dithered fringes, speckle, pictures from files";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(params: &Params) -> bool {
        params.speckle.is_some()
    }

    fn files(params: &Params) -> Vec<FileUse> {
        params.image.iter().flat_map(|image| image.uses(params.max_file_mb)).collect()
    }

    fn canonical(params: &Params) -> Result<serde_json::Value, String> {
        // Where the files lie does not matter: content and names are in the key.
        let mut params = params.clone();
        for path in params.image.iter_mut().flat_map(|image| &mut image.files) {
            *path = path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
        }
        canonical_value(&params)
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        fringes::check(&params.f_x, &params.orientation_deg, params.phases, problems);
        let patterns =
            [("f_x", !params.f_x.is_empty()), ("speckle", params.speckle.is_some()), ("image", params.image.is_some())];
        let mut given = patterns.iter().filter(|(_, given)| *given).map(|(name, _)| *name);
        match (given.next(), given.next()) {
            (None, _) => problems.push_with_hint(
                "f_x",
                "f_x is empty: nothing would be shown",
                "list at least one, such as [0, 0.1], or give `speckle` or `image`",
            ),
            (Some(one), Some(other)) => problems.push_with_hint(
                other,
                format!("`{one}` and `{other}` are two patterns"),
                "leave one of them out; give each a stage of its own",
            ),
            (Some(_), None) => {}
        }
        if let Some(speckle) = &params.speckle {
            check_speckle(speckle, problems);
        }
        let size = params.image.as_ref().and_then(|image| {
            if params.pixels.is_some() {
                problems.push_with_hint("pixels", "a picture has pixels of its own", "leave `pixels` out");
            }
            image.check(|at| known.files.get(at), problems)
        });
        if params.image.is_some() && size.is_none() {
            return;
        }
        if let Some(scene) = known.get::<Scene>("scene") {
            match Screen::of(&scene, size.or(params.pixels)) {
                Err(("pixels", what, _)) if size.is_some() => problems.push_with_hint(
                    image::at(0),
                    what,
                    "make the picture for this projector, or leave the projector's `pixels` out",
                ),
                Err(lack) => unfit_scene(lack, known, problems),
                Ok(screen) => check_resolution(params, &screen, problems),
            }
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::of_pattern(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let method = match (&params.image, params.speckle, params.wave) {
            (Some(_), ..) => "image",
            (None, Some(_), _) => "speckle",
            (None, None, Wave::Sinusoid) => "sinusoid",
            (None, None, Wave::Square) => "square",
        };
        let layers = form::of_pattern(params, known).get("pattern").and_then(|pattern| pattern.extent());
        let seconds = layers.map(|all| (all.pixels() * all.layers()) as f64 * PER_VALUE);
        let memory = layers.map(memory);
        StagePlan { method: Some(method.into()), seconds, memory, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let pictures = pictures(params, ctx)?;
        let size = pictures.first().map(|picture| [picture.columns, picture.rows]);
        let screen = Screen::of(&inputs.scene, size.or(params.pixels)).map_err(|(path, what, hint)| {
            if path.is_empty() { Error::failed_with_hint(what, hint) } else { Error::invalid(path, what) }
        })?;
        let layers = layers(params, &pictures, &screen, ctx)?;
        let surface_frequency = if ctx.wants("surface_frequency") {
            Some(surface_frequency(params, &inputs.scene, &screen, &layers, ctx)?)
        } else {
            None
        };
        let mut stack = ImageStack::new(screen.rows, screen.columns);
        layers.into_iter().for_each(|(info, values)| stack.push(info, plane(&screen, values)));
        Ok(Out { pattern: Pattern(stack), surface_frequency })
    }
}

fn check_speckle(speckle: &Speckle, problems: &mut Problems) {
    let (length, contrast) = (speckle.correlation_length.0, speckle.contrast.0);
    problems.require(length > 0.0, "speckle.correlation_length", length, "mm", "be > 0");
    problems.require(contrast > 0.0 && contrast <= 1.0, "speckle.contrast", contrast, "", "lie in (0, 1]");
    let count = f64::from(speckle.count);
    problems.require((1.0..=4096.0).contains(&count), "speckle.count", count, "", "lie in [1, 4096]");
}

/// What the projector's pixels cannot show.
fn check_resolution(params: &Params, screen: &Screen, problems: &mut Problems) {
    let pitch = screen.pitch();
    for (i, f) in params.f_x.iter().enumerate() {
        let cycles = params.orientation_deg.iter().map(|o| {
            let (x, y) = Fringe { f_x: f.0, orientation_deg: o.0, turns: 0.0 }.along();
            let view = &screen.view;
            let over = |axis: glam::DVec3, pitch: f64| (axis.x * x + axis.y * y).abs() * pitch;
            over(view.right, pitch[0]).max(over(view.top, pitch[1]))
        });
        let worst = cycles.fold(0.0, f64::max);
        // Room for the rounding of a pitch that was meant to be exactly half a period.
        if worst > 0.5 * (1.0 + 1e-9) {
            problems.push_with_hint(
                format!("f_x.{i}"),
                format!(
                    "f_x = {f} is beyond what the projector's pixels of {} x {} mm resolve ({:.4} mm^-1)",
                    pitch[0],
                    pitch[1],
                    0.5 / worst * f.0
                ),
                "give the projector more pixels or a smaller field, or lower f_x",
            );
        }
    }
    if let Some(speckle) = &params.speckle {
        let (length, widest) = (speckle.correlation_length.0, pitch[0].max(pitch[1]));
        if length > 0.0 && length < 2.0 * widest {
            problems.push_with_hint(
                "speckle.correlation_length",
                format!(
                    "correlation_length = {length} mm is below two of the projector's pixels of {} x {} mm",
                    pitch[0], pitch[1]
                ),
                "give the projector more pixels or a smaller field, or larger speckles",
            );
        }
        let shortest = pitch[0].min(pitch[1]);
        if length > 0.1 * shortest * (screen.columns.max(screen.rows) as f64) {
            problems.warn(
                "speckle.correlation_length",
                format!("correlation_length = {length} mm: fewer than a hundred speckles in the field"),
            );
        }
    }
}

/// The pictures of all files, of one size.
fn pictures(params: &Params, ctx: Ctx<'_>) -> Result<Vec<Picture>, Error> {
    let Some(image) = &params.image else { return Ok(Vec::new()) };
    let mut pictures: Vec<Picture> = Vec::new();
    for FileUse { at, path, .. } in image.uses(params.max_file_mb) {
        let bytes = ctx.file(&at).ok_or_else(|| Error::failed(format!("`{path}` was not read")))?;
        let picture = picture::read(&bytes).map_err(|what| Error::invalid(at.as_str(), format!("`{path}`: {what}")))?;
        if pictures.first().is_some_and(|first| (first.columns, first.rows) != (picture.columns, picture.rows)) {
            return Err(Error::invalid(at.as_str(), format!("`{path}` has another size than the first picture")));
        }
        pictures.push(picture);
    }
    Ok(pictures)
}

fn layers(
    params: &Params,
    pictures: &[Picture],
    screen: &Screen,
    ctx: Ctx<'_>,
) -> Result<Vec<(LayerInfo, Vec<f32>)>, Error> {
    let values: Vec<Vec<f32>> = if let Some(image) = &params.image {
        pictures.iter().map(|picture| image.values(picture)).collect()
    } else if let Some(speckles) = &params.speckle {
        let key = philox::key(ctx.seed());
        ctx.map_tiles(speckles.count as usize, |i| {
            speckle(speckles, screen.pitch(), screen.columns, screen.rows, key, i as u32)
        })?
    } else {
        let shown = fringes(&params.f_x, &params.orientation_deg, params.phases);
        ctx.map_tiles(shown.len(), |i| fringe_values(params.wave, &shown[i], screen))?
    };
    let mut layers: Vec<(LayerInfo, Vec<f32>)> = form::layers(params).into_iter().zip(values).collect();
    layers.iter_mut().for_each(|(_, values)| dither(params.dither, values, screen.columns));
    Ok(layers)
}

/// Parts of a pixel, per side, over which a square wave is averaged.
const PARTS: u32 = 16;

fn fringe_values(wave: Wave, fringe: &Fringe, screen: &Screen) -> Vec<f32> {
    if fringe.f_x == 0.0 {
        return vec![0.5; screen.pixels()];
    }
    let (x, y) = fringe.along();
    let turns = |pixel: usize, px: f64, py: f64| {
        let p = screen.on_plane(pixel, px, py);
        x * p.x + y * p.y + fringe.turns
    };
    let value = |pixel: usize| match wave {
        Wave::Sinusoid => 0.5 + 0.5 * sin_cos_turns(turns(pixel, 0.5, 0.5)).1,
        Wave::Square => {
            let part = |k: u32| (f64::from(k) + 0.5) / f64::from(PARTS);
            let parts = (0..PARTS).flat_map(|i| (0..PARTS).map(move |j| (part(i), part(j))));
            let bright = parts.filter(|&(px, py)| {
                // Its place in the period, from -1/2.
                let t = turns(pixel, px, py);
                (t - t.round()).abs() < 0.25
            });
            bright.count() as f64 / f64::from(PARTS * PARTS)
        }
    };
    // f32 rounds to within [0, 1].
    (0..screen.pixels()).map(|pixel| value(pixel).clamp(0.0, 1.0) as f32).collect()
}

fn surface_frequency(
    params: &Params,
    scene: &Scene,
    screen: &Screen,
    layers: &[(LayerInfo, Vec<f32>)],
    ctx: Ctx<'_>,
) -> Result<SurfaceFrequency, Error> {
    let bodies = Bodies::of(scene);
    let hit = |pixel: usize| {
        let (origin, w) = screen.ray(pixel, 0.5, 0.5);
        bodies.first_hit(origin, w)
    };
    let map = Map { screen, hit: &hit, most_cycles: 0.5 };
    let mut shown = Vec::new();
    for (f, o) in form::mapped(params) {
        let own = layers.iter().filter(|(info, _)| info.f_x_per_mm == Some(f) && info.orientation_deg == Some(o));
        shown.push((f, o, own.map(|(_, values)| values.as_slice()).collect()));
    }
    map.of(&shown, None, &vec![false; screen.pixels()], ctx)
}
