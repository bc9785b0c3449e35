//! Surfaces of objects.

use serde::{Deserialize, Serialize};

/// What light meets at the skin of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// A smooth boundary between the refractive indices of the two sides.
    #[default]
    Smooth,
    /// A rough boundary (GGX microfacets) of this roughness, in (0, 1].
    Rough(f64),
    /// Opaque, diffusely reflecting this fraction of the light that falls on it.
    Lambertian(f64),
}
