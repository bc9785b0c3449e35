//! The program as a user runs it, in one binary.

#[path = "all/space.rs"]
mod space;

#[path = "all/add_a_stage.rs"]
mod add_a_stage;
#[path = "all/arrows.rs"]
mod arrows;
#[path = "all/browser.rs"]
mod browser;
#[path = "all/checks.rs"]
mod checks;
#[path = "all/commands.rs"]
mod commands;
#[path = "all/conditions.rs"]
mod conditions;
#[path = "all/crash.rs"]
mod crash;
#[cfg(unix)]
#[path = "all/docs.rs"]
mod docs;
#[path = "all/draws.rs"]
mod draws;
#[path = "all/estimates.rs"]
mod estimates;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[path = "all/faults.rs"]
mod faults;
#[path = "all/figures.rs"]
mod figures;
#[path = "all/floors.rs"]
mod floors;
#[path = "all/inputs.rs"]
mod inputs;
#[path = "all/joints.rs"]
mod joints;
#[path = "all/latest.rs"]
mod latest;
#[path = "all/licences.rs"]
mod licences;
#[cfg(target_os = "linux")]
#[path = "all/locks.rs"]
mod locks;
#[path = "all/low_samples.rs"]
mod low_samples;
#[path = "all/luts.rs"]
mod luts;
#[path = "all/manual.rs"]
mod manual;
#[path = "all/measured.rs"]
mod measured;
#[path = "all/memory.rs"]
mod memory;
#[path = "all/memos.rs"]
mod memos;
#[path = "all/meshes.rs"]
mod meshes;
#[path = "all/metrics.rs"]
mod metrics;
#[path = "all/mismatches.rs"]
mod mismatches;
#[path = "all/near_normal.rs"]
mod near_normal;
#[path = "all/partial.rs"]
mod partial;
#[path = "all/people.rs"]
mod people;
#[path = "all/phantoms.rs"]
mod phantoms;
#[path = "all/pictures.rs"]
mod pictures;
#[path = "all/profile.rs"]
mod profile;
#[path = "all/random_scenes.rs"]
mod random_scenes;
#[path = "all/record.rs"]
#[allow(dead_code, reason = "the bench that renews records needs the rest")]
mod record;
#[path = "all/report.rs"]
mod report;
#[path = "all/reproducible.rs"]
mod reproducible;
#[path = "all/rerun.rs"]
mod rerun;
#[path = "all/rigs.rs"]
mod rigs;
#[path = "all/saturation.rs"]
mod saturation;
#[path = "all/schema.rs"]
mod schema;
#[path = "all/shapes.rs"]
mod shapes;
#[path = "all/shards.rs"]
mod shards;
#[path = "all/shots.rs"]
mod shots;
#[path = "all/spheres.rs"]
mod spheres;
#[path = "all/starters.rs"]
mod starters;
#[cfg(unix)]
#[path = "all/submit.rs"]
mod submit;
#[path = "all/terminal.rs"]
mod terminal;
#[path = "all/together.rs"]
mod together;
#[path = "all/tubes.rs"]
mod tubes;
#[path = "all/unchanged.rs"]
mod unchanged;
#[path = "all/usual.rs"]
mod usual;
#[path = "all/wrong_files.rs"]
mod wrong_files;
#[path = "all/wrong_wavelengths.rs"]
mod wrong_wavelengths;
