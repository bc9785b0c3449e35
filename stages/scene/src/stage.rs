//! The stage: instant, draws nothing, one record and a sketch.

use turbid_contract::payload::{Preview, Scene};
use turbid_contract::{Ctx, Error, Known, Problems, Stage, StagePlan, in_ports, out_ports};

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

    fn check(params: &Params, _: &Known, problems: &mut Problems) {
        assemble(params, problems);
    }

    fn plan(_: &Params, _: &Known) -> StagePlan {
        StagePlan { seconds: Some(0.0), ..StagePlan::default() }
    }

    fn run(params: &Params, _: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let mut problems = Problems::default();
        let scene = assemble(params, &mut problems);
        if let Some(problem) = problems.into_parts().0.into_iter().next() {
            return Err(Error::Invalid(problem));
        }
        let preview = ctx.wants("preview").then(|| sketch(&scene));
        Ok(Out { scene, preview })
    }
}
