//! Pictures of artifacts for people: PNG figures with titles, colour bars and units.

mod arrange;
mod canvas;
mod colour;
mod figure;
mod notation;
mod number;
mod panel;
mod pixels;
mod range;
mod sketch;
mod stack;
#[cfg(test)]
mod tests;
mod text;
mod ticks;

use turbid_contract::Artifact;

/// A PNG file that shows the artifact under a heading; None where there is nothing to see (records, tables without
/// a grid). The same artifact and title give the same bytes.
///
/// Image stacks become a panel per layer: viridis for quantities, blue to red around zero for errors, one scale for
/// layers that belong together, stripes for masked pixels, the reasons' legend for masks. Stacks of `red`, `green`,
/// `blue` are shown as the picture they are.
pub fn picture(artifact: &Artifact, title: &str) -> Option<Vec<u8>> {
    let figure = match artifact {
        Artifact::Images(stack) if stack.layers.is_empty() => return None,
        Artifact::Images(stack) => sketch::figure(stack, title).unwrap_or_else(|| stack::figure(stack, title)),
        Artifact::Table(_) | Artifact::Record(_) => return None,
    };
    Some(figure.draw().to_png())
}
