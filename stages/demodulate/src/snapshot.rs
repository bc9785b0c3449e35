//! The method `single_shot`: one frame of each f_x in; M_DC, M_AC and phase of every line out, as if phases had been stepped.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason, Scene};
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind};
use turbid_optics::elementary::atan2;

use crate::fourier::product;
use crate::single_shot::{Filter, noise_gain, part};
use crate::stage::Params;

/// Modulation, and the phase if wanted.
pub fn run(
    params: &Params,
    frames: &Frames,
    scene: Option<&Scene>,
    ctx: Ctx<'_>,
) -> Result<(ImageStack, Option<ImageStack>), Error> {
    let stack = &frames.0;
    let filter = if params.rectangles { Filter::Rectangle } else { Filter::Gaussian };
    let mut shots: Vec<&Layer> = Vec::new();
    let fringed = |l: &&Layer| l.info.kind == LayerKind::Value && l.info.f_x_per_mm.is_some_and(|f| f > 0.0);
    for layer in stack.layers.iter().filter(fringed) {
        // The first phase of each fringe is the shot; others may stand beside it for comparison.
        if shots.iter().all(|s| !same_fringe(&s.info, &layer.info)) {
            shots.push(layer);
        }
    }
    if shots.is_empty() {
        return Err(Error::failed_with_hint(
            "the frames hold no fringes (f_x > 0)",
            "single_shot reads one frame with a carrier",
        ));
    }
    let mut modulation = ImageStack::new(stack.rows(), stack.columns());
    modulation.attributes = stack.attributes.clone();
    let mut phases = ImageStack::new(stack.rows(), stack.columns());
    phases.attributes = stack.attributes.clone();
    let mut seen: Vec<Option<f64>> = Vec::new();
    for shot in shots {
        let carrier = carrier(params, &shot.info, scene, stack)?;
        let first = !seen.contains(&shot.info.wavelength_nm);
        seen.push(shot.info.wavelength_nm);
        let phase = one(params, shot, stack, carrier, filter, first, &mut modulation)?;
        phases.layers.extend(phase);
        ctx.checked()?;
    }
    order(&mut modulation);
    order(&mut phases);
    Ok((modulation, ctx.wants("phase").then_some(phases)))
}

fn same_fringe(a: &LayerInfo, b: &LayerInfo) -> bool {
    a.f_x_per_mm == b.f_x_per_mm && a.orientation_deg == b.orientation_deg && a.wavelength_nm == b.wavelength_nm
}

/// Cycles per pixel along rows or columns, signed by their order in the image; and whether along rows.
#[derive(Clone, Copy)]
struct Carrier {
    cycles: f64,
    along_rows: bool,
}

/// mm of a pixel along x and along y, in the plane of the pattern.
pub fn pixel_size(params: &Params, scene: Option<&Scene>) -> Result<[f64; 2], Error> {
    match (params.pixel_mm, scene.and_then(|s| s.camera.as_ref())) {
        (Some(pixel), _) => Ok([pixel.0; 2]),
        (None, Some(c)) => Ok([c.field[0] / f64::from(c.pixels[0]), c.field[1] / f64::from(c.pixels[1])]),
        (None, None) => {
            let hint = "connect the port `scene`, or give pixel_mm";
            Err(Error::failed_with_hint("the size of a pixel in mm is not known", hint))
        }
    }
}

fn carrier(params: &Params, info: &LayerInfo, scene: Option<&Scene>, stack: &ImageStack) -> Result<Carrier, Error> {
    let f_x = info.f_x_per_mm.unwrap_or(0.0);
    let pixel = pixel_size(params, scene)?;
    let turns = info.orientation_deg.unwrap_or(0.0) / 360.0;
    let (sin, cos) = turbid_optics::elementary::sin_cos_turns(turns);
    let (along_rows, cycles) = if sin.abs() < 1e-9 {
        (true, f_x * pixel[0] * cos)
    } else if cos.abs() < 1e-9 {
        // Rows count downwards, y upwards.
        (false, -f_x * pixel[1] * sin)
    } else {
        let what = format!("fringes at {} deg run neither along rows nor along columns", 360.0 * turns);
        return Err(Error::failed_with_hint(what, "single_shot wants orientation_deg 0 or 90"));
    };
    let periods = cycles.abs() * if along_rows { stack.columns() } else { stack.rows() } as f64;
    // The band around the carrier ends at 3/2 of it.
    if cycles.abs() > 1.0 / 3.0 || periods < 4.0 {
        let what = format!("f_x = {f_x} mm^-1 is {:.4} cycles per pixel and {periods:.1} in the image", cycles.abs());
        return Err(Error::failed_with_hint(
            what,
            "single_shot needs 3 pixels or more per period and 4 periods or more",
        ));
    }
    Ok(Carrier { cycles, along_rows })
}

