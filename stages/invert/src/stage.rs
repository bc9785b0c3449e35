//! The stage `invert`: checks that reflectance and table mean the same, and inverts each wavelength.

use std::borrow::Cow;

use turbid_contract::layers::wavelengths;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Exposure, Lut, Maps, Reflectance, Relief, Scene, Sections};
use turbid_contract::planes::mean_se;
use turbid_contract::sharing::Sharing;
use turbid_contract::{
    Attributes, Ctx, Error, Extent, Extents, Forms, ImageStack, Known, Layer, LayerInfo, LayerKind, Parts, Problems,
    Ratio, Stage, StagePlan, in_ports, out_ports,
};
use turbid_optics::level::named;

use crate::choice::{Choice, choose, orientation};
use crate::conditions::{self, Compared, extremes};
use crate::form;
use crate::inverse::{InverseTable, TOLERANCE};
use crate::joints::{self, correctable};
use crate::lanes::{Lanes, Noise};
use crate::lut::{self, MOST, agree, of_table, sections, table_of, tables};
use crate::memory::memory;
use crate::params::{Method, NoiseBias, Outside, Params};
use crate::pass::{Pass, Tally};
use crate::profile::{self, Correction};
use crate::sectioned::{Places, Solver, prepare};
use crate::uncertain::{Image, told};
use crate::unknown;

in_ports! {
    pub struct In {
        /// Calibrated reflectance.
        reflectance: parts Reflectance,
        /// Table of the same convention, g and n, which holds both f_x.
        lut: one Lut,
        /// Which pixel belongs to which section of the table, where it has any.
        sections: optional Sections,
        /// Heights of the surface, as `profilometry` measures them or `truth` of `render`: maps are then corrected for distance and slope.
        height: optional Relief,
        /// Unit normals of the surface, where they are not to be taken from the heights.
        normals: optional Relief,
        /// Camera and projector, for the correction.
        scene: optional Scene,
    }
}

out_ports! {
    pub struct Out {
        /// mu_a and mu_s' with standard errors and mask.
        maps: one Maps,
        /// Covariance of mu_a and mu_s' of each pixel.
        covariance: optional Covariance,
        /// Light and view of each pixel; only where the shape is corrected for.
        exposure: optional Exposure,
    }
}

/// CPU seconds for a table of the default size (measured).
const PER_TABLE: f64 = 0.06;
/// Sections that a table is taken to have.
const SECTIONS: f64 = 5.0;

/// `use: invert`
pub struct Invert;

