//! How much memory a demodulation takes, by the layers of its inputs and outputs.

use turbid_contract::payload::Frames;
use turbid_contract::{Extent, Form, Forms, Known, Parts};

/// Bytes that the run holds at the most; `None` where the layers of the frames are not known.
///
/// Beside the inputs and the `forms` of the outputs that are wanted there are flags of unknown errors (2 bytes for each fringe of a pixel, which
/// its M_DC is counted by) and a plane of the mask.
///
/// `by_channel`: of the frames no more than those of one wavelength are held at a time.
pub fn memory(known: &Known, forms: &Forms, by_channel: bool) -> Option<u64> {
    let frames = known.extent("frames")?;
    let layers = known.form("frames").and_then(|form| form.layers.as_deref()).filter(|_| by_channel);
    let held = layers.map_or(frames.layers(), |layers| {
        let wavelengths: Vec<_> = layers.iter().map(|info| info.wavelength_nm).collect();
        Parts::<Frames>::most_of_a_channel(layers, &wavelengths) as u64
    });
    let held = 4 * frames.pixels() * held;
    let modulation = forms.get("modulation")?.values()?;
    let fringes = modulation.iter().filter(|info| info.name == "m_dc").count() as u64;
    let wanted = forms.iter().filter(|(port, _)| **port == "modulation" || known.is_wanted(port));
    let made: u64 = wanted.map(|(_, form)| certain(form, frames.pixels())).sum();
    let covariance = known.extent("covariance").map_or(0, Extent::bytes);
    Some(held + covariance + made + frames.pixels() * (4 + 2 * fringes))
}

/// Bytes of the layers that are there whatever a run finds.
fn certain(form: &Form, pixels: u64) -> u64 {
    4 * pixels * form.layers.as_ref().map_or(0, Vec::len) as u64
}
