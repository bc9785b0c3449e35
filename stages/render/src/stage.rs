//! The stage: checks, traces, and fills the ports that are wanted.

use turbid_contract::payload::{CONDITIONS, Covariance, Frames, Pattern, Power, Scene, Truth, White};
use turbid_contract::{Ctx, Error, Forms, Known, LayerInfo, Pilot, Problems, Stage, StagePlan, in_ports, out_ports};

use crate::cautions::{self, say_in};
use crate::channels::groups;
use crate::conditions::{layers, tell_dark_frames, warn_of_darkness};
use crate::detector::Detector;
use crate::field::Field;
use crate::form;
use crate::forward::tally;
use crate::frames::Images;
use crate::joints;
use crate::kernel::Kernels;
use crate::lamp_reflection::{WithLampReflections, by_manifold_sampling, lamp_reflections};
use crate::method::{Estimate, Taken, sums};
use crate::params::Params;
use crate::power::power;
use crate::projected::Projected;
use crate::rig::Rig;
use crate::truth::truth;

in_ports! {
    pub struct In {
        /// The scene to look at.
        scene: one Scene,
        /// What the projector shows instead of sinusoids: layers that cover its field, a frame for each.
        pattern: optional Pattern,
    }
}

out_ports! {
    pub struct Out {
        /// Radiance for every spatial frequency, orientation and phase, with standard errors.
        frames: one Frames,
        /// Per pixel, of M_DC and of re, im of every f_x > 0 (with a pattern: of those fringes whose phases its layers tell).
        covariance: optional Covariance,
        /// mu_a, mu_s_prime, height, depth, normal, object at the pixel centres.
        truth: optional Truth,
        /// The frame under the pattern 1 and the steady lights.
        white: optional White,
        /// Where the power of all lights went, at pattern value 1: out of the scene, into each object, through each detector.
        power: optional Power,
    }
}

pub struct RenderStage;

impl Stage for RenderStage {
    const NAME: &'static str = "render";
    const VERSION: u32 = 33;
    const ABOUT: &'static str =
        "Renders camera frames under projected sinusoids by unbiased path tracing, with standard errors";
    const STOPPING: &'static [&'static str] = &["samples", "target_error", "max_seconds"];

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(_: &Params) -> bool {
        true
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        let patterned = known.connected.iter().any(|port| port == "pattern");
        params.check(patterned, problems);
        if let Some(scene) = known.get::<Scene>("scene") {
            params.check_scene(&scene, patterned, problems);
            cautions::check(params, &scene, problems);
            warn_of_darkness(&scene, problems);
            joints::check(params, &scene, known, problems);
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let scene = known.get::<Scene>("scene");
        let mut plan = crate::plan::plan(params, scene.as_deref(), known);
        if let Some(scene) = &scene {
            say_in(&mut plan, scene);
        }
        plan
    }

    fn pilot(params: &Params, known: &Known, ctx: Ctx<'_>) -> Option<Pilot> {
        let patterned = known.connected.iter().any(|port| port == "pattern");
        crate::pilot::pilot(params, &*known.get::<Scene>("scene")?, patterned, ctx)
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let scene = inputs.scene;
        let mut problems = Problems::default();
        params.check(inputs.pattern.is_some(), &mut problems);
        let asked = inputs.pattern.as_ref().map_or_else(|| params.clone(), |pattern| params.showing(infos(pattern)));
        asked.check_scene(&scene, inputs.pattern.is_some(), &mut problems);
        if let Some(problem) = problems.into_parts().0.into_iter().next() {
            return Err(Error::Invalid(problem));
        }
        let rig = Rig::of(&scene)?;
        let steady = rig.steady[0].shines();
        let projected = match (&inputs.pattern, &scene.projector) {
            (None, _) => Projected::sinusoids(params, steady),
            (Some(pattern), Some(projector)) => Projected::pattern(pattern, params, projector, steady)?,
            (Some(_), None) => {
                return Err(joints::no_projector());
            }
        };
        let taken = Taken::of(params, &scene, inputs.pattern.is_some());
        let kernels = Kernels::of(&taken, &rig, &projected, ctx.wants("power"));
        ctx.kernel(&kernels.name, &kernels.refused);
        let traced = sums(&taken, params, &scene, &rig, &projected, ctx)?;
        let mut estimate = traced.estimate(params, &rig, &projected, ctx)?;
        estimate.add_lamp_reflections(&rig, &projected, ctx)?;
        tell_unknown(&estimate, &rig, ctx);
        let images = Images {
            projected: &projected,
            rows: rig.camera.rows,
            columns: rig.camera.columns,
            wavelengths_nm: &scene.wavelengths_nm,
            channels: &estimate.channels,
            n: estimate.n,
            design_effect: estimate.design_effect,
            shared_paths: shared_paths(&scene, &rig, &projected),
        };
        let power = if ctx.wants("power") {
            joints::has_power(&rig)?;
            let tallies = tally(&rig, &Detector::all(&scene), params.photons, ctx)?;
            Some(power(&scene, &rig.object_of, &tallies))
        } else {
            None
        };
        ctx.measure("flights", traced.flights() as f64, "1");
        if estimate.n > 0 {
            ctx.measure("samples", f64::from(estimate.n), "1");
            if params.max_seconds.is_some() {
                ctx.reached(&[("samples", estimate.n.into())]);
            }
        }
        for (part, of) in [(0.5, "error: m_ac per pixel"), (0.95, "error: m_ac per pixel, 95th percentile")] {
            if let Some(error) = images.relative_error_of(part) {
                ctx.measure(of, 100.0 * error, "%");
            }
        }
        let mut frames = images.frames();
        let mut covariance = ctx.wants("covariance").then(|| images.covariance());
        let mut white = ctx.wants("white").then(|| images.white());
        // The sums take more room than all that is made of them.
        drop(estimate);
        drop(traced);
        let along = inputs.pattern.as_ref().and_then(|pattern| pattern.0.attributes.get_key_value("fringes_along"));
        frames.0.attributes.extend(along.map(|(name, surface)| (name.clone(), surface.clone())));
        tell_dark_frames(&frames.0, ctx);
        if let Some(said) = turbid_geometry::conditions(&scene) {
            said.insert_into(&mut frames.0.attributes, CONDITIONS);
            layers(&scene, &mut frames.0, ctx)?;
        }
        let mut truth = ctx.wants("truth").then(|| truth(&scene, &rig.worlds[0], &rig.object_of, &rig.camera));
        let seen = [covariance.as_mut().map(|c| &mut c.0), white.as_mut().map(|w| &mut w.0)];
        for stack in seen.into_iter().flatten().chain([&mut frames.0]) {
            scene.rig().insert_into(&mut stack.attributes);
            if let Some(camera) = &scene.camera {
                stack.set_pixel_pitch(camera);
            }
        }
        if let Some(truth) = &mut truth {
            scene.rig().insert_into(&mut truth.0.attributes);
        }
        Ok(Out { frames, covariance, truth, white, power })
    }
}

