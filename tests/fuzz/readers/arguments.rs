//! Arguments of the command line: `STAGE[axis=value].PORT`, and `--set PATH=VALUE`.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use turbid::cli::Selector;
use turbid::plan::{Plan, Target};
use turbid::registry::Registry;
use turbid::spec;

use super::{Reader, Seen, no_more, nothing};
use crate::mutate::Form;

pub fn readers() -> Vec<Reader> {
    vec![
        Reader {
            name: "selector",
            form: Form::Text,
            share: 1,
            claims: nothing,
            seeds: || {
                [&b"scene"[..], b"frames.frames", b"s[A=1.5,b=x].p", b"s[ a = 0.1 , b=\xc2\xb5 ]"]
                    .map(<[u8]>::to_vec)
                    .to_vec()
            },
            read: select,
            law: no_more,
        },
        Reader {
            name: "set",
            form: Form::Text,
            share: 2,
            claims: nothing,
            // One override a line.
            seeds: || {
                let lines = ["vars.samples=64", "seed=3\nabout=a b", "stages.rig.with.camera.pixels=[8, 8]"];
                lines.map(|l| l.as_bytes().to_vec()).to_vec()
            },
            read: set,
            law: no_more,
        },
    ]
}

/// A pipeline that is shipped.
static SHIPPED: LazyLock<Plan> = LazyLock::new(|| {
    let spec = spec::load(&shipped(), &[]).expect("the shipped pipeline is right");
    Plan::build(spec, spec::Report::default(), &Registry::builtin(), &[]).expect("the shipped pipeline is right")
});

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/quickstart.yaml")
}

fn select(input: &[u8]) -> Result<Seen, String> {
    let text = String::from_utf8_lossy(input);
    let _ = Target::parse(&text);
    let selector = Selector::parse(&text);
    if let Ok(selector) = &selector {
        let _ = selector.instances(&SHIPPED);
    }
    Ok(Seen::as_large(selector.is_ok(), input))
}

fn set(input: &[u8]) -> Result<Seen, String> {
    let overrides: Vec<String> = String::from_utf8_lossy(input).split('\n').map(str::to_owned).collect();
    let (spec, report) = spec::read(&shipped(), &overrides);
    drop((report.to_string(), report.to_json()));
    let plan = spec.map(|spec| Plan::build(spec, report, &Registry::builtin(), &[]));
    if let Some(Err(report)) = &plan {
        drop((report.to_string(), report.to_json()));
    }
    Ok(Seen::as_large(matches!(plan, Some(Ok(_))), input))
}
