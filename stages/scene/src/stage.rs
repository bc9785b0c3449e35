//! The stage: instant, draws nothing, one record and a sketch.

use turbid_contract::canonical::canonical_value;
use turbid_contract::payload::{Preview, Scene};
use turbid_contract::serde_json::Value;
use turbid_contract::{Ctx, Error, FileUse, Known, Problems, Stage, StagePlan, in_ports, out_ports};

use crate::assemble::assemble;
use crate::params::Params;
use crate::sketch::sketch;

in_ports! {
    pub struct In {}
}

out_ports! {
    pub struct Out {
        /// Media, objects, camera and projector in mm and mm^-1.
        scene: one Scene,
        /// Top and side view of the set-up with the fields of camera and projector.
        preview: preview Preview,
    }
}

pub struct SceneStage;

impl Stage for SceneStage {
    const NAME: &'static str = "scene";
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "Describes media, objects, camera and projector, and checks that they fit together";
    const INSTANT: bool = true;

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn files(params: &Params) -> Vec<FileUse> {
        let meshes = params.objects.iter().filter_map(|(name, o)| Some((name, o.mesh.as_ref()?)));
        meshes.map(|(name, m)| FileUse { at: format!("objects.{name}.mesh.file"), path: m.file.clone() }).collect()
    }

    fn canonical(params: &Params) -> Result<Value, String> {
        let mut params = params.clone();
        for mesh in params.objects.values_mut().filter_map(|o| o.mesh.as_mut()) {
            // Where the file lies does not matter: its content and name are in the key.
            let name = mesh.file.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
            mesh.file = name;
        }
        canonical_value(&params)
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        assemble(params, &|at| known.files.get(at).cloned(), problems);
    }

    fn plan(_: &Params, _: &Known) -> StagePlan {
        StagePlan { seconds: Some(0.0), ..StagePlan::default() }
    }

    fn run(params: &Params, _: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let mut problems = Problems::default();
        let scene = assemble(params, &|at| ctx.file(at), &mut problems);
        if let Some(problem) = problems.into_parts().0.into_iter().next() {
            return Err(Error::Invalid(problem));
        }
        let preview = ctx.wants("preview").then(|| sketch(&scene));
        Ok(Out { scene, preview })
    }
}
