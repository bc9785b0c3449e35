//! What is wrong with the parameters of a render: by themselves, and for a given scene.

use turbid_contract::payload::Scene;
use turbid_contract::{Problems, Usual};

use crate::lamp_reflection::in_focus;
use crate::light::Carrier;
use crate::mirrors::Mirrors;
use crate::params::{Method, Params};
use crate::plan::flights_per_path;
use crate::plane_wave::no_plane_wave;
use crate::random::MOST_CHANNELS;
use crate::rig::Rig;
use crate::strata::{Bending, facetted};
use crate::surfaces::no_surface;
use crate::uniform::obstacle;
use crate::world::World;

/// The most frames that one instance may make.
const MOST_FRAMES: usize = 4096;
/// A path of more flights than this would not end while somebody waits.
const MOST_FLIGHTS: f64 = 1e8;

impl Params {
    /// What is wrong whatever the scene; `patterned`: what is shown comes by the port `pattern`.
    pub fn check(&self, patterned: bool, problems: &mut Problems) {
        if self.f_x.is_empty() && !patterned {
            problems.push_with_hint(
                "f_x",
                "f_x is empty: nothing would be projected",
                "list at least one, such as [0, 0.1]",
            );
        }
        for (i, f) in self.f_x.iter().enumerate() {
            problems.require(f.0 >= 0.0, format!("f_x.{i}"), f.0, "mm^-1", "be >= 0");
            if let Some((message, hint)) = Usual::F_X.doubt(f.0) {
                problems.warn_ranked(Usual::F_X.off(f.0), format!("f_x.{i}"), message, hint);
            }
            if self.f_x[..i].contains(f) {
                problems.push(format!("f_x.{i}"), format!("f_x = {f} stands twice"));
            }
        }
        let phases = f64::from(self.phases);
        problems.require(self.phases >= 3, "phases", phases, "", "be >= 3: fewer do not fix mean, amplitude and phase");
        if self.orientation_deg.is_empty() {
            problems.push_with_hint("orientation_deg", "orientation_deg is empty", "leave it out for [0]");
        }
        for (i, o) in self.orientation_deg.iter().enumerate() {
            problems.require(o.0.abs() <= 360.0, format!("orientation_deg.{i}"), o.0, "deg", "lie in [-360, 360]");
            if self.orientation_deg[..i].contains(o) {
                problems.push(format!("orientation_deg.{i}"), format!("orientation_deg = {o} stands twice"));
            }
        }
        let frames = self.f_x.len().saturating_mul(self.phases as usize).saturating_mul(self.orientation_deg.len());
        if frames > MOST_FRAMES {
            problems.push("f_x", format!("f_x, phases and orientations make {frames} frames, more than {MOST_FRAMES}"));
        }
        if let Some(samples) = self.samples {
            let rule = "be >= 2: a standard error needs two paths";
            problems.require(samples >= 2, "samples", f64::from(samples), "", rule);
        }
        let rule = "be >= 2: a standard error needs two";
        problems.require(self.photons >= 2, "photons", f64::from(self.photons), "", rule);
        if let Some(target) = self.target_error {
            problems.require(target.0 > 0.0 && target.0 < 1.0, "target_error", target.0, "", "lie in (0, 1)");
        }
        if let Some(limit) = self.max_seconds {
            problems.require(limit.0 > 0.0, "max_seconds", limit.0, "s", "be > 0");
        }
        let unlimited = self.samples.is_none() && self.target_error.is_none() && self.max_seconds.is_none();
        if unlimited && self.method != Method::Rte {
            problems.push_with_hint(
                "samples",
                "nothing says when to stop",
                "give samples, target_error or max_seconds",
            );
        }
        if patterned && self.method == Method::Rte {
            problems.push_with_hint(
                "method",
                "images are projected: the transport solver gives what sinusoids light",
                "write `method: auto`, `fit` or `path`",
            );
        }
    }

    /// What is wrong with them for this scene; `patterned`: what is shown comes by the port `pattern`.
    pub fn check_scene(&self, scene: &Scene, patterned: bool, problems: &mut Problems) {
        if scene.objects.is_empty() {
            let hint = "render a scene that takes its rig from it: `in: {rig: ..}`";
            problems.at_input("scene", "the scene has no object: it is a rig for other scenes", hint);
        }
        if scene.camera.is_none() {
            problems.at_input("scene", "the scene has no camera", "add `camera` to the scene, or to its rig");
        }
        if scene.projector.is_none() && scene.lights.is_empty() {
            problems.at_input(
                "scene",
                "the scene has no projector, so all would be dark",
                "add `projector` to the scene, or to its rig",
            );
        }
        if let (None, Some(i)) = (&scene.projector, self.f_x.iter().position(|f| f.0 > 0.0))
            && !scene.lights.is_empty()
        {
            problems.push_with_hint(
                format!("f_x.{i}"),
                format!("f_x = {}: the scene has no projector that could show a pattern", self.f_x[i]),
                "add `projector` to the scene, or write f_x: [0] for the steady lights alone",
            );
        }
        self.check_pitches(scene, problems);
        if scene.channels() > MOST_CHANNELS {
            problems.push_with_hint(
                "",
                format!("{} wavelengths: there are random numbers for {MOST_CHANNELS}", scene.channels()),
                "render parts of the spectrum one after the other",
            );
        }
        if let Ok(rig) = Rig::of(scene) {
            if rig.worlds.iter().any(|world| Bending::of(world) == Bending::Anywhere) {
                problems.push_with_hint(
                    "",
                    "smooth and rough walls between different indices meet: light connections through both are not found",
                    "give all that has n != 1 a rough surface, such as `surface: {rough: 0.1}`, or none of it",
                );
            }
            if rig.worlds.iter().any(has_clear_facets) {
                problems.warn("", "a mesh of another n than its surroundings is so clear that light is reflected in it several times: of connections by several facets few are found, and standard errors may say too little");
            }
            check_mirrors(&rig, problems);
            check_lamp_reflections(&rig, problems);
        }
        if let (Method::Rte, Some(reason)) = (self.method, no_plane_wave(scene)) {
            problems.push_with_hint(
                "method",
                format!("the transport solver does not give the image: {reason}"),
                "write `method: auto`, `fit` or `path`",
            );
        }
        let by_pixels = match self.method {
            Method::Path => true,
            Method::Rte => false,
            Method::Fit | Method::Auto => patterned || obstacle(scene, self.target_error.map(|t| t.0)).is_some(),
        };
        if let (Method::Fit, true, Some(reason)) = (self.method, by_pixels, no_surface(scene)) {
            problems.push_with_hint(
                "method",
                format!("no part of the image can be fitted: {reason}"),
                "write `method: path` or `method: auto`",
            );
        }
        if let (true, Some(samples @ 2..64)) = (by_pixels, self.samples) {
            let text = "standard errors from fewer than 64 paths per pixel are themselves uncertain";
            problems.warn("samples", format!("samples = {samples}: {text}"));
        }
        let flights = flights_per_path(scene);
        if flights > MOST_FLIGHTS {
            problems.push_with_hint(
                "",
                format!("a path would make about {flights:.0e} flights: light that is hardly absorbed does not leave an object this thick"),
                "make the object thinner or give its medium some absorption",
            );
        }
    }

