//! Pictures of artifacts for people: PNG figures with titles, colour bars and units.

mod arrange;
mod axis;
mod canvas;
mod caption;
pub mod chart;
mod classes;
mod colour;
mod figure;
mod lut;
mod media;
mod notation;
mod number;
pub mod overview;
mod panel;
mod pixels;
mod range;
mod scale;
mod sketch;
mod stack;
#[cfg(test)]
mod tests;
mod text;
mod ticks;
mod transfer;
mod tristimulus;

use std::borrow::Cow;

use turbid_contract::{Artifact, Head, ImageStack, LayerInfo};

#[cfg(test)]
use canvas::Canvas;
pub use caption::Caption;
use figure::Figure;

/// A PNG file that shows the artifact under its caption; None where there is nothing to see (records, tables without
/// a grid). The same artifact and caption give the same bytes.
///
/// Image stacks become a panel per layer: viridis for quantities, blue to red around zero for errors, one scale for
/// layers that belong together, a colour and a name for each reason, object or section, a bar in mm where the pixels' pitch is known. Masked
/// pixels have grey stripes; pink ones lie over pixels that hold the end of a table. Stacks of `red`, `green`,
/// `blue` are shown as the picture they are, and frames of a red, a green and a blue wavelength also in colours. Look-up tables become their
/// mesh and their reflectances over (mu_a, mu_s'), a fit of media the error of each under its name, photon
/// transfer the variance over the level with its line, metrics their [charts](chart::charts).
pub fn picture(artifact: &Artifact, caption: &Caption) -> Option<Vec<u8>> {
    let mut figure = figure(artifact, &caption.title)?;
    figure.subheading.clone_from(&caption.subtitle);
    Some(figure.draw().to_png(&caption.facts))
}

/// The same of an image stack of which `part` reads the layers that are wanted, by their place and what they are: of a large one no more than one layer is held at
/// a time, and the masks.
///
/// Error: that of reading.
pub fn picture_of_parts<E>(head: &Head, part: Part<'_, E>, caption: &Caption) -> Result<Option<Vec<u8>>, E> {
    if head.layers.is_empty() || sketch::is_drawn(&head.layers) || head.attributes.contains_key("media") {
        return Ok(picture(&Artifact::Images(part(&|_, _| true)?), caption));
    }
    let colours = tristimulus::read(&head.layers);
    let colours = stack::colours(&part(&|k, _| colours.contains(&k))?);
    let read = |wanted: usize| {
        let layer = part(&|k, _| k == wanted)?.layers.pop().expect("a part holds what was asked for");
        Ok(Cow::Owned(layer.data))
    };
    let mut figure = stack::figure_of(head, &read, colours, &caption.title)?;
    figure.subheading.clone_from(&caption.subtitle);
    Ok(Some(figure.draw().to_png(&caption.facts)))
}

/// Reads layers.
pub type Part<'a, E> = &'a dyn Fn(&dyn Fn(usize, &LayerInfo) -> bool) -> Result<ImageStack, E>;

fn figure(artifact: &Artifact, title: &str) -> Option<Figure> {
    match artifact {
        Artifact::Images(stack) if stack.layers.is_empty() => None,
        Artifact::Images(stack) => Some(
            sketch::figure(stack, title)
                .or_else(|| media::figure(stack, title))
                .unwrap_or_else(|| stack::figure(stack, title)),
        ),
        Artifact::Table(table) => lut::figure(table, title)
            .or_else(|| transfer::figure(table, title))
            .or_else(|| chart::panel::figure(table, title)),
        Artifact::Record(_) => None,
    }
}

/// The picture under a plain heading.
#[cfg(test)]
fn draw(artifact: &Artifact, title: &str) -> Option<Canvas> {
    figure(artifact, title).map(|figure| figure.draw())
}