impl<'a> Estimate<'a> {
    /// Adds the images of lamps in smooth surfaces.
    fn add_lamp_reflections(&mut self, rig: &'a Rig, projected: &'a Projected, ctx: Ctx<'_>) -> Result<(), Error> {
        let known = lamp_reflections(rig, projected, ctx)?;
        let sampled = by_manifold_sampling(rig, projected, self.n, ctx)?;
        let fields = std::mem::take(&mut self.channels).into_iter().zip(known.into_iter().zip(sampled));
        self.channels = fields
            .map(|(field, (lamp_reflections, sampled))| -> Box<dyn Field + 'a> {
                if lamp_reflections.is_empty() && sampled.is_none() {
                    field
                } else {
                    Box::new(WithLampReflections { field, lamp_reflections, sampled })
                }
            })
            .collect();
        Ok(())
    }
}

/// Says so where too few paths see what makes pixels bright.
fn tell_unknown(estimate: &Estimate<'_>, rig: &Rig, ctx: Ctx<'_>) {
    let unknown = |field: &dyn Field| (0..field.pixels()).filter(|&pixel| field.se_unknown(pixel)).count();
    let unknown = estimate.channels.iter().map(|field| unknown(field.as_ref())).max().unwrap_or(0);
    if unknown > 0 {
        let percent = 100.0 * unknown as f64 / rig.camera.pixels() as f64;
        ctx.measure("pixels of unknown standard error", percent, "%");
        ctx.warn(format!(
            "of {percent:.1} % of the pixels the standard errors are unknown: too few paths see what makes them bright"
        ));
    }
}

fn infos(pattern: &Pattern) -> impl Iterator<Item = &LayerInfo> {
    pattern.0.layers.iter().map(|layer| &layer.info)
}

/// The wavelengths of each group of channels that one walk serves.
fn shared_paths(scene: &Scene, rig: &Rig, projected: &Projected) -> Vec<Vec<f64>> {
    if scene.channels() == 1 {
        return Vec::new();
    }
    let shared = groups(rig, &projected.carriers, &projected.projected_images)
        .into_iter()
        .filter(|group| group.shared.is_some());
    shared.map(|group| group.channels.iter().map(|&c| scene.wavelengths_nm[c]).collect()).collect()
}