impl Stage for Invert {
    const NAME: &'static str = "invert";
    const VERSION: u32 = 10;
    const ABOUT: &'static str =
        "maps of mu_a and mu_s' from calibrated reflectance by a look-up table, with standard errors";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        if let Some(f_x) = &params.f_x {
            let (many, count) = (params.method == Method::LeastSquares, f_x.len());
            if !(count == 2 || many && (2..=MOST).contains(&count)) {
                let rule = if many { format!("2 to {MOST}") } else { "2".to_owned() };
                let message = format!("{count} f_x are given; `method: {}` takes {rule}", params.method.name());
                problems.push_with_hint("f_x", message, "`method: least_squares` takes more than two");
            }
            for (k, f) in f_x.iter().enumerate() {
                let (at, low) = (format!("f_x.{k}"), if k == 0 { None } else { Some(f_x[k - 1].0) });
                match low {
                    None => problems.require(f.0 >= 0.0, at, f.0, "mm^-1", "be >= 0"),
                    Some(low) => problems.require(
                        f.0 > low && f.0.is_finite(),
                        at,
                        f.0,
                        "mm^-1",
                        if k == 1 { "be above the first f_x" } else { "be above the f_x before it" },
                    ),
                };
            }
        }
        if params.method == Method::LeastSquares && params.outside == Outside::Nearest {
            problems.push_with_hint(
                "outside",
                "`method: least_squares` masks what lies outside the table",
                "write `outside: mask`, or leave it out",
            );
        }
        profile::check(params.profile.as_ref(), known, problems);
        if let Some(Ratio(most)) = params.largest_misreading {
            problems.require(most > 0.0 && most.is_finite(), "largest_misreading", most, "", "be > 0 (0.1 is 10 %)");
        }
        conditions::check(params, known, problems);
        joints::check(params, known, problems);
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let corrects = known.connected.iter().any(|port| port == "height");
        let left_out = if corrects { Vec::new() } else { vec!["profile correction (no heights)".to_owned()] };
        // To prepare the table takes most of it, for each of its sections; how many those are shows when they are made.
        let sections = if known.connected.iter().any(|port| port == "sections") { SECTIONS } else { 1.0 };
        let seconds = Some(PER_TABLE * sections + conditions::seconds(params, known));
        let of = |port: &str| known.extent(port).map_or(0, Extent::bytes);
        let others = ["lut", "sections", "height", "normals"].map(of).iter().sum();
        let memory = known.extent("reflectance").map(|stack| memory(stack, others, corrects, &known.wanted));
        let in_parts = vec!["reflectance"];
        let (memory, makes) = memory.map_or((None, Extents::new()), |(bytes, makes)| (Some(bytes), makes));
        StagePlan {
            method: Some(params.method.name().into()),
            left_out,
            seconds,
            memory,
            in_parts,
            makes,
            ..StagePlan::default()
        }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let (head, lut) = (inputs.reflectance.head(), &inputs.lut);
        let wavelengths_nm = wavelengths(&head.layers, "r_d");
        agree(&head.attributes, &lut.0.attributes, &wavelengths_nm)?;
        let correction = correction(params, &inputs, ctx)?;
        // What is said of the reflectance, and how its surface lies to the light; the rest comes wavelength by wavelength.
        let about = inputs.reflectance.conditions()?.0;
        let Choice { f_x, of } = choose(&head.layers, params)?;
        let sectioned = lut.0.attributes.contains_key("sections");
        let places = Places::new(inputs.sections.as_ref(), sections(lut), (head.rows, head.columns), sectioned)?;
        let noise = head.layers.iter().any(|info| info.kind == LayerKind::StandardError);
        let prepared = prepare(lut, &f_x, params, noise, ctx)?;
        let table_error = prepared.iter().filter_map(|p| p.table.as_ref()).map(|t| t.worst_error).fold(0.0, f64::max);
        if params.method == Method::Table {
            ctx.measure("table_error", 100.0 * table_error, "%");
        }
        if table_error > TOLERANCE && params.method == Method::Table {
            let (worst, size) =
                (100.0 * table_error, prepared.iter().filter_map(|p| p.table.as_ref()).map(InverseTable::size));
            let size = size.fold(0, usize::max);
            ctx.warn(format!("resampling the table adds up to {worst:.2} % even with {size} x {size} nodes"));
        }
        let solvers: Vec<Solver<'_>> = prepared.iter().map(|p| p.solver(params.method, params.outside)).collect();
        let pass = |noise: bool| Pass {
            noise,
            covariance: ctx.wants("covariance"),
            outside: params.outside == Outside::Nearest,
            corrects: params.noise_bias == NoiseBias::Correct,
            single: params.method == Method::Table,
        };
        let mut maps = Layers::default();
        let mut covariance = Layers::default();
        // The table of each wavelength; sections are all those of the one table.
        let several = tables(&lut.0.attributes) > 1;
        let mut table_at = Vec::new();
        for (wavelength_nm, at) in of {
            let place = lut::places(&lut.0.attributes, &[wavelength_nm])?[0];
            let table = table_of(&lut.0.attributes, place);
            table_at.push((wavelength_nm, table));
            let solvers = if several { &solvers[table..=table] } else { &solvers[..] };
            let seen = Seen::of(&inputs.reflectance, at, wavelength_nm, correction.as_ref())?;
            invert(&seen, (solvers, &places, correction.as_ref()), &pass, ctx, &mut maps, &mut covariance)?;
        }
        let exposure = match (&correction, ctx.wants("exposure")) {
            (Some(correction), true) => {
                let mut image = correction.image(&f_x);
                image.take_pixel_pitch(&about);
                Some(Exposure(image))
            }
            (None, true) => {
                let what = "`exposure` is wanted, but without the input `height` no light falls on any shape";
                return Err(Error::failed_with_hint(what, "connect `height` and `scene`"));
            }
            (_, false) => None,
        };
        let mut attributes = about.attributes.clone();
        attributes.insert("f_x".into(), f_x.clone().into());
        if params.method == Method::Table {
            attributes.insert("table_error".into(), table_error.into());
        }
        let mut covariance = (!covariance.values.is_empty()).then(|| {
            let mut stack = covariance.into_stack(&about, attributes.clone());
            stack.attributes.insert("quantities".into(), form::quantities());
            stack
        });
        let mut maps = maps.into_stack(&about, attributes);
        for table in 0..tables(&lut.0.attributes) {
            let at: Vec<Option<f64>> = table_at.iter().filter(|(_, of)| *of == table).map(|(nm, _)| *nm).collect();
            let compared = extremes(f_x.clone()).and_then(|f_x| {
                let (own, channel) =
                    (of_table(&lut.0.attributes, table), if several { first(&table_at, table) } else { 0 });
                Compared::of(&about.attributes, &own, (f_x, channel), correction.is_some())
            });
            if let Some(compared) = compared {
                let most = params.largest_misreading.map(|most| most.0);
                conditions::tell((&compared, &at), &about, &mut maps, covariance.as_mut(), most, ctx)?;
            }
        }
        Ok(Out { maps: Maps(maps), covariance: covariance.map(Covariance), exposure })
    }
}

