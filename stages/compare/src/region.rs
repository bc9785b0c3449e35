//! Regions of an image: objects, rectangles, disks, and distance from the edges between objects.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{Length, Problems};

/// Which pixels count; a pixel must meet every condition that is given.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Name of the object that the camera sees there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rect: Option<Rect>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disk: Option<Disk>,
    /// Leaves out pixels nearer than this to a pixel of another object, where light crosses the edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub erode_mm: Option<Length>,
    /// The same in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub erode_px: Option<f64>,
}

/// A rectangle, in mm from the centre of the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rect {
    /// Of the rectangle; x to the right, y up.
    pub center: [Length; 2],
    /// Width and height.
    pub size: [Length; 2],
}

/// A disk, in mm from the centre of the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Disk {
    /// Of the disk; x to the right, y up.
    pub center: [Length; 2],
    /// Its diameter.
    pub diameter: Length,
}

impl Region {
    /// Reports what no region can be.
    pub fn check(&self, path: &str, problems: &mut Problems) {
        if *self == Self::default() {
            let hint = "give `object`, `rect`, `disk`, `erode_mm` or `erode_px`";
            problems.push_with_hint(path, "the region has no condition", hint);
        }
        if self.erode_mm.is_some() && self.erode_px.is_some() {
            problems.push(format!("{path}.erode_px"), "erode_mm and erode_px exclude each other");
        }
        let mut require = |value: f64, holds: bool, name: &str, unit: &str, rule: &str| {
            problems.require(holds && value.is_finite(), format!("{path}.{name}"), value, unit, rule);
        };
        if let Some(Length(mm)) = self.erode_mm {
            require(mm, mm >= 0.0, "erode_mm", "mm", "be >= 0");
        }
        if let Some(px) = self.erode_px {
            require(px, px >= 0.0, "erode_px", "px", "be >= 0");
        }
        if let Some(rect) = &self.rect {
            for (i, side) in rect.size.iter().enumerate() {
                require(side.0, side.0 > 0.0, &format!("rect.size.{i}"), "mm", "be > 0");
            }
        }
        if let Some(disk) = &self.disk {
            require(disk.diameter.0, disk.diameter.0 > 0.0, "disk.diameter", "mm", "be > 0");
        }
    }

    /// Whether a length in mm occurs, so that the size of a pixel must be known.
    pub fn needs_mm(&self) -> bool {
        self.rect.is_some() || self.disk.is_some() || self.erode_mm.is_some()
    }

    /// Which pixels belong to the region.
    pub fn select(&self, view: &View<'_>) -> Selection {
        let object = self.object.as_ref().map(|name| view.objects.iter().position(|o| o == name));
        let mut selected: Vec<bool> = view.labels.iter().map(|l| l.is_some()).collect();
        for (i, selected) in selected.iter_mut().enumerate() {
            let at = view.position(i);
            *selected &= object.is_none_or(|wanted| wanted.is_some() && view.labels[i] == wanted)
                && self.rect.as_ref().is_none_or(|r| r.holds(at))
                && self.disk.as_ref().is_none_or(|d| d.holds(at));
        }
        let erosion = match (self.erode_mm, self.erode_px) {
            (Some(Length(mm)), _) => Some((mm, view.pixel_mm)),
            (None, Some(px)) => Some((px, [1.0, 1.0])),
            (None, None) => None,
        };
        if let Some((distance, pixel)) = erosion {
            let near = near_edges(view, distance, pixel);
            selected.iter_mut().zip(near).for_each(|(selected, near)| *selected &= !near);
        }
        Selection(selected)
    }
}

impl Rect {
    fn holds(&self, at: [f64; 2]) -> bool {
        (0..2).all(|k| (at[k] - self.center[k].0).abs() <= self.size[k].0 / 2.0)
    }
}

impl Disk {
    fn holds(&self, at: [f64; 2]) -> bool {
        let [dx, dy] = [0, 1].map(|k| at[k] - self.center[k].0);
        dx * dx + dy * dy <= (self.diameter.0 / 2.0) * (self.diameter.0 / 2.0)
    }
}

/// What is seen where.
pub struct View<'a> {
    pub columns: usize,
    pub rows: usize,
    /// Width and height of a pixel.
    pub pixel_mm: [f64; 2],
    /// Index of the object seen by each pixel, row by row; `None` where there is none.
    pub labels: &'a [Option<usize>],
    pub objects: &'a [String],
}

impl View<'_> {
    /// Centre of a pixel in mm from the centre of the image, x to the right, y up.
    fn position(&self, pixel: usize) -> [f64; 2] {
        let (row, column) = ((pixel / self.columns) as f64, (pixel % self.columns) as f64);
        let x = (column + 0.5 - self.columns as f64 / 2.0) * self.pixel_mm[0];
        let y = (self.rows as f64 / 2.0 - row - 0.5) * self.pixel_mm[1];
        [x, y]
    }
}

