//! What the outputs of a render will hold, by params, scene and the form of a pattern.

use turbid_contract::payload::{CONDITIONS, Scene};
use turbid_contract::{Attributes, Form, Forms, Known, LayerInfo};

use crate::cautions::errors_may_be_unknown;
use crate::conditions::infos;
use crate::frames::{covariance_layer, frame_layer, listed, pairs, white_layer};
use crate::params::Params;
use crate::projected::{Projected, Quantity, of_layers};
use crate::response::Layout;
use crate::{power, truth};

/// Open where the scene is not known; frames and covariance also where the layers of the pattern are not.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let Some(scene) = known.get::<Scene>("scene") else { return Forms::new() };
    let conditions = turbid_geometry::conditions(&scene);
    let mut forms = forms(params, &scene, known, conditions.is_some());
    if let Some(said) = conditions {
        said.insert_into(&mut forms.entry("frames").or_default().attributes, CONDITIONS);
    }
    forms
}

/// The same without the conditions of light and view, which take rays to find; for sizes.
pub fn sizes(params: &Params, scene: &Scene, known: &Known) -> Forms {
    forms(params, scene, known, scene.objects.values().any(|object| object.medium.is_some()))
}

/// `conditioned`: whether the camera sees a medium.
fn forms(params: &Params, scene: &Scene, known: &Known, conditioned: bool) -> Forms {
    let seen = Seen::of(scene);
    let pattern = known.is_connected("pattern").then(|| known.form("pattern").cloned().unwrap_or_default());
    let mut frames = Form { attributes: of_frames(scene, pattern.as_ref()), ..seen.open() };
    let mut covariance = seen.open();
    if let Some((projected, quantities)) = projected(params, pattern.as_ref()) {
        let layers = |wavelength_nm: &Option<f64>| -> Vec<LayerInfo> {
            projected.iter().map(|info| frame_layer(info, *wavelength_nm)).collect()
        };
        seen.add_values(&mut frames, seen.wavelengths_nm.iter().flat_map(layers));
        if conditioned {
            let (there, perhaps) = infos(scene);
            frames.layers.get_or_insert_default().extend(there);
            frames.perhaps.push(perhaps);
        }
        let count = quantities.len();
        let layers = |(channel, wavelength_nm): (usize, &Option<f64>)| -> Vec<LayerInfo> {
            let first = channel * count;
            pairs(count).map(|pair| covariance_layer(pair.map(|i| first + i), *wavelength_nm)).collect()
        };
        covariance.layers = Some(seen.wavelengths_nm.iter().enumerate().flat_map(layers).collect());
        covariance.attributes.extend([listed(&quantities, &seen.wavelengths_nm)]);
    }
    let mut white = seen.open();
    seen.add_values(&mut white, seen.wavelengths_nm.iter().copied().map(white_layer));
    let (mut layers, mask) = truth::layers(scene);
    layers.push(mask);
    let truth = Form { layers: Some(layers), attributes: truth::said(scene), ..seen.open() };
    let power = power::form(scene, params.photons);
    Forms::from([("frames", frames), ("covariance", covariance), ("white", white), ("truth", truth), ("power", power)])
}

/// What all images of a scene have in common.
struct Seen {
    pixels: Option<[u64; 2]>,
    /// Of each channel.
    wavelengths_nm: Vec<Option<f64>>,
    /// Attributes of frames, covariance and white.
    attributes: Attributes,
    may_flag: bool,
}

impl Seen {
    fn of(scene: &Scene) -> Self {
        Self {
            pixels: scene.camera.as_ref().map(|camera| [camera.pixels[1], camera.pixels[0]].map(u64::from)),
            wavelengths_nm: (0..scene.channels()).map(|c| scene.wavelengths_nm.get(c).copied()).collect(),
            attributes: of_images(scene),
            may_flag: errors_may_be_unknown(scene),
        }
    }

    fn open(&self) -> Form {
        Form { pixels: self.pixels, ..Form::said(self.attributes.clone()) }
    }

    /// Each value with its standard error behind it, which may be unknown in pixels.
    fn add_values(&self, form: &mut Form, values: impl Iterator<Item = LayerInfo>) {
        let layers = form.layers.get_or_insert_default();
        for info in values {
            let error = info.standard_error();
            form.perhaps.extend(self.may_flag.then(|| info.se_unknown()));
            layers.extend([info, error]);
        }
    }
}

/// What frames, covariance and white say of the scene.
fn of_images(scene: &Scene) -> Attributes {
    let mut attributes = Attributes::new();
    if let Some(camera) = &scene.camera {
        camera.insert_pitch_into(&mut attributes);
    }
    scene.rig().insert_into(&mut attributes);
    attributes
}

/// What frames say beside their conditions. How many samples there are, and what the errors of pixels share, only a run can tell.
fn of_frames(scene: &Scene, pattern: Option<&Form>) -> Attributes {
    let mut attributes = of_images(scene);
    let along = pattern.and_then(|pattern| pattern.attributes.get_key_value("fringes_along"));
    attributes.extend(along.map(|(name, surface)| (name.clone(), surface.clone())));
    attributes
}

/// What is projected, frame by frame, and the quantities behind the frames.
fn projected(params: &Params, pattern: Option<&Form>) -> Option<(Vec<LayerInfo>, Vec<Quantity>)> {
    let (frames, quantities) = match pattern {
        None => {
            let Projected { frames, quantities, .. } = Projected::sinusoids(params, false);
            (frames, quantities)
        }
        Some(pattern) => {
            let layers = pattern.values()?;
            of_layers(&layers, Layout { carriers: 0, projected_images: layers.len(), steady: false })
        }
    };
    Some((frames.into_iter().map(|(info, _)| info).collect(), quantities))
}