/// The number of the first wavelength that reads this table.
fn first(table_at: &[(Option<f64>, usize)], table: usize) -> usize {
    table_at.iter().position(|(_, of)| *of == table).unwrap_or(0)
}

/// What the shape does to each pixel, where it is known.
///
/// Errors: a table that the scaling of half-spaces does not hold for, fringes of several orientations, a shape that does not fit the image.
fn correction(params: &Params, inputs: &In<'_>, ctx: Ctx<'_>) -> Result<Option<Correction>, Error> {
    let Some(relief) = &inputs.height else { return Ok(None) };
    let scene = inputs.scene.as_ref().ok_or_else(|| Error::failed("`height` is connected, but not `scene`"))?;
    let head = inputs.reflectance.head();
    correctable(&head.attributes, &inputs.lut.0.attributes)?;
    let orientation = orientation(&head.layers, &choose(&head.layers, params)?)?;
    let size = (head.rows, head.columns);
    let normals = inputs.normals.as_ref().map(|Relief(stack)| stack);
    let profile = params.profile.unwrap_or_default();
    Correction::new(&profile, scene, relief, normals, size, orientation, ctx).map(Some)
}

/// Layers of a stack in the making; values first.
#[derive(Default)]
struct Layers {
    values: Vec<(LayerInfo, Array2<f32>)>,
    others: Vec<(LayerInfo, Array2<f32>)>,
}

impl Layers {
    fn into_stack(self, like: &ImageStack, attributes: Attributes) -> ImageStack {
        let mut stack = ImageStack::new(like.rows(), like.columns());
        stack.attributes = attributes;
        self.values.into_iter().chain(self.others).for_each(|(info, data)| stack.push(info, data));
        stack
    }
}

/// The reflectance at one wavelength.
struct Seen {
    stack: ImageStack,
    /// Where R_d at each f_x is in the whole, which covariances point to, and in `stack`.
    places: Vec<usize>,
    layers: Vec<usize>,
}

