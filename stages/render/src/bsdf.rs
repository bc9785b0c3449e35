//! BSDFs: what a ray meets at the interface of a body.

/// How the interface of a body treats light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Bsdf {
    /// A boundary that obeys Fresnel and Snell where the refractive indices differ, nothing where they do not.
    #[default]
    Smooth,
    /// A boundary of GGX microfacets of this roughness where the refractive indices differ, nothing where they do not.
    Rough(f64),
    /// Opaque, reflecting this fraction of the light with a radiance that is the same in all directions.
    Lambertian(f64),
    /// The same with a fraction that varies over the surface, as an index into [`World::textures`](crate::world::World::textures).
    Textured(usize),
    /// Opaque, reflecting all light as a mirror does.
    Mirror,
}

impl Bsdf {
    /// Whether light cannot enter the body.
    #[inline(always)]
    pub fn is_opaque(&self) -> bool {
        matches!(self, Self::Lambertian(_) | Self::Textured(_) | Self::Mirror)
    }
}
