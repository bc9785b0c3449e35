//! Artifacts to bytes and back; the same artifact gives the same bytes, whatever the thread or the process.

use turbid_contract::{Artifact, ArtifactKind, Table, guard};

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

/// Encodes a table that comes in pieces with the same columns: of a long one no two pieces are held at once.
///
/// Error: [`StoreError::Unfit`] where a value is not finite, or where there is no piece.
pub fn encode_pieces(pieces: impl Iterator<Item = Table>) -> Result<Vec<u8>, StoreError> {
    parquet::encode_pieces(pieces)
}

/// Decodes what [`encode`] wrote. Error: [`StoreError::Unfit`] where the bytes are of another kind, or nothing that was encoded.
pub fn decode(kind: ArtifactKind, bytes: &[u8]) -> Result<Artifact, StoreError> {
    let decode = || {
        Ok(match kind {
            ArtifactKind::Images => Artifact::Images(exr::decode(bytes)?),
            ArtifactKind::Table => Artifact::Table(parquet::decode_table(bytes)?),
            ArtifactKind::Record => Artifact::Record(parquet::decode_record(bytes)?),
        })
    };
    // The library that reads Parquet panics at some files that nobody wrote (a dictionary that is not there, a negative offset).
    guard::guarded(|| Ok(decode())).unwrap_or_else(|text| Err(StoreError::unfit(text)))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use turbid_contract::ndarray::Array2;
    use turbid_contract::{Attributes, Cells, ImageStack, LayerInfo, LayerKind, Record};

    use super::*;
    use crate::digest::Digest;

    fn attributes() -> Attributes {
        Attributes::from([
            ("g".to_owned(), json!(0.1 + 0.2)),
            ("Gewebe µ 𝛼 \" \\ \u{1}".to_owned(), json!({"λ": ["ü", null, true, -1, 1e300, 5e-324, u64::MAX]})),
        ])
    }

    fn stack(rows: usize, columns: usize) -> ImageStack {
        let mut stack = ImageStack::new(rows, columns);
        let pixel = |scale: f32| Array2::from_shape_fn((rows, columns), |(r, c)| scale * (r * columns + c) as f32);
        stack.push(LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(0.1), pixel(0.1));
        stack.push(LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(0.1), pixel(f32::MIN_POSITIVE / 4.0));
        let mut rich = LayerInfo::new("Phase φ/2 \u{0}", LayerKind::Covariance, "1");
        (rich.f_x_per_mm, rich.phase_rad, rich.orientation_deg) = (Some(1.0 / 3.0), Some(2.0 / 3.0), Some(-1e-300));
        (rich.wavelength_nm, rich.pair, rich.mean_se) = (Some(1e300), Some([0, u32::MAX]), Some(5e-324));
        stack.push(rich, pixel(-f32::MAX / 1e6));
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), pixel(0.0));
        stack.push(LayerInfo::new("", LayerKind::Value, ""), pixel(-0.0));
        stack.attributes = attributes();
        stack
    }

    fn table(rows: usize) -> Table {
        let mut table = Table { attributes: attributes(), ..Table::default() };
        table.push("mu_a", "mm^-1", Cells::F64((0..rows).map(|i| i as f64 / 3.0).collect()));
        table.push("µ count", "1", Cells::I64((0..rows).map(|i| i64::MIN + i as i64).collect()));
        table.push("good", "1", Cells::Bool((0..rows).map(|i| i % 3 == 0).collect()));
        table.push("name", "", Cells::Text((0..rows).map(|i| format!("Gewebe µ {i}")).collect()));
        table
    }

    fn record() -> Record {
        let fields = [
            ("a number", json!(0.1 + 0.2)),
            ("whole", json!(-3)),
            ("whole float", json!(3.0)),
            ("largest", json!(u64::MAX)),
            ("flag", json!(false)),
            ("text", json!("{\"not\": \"parsed\"} µ")),
            ("nothing", Value::Null),
            ("list", json!([])),
            ("nested µ", json!({"b": [1.0, 2, {"c": "d"}], "a": 5e-324})),
            ("", json!("no name")),
        ];
        Record { fields: fields.into_iter().map(|(name, value)| (name.to_owned(), value)).collect() }
    }

    fn all() -> Vec<Artifact> {
        let mut many = ImageStack::new(1, 1);
        for i in 0..2000 {
            many.push(LayerInfo::value("cov", "1").with_f_x(f64::from(i)), Array2::from_elem((1, 1), i as f32));
        }
        // More than a row group.
        let mut long = Table::default();
        long.push("x", "mm", Cells::F64((0..70_000).map(f64::from).collect()));
        vec![
            Artifact::Images(stack(1, 1)),
            Artifact::Images(stack(3, 5)),
            Artifact::Images(stack(64, 33)),
            Artifact::Images(many),
            Artifact::Table(table(0)),
            Artifact::Table(table(1)),
            Artifact::Table(long),
            Artifact::Table(Table::default()),
            Artifact::Table(table_with_unknowns()),
            Artifact::Record(record()),
            Artifact::Record(Record::default()),
        ]
    }

    /// A column that knows some, all or none of its numbers stays one that may be unknown.
    fn table_with_unknowns() -> Table {
        let mut table = Table::default();
        table.push("some", "%", Cells::MaybeF64(vec![Some(-0.0), None, Some(5e-324)]));
        table.push("all", "%", Cells::MaybeF64(vec![Some(1.0); 3]));
        table.push("none", "%", Cells::MaybeF64(vec![None; 3]));
        table
    }

    /// Every bit of every number and name comes back.
    #[test]
    fn what_is_encoded_is_decoded() {
        for artifact in all() {
            let bytes = encode(&artifact).unwrap();
            let again = decode(artifact.kind(), &bytes).unwrap();
            assert!(again == artifact, "{:?}", artifact.kind());
            // Equality of floats does not see the sign of zero, equality of encodings does.
            assert!(encode(&again).unwrap() == bytes, "{:?}", artifact.kind());
        }
    }

    #[test]
    fn threads_and_repetition_do_not_show_in_the_bytes() {
        for artifact in all() {
            let first = encode(&artifact).unwrap();
            std::thread::scope(|scope| {
                let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| encode(&artifact).unwrap())).collect();
                assert!(threads.into_iter().all(|t| t.join().expect("no panic") == first), "{:?}", artifact.kind());
            });
        }
    }

    /// A change here makes every stored result unreachable from its digest: it needs a raised store format, or an
    /// encoder that is set back to what it wrote before.
    #[test]
    fn golden_bytes() {
        let digest = |artifact| Digest::of(&encode(&artifact).unwrap()).short();
        let found = [Artifact::Images(stack(3, 5)), Artifact::Table(table(5)), Artifact::Record(record())].map(digest);
        assert_eq!(found, ["976454f7d27c", "bd52f7fab0c1", "2c6690db458b"]);
    }

    #[test]
    fn what_is_not_finite_is_named() {
        for (value, text) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (f32::NEG_INFINITY, "-inf")] {
            let mut stack = stack(3, 5);
            stack.layers[1].data[(2, 4)] = value;
            let message = encode(&Artifact::Images(stack)).unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("layer 1 `m_ac` has the value {text} at row 2, column 4")),
                "{message}"
            );
            let mut table = table(5);
            table.columns[0].cells = Cells::F64(vec![0.0, 0.0, 0.0, f64::from(value), 0.0]);
            let message = encode(&Artifact::Table(table.clone())).unwrap_err().to_string();
            assert!(message.starts_with(&format!("column `mu_a` has the value {text} in row 3")), "{message}");
            table.columns[0].cells = Cells::MaybeF64(vec![None, None, None, Some(f64::from(value)), None]);
            let message = encode(&Artifact::Table(table)).unwrap_err().to_string();
            assert!(message.starts_with(&format!("column `mu_a` has the value {text} in row 3")), "{message}");
        }
        let message = encode(&Artifact::Images(ImageStack::new(1, 1))).unwrap_err().to_string();
        assert!(message.contains("without layers"), "{message}");
    }

    /// Whatever byte is wrong, decoding ends without a panic, with an error or with an artifact that can be encoded.
    #[test]
    fn no_byte_makes_it_panic() {
        for artifact in [Artifact::Images(stack(2, 2)), Artifact::Table(table(2)), Artifact::Record(record())] {
            let bytes = encode(&artifact).unwrap();
            for at in 0..bytes.len() {
                let mut wrong = bytes.clone();
                wrong[at] = !wrong[at];
                if let Ok(decoded) = decode(artifact.kind(), &wrong) {
                    let _ = encode(&decoded);
                }
            }
        }
    }

    /// Bytes of one kind are not taken for another, and what is no file at all is an error, not a panic.
    #[test]
    fn foreign_bytes_are_refused() {
        let artifacts = [Artifact::Images(stack(3, 5)), Artifact::Table(table(5)), Artifact::Record(record())];
        for artifact in &artifacts {
            let bytes = encode(artifact).unwrap();
            for other in artifacts.iter().map(Artifact::kind).filter(|kind| *kind != artifact.kind()) {
                assert!(decode(other, &bytes).is_err(), "{:?} as {other:?}", artifact.kind());
            }
            for n in [0, 1, 4, 8, bytes.len() / 2, bytes.len() - 1] {
                assert!(decode(artifact.kind(), &bytes[..n]).is_err(), "{:?} cut to {n}", artifact.kind());
            }
        }
    }
}
