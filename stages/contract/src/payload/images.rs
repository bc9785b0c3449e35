//! Payloads that are image stacks; each documents its layers.

use crate::artifact::{Artifact, ArtifactKind, ImageStack};
use crate::error::Error;
use crate::payload::Payload;
use crate::payload::quantity::{COV, INCIDENCE, MASK, Quantity, THICKNESS, VIEW, in_own_unit, quantity};

macro_rules! image_payload {
    ($(#[$doc:meta])* $name:ident, $payload:literal, $holds:expr) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name(pub ImageStack);

        impl Payload for $name {
            const NAME: &'static str = $payload;
            const KIND: ArtifactKind = ArtifactKind::Images;
            const HOLDS: &'static [Quantity] = $holds;

            fn into_artifact(self) -> Artifact {
                Artifact::Images(self.0)
            }

            fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
                match artifact {
                    Artifact::Images(stack) => Ok(Self(stack)),
                    other => Err(Error::failed(format!(concat!($payload, " must be an image stack, not {:?}"), other.kind()))),
                }
            }
        }
    };
}

image_payload!(
    /// A projected pattern: layers `pattern`, values in [0, 1], with f_x, phase, orientation.
    Pattern, "pattern", &[quantity("pattern", "1", "share of the full light, 0 to 1")]
);
image_payload!(
    /// Camera frames: layers `radiance` (W mm^-2 sr^-1) with f_x, phase, orientation, wavelength, and `radiance_se`.
    ///
    /// A sinusoid is (1 + cos(2 pi f_x u + phase)) / 2; f_x = 0 is one frame at 1/2. So with L(P) the response to
    /// pattern P, frame = L(1)/2 + Re(e^{i phase} L(e^{i 2 pi f_x u}))/2.
    Frames, "frames", &[in_own_unit("radiance", "W mm^-2 sr^-1, or counts of a camera"), MASK, VIEW, INCIDENCE, THICKNESS]
);
image_payload!(
    /// Per-pixel covariance of the quantities behind frames: covariance layers `cov` with `pair`.
    ///
    /// The attribute `quantities` lists them in order: `[{"part": "dc"|"re"|"im", "f_x_per_mm": f,
    /// "orientation_deg": o, "wavelength_nm": w?}]` with dc = L(1)/2 (so that it is M_DC) and
    /// re + i im = L(e^{i 2 pi f_x u})/2 (so that its modulus is M_AC). All pairs i <= j are stored.
    Covariance, "covariance", &[COV, MASK]
);
image_payload!(
    /// Demodulated frames: for each f_x value layers `m_dc` and `m_ac` (W mm^-2 sr^-1; at f_x = 0 both are M_DC),
    /// their `_se` layers, covariance layers `cov` whose `pair` indexes this stack's layers, and `mask`.
    Modulation, "modulation", &[in_own_unit("m_dc", "mean of the fringes, in the unit of the frames"), in_own_unit("m_ac", "amplitude of the fringes; at f_x = 0 the mean"), COV, MASK, VIEW, INCIDENCE, THICKNESS]
);
image_payload!(
    /// Phase of the fringe: layers `phase` (rad, wrapped to (-pi, pi]) and `phase_se` for each f_x > 0.
    Phase, "phase", &[quantity("phase", "rad", "of the fringe, in (-pi, pi]"), MASK, VIEW, INCIDENCE, THICKNESS]
);
image_payload!(
    /// Calibrated reflectance: layers `r_d` (1) for each f_x with `r_d_se`, covariance layers `cov` with `pair`, `mask`.
    ///
    /// Attributes: `convention`, `g`, `n` and the reference's properties.
    Reflectance, "reflectance", &[quantity("r_d", "1", "diffuse reflectance, as `convention` says"), COV, MASK, VIEW, INCIDENCE, THICKNESS]
);
image_payload!(
    /// Optical property maps: `mu_a`, `mu_s_prime` (mm^-1), `mu_a_se`, `mu_s_prime_se`, `mask`.
    Maps, "maps", &[quantity("mu_a", "mm^-1", "absorption coefficient"), quantity("mu_s_prime", "mm^-1", "reduced scattering coefficient"), quantity("height", "mm", "world z of the surface"), quantity("normal_x", "1", "unit normal towards the camera"), quantity("normal_y", "1", "unit normal towards the camera"), quantity("normal_z", "1", "unit normal towards the camera"), quantity("outside", "1", "the side on which the table ended, where the nearest node stands in"), COV, MASK]
);
image_payload!(
    /// What maps of several wavelengths are made of: a layer for each chromophore (`HbO2`, `Hb` in uM; `water`, `lipid`, `melanin` as shares of the volume;
    /// others by the names and units that users give them), `THb` (uM), `StO2` (1), `scatter_a` (mm^-1), `scatter_b` (1), `residual` (mm^-1),
    /// `at_bound` (how many concentrations were held at 0), their `_se`, `mask`.
    Concentrations, "concentrations", &[]
);
image_payload!(
    /// What the camera truly looks at, at pixel centres: `mu_a`, `mu_s_prime` (mm^-1), `height` (world z of the first
    /// hit, mm), `depth` (along the camera axis, mm), `normal_x|y|z`, `object` (index into the attribute `objects`), `mask`.
    /// The attribute `field` is what the camera sees in the plane of its look_at: width and height in mm.
    Truth, "truth", &[quantity("mu_a", "mm^-1", "absorption coefficient"), quantity("mu_s_prime", "mm^-1", "reduced scattering coefficient"), quantity("height", "mm", "world z of the first hit"), quantity("depth", "mm", "along the camera axis"), quantity("normal_x", "1", "unit normal of the surface"), quantity("normal_y", "1", "unit normal of the surface"), quantity("normal_z", "1", "unit normal of the surface"), quantity("object", "1", "index into the attribute `objects`"), quantity("albedo", "1", "of a Lambertian surface"), MASK]
);
image_payload!(
    /// Frame under uniform white light: layers `radiance` and `radiance_se`.
    White, "white", &[in_own_unit("radiance", "under uniform white light, W mm^-2 sr^-1"), MASK]
);
image_payload!(
    /// Estimate, truth and relative error of maps side by side, for people.
    Errors, "errors", &[]
);
image_payload!(
    /// What a pattern does on the surfaces that it is projected onto, by pixels of the projector: for each fringe layers `f_surface`
    /// (spatial frequency along the surface, mm^-1) and `cycles_per_pixel` (1) with its f_x; `coordinate` (mm along the surface) where
    /// the pattern was made for one; `mask`.
    SurfaceFrequency, "surface_frequency", &[quantity("f_surface", "mm^-1", "spatial frequency along the surface"), quantity("cycles_per_pixel", "1", "of the projector"), quantity("coordinate", "mm", "along the surface"), MASK]
);
image_payload!(
    /// How the projector's light falls on a surface, by pixels of the camera: layers `irradiance` (1, over that on the reference plane
    /// which the same pixel sees), `f_surface` (mm^-1, along the surface) for each f_x > 0, `incidence` and `view` (rad, between the normal and the
    /// ways to projector and camera), `mask`.
    Exposure, "exposure", &[quantity("irradiance", "1", "over that on the reference plane"), quantity("f_surface", "mm^-1", "spatial frequency along the surface"), quantity("incidence", "rad", "between the normal and the way to the projector"), quantity("view", "rad", "between the normal and the way to the camera"), MASK]
);
image_payload!(
    /// A picture for people: layers `red`, `green`, `blue` (or `grey`) in [0, 1].
    Preview, "preview", &[]
);
image_payload!(
    /// Where a look-up table can be trusted: over (mu_a, mu_s') nodes, noise gains and the sign of the Jacobian.
    Validity, "validity", &[]
);
