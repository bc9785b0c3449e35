//! Look-up tables: reflectance over a grid of (mu_a, mu_s') for one or more spatial frequencies.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::fixed::Fixed;
use crate::payload::{Payload, Quantity, quantity};

/// What a reflectance means; travels with every reflectance and table, and must agree where they meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Convention {
    /// pi x radiance along the normal / irradiance, specular reflection left out: what a camera measures.
    #[default]
    Camera,
    /// Power that leaves into the hemisphere / power incident, specular reflection left out.
    HemisphericalIncident,
    /// Power that leaves into the hemisphere / power that entered.
    HemisphericalEntered,
    /// M over M of the reference phantom: no model enters, and only a table of phantoms with the same reference can read it.
    Relative,
}

/// One row per node and spatial frequency: columns `mu_a`, `mu_s_prime`, `f_x` (mm^-1), `r_d`, `r_d_se` (random error), `r_d_bound`
/// (what the model's own solution leaves uncertain; null where that is not known) (1).
///
/// Order: f_x outermost, then mu_a, then mu_s'; where the table has sections (attribute `sections`, a list as in [`crate::payload::Section`])
/// a column `section` comes first and runs slowest. Where g or n differ between wavelengths there is a table for each pair of them, one after the other:
/// columns `g` and `n` come first, the attributes `g` and `n` are lists with one value for each of the attribute `wavelengths_nm`. Attributes: `f_x`, `mu_a`, `mu_s_prime` (the axes), `g`, `n`,
/// `thickness` (mm, null for a half-space), `convention`, `model`; of phantoms also `reference` (its `mu_a`, `mu_s_prime`, mm^-1).
#[derive(Clone, Debug, PartialEq)]
pub struct Lut(pub Fixed<Table>);

impl From<Table> for Lut {
    fn from(table: Table) -> Self {
        Self(table.into())
    }
}

impl Payload for Lut {
    const NAME: &'static str = "lut";
    const KIND: ArtifactKind = ArtifactKind::Table;
    const HOLDS: &'static [Quantity] = &[
        quantity("section", "", "of a surface, where the table has several"),
        quantity("g", "1", "anisotropy of the table, where there are several beside each other"),
        quantity("n", "1", "refractive index of the table, where there are several beside each other"),
        quantity("mu_a", "mm^-1", "absorption coefficient of the node"),
        quantity("mu_s_prime", "mm^-1", "reduced scattering coefficient of the node"),
        quantity("f_x", "mm^-1", "spatial frequency"),
        quantity("r_d", "1", "diffuse reflectance, as `convention` says"),
        quantity("r_d_bound", "1", "what the solution of the model leaves uncertain; null where that is not known"),
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Table((*self.0).clone())
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(table.into()),
            other => Err(Error::failed(format!("lut must be a table, not {:?}", other.kind()))),
        }
    }
}