    /// No f_x may be finer than the pixels of camera and projector.
    pub fn check_pitches(&self, scene: &Scene, problems: &mut Problems) {
        let cameras = scene.camera.as_ref().map(|c| ("camera", c.field, c.pixels));
        let projectors = scene.projector.as_ref().and_then(|p| p.pixels.map(|n| ("projector", p.field, n)));
        for (who, field, pixels) in cameras.into_iter().chain(projectors) {
            let pitch = [field[0] / f64::from(pixels[0]), field[1] / f64::from(pixels[1])];
            self.check_resolution(who, pitch, problems);
        }
    }

    /// No carrier may have more than half a cycle per pixel, along either side of the pixels.
    fn check_resolution(&self, who: &str, pitch: [f64; 2], problems: &mut Problems) {
        for (i, f) in self.f_x.iter().enumerate() {
            let worst = self
                .orientation_deg
                .iter()
                .map(|o| {
                    let (x, y) = Carrier::new(f.0, o.0).along();
                    (x.abs() * pitch[0]).max(y.abs() * pitch[1])
                })
                .fold(0.0, f64::max);
            // Room for the rounding of a pitch that was meant to be exactly half a period.
            if worst > 0.5 * (1.0 + 1e-9) {
                let most = 0.5 / worst * f.0;
                problems.push_with_hint(
                    format!("f_x.{i}"),
                    format!(
                        "f_x = {f} is beyond what the {who}'s pixels of {} x {} mm resolve ({most:.4} mm^-1)",
                        pitch[0], pitch[1]
                    ),
                    match Usual::F_X.doubt(f.0) {
                        Some((_, in_another_unit)) => in_another_unit,
                        None => format!("give the {who} more pixels or a smaller field, or lower f_x"),
                    },
                );
            }
        }
    }
}

/// Whether light may be reflected several times in a mesh before it is extinguished: across it are less than three mean free paths.
fn has_clear_facets(world: &World) -> bool {
    let looked_for = Bending::of(world) == Bending::AtInterfaces;
    looked_for
        && facetted(world).any(|body| {
            let (low, high) = body.solid.bounds();
            world.materials[body.material].mu_t() * (high - low).min_element() < 3.0
        })
}

/// What this version cannot say of the light that mirrors throw.
fn check_mirrors(rig: &Rig, problems: &mut Problems) {
    let (world, mirrors) = (&rig.worlds[0], Mirrors::of(&rig.worlds[0]));
    // Light from all sides is found by paths.
    if rig.shines() && mirrors.curved && Bending::of(world) == Bending::AtRough {
        problems.push_with_hint(
            "",
            "a mirror is curved, and there are rough walls between different n: the light that goes by both is not found by this version",
            "give what has n != 1 a smooth surface, make mirrors of slabs and boxes, or light the scene by ambient light alone",
        );
    }
}

/// What this version cannot say of lamp reflections.
fn check_lamp_reflections(rig: &Rig, problems: &mut Problems) {
    if rig.excludes_specular || !rig.shines() {
        return;
    }
    let world = &rig.worlds[0];
    let (bending, mirrors) = (Bending::of(world), Mirrors::of(world));
    let smooth = matches!(bending, Bending::AtPlanes(_) | Bending::AtInterfaces) || !mirrors.is_empty();
    if smooth && rig.is_parallel() {
        problems.push_with_hint(
            "",
            "an orthographic camera sees nothing or too much of a parallel beam's reflection in planes: both have one direction only",
            "write `specular: exclude` in the camera, make it a pinhole far away, or the beam a spot",
        );
        return;
    }
    if mirrors.face && bending != Bending::AtInterfaces {
        problems.push_with_hint(
            "",
            "flat mirrors face each other: the lamp reflections between them are endless",
            "write `specular: exclude` in the camera, or leave one mirror",
        );
    }
    if in_focus(rig) {
        problems.push_with_hint(
            "camera.position",
            "walls bring the light of a lamp to a focus at the camera, as round ones do on their axis: it is endlessly bright",
            "move the camera or the light aside, give the camera an aperture, or write `specular: exclude`",
        );
    }
}