/// Which pixels are selected, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection(pub Vec<bool>);

/// Pixels whose centre lies nearer than `distance` to the centre of a pixel with another label.
///
/// Only pixels that have a neighbour (up, down, left, right) of another label can be the nearest one of another label:
/// the pixel before it on the way would be nearer. So it is enough to stamp a disk around these.
fn near_edges(view: &View<'_>, distance: f64, pixel: [f64; 2]) -> Vec<bool> {
    let (rows, columns) = (view.rows as i64, view.columns as i64);
    let label = |r: i64, c: i64| {
        let inside = (0..rows).contains(&r) && (0..columns).contains(&c);
        inside.then(|| view.labels[(r * columns + c) as usize])
    };
    let reach = |size: f64, count: i64| (libm::ceil(distance / size).min(count as f64)) as i64;
    let (reach_x, reach_y) = (reach(pixel[0], columns), reach(pixel[1], rows));
    let mut offsets = Vec::new();
    for dr in -reach_y..=reach_y {
        for dc in -reach_x..=reach_x {
            let (dx, dy) = (dc as f64 * pixel[0], dr as f64 * pixel[1]);
            if dx * dx + dy * dy < distance * distance {
                offsets.push((dr, dc));
            }
        }
    }
    let mut near = vec![false; view.labels.len()];
    for r in 0..rows {
        for c in 0..columns {
            let own = view.labels[(r * columns + c) as usize];
            let neighbours = [(r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)];
            if neighbours.iter().all(|&(r, c)| label(r, c).is_none_or(|l| l == own)) {
                continue;
            }
            for &(dr, dc) in &offsets {
                if label(r + dr, c + dc).is_some_and(|l| l != own) {
                    near[((r + dr) * columns + c + dc) as usize] = true;
                }
            }
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view<'a>(labels: &'a [Option<usize>], columns: usize, objects: &'a [String]) -> View<'a> {
        View { columns, rows: labels.len() / columns, pixel_mm: [0.5, 0.5], labels, objects }
    }

    /// Erosion against its definition, every pixel against every other, on a disk, a stripe and a lone pixel.
    #[test]
    fn erosion_is_the_distance_to_other_objects() {
        let objects: Vec<String> = ["a", "b"].map(String::from).to_vec();
        let columns = 17;
        let pictures: [&dyn Fn(i64, i64) -> Option<usize>; 3] = [
            &|r, c| Some(usize::from((r - 7).pow(2) + (c - 8).pow(2) < 20)),
            &|_, c| if c < 5 { None } else { Some(usize::from(c > 11)) },
            &|r, c| Some(usize::from((r, c) == (0, 16))),
        ];
        for picture in pictures {
            let labels: Vec<_> = (0..15 * 17).map(|i| picture(i / 17, i % 17)).collect();
            let view = view(&labels, columns, &objects);
            for distance in [0.0, 0.5, 0.8, 2.0, 100.0] {
                let got = near_edges(&view, distance, [0.5, 0.5]);
                for (i, &near) in got.iter().enumerate() {
                    let want = (0..labels.len()).any(|j| {
                        let [dx, dy] = [0, 1].map(|k| view.position(i)[k] - view.position(j)[k]);
                        labels[j] != labels[i] && dx * dx + dy * dy < distance * distance
                    });
                    assert_eq!(near, want, "pixel {i}, distance {distance}");
                }
            }
        }
    }

    /// A disk of diameter d holds pi d^2 / 4 of area, a rectangle a x b; y points up, x to the right.
    #[test]
    fn shapes_hold_their_area_at_their_place() {
        let labels = vec![Some(0); 200 * 200];
        let objects = vec!["a".to_owned()];
        let view = view(&labels, 200, &objects);
        let count = |region: &Region| region.select(&view).0.iter().filter(|&&s| s).count() as f64 * 0.25;
        let center = [Length(10.0), Length(20.0)];
        let disk = Region { disk: Some(Disk { center, diameter: Length(30.0) }), ..Region::default() };
        assert!((count(&disk) / (std::f64::consts::PI * 225.0) - 1.0).abs() < 0.01);
        let size = [Length(20.0), Length(10.0)];
        let rect = Region { rect: Some(Rect { center, size }), ..Region::default() };
        assert_eq!(count(&rect), 200.0);
        let first = rect.select(&view).0.iter().position(|&s| s).unwrap();
        assert_eq!((first / 200, first % 200), (50, 100), "top left corner at x = 0, y = 25 mm");
        let other = Region { object: Some("b".into()), ..rect };
        assert_eq!(count(&other), 0.0);
    }
}
