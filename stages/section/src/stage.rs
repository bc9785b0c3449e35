//! The stage `section_tube`: modulation and truth in, sections out.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Modulation, Section, Sections, Truth};
use turbid_contract::{
    Ctx, Error, Extent, ImageStack, Known, Layer, LayerInfo, LayerKind, Problems, Stage, StagePlan, in_ports, out_ports,
};

use crate::blend::{Share, share};
use crate::depth::{Seen, arc_lengths};
use crate::params::{Method, Params};
use crate::profile::{Pixel, Profile, RINGS, Ring};
use crate::split;

/// What the paper takes: five sections that differ by more than 10 grey levels.
const PAPER: (u32, f64) = (5, 10.0);

in_ports! {
    pub struct In {
        /// Modulation of the tube, best that of its reference material.
        modulation: one Modulation,
        /// Height, normals and objects that the camera sees.
        truth: one Truth,
    }
}

out_ports! {
    pub struct Out {
        /// Section, neighbour and shares of each pixel, arc length, and the list of sections.
        sections: one Sections,
    }
}

/// `use: section_tube`
pub struct SectionTube;

impl Stage for SectionTube {
    const NAME: &'static str = "section_tube";
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "Sections along the wall of a tube, for tables of their own";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, _known: &Known, problems: &mut Problems) {
        if let Some(count) = params.count {
            let rule = format!("lie in [1, {RINGS}]");
            problems.require((1..=RINGS as u32).contains(&count), "count", f64::from(count), "", &rule);
        }
        if let Some(threshold) = params.threshold {
            let holds = threshold > 0.0 && threshold < 255.0;
            problems.require(holds, "threshold", threshold, "grey levels", "lie in (0, 255)");
            if params.method != Method::IntensitySteps {
                let what = format!("`{}` knows no threshold", params.method.name());
                problems.push_with_hint("threshold", what, "leave it out, or use `method: intensity_steps`");
            }
        }
        problems.require((0.0..=1.0).contains(&params.blend), "blend", params.blend, "", "lie in [0, 1]");
        if params.objects.as_ref().is_some_and(Vec::is_empty) {
            problems.push_with_hint("objects", "objects is empty", "leave it out for all of them");
        }
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let left_out = if params.blend == 0.0 { vec!["blending between sections".into()] } else { Vec::new() };
        // Section, neighbour, weight, arc length and mask, and what is known of each pixel of the wall while it is sorted (f64).
        let of = |port: &str| known.extent(port).map_or(0, Extent::bytes);
        let sections = known.extent("modulation").map(|m| Extent::Images { pixels: m.pixels(), layers: 5 });
        let memory = sections.map(|s| of("modulation") + of("truth") + s.bytes() + 128 * s.pixels());
        let makes = sections.map(|sections| ("sections", sections)).into_iter().collect();
        StagePlan { method: Some(params.method.name().into()), left_out, memory, makes, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let light = Light::of(&inputs.modulation.0)?;
        let truth = &inputs.truth.0;
        if (truth.rows(), truth.columns()) != (light.rows, light.columns) {
            return Err(Error::failed_with_hint(
                format!(
                    "the modulation has {} x {} pixels, the truth {} x {}",
                    light.columns,
                    light.rows,
                    truth.columns(),
                    truth.rows()
                ),
                "both must be seen by the same camera",
            ));
        }
        let (wall, objects) = wall(params, truth)?;
        // Counted from the highest point of these objects: the rim, where the camera sees it.
        let top = objects.iter().flatten().map(|s| s.height).fold(f64::NEG_INFINITY, f64::max);
        let arc = arc_lengths(&objects, top);
        let length = arc.iter().flatten().copied().fold(0.0, f64::max);
        if length <= 0.0 {
            return Err(Error::failed_with_hint(
                format!("no pixel shows a wall of {wall}: sections need surfaces that fall away from the camera"),
                "point the camera down the tube, or name its object in `objects`",
            ));
        }
        let good: Vec<Pixel> = (0..arc.len())
            .filter_map(|i| {
                let (m_dc, m_ac) = light.at(i)?;
                Some(Pixel { s: arc[i]?, m_dc, m_ac })
            })
            .collect();
        if good.is_empty() {
            let on_wall = |i: &usize| arc[*i].is_some();
            let reasons = ctx.measure_masked((0..arc.len()).filter(on_wall).map(|i| light.reason(i)));
            return Err(Error::failed_with_hint(
                format!("no pixel of the wall of {wall} has a good modulation: {reasons}"),
                "give the frames more paths or more light; `low_signal: 0` in `demodulate` masks no pixel for being noisy",
            ));
        }
        let profile = Profile::of(&good, length);
        let (bounds_mm, list) = cut(params, &profile, light.white(), ctx)?;
        ctx.measure("sections", list.len() as f64, "1");
        let mut sections = sections(params, &light, &arc, &bounds_mm, &list);
        sections.0.take_pixel_pitch(truth);
        ctx.measure_masked(sections.0.mask(None).into_iter().flat_map(|mask| mask.data.iter().copied()));
        Ok(Out { sections })
    }
}

