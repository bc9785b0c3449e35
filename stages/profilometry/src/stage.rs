//! The stage `profilometry`: phases and geometry in, heights with errors and reasons out.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Maps, MaskReason, Phase, Rig as Rigs, Scene};
use turbid_contract::{
    Ctx, Error, Extent, Forms, ImageStack, Known, Layer, LayerInfo, LayerKind, Length, Problems, Stage, StagePlan,
    in_ports, out_ports,
};
use turbid_geometry::tangent;

use crate::form;
use crate::formula::Formula;
use crate::geometry::Rig;
use crate::params::{Method, Params, ReferenceSurface, Unwrap};
use crate::phase::{Difference, Fringes, difference, reference_coordinates, refine, same};
use crate::solve::{Height, Line, by_formula, triangulate};
use crate::unwrap::unwrap;

in_ports! {
    pub struct In {
        /// Phase of the fringes on the sample.
        sample: one Phase,
        /// Phase of the same fringes on the reference surface; computed if left out.
        reference: optional Phase,
        /// Camera and projector.
        scene: one Scene,
    }
}

out_ports! {
    pub struct Out {
        /// Height (world z, mm) with standard error and mask.
        height: one Maps,
        /// Unit normals towards the camera, from 5 x 5 pixels.
        normals: optional Maps,
    }
}

/// Bytes for each pixel beside its inputs: phases, their differences and whole turns, coordinates, heights with slopes, all some thirty numbers in f64, and
/// the outputs.
const OF_PIXEL: u64 = 250;

/// `use: profilometry`
pub struct Profilometry;

