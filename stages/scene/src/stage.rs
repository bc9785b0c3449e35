//! The stage: instant, draws nothing, one record and a sketch.

use std::sync::Arc;

use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{Preview, Scene};
use turbid_contract::serde_json::Value;
use turbid_contract::{Ctx, Error, FileUse, Known, Problems, Stage, StagePlan, in_ports, out_ports};

use crate::assemble::{RigInput, assemble, scattered};
use crate::kept::Kept;
use crate::params::{AlbedoParams, ObjectParams, Params, SurfaceParams, TextureParams};
use crate::sketch::sketch;

in_ports! {
    pub struct In {
        /// Another scene whose camera, projector, lights and wavelength_nm this one takes: one rig for both, so that a change in it
        /// reaches both.
        rig: optional Scene,
    }
}

out_ports! {
    pub struct Out {
        /// Media, objects, camera and projector in mm and mm^-1.
        scene: one Scene,
        /// The set-up to scale, with axes and fields of camera and projector; what they look at, enlarged; the view from above.
        preview: preview Preview,
    }
}

pub struct SceneStage;

impl Stage for SceneStage {
    const NAME: &'static str = "scene";
    const VERSION: u32 = 5;
    const ABOUT: &'static str = "Describes media, objects, camera and projector, and checks that they fit together";
    const INSTANT: bool = true;

    type Params = Kept;
    type In = In<'static>;
    type Out = Out;

    fn files(kept: &Kept) -> Vec<FileUse> {
        let mut params = kept.params.clone();
        let max = params.max_file_mb;
        let files = params.objects.iter_mut().flat_map(|(name, o)| files(name, o));
        files.map(|(at, path)| FileUse::new(at, path.as_str(), max)).collect()
    }

    fn canonical(kept: &Kept) -> Result<Value, String> {
        let mut params = kept.params.clone();
        for (_, path) in params.objects.iter_mut().flat_map(|(name, o)| files(name, o)) {
            // Where the file lies does not matter: its content and name are in the key.
            *path = path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
        }
        canonical_value(&params)
    }

    fn check(kept: &Kept, known: &Known, problems: &mut Problems) {
        let rig = match known.get::<Scene>("rig") {
            Some(scene) => RigInput::Known { scene, producer: known.producer("rig").to_owned() },
            None if known.is_connected("rig") => RigInput::Unknown,
            None => RigInput::None,
        };
        let scene = assemble(&kept.params, &rig, &|at| known.files.get(at), problems);
        match rig {
            RigInput::Known { scene: rig, .. } if problems.is_empty() => kept.keep(Some(rig), scene),
            RigInput::None if problems.is_empty() => kept.keep(None, scene),
            _ => {}
        }
    }

    fn plan(_: &Kept, _: &Known) -> StagePlan {
        // The sketch takes nearly all of it.
        StagePlan { seconds: Some(0.02), ..StagePlan::default() }
    }

    fn run(kept: &Kept, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let scene = match kept.made_with(inputs.rig.as_ref()) {
            Some(scene) => scene,
            None => assembled(&kept.params, inputs.rig, ctx)?,
        };
        let preview = ctx.wants("preview").then(|| sketch(&scene, &scattered(&kept.params)));
        Ok(Out { scene, preview })
    }
}

/// The scene of a run that no check went before. Error: the first mistake.
fn assembled(params: &Params, rig: Option<Scene>, ctx: Ctx<'_>) -> Result<Scene, Error> {
    let mut problems = Problems::default();
    let known = |scene| RigInput::Known { scene: Arc::new(scene), producer: "rig".to_owned() };
    let rig = rig.map_or(RigInput::None, known);
    let scene = assemble(params, &rig, &|at| ctx.file(at), &mut problems);
    problems.into_parts().0.into_iter().next().map_or(Ok(scene), |problem| Err(Error::Invalid(problem)))
}

/// The files that an object names: field, path.
fn files<'a>(name: &str, o: &'a mut ObjectParams) -> impl Iterator<Item = (String, &'a mut String)> {
    let mesh = o.mesh.as_mut().map(|m| (format!("objects.{name}.mesh.file"), &mut m.file));
    let image = match &mut o.surface {
        SurfaceParams::Lambertian(AlbedoParams::Textured(TextureParams::Image(i))) => {
            Some((format!("objects.{name}.surface.lambertian.image.file"), &mut i.file))
        }
        _ => None,
    };
    mesh.into_iter().chain(image)
}
