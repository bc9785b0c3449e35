//! Pictures of artifacts for people: PNG figures with titles, colour bars and units.

mod arrange;
mod axis;
mod canvas;
mod colour;
mod figure;
mod lut;
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
mod tristimulus;

use turbid_contract::Artifact;

use canvas::Canvas;

/// A PNG file that shows the artifact under a heading; None where there is nothing to see (records, tables without
/// a grid). The same artifact and title give the same bytes.
///
/// Image stacks become a panel per layer: viridis for quantities, blue to red around zero for errors, one scale for
/// layers that belong together, stripes for masked pixels, the reasons' legend for masks. Stacks of `red`, `green`,
/// `blue` are shown as the picture they are, and frames of a red, a green and a blue wavelength also in colours. Look-up tables become their mesh and their reflectances over (mu_a, mu_s').
pub fn picture(artifact: &Artifact, title: &str) -> Option<Vec<u8>> {
    draw(artifact, title).map(|canvas| canvas.to_png())
}

fn draw(artifact: &Artifact, title: &str) -> Option<Canvas> {
    let figure = match artifact {
        Artifact::Images(stack) if stack.layers.is_empty() => return None,
        Artifact::Images(stack) => sketch::figure(stack, title).unwrap_or_else(|| stack::figure(stack, title)),
        Artifact::Table(table) => lut::figure(table, title)?,
        Artifact::Record(_) => return None,
    };
    Some(figure.draw())
}