impl Stage for Profilometry {
    const NAME: &'static str = "profilometry";
    const VERSION: u32 = 5;
    const ABOUT: &'static str = "Height of a surface from the phase of the fringes on it, with standard errors";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        form::check(params, known, problems);
        if let Some([low, high]) = params.heights {
            problems.require(high.0 > low.0, "heights.1", high.0, "mm", "be above the lowest height");
        }
        if let Some(f_x) = params.f_x {
            problems.require(f_x.0 > 0.0, "f_x", f_x.0, "mm^-1", "be > 0");
        }
        if let Some(ReferenceSurface::Tube(tube)) = params.reference_surface {
            for (name, length) in [("inner_diameter", tube.inner_diameter), ("length", tube.length)] {
                let field = format!("reference_surface.tube.{name}");
                problems.require(length.0 > 0.0, field, length.0, "mm", "be > 0");
            }
            if params.method != Method::Triangulation {
                let rule = "only triangulation knows another reference than a plane";
                problems.push("method", rule);
            }
        }
        if let Some(scene) = known.get::<Scene>("scene") {
            match Rig::new(&scene, params.orientation_deg.map_or(0.0, |o| o.0)) {
                Err(what) => problems.push("", what),
                Ok(rig) => {
                    match (params.orientation_deg, sensitive(&rig)) {
                        (Some(orientation), Err(what)) => {
                            problems.push("orientation_deg", format!("fringes of {orientation} {what}"));
                        }
                        (None, _) if rig.apart() <= LEAST_BASELINE * rig.projector.height() => {
                            let message =
                                "camera and projector stand one above the other: fringes of no direction show a height";
                            problems.push_with_hint("", message, "move one of them sideways");
                        }
                        (None, Err(what)) => {
                            let message = format!("fringes along x (orientation 0 deg) {what}");
                            problems.warn(
                                "",
                                format!("{message}; say orientation_deg where those of the sample are turned"),
                            );
                        }
                        _ => {}
                    }
                    if let Some(surface @ ReferenceSurface::Tube(_)) = &params.reference_surface
                        && reference_coordinates(&rig, surface).iter().all(Result::is_err)
                    {
                        let hint = "compare its diameter, length, top and center with the scene";
                        problems.push_with_hint(
                            "reference_surface",
                            "no pixel of the camera sees the reference tube",
                            hint,
                        );
                    }
                    if let (Method::Formula, Some(what)) = (params.method, departs(&rig)) {
                        problems.warn("method", format!("the formula does not hold exactly: {what}"));
                    }
                }
            }
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let method = match params.method {
            Method::Triangulation => "triangulation",
            Method::Formula => "formula",
            Method::ReferenceMap => "reference_map",
        };
        let mut left_out = Vec::new();
        if let (Some(scene), Unwrap::Auto, Some(_), Some(f_x)) =
            (known.get::<Scene>("scene"), params.unwrap, params.heights, params.f_x)
            && let Ok(rig) = Rig::new(&scene, params.orientation_deg.map_or(0.0, |o| o.0))
            && within_a_turn(&rig, params, f_x.0)
        {
            left_out.push("unwrapping (|dphi| < pi at all heights)".to_owned());
        }
        let sample = known.extent("sample");
        let memory = sample.map(|sample| {
            OF_PIXEL * sample.pixels() + sample.bytes() + known.extent("reference").map_or(0, Extent::bytes)
        });
        let wants_normals = known.wanted.iter().any(|port| port == "normals");
        // Height, its standard error, the mask; three parts of the normal and its mask.
        let ports = [("height", 3, true), ("normals", 4, wants_normals)].into_iter().filter(|port| port.2);
        let images = |pixels| ports.map(|(port, layers, _)| (port, Extent::Images { pixels, layers })).collect();
        let makes = sample.map(|sample| images(sample.pixels())).unwrap_or_default();
        StagePlan { method: Some(method.into()), left_out, memory, makes, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let stack = &inputs.sample.0;
        let fringes = Fringes::of(stack, params)?;
        let rig = Rig::new(&inputs.scene, fringes.orientation_deg).map_err(Error::failed)?;
        let reference = inputs.reference.as_ref().map(|Phase(stack)| stack);
        for (what, stack) in [("sample", Some(stack)), ("reference", reference)] {
            if let Some(stack) = stack.filter(|s| (s.rows(), s.columns()) != (rig.rows, rig.columns)) {
                let (columns, rows) = (stack.columns(), stack.rows());
                let camera = format!("{} x {}", rig.columns, rig.rows);
                return Err(Error::failed(format!("the {what} has {columns} x {rows} pixels, the camera {camera}")));
            }
        }
        if let Some(reference) = reference {
            Rigs::shared(&stack.attributes, &reference.attributes)?;
        }
        sensitive(&rig).map_err(|what| {
            let place = format!("the fringes (orientation {} deg)", fringes.orientation_deg);
            Error::failed_with_hint(format!("{place} {what}"), "project fringes that vary along the baseline")
        })?;
        let surface = params.reference_surface.unwrap_or(ReferenceSurface::Plane(Length(rig.plane())));
        let coordinates = reference_coordinates(&rig, &surface);
        let mut mask = masks(stack, reference, &coordinates);
        let found = turns_found(params, &rig, &fringes, stack, reference, &coordinates, &mask, ctx)?;
        let f_x = fringes.f_x(fringes.last());
        let heights = heights(params, &rig, &fringes, reference, &coordinates, &found, f_x, &mask)?;
        let mut out = planes(&rig, &heights, &found, &mut mask, ctx);
        let mut normals = ctx.wants("normals").then(|| normals(&rig, &out, &mask));
        if let Some(camera) = &inputs.scene.camera {
            out.set_pixel_pitch(camera);
            normals.iter_mut().for_each(|normals| normals.0.set_pixel_pitch(camera));
        }
        Ok(Out { height: Maps(out), normals })
    }
}

/// Share of the distance that camera and projector must stand apart.
const LEAST_BASELINE: f64 = 1e-3;

/// Whether the fringes tell heights apart: the baseline along them is more than a thousandth of the distance.
fn sensitive(rig: &Rig) -> Result<(), String> {
    let (baseline, distance) = (rig.baseline(), rig.projector.height());
    if baseline.abs() > LEAST_BASELINE * distance {
        return Ok(());
    }
    Err(format!(
        "show no height: along their direction camera and projector are {baseline:.3} mm apart, {distance:.1} mm from the surface"
    ))
}

/// What the formula assumes and the set-up does not have.
fn departs(rig: &Rig) -> Option<String> {
    let (c, p, plane) = (rig.camera.position, rig.projector.position, rig.plane());
    if (c.z - p.z).abs() > 1e-3 * (p.z - plane).abs() {
        return Some(format!("camera and projector stand {} and {} mm over the plane", c.z - plane, p.z - plane));
    }
    let distorted = rig.camera.distortion.is_some() || rig.projector.distortion.is_some();
    distorted.then(|| "a lens distorts".to_owned())
}

/// The first reason against each pixel.
fn masks(
    sample: &ImageStack,
    reference: Option<&ImageStack>,
    coordinates: &[Result<f64, MaskReason>],
) -> Vec<MaskReason> {
    let mut mask: Vec<MaskReason> = coordinates.iter().map(|u| u.err().unwrap_or(MaskReason::Good)).collect();
    for (stack, own) in [(Some(sample), true), (reference, false)] {
        let Some(layer) = stack.and_then(|s| s.mask(None).or_else(|| s.layers.iter().find(|l| l.info.is_pixel_mask())))
        else {
            continue;
        };
        for (mask, &code) in mask.iter_mut().zip(layer.pixels().iter()) {
            if *mask == MaskReason::Good && code != 0.0 {
                let reason = MaskReason::ALL.into_iter().find(|r| r.code() == code);
                *mask = if own { reason.unwrap_or(MaskReason::NotFinite) } else { MaskReason::LowReference };
            }
        }
    }
    mask
}

/// Whether no height in the known range is a whole turn from the reference, at any of a lattice of pixels.
fn within_a_turn(rig: &Rig, params: &Params, f_x: f64) -> bool {
    let Some(range) = params.heights else { return false };
    let surface = params.reference_surface.unwrap_or(ReferenceSurface::Plane(Length(rig.plane())));
    let coordinates = reference_coordinates(rig, &surface);
    let step = (coordinates.len() / 4096).max(1);
    (0..coordinates.len()).step_by(step).chain([coordinates.len() - 1]).all(|pixel| {
        range.iter().all(|height| {
            let u = rig.on_plane(pixel, height.0).and_then(|r| rig.coordinate(r));
            match (u, coordinates[pixel]) {
                (Some(u), Ok(reference)) => (TAU * f_x * (u - reference)).abs() < PI,
                _ => true,
            }
        })
    })
}

/// The phase difference of the highest f_x with its whole turns.
#[allow(clippy::too_many_arguments, reason = "the parts of one stage, used once")]
fn turns_found(
    params: &Params,
    rig: &Rig,
    fringes: &Fringes<'_>,
    sample: &ImageStack,
    reference: Option<&ImageStack>,
    coordinates: &[Result<f64, MaskReason>],
    mask: &[MaskReason],
    ctx: Ctx<'_>,
) -> Result<Difference, Error> {
    let last = fringes.last();
    let of = |k: usize| difference(sample, fringes.layers[k], reference, coordinates, mask);
    let mut found = of(last)?;
    let how = match params.unwrap {
        Unwrap::Auto if within_a_turn(rig, params, fringes.f_x(last)) => Unwrap::None,
        Unwrap::Auto => Unwrap::Quality,
        how => how,
    };
    match how {
        Unwrap::Temporal => {
            let mut coarse = of(0)?.delta;
            for k in 1..=last {
                let mut fine = of(k)?.delta;
                refine(&coarse, &mut fine, fringes.f_x(k) / fringes.f_x(k - 1));
                coarse = fine;
            }
            found.delta = coarse;
        }
        Unwrap::Quality => {
            let wrapped: Vec<f32> = found.delta.iter().map(|&d| d as f32).collect();
            let good: Vec<bool> = mask.iter().map(|&m| m == MaskReason::Good).collect();
            let unwrapped = unwrap(&wrapped, &good, rig.columns);
            ctx.measure("pieces", unwrapped.pieces as f64, "1");
            if unwrapped.pieces > 1 {
                let pieces = unwrapped.pieces;
                ctx.warn(format!(
                    "masked pixels part the phase into {pieces} pieces; whole turns between them are unknown"
                ));
            }
            found.delta.iter_mut().zip(&unwrapped.turns).for_each(|(d, &turns)| *d += TAU * f64::from(turns));
        }
        Unwrap::None | Unwrap::Auto => {}
    }
    Ok(found)
}

#[allow(clippy::too_many_arguments, reason = "the parts of one stage, used once")]
fn heights(
    params: &Params,
    rig: &Rig,
    fringes: &Fringes<'_>,
    reference: Option<&ImageStack>,
    coordinates: &[Result<f64, MaskReason>],
    found: &Difference,
    f_x: f64,
    mask: &[MaskReason],
) -> Result<Vec<Height>, Error> {
    let plane = match params.reference_surface {
        Some(ReferenceSurface::Plane(height)) => height.0,
        _ => rig.plane(),
    };
    let pixels = 0..rig.rows * rig.columns;
    let masked = |pixel: usize, height: &dyn Fn() -> Height| match mask[pixel] {
        MaskReason::Good => height(),
        reason => Err(reason),
    };
    Ok(match params.method {
        Method::Triangulation => {
            pixels.map(|i| masked(i, &|| triangulate(rig, i, f_x, coordinates[i].ok(), found.delta[i]))).collect()
        }
        Method::Formula => {
            let formula = Formula { l_0: rig.camera.position.z - plane, d: rig.baseline(), f_0: f_x };
            pixels.map(|i| masked(i, &|| by_formula(&formula, plane, found.delta[i]))).collect()
        }
        Method::ReferenceMap => {
            let measured = match reference {
                Some(stack) => Some(same(stack, &fringes.layers[fringes.last()].info)?.pixels()),
                None => None,
            };
            let wrapped: Vec<Option<f64>> = pixels
                .clone()
                .map(|i| {
                    let good = mask[i] == MaskReason::Good;
                    let phase = match &measured {
                        Some(phase) => Some(f64::from(phase[i])),
                        None => coordinates[i].ok().map(|u| TAU * f_x * u),
                    };
                    phase.filter(|_| good)
                })
                .collect();
            let positions: Vec<Option<f64>> =
                pixels.clone().map(|i| rig.on_plane(i, plane).map(|r| r.dot(rig.along))).collect();
            // Lines of the image along which the fringes vary most.
            let along_rows = rig.along.dot(rig.camera.right).abs() >= rig.along.dot(rig.camera.top).abs();
            let (count, length) = if along_rows { (rig.rows, rig.columns) } else { (rig.columns, rig.rows) };
            let at = |line: usize, k: usize| if along_rows { line * length + k } else { k * count + line };
            let mut out = vec![Err(MaskReason::NoHeight); rig.rows * rig.columns];
            for line in 0..count {
                let own: Vec<usize> = (0..length).map(|k| at(line, k)).collect();
                let pick = |of: &[Option<f64>]| own.iter().map(|&i| of[i]).collect::<Vec<_>>();
                let ruler = Line::new(&pick(&positions), &pick(&wrapped));
                for &i in &own {
                    out[i] = masked(i, &|| match &ruler {
                        Some(ruler) => ruler.height(rig, plane, positions[i], found.delta[i]),
                        None => Err(MaskReason::LowReference),
                    });
                }
            }
            out
        }
    })
}

/// Height, its standard error where known, and the mask.
fn planes(rig: &Rig, heights: &[Height], found: &Difference, mask: &mut [MaskReason], ctx: Ctx<'_>) -> ImageStack {
    let (mut z, mut se) = (vec![0.0_f32; heights.len()], vec![0.0_f32; heights.len()]);
    for (i, height) in heights.iter().enumerate() {
        match *height {
            Ok((height, slope)) if (height + slope).is_finite() => {
                z[i] = height as f32;
                if let Some(phase_se) = &found.se {
                    let own = slope * phase_se[i];
                    se[i] = own.abs() as f32;
                }
            }
            Ok(_) => mask[i] = MaskReason::NotFinite,
            Err(reason) => mask[i] = reason,
        }
    }
    let mut stack = ImageStack::new(rig.rows, rig.columns);
    let image = |data: Vec<f32>| Array2::from_shape_vec((rig.rows, rig.columns), data).expect("one value per pixel");
    let mut info = LayerInfo::value("height", "mm");
    let unknown = |i: usize| {
        let flagged = found.se.is_some() && found.se_unknown.as_ref().is_some_and(|flags| flags[i]);
        f32::from(u8::from(flagged && mask[i] == MaskReason::Good))
    };
    let unknown: Vec<f32> = (0..heights.len()).map(unknown).collect();
    let any_unknown = unknown.contains(&1.0);
    if found.se.is_some() && !any_unknown {
        info.mean_se = found.sharing.mean_se(&se, |i| mask[i] == MaskReason::Good);
    }
    stack.push(info.clone(), image(z));
    if found.se.is_some() {
        stack.push(info.standard_error(), image(se));
    }
    stack.push(mask_layer(), image(mask.iter().map(|m| m.code()).collect()));
    if any_unknown {
        stack.push(info.se_unknown(), image(unknown));
    }
    let reasons = ctx.measure_masked(mask.iter().map(|m| m.code()));
    if !mask.contains(&MaskReason::Good) {
        ctx.warn(format!("no pixel has a height: {reasons}"));
    }
    stack
}

fn mask_layer() -> LayerInfo {
    LayerInfo::new("mask", LayerKind::Mask, "1")
}

/// Pixels on each side that a normal is taken from.
const NORMAL_REACH: usize = 2;

fn normals(rig: &Rig, heights: &ImageStack, mask: &[MaskReason]) -> Maps {
    let z = heights.find("height", None).map(Layer::pixels).expect("made before");
    let point = |i: usize| {
        let good = mask[i] == MaskReason::Good;
        good.then(|| rig.on_plane(i, f64::from(z[i]))).flatten()
    };
    let points: Vec<Option<DVec3>> = (0..mask.len()).map(point).collect();
    let normal = |i: usize| tangent(&points, rig.columns, i, NORMAL_REACH).map(|tangent| tangent.normal(-rig.ray(i).1));
    let found: Vec<Option<DVec3>> = (0..mask.len()).map(normal).collect();
    let mut stack = ImageStack::new(rig.rows, rig.columns);
    let image = |value: &dyn Fn(usize) -> f32| {
        Array2::from_shape_fn((rig.rows, rig.columns), |(r, c)| value(r * rig.columns + c))
    };
    for (k, name) in ["normal_x", "normal_y", "normal_z"].into_iter().enumerate() {
        stack.push(LayerInfo::value(name, "1"), image(&|i| found[i].map_or(0.0, |n| n[k] as f32)));
    }
    let reason = |i: usize| match (mask[i], found[i]) {
        (MaskReason::Good, None) => MaskReason::NoHeight.code(),
        (reason, _) => reason.code(),
    };
    stack.push(mask_layer(), image(&reason));
    Maps(stack)
}