impl Seen {
    /// As it would be on a plane, where the shape is corrected for. Error: it cannot be read.
    fn of(
        reflectance: &Parts<'_, Reflectance>,
        places: Vec<usize>,
        wavelength_nm: Option<f64>,
        correction: Option<&Correction>,
    ) -> Result<Self, Error> {
        let held = reflectance.places(wavelength_nm);
        let at = |place: &usize| held.iter().position(|held| held == place).expect("it is of this wavelength");
        let layers = places.iter().map(at).collect();
        let stack = reflectance.channel(wavelength_nm)?.0;
        let stack = correction.map(|correction| correction.corrected(&stack)).unwrap_or(stack);
        Ok(Self { stack, places, layers })
    }
}

fn invert(
    Seen { stack, places: whole, layers }: &Seen,
    (solvers, places, correction): (&[Solver<'_>], &Places, Option<&Correction>),
    pass: &dyn Fn(bool) -> Pass,
    ctx: Ctx<'_>,
    maps: &mut Layers,
    covariances: &mut Layers,
) -> Result<(), Error> {
    let of: Vec<&Layer> = layers.iter().map(|&k| &stack.layers[k]).collect();
    let wavelength_nm = of[0].info.wavelength_nm;
    let r: Vec<_> = of.iter().map(|l| l.pixels()).collect();
    let se: Option<Vec<_>> = of.iter().map(|l| stack.standard_error(&l.info).map(Layer::pixels)).collect();
    let known = se.is_some();
    let se = se.unwrap_or_default();
    let between = |a: usize, b: usize| {
        let wanted = [whole[a] as u32, whole[b] as u32];
        let found = stack.layers.iter().find(|l| {
            let turned = [wanted[1], wanted[0]];
            l.info.kind == LayerKind::Covariance && l.info.pair.is_some_and(|p| p == wanted || p == turned)
        });
        found.map(Layer::pixels)
    };
    let count = of.len();
    // [a][b]; empty where they are independent, and on the diagonal.
    let covariance: Vec<Option<_>> = (0..count * count)
        .map(|ab| if ab / count == ab % count { None } else { between(ab / count, ab % count) })
        .collect();
    // Of R_a and R_b relative to both.
    let c_r = |i: usize, a: usize, b: usize| {
        let per = |k: usize| 1.0 / f64::from(r[k][i]);
        if a == b {
            let relative = f64::from(se[a][i]) * per(a);
            return relative * relative;
        }
        covariance[a * count + b].as_ref().map_or(0.0, |c| f64::from(c[i])) * per(a) * per(b)
    };
    let carried = stack.mask(wavelength_nm).map(Layer::pixels);
    let mask = both(carried.as_deref(), places.mask.as_deref());
    let pass = pass(known);
    // One by one, not as copies of the first: the system hands out pages of zeros when they are first written.
    let mut planes: Vec<_> = (0..pass.plane_count()).map(|_| Array2::zeros((stack.rows(), stack.columns()))).collect();
    let shaken = known && correction.is_some_and(|c| c.shakes.is_some());
    // Most images are of this kind: worth a way of their own.
    let lanes = match (solvers, places.sectioned()) {
        ([Solver::Pair(inverter)], false) if inverter.reads_the_table() && !shaken => Some(Lanes {
            inverter,
            correction,
            r: [&r[0], &r[1]],
            noise: known.then(|| Noise { se: [&se[0], &se[1]], covariance: covariance[1].as_deref() }),
            level: named(ctx.simd()),
        }),
        _ => None,
    };
    let tiles = ctx.fill_planes(&mut planes, |pixels, planes| {
        if let Some(lanes) = &lanes {
            return lanes.run(&pass, mask.as_deref(), pixels, planes);
        }
        pass.run(mask.as_deref(), pixels, planes, |i| {
            let mut values = [0.0; MOST];
            values.iter_mut().zip(&r).for_each(|(value, r)| *value = f64::from(r[i]));
            let noise = |a: usize, b: usize| c_r(i, a, b);
            let noise: Option<&dyn Fn(usize, usize) -> f64> = if known { Some(&noise) } else { None };
            let solved = places.solve(i, |k| solvers[k].solve(&values[..count], noise))?;
            Ok(correction.map_or(solved, |correction| correction.stretched(i, solved)))
        })
    })?;
    let mut tally = tiles.iter().fold(Tally::default(), Tally::add);
    let mut flags = unknown::of_layers(stack, &of);
    let sharing = of.iter().map(|l| stack.sharing(&l.info)).fold(Sharing::NONE, Sharing::or);
    // A node that is near says nothing of slopes, and pixels that hold the nearest one are not lost.
    if known && !pass.outside && !solvers.iter().any(Solver::reads_nodes) {
        let image =
            Image::of(stack.columns(), (&r, &se, &covariance), mask.as_deref(), &planes, &sharing, pass.corrects);
        let kept = image.keep(
            &|i, r, noise| {
                let solved = places.solve(i, |k| solvers[k].solve(r, Some(noise)))?;
                Ok(correction.map_or(solved, |correction| correction.stretched(i, solved)))
            },
            ctx,
        )?;
        pass.write_kept(&kept, &mut planes, &mut tally);
        unknown::flag(&mut flags, told(&kept, stack, ctx), stack.rows() * stack.columns());
    }
    let reasons = ctx.measure_masked(planes[planes.len() - 1].iter().copied());
    let sums = &tally.sums;
    if sums.mu_a() > 0.0 {
        ctx.measure("noise_bias_mu_a", 100.0 * sums.noise_bias() / sums.mu_a(), "%");
    }
    if tally.good == 0 {
        ctx.warn(format!("all pixels are masked: {reasons}"));
    }
    if tally.outside > 0 {
        ctx.warn(format!("{} pixels lie outside the table and hold the nearest node", tally.outside));
    }

    let mean_known = of.iter().all(|l| stack.se_unknown(&l.info).is_none() || l.info.mean_se.is_some());
    let flags = unknown::plane(flags, &planes[planes.len() - 1]);
    let infos = ["mu_a", "mu_s_prime"].map(|name| form::property(name, wavelength_nm));
    let factors = (known && mean_known).then(|| {
        let plane = |k: usize| planes[k].as_slice().expect("planes are row-major");
        let mask = plane(planes.len() - 1);
        [2, 3].map(|k| sharing.factor(plane(k), |i| mask[i] == 0.0))
    });
    let mut planes = planes.into_iter();
    let mut next = || planes.next().expect("as many planes as plane_count says");
    for (k, info) in infos.iter().enumerate() {
        let mut info = info.clone();
        let own = factors.as_ref().and_then(|factors| mean_se(sums.variances()[k], tally.good, factors[k]));
        info.mean_se = own.map(|own| libm::hypot(own, sums.common()[k] / tally.good as f64));
        maps.values.push((info, next()));
    }
    if known {
        infos.iter().for_each(|info| maps.others.push((info.standard_error(), next())));
        for pair in [[0, 0], [0, 1], [1, 1]].into_iter().filter(|_| pass.covariance) {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "mm^-2");
            (info.pair, info.wavelength_nm) = (Some(pair), wavelength_nm);
            covariances.values.push((info, next()));
        }
    }
    if pass.outside {
        let mut info = LayerInfo::value("outside", "1");
        info.wavelength_nm = wavelength_nm;
        maps.others.push((info, next()));
    }
    let mut info = LayerInfo::new("mask", LayerKind::Mask, "1");
    info.wavelength_nm = wavelength_nm;
    let mask = next();
    if known && pass.covariance {
        covariances.others.push((info.clone(), mask.clone()));
    }
    maps.others.push((info, mask));
    if let Some(flags) = flags.filter(|_| known) {
        infos.iter().for_each(|info| maps.others.push((info.se_unknown(), flags.clone())));
    }
    Ok(())
}

/// The first reason that either names.
fn both<'m>(a: Option<&'m [f32]>, b: Option<&'m [f32]>) -> Option<Cow<'m, [f32]>> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.iter().zip(b).map(|(&a, &b)| if a != 0.0 { a } else { b }).collect()),
        (one, other) => one.or(other).map(Cow::Borrowed),
    }
}