/// Adds the layers of one shot; gives those of its phase.
fn one(
    params: &Params,
    shot: &Layer,
    stack: &ImageStack,
    carrier: Carrier,
    filter: Filter,
    with_f_0: bool,
    out: &mut ImageStack,
) -> Result<Vec<Layer>, Error> {
    let (rows, columns) = (stack.rows(), stack.columns());
    let (count, length) = if carrier.along_rows { (rows, columns) } else { (columns, rows) };
    let place = |line: usize, k: usize| if carrier.along_rows { (line, k) } else { (k, line) };
    let plane = || Array2::<f32>::zeros((rows, columns));
    let [mut dc, mut ac, mut phase, mut mask] = [plane(), plane(), plane(), plane()];
    let se = stack.standard_error(&shot.info);
    let [mut dc_se, mut ac_se, mut phase_se] = [plane(), plane(), plane()];
    let gain = noise_gain(filter, carrier.cycles.abs());
    let carried = stack.mask(shot.info.wavelength_nm);
    let shift = shot.info.phase_rad.unwrap_or(0.0) / std::f64::consts::TAU;
    let (shift_sin, shift_cos) = turbid_optics::elementary::sin_cos_turns(shift);
    let (mut good, mut variances) = (0_u64, 0.0);
    // Beyond the reach of the filter (3.2 periods) a bad pixel has no weight.
    let reach = libm::ceil(3.2 / carrier.cycles.abs()) as usize;
    for line in 0..count {
        let values: Vec<f64> = (0..length).map(|k| f64::from(shot.data[place(line, k)])).collect();
        let bad = |k: usize| {
            let carried = carried.map_or(0.0, |m| m.data[place(line, k)]);
            if carried != 0.0 {
                carried
            } else if !values[k].is_finite() {
                MaskReason::NotFinite.code()
            } else if params.saturation.is_some_and(|level| values[k] >= level) {
                MaskReason::Saturated.code()
            } else {
                0.0
            }
        };
        let reasons: Vec<f32> = (0..length).map(bad).collect();
        let clean: Vec<f64> = values.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
        let found = part(&clean, carrier.cycles.abs(), filter);
        for k in 0..length {
            let at = place(line, k);
            let near = reasons[k.saturating_sub(reach)..(k + reach + 1).min(length)].iter().find(|&&r| r != 0.0);
            let own = if reasons[k] != 0.0 { Some(&reasons[k]) } else { near };
            let [re, im] = found.fringe[k];
            let m_ac = (re * re + im * im).sqrt();
            let weak = found.dc[k] <= 0.0 || m_ac <= f64::from(f32::EPSILON) * found.dc[k];
            if let Some(&reason) = own {
                mask[at] = reason;
                continue;
            }
            if weak {
                mask[at] = MaskReason::LowSignal.code();
                continue;
            }
            good += 1;
            (dc[at], ac[at]) = (found.dc[k] as f32, m_ac as f32);
            // A carrier that falls along the line shows the conjugate.
            let z = if carrier.cycles < 0.0 { [re, -im] } else { [re, im] };
            let [re, im] = product(z, [shift_cos, -shift_sin]);
            phase[at] = atan2(im, re) as f32;
            if let Some(se) = se {
                let variance = gain * f64::from(se.data[at]) * f64::from(se.data[at]);
                variances += f64::from(se.data[at]) * f64::from(se.data[at]);
                dc_se[at] = variance.sqrt() as f32;
                ac_se[at] = (2.0 * variance).sqrt() as f32;
                phase_se[at] = ((2.0 * variance).sqrt() / m_ac) as f32;
            }
        }
    }
    let mut info = LayerInfo { name: "m_dc".into(), phase_rad: None, mean_se: None, ..shot.info.clone() };
    let mut push = |info: &LayerInfo, data: &Array2<f32>, own: &Array2<f32>, factor: f64| {
        let mut info = info.clone();
        info.mean_se = if se.is_some() { mean_se(factor * variances, good, 1.0) } else { None };
        out.push(info.clone(), data.clone());
        if se.is_some() {
            out.push(info.standard_error(), own.clone());
        }
    };
    if with_f_0 {
        // The same frame stands in for the one at f_x = 0.
        for name in ["m_dc", "m_ac"] {
            let f_0 = LayerInfo { name: name.into(), f_x_per_mm: Some(0.0), orientation_deg: None, ..info.clone() };
            push(&f_0, &dc, &dc_se, 1.0);
        }
    }
    push(&info, &dc, &dc_se, 1.0);
    info.name = "m_ac".into();
    push(&info, &ac, &ac_se, 2.0);
    let mut mask_info = LayerInfo::new("mask", LayerKind::Mask, "1");
    mask_info.wavelength_nm = shot.info.wavelength_nm;
    match out.layers.iter_mut().find(|l| l.info == mask_info) {
        // A pixel is good where every shot of its wavelength is.
        Some(known) => known.data.zip_mut_with(&mask, |known, &new| *known = if *known == 0.0 { new } else { *known }),
        None => out.push(mask_info.clone(), mask.clone()),
    }
    let info = LayerInfo { name: "phase".into(), unit: "rad".into(), ..info };
    let mut phases = vec![Layer { info: info.clone(), data: phase }];
    if se.is_some() {
        phases.push(Layer { info: info.standard_error(), data: phase_se });
    }
    phases.push(Layer { info: mask_info, data: mask });
    Ok(phases)
}

/// Values first, then errors, then masks.
pub fn order(stack: &mut ImageStack) {
    let rank = |kind: LayerKind| match kind {
        LayerKind::Value => 0,
        LayerKind::StandardError => 1,
        LayerKind::Covariance => 2,
        LayerKind::Mask => 3,
    };
    stack.layers.sort_by_key(|l| rank(l.info.kind));
}
