//! What rough walls lose between their facets, said where alpha stands.

use turbid_contract::Problems;
use turbid_contract::payload::{Scene, Surface};
use turbid_optics::between_facets::{shares, worst_neighbour};

/// Less than this part of the light is not worth a word.
const NOTHING: f64 = 1e-3;

/// Warns of every object with a rough wall: by its roughness and the index on both sides.
pub fn warn_of_lost_light(scene: &Scene, problems: &mut Problems) {
    for (name, object) in &scene.objects {
        let (Surface::Rough(alpha), Some(medium)) = (&object.surface, &object.medium) else { continue };
        let n = scene.media[medium].n;
        if n == 1.0 {
            continue;
        }
        let indices = scene.media.values().map(|medium| medium.n).chain([1.0]);
        let (outside, lost) = worst_neighbour(*alpha, n, indices);
        if lost < NOTHING {
            continue;
        }
        let once = [[outside, n], [n, outside]].map(|n| 100.0 * shares(*alpha, n).lost);
        problems.warn(
            format!("objects.{name}.surface.rough"),
            format!(
                "rough = {alpha}: light that would meet a second facet is lost, between n = {outside} and {n} {:.2} % of even light that comes from outside \
                 and {:.2} % of what comes from inside; of light that goes in and would all come back {:.2} % is missing. A smaller alpha loses less",
                once[0],
                once[1],
                100.0 * lost
            ),
        );
    }
}
