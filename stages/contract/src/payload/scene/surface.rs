//! Surfaces of objects.

use serde::{Deserialize, Serialize};

use super::texture::Texture;

/// What light meets at the skin of an object.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// A smooth boundary between the refractive indices of the two sides.
    #[default]
    Smooth,
    /// A rough boundary (GGX microfacets) of this roughness, in (0, 1].
    Rough(f64),
    /// Opaque, diffusely reflecting this fraction of the light that falls on it.
    Lambertian(f64),
    /// The same with a fraction that varies over the surface.
    Textured(Texture),
    /// Opaque, reflecting all light as a mirror does.
    Mirror,
}

impl Surface {
    /// Whether no light enters the object.
    pub fn is_opaque(&self) -> bool {
        matches!(self, Self::Lambertian(_) | Self::Textured(_) | Self::Mirror)
    }
}
