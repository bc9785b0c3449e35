//! Blocks with a random skin: checked, and made into meshes.

use turbid_contract::Problems;
use turbid_contract::payload::Mesh;
use turbid_draw::stream;

use crate::assemble::plain;
use crate::params::ReliefParams;
use crate::relief::Relief;

/// Triangles of a mesh that is made; more take minutes to render and 40 MB of the scene's record.
pub const MOST_TRIANGLES: f64 = 1e6;
/// Heights over the correlation length from which on slopes look like a mistake: 2 times it is their root mean square.
const STEEP: f64 = 1.0;

/// `None` where it bounds no solid.
pub fn relief(name: &str, r: &ReliefParams, problems: &mut Problems) -> Option<Mesh> {
    let at = |field: &str| format!("objects.{name}.relief.{field}");
    let positive = [
        ("size.0", r.size[0].0),
        ("size.1", r.size[1].0),
        ("thickness", r.thickness.0),
        ("correlation_length", r.correlation_length.0),
    ];
    for (field, v) in positive {
        problems.require(v > 0.0, at(field), v, "mm", "be > 0");
    }
    let rule = "be >= 0; 0 is flat";
    problems.require(r.amplitude.0 >= 0.0, at("amplitude"), r.amplitude.0, "mm", rule);
    if !(positive.iter().all(|(_, v)| *v > 0.0) && r.amplitude.0 >= 0.0) {
        return None;
    }
    let block = Relief {
        size: plain(r.size),
        thickness: r.thickness.0,
        amplitude: r.amplitude.0 + 0.0,
        correlation_length: r.correlation_length.0,
        top: r.top.0 + 0.0,
        center: plain(r.center),
        seed: stream(r.seed, name),
    };
    let count = block.triangle_count();
    if count > MOST_TRIANGLES {
        let least = block.correlation_length * libm::sqrt(count / MOST_TRIANGLES);
        problems.push_with_hint(
            at("correlation_length"),
            format!(
                "correlation_length = {} mm on {} x {} mm takes {count:e} triangles, more than {MOST_TRIANGLES:e}: its squares are an eighth of it",
                block.correlation_length, block.size[0], block.size[1]
            ),
            format!("make it {least:.2} mm or more, or `size` smaller: the camera need not see the edge"),
        );
        return None;
    }
    if block.amplitude >= STEEP * block.correlation_length {
        let slope = libm::atan(2.0 * block.amplitude / block.correlation_length).to_degrees();
        problems.warn(
            at("amplitude"),
            format!(
                "amplitude = {} mm with a correlation_length of {} mm: slopes are {slope:.0} degrees steep (root mean square)",
                block.amplitude, block.correlation_length
            ),
        );
    }
    match block.mesh() {
        Ok(mesh) => Some(mesh),
        Err(lowest) => {
            problems.push_with_hint(
                at("thickness"),
                format!(
                    "thickness = {} mm: with this seed the lowest point of the relief lies {:.3} mm below `top`, through the lower face",
                    block.thickness, -lowest
                ),
                "make the block thicker (six amplitudes hold for any seed), or the amplitude smaller",
            );
            None
        }
    }
}
