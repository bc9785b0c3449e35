//! The projector's pixels: where each stands in the pattern's plane, and where its light goes.

use glam::DVec3;
use turbid_contract::payload::{Profile, Projector, Scene};
use turbid_geometry::projector_view;
use turbid_optics::view::View;

/// A projector that shows pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    pub view: View,
    pub profile: Profile,
    pub columns: usize,
    pub rows: usize,
}

/// Why there is none: the field at fault, what is wrong, the way out.
pub type Lack = (&'static str, String, &'static str);

impl Screen {
    /// The projector of the scene, with its own pixels or, where it has none, with `pixels`.
    ///
    /// Error: no projector, no pixels, or two numbers of pixels.
    pub fn of(scene: &Scene, pixels: Option<[u32; 2]>) -> Result<Self, Lack> {
        let Some(projector) = &scene.projector else {
            let what = "the scene has no projector that could show a pattern";
            return Err(("", what.to_owned(), "add `projector` to the scene"));
        };
        let pixels = match (projector.pixels, pixels) {
            (Some(own), Some(given)) if own != given => {
                let what = format!(
                    "the scene's projector has {} x {} pixels, not {} x {}",
                    own[0], own[1], given[0], given[1]
                );
                return Err(("pixels", what, "leave `pixels` out here"));
            }
            (Some(pixels), _) | (None, Some(pixels)) => pixels,
            (None, None) => {
                let what = "nothing says how many pixels the pattern has".to_owned();
                return Err(("pixels", what, "give the scene's projector `pixels: [columns, rows]`, or write it here"));
            }
        };
        Self::new(projector, pixels)
    }

    fn new(projector: &Projector, [columns, rows]: [u32; 2]) -> Result<Self, Lack> {
        let most = 1 << 26;
        let total = u64::from(columns) * u64::from(rows);
        if total == 0 || total > most {
            return Err((
                "pixels",
                format!("{columns} x {rows} pixels: there must be 1 to {most}"),
                "choose another number",
            ));
        }
        let view = projector_view(projector)
            .map_err(|e| ("", format!("the projector of the scene is no view: {e:?}"), "move it"))?;
        Ok(Self { view, profile: projector.profile, columns: columns as usize, rows: rows as usize })
    }

    pub fn pixels(&self) -> usize {
        self.columns * self.rows
    }

    /// Width and height of a pixel in the pattern's plane, mm.
    pub fn pitch(&self) -> [f64; 2] {
        [self.view.field.x / self.columns as f64, self.view.field.y / self.rows as f64]
    }

    /// The image position of a point of a pixel: (0, 0) its upper left corner, (1, 1) its lower right.
    #[inline]
    pub fn place(&self, pixel: usize, x: f64, y: f64) -> (f64, f64) {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        ((column + x) / self.columns as f64, (row + y) / self.rows as f64)
    }

    /// Where a point of a pixel stands in the pattern's plane; a lens that distorts sends its light elsewhere.
    pub fn on_plane(&self, pixel: usize, x: f64, y: f64) -> DVec3 {
        let (x, y) = self.place(pixel, x, y);
        self.view.plane_point(x, y)
    }

    /// Origin and unit vector of its light.
    #[inline]
    pub fn ray(&self, pixel: usize, x: f64, y: f64) -> (DVec3, DVec3) {
        let (x, y) = self.place(pixel, x, y);
        self.view.ray(x, y)
    }

    /// Radiant intensity along a unit vector, in a unit of its own: that of pattern value 1.
    pub fn intensity(&self, w: DVec3) -> f64 {
        match self.profile {
            Profile::UniformIntensity => 1.0,
            // The same irradiance E = I cos / R^2 all over the plane, R = h / cos.
            Profile::Flat => 1.0 / (w.z * w.z * w.z).abs(),
        }
    }
}
