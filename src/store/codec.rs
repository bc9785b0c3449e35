//! Artifacts to bytes and back; the same artifact gives the same bytes, whatever the thread or the process.

use turbid_contract::{Artifact, ArtifactKind};

use crate::store::error::StoreError;
use crate::store::{exr, parquet};

/// Encodes an artifact: image stacks as EXR, tables and records as Parquet.
///
/// Error: [`StoreError::Unfit`] where a value is not finite, or where there is no layer.
pub fn encode(artifact: &Artifact) -> Result<Vec<u8>, StoreError> {
    match artifact {
        Artifact::Images(stack) => exr::encode(stack),
        Artifact::Table(table) => parquet::encode_table(table),
        Artifact::Record(record) => parquet::encode_record(record),
    }
}

/// Decodes what [`encode`] wrote. Error: [`StoreError::Unfit`] where the bytes are of another kind.
pub fn decode(kind: ArtifactKind, bytes: &[u8]) -> Result<Artifact, StoreError> {
    Ok(match kind {
        ArtifactKind::Images => Artifact::Images(exr::decode(bytes)?),
        ArtifactKind::Table => Artifact::Table(parquet::decode_table(bytes)?),
        ArtifactKind::Record => Artifact::Record(parquet::decode_record(bytes)?),
    })
}