/// Bounds in mm and the list of sections. Where nobody says how many there are to be, as many up to five as the image has pixels and the light
/// has steps for, with a warning if these are fewer.
fn cut(params: &Params, profile: &Profile, white: f64, ctx: Ctx<'_>) -> Result<(Vec<f64>, Vec<Section>), Error> {
    let first = attempt(params, profile, white);
    if params.count.is_some() || params.threshold.is_some() {
        return first;
    }
    let Err(why @ Error::Failed { .. }) = first else { return first };
    for count in (1..PAPER.0).rev() {
        if let Ok(found) = attempt(&Params { count: Some(count), ..params.clone() }, profile, white) {
            let what = match &why {
                Error::Failed { what, .. } => what.as_str(),
                _ => "",
            };
            ctx.warn(format!("{count} sections in place of {}: {what}", PAPER.0));
            return Ok(found);
        }
    }
    Err(why)
}

/// The cut that `params` ask for.
fn attempt(params: &Params, profile: &Profile, white: f64) -> Result<(Vec<f64>, Vec<Section>), Error> {
    let bounds = bounds(params, profile, white)?;
    let bounds_mm: Vec<f64> = bounds.iter().map(|&k| k as f64 * profile.ring_mm).collect();
    let list = list(profile, &bounds, &bounds_mm);
    let least = u64::from(params.least_pixels.max(1));
    if let Some((k, section)) = list.iter().enumerate().find(|(_, s)| s.pixels < least) {
        return Err(Error::failed_with_hint(
            format!(
                "section {k} of {}, from {:.1} to {:.1} mm along the wall, has {} pixels with a good modulation; {least} are wanted",
                list.len(),
                section.from_mm,
                section.to_mm,
                section.pixels
            ),
            "ask for fewer sections, give the camera more pixels, or lower `least_pixels`",
        ));
    }
    Ok((bounds_mm, list))
}

/// M_DC of the lowest f_x and M_AC of the highest, of the first wavelength.
struct Light<'a> {
    rows: usize,
    columns: usize,
    m_dc: std::borrow::Cow<'a, [f32]>,
    m_ac: std::borrow::Cow<'a, [f32]>,
    mask: Option<std::borrow::Cow<'a, [f32]>>,
}

impl<'a> Light<'a> {
    fn of(stack: &'a ImageStack) -> Result<Self, Error> {
        let of = |name: &str, lowest: bool| {
            let value = |l: &&Layer| l.info.name == name && l.info.kind == LayerKind::Value;
            let first = stack.layers.iter().find(value)?.info.wavelength_nm;
            let layers = stack.layers.iter().filter(value).filter(|l| l.info.wavelength_nm == first);
            let f_x = |l: &&Layer| l.info.f_x_per_mm.unwrap_or(0.0);
            let by_f = |a: &&Layer, b: &&Layer| f_x(a).total_cmp(&f_x(b));
            if lowest { layers.min_by(by_f) } else { layers.max_by(by_f) }
        };
        let missing = |name: &str| Error::failed(format!("the modulation holds no layer `{name}`"));
        let m_dc = of("m_dc", true).ok_or_else(|| missing("m_dc"))?;
        let m_ac = of("m_ac", false).ok_or_else(|| missing("m_ac"))?;
        let mask = stack.mask(m_dc.info.wavelength_nm).map(Layer::pixels);
        Ok(Self { rows: stack.rows(), columns: stack.columns(), m_dc: m_dc.pixels(), m_ac: m_ac.pixels(), mask })
    }

    /// Where both are good and positive.
    fn at(&self, i: usize) -> Option<(f64, f64)> {
        let (m_dc, m_ac) = (f64::from(self.m_dc[i]), f64::from(self.m_ac[i]));
        let good = self.mask.as_ref().is_none_or(|mask| mask[i] == 0.0);
        (good && m_dc > 0.0 && m_ac > 0.0).then_some((m_dc, m_ac))
    }

    /// Why a pixel is not good: the modulation's own reason, or that it has no signal.
    fn reason(&self, i: usize) -> f32 {
        let own = self.mask.as_ref().map_or(0.0, |mask| mask[i]);
        if own == 0.0 && self.at(i).is_none() { MaskReason::LowSignal.code() } else { own }
    }

