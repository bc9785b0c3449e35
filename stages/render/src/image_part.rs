//! Parts of an image, each of whose paths have an origin of their own: where f32 does not hold all that is seen from one.

use glam::DVec3;

use crate::camera::Camera;
use crate::setting::Setting;
use crate::world::Chords;

/// The most parts along a side.
pub const MOST_PARTS: usize = 64;

/// A rectangle of an image, whose upper left corner is (0, 0) and lower right corner (1, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePart {
    low: [f64; 2],
    size: f64,
}

impl ImagePart {
    pub const WHOLE: Self = Self { low: [0.0; 2], size: 1.0 };

    /// Of `along` x `along` the one in a column and a row.
    pub fn of(along: usize, [column, row]: [usize; 2]) -> Self {
        let size = 1.0 / along as f64;
        Self { low: [column as f64 * size, row as f64 * size], size }
    }

    /// Where the middle of the part meets the first body that is not void, without one where the camera looks; and the largest distance (mm) from there to what the corners
    /// of the part see of the horizontal plane through it, infinite where one sees nothing of it.
    pub fn seen(&self, s: &Setting<'_>) -> (DVec3, f64) {
        let view = &s.camera.view;
        let ray = |x: f64, y: f64| view.ray(self.low[0] + x * self.size, self.low[1] + y * self.size);
        let mut chords = Chords::default();
        let (from, along) = ray(0.5, 0.5);
        let mut segments = s.world.trace(from, along, None, &mut chords);
        let middle = segments.find(|segment| segment.material != 0);
        let origin = middle.map_or(view.look_at, |segment| from + segment.start * along);
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let (from, along) = ray(x, y);
            from + (origin.z - from.z) / along.z * along
        });
        let reach = corners.map(|corner| (corner - origin).length());
        (origin, reach.into_iter().fold(0.0, |most, reach| if reach > most || reach.is_nan() { reach } else { most }))
    }
}

/// So many parts along each side are the fewest of which none reaches farther than `range` (mm); 1 where no number is enough.
pub fn parts_along(s: &Setting<'_>, range: f64) -> usize {
    let pixels = s.camera.columns.max(s.camera.rows).next_power_of_two();
    let counts = (0..).map(|power| 1 << power).take_while(|&n| n <= MOST_PARTS.min(pixels));
    let fits = |n: usize| {
        let mut parts = (0..n).flat_map(|row| (0..n).map(move |column| ImagePart::of(n, [column, row])));
        parts.all(|part| part.seen(s).1 <= range)
    };
    counts.into_iter().find(|&n| fits(n)).unwrap_or(1)
}

/// The part in which a pixel's centre lies, by its column and row among `along` x `along`.
pub fn part_of(camera: &Camera, along: usize, pixel: usize) -> [usize; 2] {
    let part = |at: usize, count: usize| (2 * at + 1) * along / (2 * count);
    [part(pixel % camera.columns, camera.columns), part(pixel / camera.columns, camera.rows)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel is in one part, those of a row and column of parts side by side; with more parts than pixels each has its own.
    #[test]
    fn pixels_are_dealt_out_to_parts() {
        let view = turbid_optics::view::View::new(DVec3::new(0.0, 0.0, 9.0), DVec3::ZERO, DVec3::Y, glam::DVec2::ONE);
        let camera = Camera { view: view.expect("not along y"), columns: 6, rows: 4 };
        let of = |along: usize| (0..24).map(|pixel| part_of(&camera, along, pixel)).collect::<Vec<_>>();
        assert!(of(1).iter().all(|&part| part == [0, 0]));
        assert_eq!(of(2)[..6], [[0, 0], [0, 0], [0, 0], [1, 0], [1, 0], [1, 0]]);
        assert_eq!(of(2)[23], [1, 1]);
        let mut own = of(8);
        own.sort_unstable();
        own.dedup();
        assert_eq!(own.len(), 24);
        assert!(own.iter().all(|part| part[0] < 8 && part[1] < 8));
    }
}
