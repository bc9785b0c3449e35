//! How a stage is written: the first block of YAML that uses it in its crate's own manual.

/// Where stages describe themselves.
const SOURCES: [&str; 15] = [
    include_str!("../../../stages/calibrate/src/lib.rs"),
    include_str!("../../../stages/chromophores/src/lib.rs"),
    include_str!("../../../stages/compare/src/lib.rs"),
    include_str!("../../../stages/demodulate/src/lib.rs"),
    include_str!("../../../stages/dis/src/lib.rs"),
    include_str!("../../../stages/iad/src/stage.rs"),
    include_str!("../../../stages/import/src/lib.rs"),
    include_str!("../../../stages/invert/src/lib.rs"),
    include_str!("../../../stages/lut/src/lib.rs"),
    include_str!("../../../stages/pattern/src/lib.rs"),
    include_str!("../../../stages/profilometry/src/lib.rs"),
    include_str!("../../../stages/render/src/lib.rs"),
    include_str!("../../../stages/scene/src/lib.rs"),
    include_str!("../../../stages/section/src/lib.rs"),
    include_str!("../../../stages/sensor/src/lib.rs"),
];

/// The example of stage `name`, without indentation; `None` for a stage of which the program has no source.
pub fn of(name: &str) -> Option<String> {
    let uses = format!("use: {name}");
    // `compare` is not `compare_all`.
    let ends = |rest: &str| rest.chars().next().is_none_or(|c| !c.is_alphanumeric() && c != '_');
    let used = |block: &&str| block.match_indices(&uses).any(|(at, _)| ends(&block[at + uses.len()..]));
    let blocks = SOURCES.iter().flat_map(|source| source.split("//! ```yaml\n").skip(1));
    let block = blocks.filter_map(|rest| rest.split("//! ```").next()).find(used)?;
    let plain = |line: &str| line.trim_start_matches("//!").strip_prefix(' ').unwrap_or_default().to_owned();
    Some(block.lines().map(|line| format!("{}\n", plain(line))).collect())
}