    /// The 99.9th percentile of M_DC over the good pixels of the image.
    fn white(&self) -> f64 {
        let mut all: Vec<f64> = (0..self.m_dc.len()).filter_map(|i| self.at(i)).map(|(m_dc, _)| m_dc).collect();
        all.sort_by(f64::total_cmp);
        all.get(((all.len() as f64 * 0.999) as usize).min(all.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }
}

/// What the objects of interest show, and their names for messages.
fn wall(params: &Params, truth: &ImageStack) -> Result<(String, Vec<Option<Seen>>), Error> {
    let layer = |name: &str| {
        let layer =
            truth.find(name, None).ok_or_else(|| Error::failed(format!("the truth holds no layer `{name}`")))?;
        Ok::<_, Error>(layer.pixels())
    };
    let names = truth.attributes.get("objects").and_then(|v| v.as_array()).cloned().unwrap_or_default();
    let names: Vec<&str> = names.iter().filter_map(serde_json::Value::as_str).collect();
    let wanted: Option<Vec<usize>> = match &params.objects {
        None => None,
        Some(objects) => {
            let place = |(i, object): (usize, &String)| {
                names.iter().position(|name| name == object).ok_or_else(|| {
                    let what = format!("the scene has no object `{object}`; it has {}", names.join(", "));
                    Error::invalid(format!("objects.{i}"), what)
                })
            };
            Some(objects.iter().enumerate().map(place).collect::<Result<_, _>>()?)
        }
    };
    let (height, normal_z, object, mask) = (layer("height")?, layer("normal_z")?, layer("object")?, layer("mask")?);
    let pixel = |i: usize| {
        let counts = mask[i] == 0.0 && wanted.as_ref().is_none_or(|w| w.contains(&(object[i] as usize)));
        counts.then(|| Seen { height: f64::from(height[i]), normal_z: f64::from(normal_z[i]) })
    };
    let named = params.objects.as_ref().map_or_else(|| "any object".to_owned(), |o| o.join(", "));
    Ok((named, (0..mask.len()).map(pixel).collect()))
}

fn bounds(params: &Params, profile: &Profile, white: f64) -> Result<split::Bounds, Error> {
    let count = params.count.unwrap_or(PAPER.0) as usize;
    let grey = |ring: &Ring| 255.0 * ring.m_dc / ring.pixels / white;
    match params.method {
        Method::EqualLength => Ok(split::by_length(RINGS, count)),
        Method::EqualLogIntensity => Ok(split::by_parts(&profile.falling(|r| libm::log(r.m_dc / r.pixels)), count)),
        Method::Optimal => split::optimal(profile, count, f64::from(params.least_pixels)).ok_or_else(|| {
            Error::failed_with_hint(
                format!("the wall cannot be cut into {count} sections of {} pixels each", params.least_pixels),
                "ask for fewer sections, give the camera more pixels, or lower `least_pixels`",
            )
        }),
        Method::IntensitySteps => {
            let falling = profile.falling(grey);
            let fall = falling[0] - falling[RINGS - 1];
            match (params.count, params.threshold) {
                (None, Some(threshold)) => Ok(split::by_step(&falling, threshold)),
                (_, threshold) => {
                    let (threshold, step) = (threshold.unwrap_or(PAPER.1), fall / count as f64);
                    if count > 1 && step < threshold {
                        return Err(Error::failed_with_hint(
                            format!(
                                "along the wall the mean intensity falls by {fall:.1} grey levels of 255: {count} sections would differ by {step:.1}, not by {threshold}"
                            ),
                            "ask for fewer sections, lower `threshold`, or use `method: equal_log_intensity`",
                        ));
                    }
                    Ok(split::by_parts(&falling, count))
                }
            }
        }
    }
}

fn list(profile: &Profile, bounds: &[usize], bounds_mm: &[f64]) -> Vec<Section> {
    let section = |k: usize| {
        let rings = &profile.rings[bounds[k]..bounds[k + 1]];
        let pixels: f64 = rings.iter().map(|r| r.pixels).sum();
        let m_dc: f64 = rings.iter().map(|r| r.m_dc).sum();
        let m_dc = if pixels > 0.0 { m_dc / pixels } else { 0.0 };
        Section { from_mm: bounds_mm[k], to_mm: bounds_mm[k + 1], pixels: pixels as u64, m_dc }
    };
    (0..bounds.len() - 1).map(section).collect()
}

fn sections(params: &Params, light: &Light<'_>, arc: &[Option<f64>], bounds_mm: &[f64], list: &[Section]) -> Sections {
    let shares: Vec<Option<Share>> = arc.iter().map(|s| s.map(|s| share(bounds_mm, params.blend, s))).collect();
    let mut stack = ImageStack::new(light.rows, light.columns);
    let image =
        |value: Vec<f32>| Array2::from_shape_vec((light.rows, light.columns), value).expect("one value per pixel");
    let of = |value: &dyn Fn(&Share) -> f64| {
        image(shares.iter().map(|s| s.as_ref().map_or(0.0, |s| value(s) as f32)).collect())
    };
    stack.push(LayerInfo::value("section", "1"), of(&|s| s.section as f64));
    stack.push(LayerInfo::value("neighbour", "1"), of(&|s| s.neighbour as f64));
    // f32 must not round a small share to nothing.
    stack.push(LayerInfo::value("weight", "1"), of(&|s| s.weight.max(f64::from(f32::MIN_POSITIVE))));
    stack.push(LayerInfo::value("arc_length", "mm"), image(arc.iter().map(|s| s.unwrap_or(0.0) as f32).collect()));
    let reason = |s: &Option<f64>| if s.is_some() { MaskReason::Good } else { MaskReason::OutsideSections }.code();
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), image(arc.iter().map(reason).collect()));
    stack.attributes.insert("sections".into(), serde_json::to_value(list).expect("finite numbers are JSON"));
    stack.attributes.insert("blend".into(), serde_json::json!(params.blend));
    stack.attributes.insert("method".into(), serde_json::json!(params.method.name()));
    Sections(stack)
}
