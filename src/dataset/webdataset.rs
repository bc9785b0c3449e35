//! A shard for the readers of WebDataset: a tar file with `ID.json` (id, draw, group, what is drawn) and `ID.npz` (the features) of each sample.
//!
//! The same samples give the same bytes: members in the order of the samples, without times, owners or compression.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Cursor};

use crc32fast::Hasher;
use half::f16;
use rayon::prelude::*;
use serde_json::{Map, Value};
use tar::{Archive as Tar, Builder, EntryType, Header};
use turbid_contract::canonical::canonical_text;
use turbid_draw::Type;

use super::feature::Values;
use super::manifest::{ColumnOf, ShardOf};
use super::shard::{Sample, halves};
use crate::export::archive::{Archive, Kind};

/// What there is of each sample, in this order.
const MEMBERS: [&str; 2] = ["json", "npz"];

/// The file of these samples, and the checksums of its rows; as `shard::encode`.
pub fn encode(columns: &[ColumnOf], types: &[Type], samples: &[Sample]) -> Result<(Vec<u8>, String), String> {
    let (known, features) = columns.split_at(3 + types.len());
    let members = |sample: &Sample| Ok([json(known, sample).into_bytes(), npz(features, sample)?]);
    let members: Vec<[Vec<u8>; 2]> = samples.par_iter().map(members).collect::<Result<_, String>>()?;
    let mut file = Builder::new(Vec::new());
    let mut checks = String::new();
    for (sample, members) in samples.iter().zip(&members) {
        for (ending, bytes) in MEMBERS.iter().zip(members) {
            append(&mut file, &format!("{}.{ending}", Sample::id(sample.index)), bytes).map_err(|e| e.to_string())?;
        }
        checks += &check(members.each_ref().map(Vec::as_slice));
    }
    Ok((file.into_inner().map_err(|e| e.to_string())?, checks))
}

fn append(file: &mut Builder<Vec<u8>>, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut header = Header::new_ustar();
    header.set_entry_type(EntryType::Regular);
    header.set_mode(0o644);
    header.set_uid(0);
    header.set_gid(0);
    header.set_mtime(0);
    header.set_size(bytes.len() as u64);
    file.append_data(&mut header, name, bytes)
}

/// CRC-32 of the members of a sample, eight hexadecimal digits.
fn check(members: [&[u8]; 2]) -> String {
    let mut hasher = Hasher::new();
    members.iter().for_each(|bytes| hasher.update(bytes));
    format!("{:08x}", hasher.finalize())
}

/// The columns of a sample that are no features, under their names.
fn json(columns: &[ColumnOf], sample: &Sample) -> String {
    let known = [Value::from(Sample::id(sample.index)), sample.index.into(), sample.group.into()];
    let values = known.into_iter().chain(sample.draws.iter().cloned());
    let members: Map<String, Value> = columns.iter().map(|column| column.name.clone()).zip(values).collect();
    canonical_text(&Value::Object(members))
}

/// An array per feature: (channels, rows, columns), or a number without axes, NaN where it is not known.
fn npz(columns: &[ColumnOf], sample: &Sample) -> Result<Vec<u8>, String> {
    let mut archive = Archive::new(Cursor::new(Vec::new()));
    for (column, values) in columns.iter().zip(&sample.values) {
        let name = column.name.as_str();
        let added = match (values, column.shape) {
            (Values::Number(number), None) => {
                archive.add(name, Kind::F64, &[], std::iter::once(number.unwrap_or(f64::NAN).to_le_bytes()))
            }
            (Values::Tensor(values), Some(shape)) if values.len() == shape.iter().product::<usize>() => {
                if column.dtype == "float16" {
                    let values = halves(name, values)?;
                    archive.add(name, Kind::F16, &shape, values.iter().map(|value| value.to_le_bytes()))
                } else {
                    archive.add(name, Kind::F32, &shape, values.iter().map(|value| value.to_le_bytes()))
                }
            }
            _ => return Err(format!("`{name}` is not {}", column.form())),
        };
        added.map_err(|e| e.to_string())?;
    }
    archive.finish().map(Cursor::into_inner).map_err(|e| e.to_string())
}

/// What is wrong with a shard: the first thing that explains the others. `indices` are the raw indices of its rows, where the index is whole.
pub fn look(bytes: &[u8], shard: &ShardOf, columns: &[ColumnOf], indices: Option<&[u64]>) -> Option<String> {
    let members = match members(bytes) {
        Ok(members) => members,
        Err(e) => return Some(format!("it cannot be read: {e}")),
    };
    // Without the index the order of the members is all that is known of the samples.
    let listed = indices.map(|indices| indices.iter().map(|&index| Sample::id(index)).collect::<Vec<_>>());
    let ids = listed.unwrap_or_else(|| ids(&members));
    if ids.len() as u64 != shard.rows {
        return Some(format!("it has {} samples, and should have {}", ids.len(), shard.rows));
    }
    let by_name: BTreeMap<&str, &[u8]> = members.iter().map(|(name, bytes)| (name.as_str(), *bytes)).collect();
    let mut wanted = Vec::new();
    for (row, id) in ids.iter().enumerate() {
        let here = format!("row {row} (sample {id})");
        let names = MEMBERS.map(|ending| format!("{id}.{ending}"));
        if let Some(missing) = names.iter().find(|name| !by_name.contains_key(name.as_str())) {
            return Some(format!("{here}: {missing} is missing"));
        }
        let found = names.each_ref().map(|name| by_name[name.as_str()]);
        if shard.checks.get(8 * row..8 * row + 8) != Some(&check(found)) {
            let lacks = names_in(found).and_then(|names| {
                let missing = columns.iter().find(|column| !names.contains(&column.name))?;
                Some(format!("{here}: `{}` is missing; it has {}", missing.name, names.join(", ")))
            });
            return Some(lacks.unwrap_or_else(|| format!("{here}: its values were changed")));
        }
        wanted.extend(names);
    }
    let found = members.iter().map(|(name, _)| name);
    let known: BTreeSet<&String> = wanted.iter().collect();
    if let Some(other) = found.clone().find(|name| !known.contains(name)) {
        return Some(format!("{other} is of no sample of this shard"));
    }
    let moved = found.zip(&wanted).find(|(found, wanted)| found != wanted);
    moved.map(|(found, wanted)| format!("{found} stands where {wanted} should"))
}

/// What a row holds of these features. Error: the bytes are no such shard, in words.
pub fn values(bytes: &[u8], features: &[ColumnOf], row: usize) -> Result<Vec<Values>, String> {
    let members = members(bytes).map_err(|e| e.to_string())?;
    let (_, npz) = members.get(MEMBERS.len() * row + 1).ok_or_else(|| format!("there is no row {row}"))?;
    let value = |column: &ColumnOf| {
        let mut numbers = array(npz, column)?;
        Ok(match column.shape {
            None => Values::Number(numbers.pop().filter(|number| !number.is_nan())),
            Some(_) => Values::Tensor(numbers.into_iter().map(|number| number as f32).collect()),
        })
    };
    features.iter().map(value).collect()
}

/// The values of a feature that is a number; NaN where one is not known. Error: the bytes are no such shard, in words.
pub fn numbers(bytes: &[u8], feature: &ColumnOf) -> Result<Vec<f64>, String> {
    let members = members(bytes).map_err(|e| e.to_string())?;
    let archives = members.iter().filter(|(name, _)| name.ends_with(".npz"));
    archives.map(|(_, npz)| array(npz, feature)?.pop().ok_or_else(|| format!("`{}` is empty", feature.name))).collect()
}

/// The numbers of an array that [`npz`] wrote.
fn array(npz: &[u8], column: &ColumnOf) -> Result<Vec<f64>, String> {
    let wrong = |e: &dyn std::fmt::Display| format!("`{}`: {e}", column.name);
    let mut archive = zip::ZipArchive::new(Cursor::new(npz)).map_err(|e| wrong(&e))?;
    let mut bytes = Vec::new();
    let mut member = archive.by_name(&format!("{}.npy", column.name)).map_err(|e| wrong(&e))?;
    io::Read::read_to_end(&mut member, &mut bytes).map_err(|e| wrong(&e))?;
    // Magic, version, and the length of the header in two bytes.
    let header = bytes.get(8..10).map_or(0, |length| 10 + usize::from(u16::from_le_bytes([length[0], length[1]])));
    let data = bytes.get(header..).filter(|_| header > 0).ok_or_else(|| wrong(&"no array"))?;
    Ok(match (column.dtype.as_str(), column.shape) {
        ("float16", Some(_)) => data.as_chunks().0.iter().map(|&bytes| f64::from(f16::from_le_bytes(bytes))).collect(),
        (_, Some(_)) => data.as_chunks().0.iter().map(|&bytes| f64::from(f32::from_le_bytes(bytes))).collect(),
        (_, None) => data.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes)).collect(),
    })
}

/// Name and bytes of each member.
fn members(bytes: &[u8]) -> io::Result<Vec<(String, &[u8])>> {
    let mut members = Vec::new();
    for entry in Tar::new(bytes).entries()? {
        let entry = entry?;
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let begin = usize::try_from(entry.raw_file_position()).unwrap_or(usize::MAX);
        let end = begin.saturating_add(usize::try_from(entry.size()).unwrap_or(usize::MAX));
        let found = bytes.get(begin..end).ok_or_else(|| io::Error::other(format!("{name} is cut off")))?;
        members.push((name, found));
    }
    Ok(members)
}

/// Samples in the order of their first members.
fn ids(members: &[(String, &[u8])]) -> Vec<String> {
    let mut ids: Vec<String> = Vec::new();
    for (name, _) in members {
        let id = name.split('.').next().unwrap_or_default();
        if !ids.iter().any(|known| known == id) {
            ids.push(id.to_owned());
        }
    }
    ids
}

/// Names of what the members of a sample hold; none where they cannot be read.
fn names_in([json, npz]: [&[u8]; 2]) -> Option<Vec<String>> {
    let known: Map<String, Value> = serde_json::from_slice(json).ok()?;
    let archive = zip::ZipArchive::new(Cursor::new(npz)).ok()?;
    let arrays = archive.file_names().map(|name| name.trim_end_matches(".npy").to_owned());
    Some(known.into_iter().map(|(name, _)| name).chain(arrays).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, dtype: &str, shape: Option<[usize; 3]>) -> ColumnOf {
        ColumnOf {
            name: name.to_owned(),
            dtype: dtype.to_owned(),
            shape,
            unit: String::new(),
            channels: Vec::new(),
            pixel_mm: None,
            about: String::new(),
        }
    }

    /// Half precision, a number that is not known, and a group that there is not.
    #[test]
    fn what_is_not_known_stays_so() {
        let known = [("id", "string"), ("draw", "int64"), ("group", "int64"), ("kind", "string")];
        let mut columns: Vec<ColumnOf> = known.map(|(name, dtype)| column(name, dtype, None)).into();
        columns.push(column("map", "float16", Some([1, 1, 3])));
        columns.push(column("rmse", "float64", None));
        let sample = |number| Sample {
            index: 12,
            group: None,
            draws: vec!["box".into()],
            values: vec![Values::Tensor(vec![0.5, f32::NAN, -2.0]), Values::Number(number)],
        };
        let (bytes, checks) = encode(&columns, &[Type::Text], &[sample(None)]).unwrap();
        let found = members(&bytes).unwrap();
        assert_eq!(found.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["00000012.json", "00000012.npz"]);
        assert_eq!(found[0].1, br#"{"draw":12,"group":null,"id":"00000012","kind":"box"}"#);
        let mut archive = zip::ZipArchive::new(Cursor::new(found[1].1)).unwrap();
        let mut array = |name: &str| {
            let mut bytes = Vec::new();
            io::Read::read_to_end(&mut archive.by_name(name).unwrap(), &mut bytes).unwrap();
            bytes.split_off(128)
        };
        let halves = array("map.npy");
        assert_eq!((&halves[..2], &halves[4..]), (&[0x00, 0x38][..], &[0x00, 0xc0][..]), "0.5 and -2");
        assert!(f16::from_le_bytes([halves[2], halves[3]]).is_nan());
        assert!(f64::from_le_bytes(array("rmse.npy").try_into().unwrap()).is_nan());

        let shard = |rows| ShardOf {
            file: String::new(),
            split: String::new(),
            number: 0,
            rows,
            bytes: 0,
            sha256: String::new(),
            checks: checks.clone(),
            key: String::new(),
            moments: String::new(),
        };
        assert_eq!(look(&bytes, &shard(1), &columns, Some(&[12])), None);
        assert_eq!(look(&bytes, &shard(1), &columns, None), None);
        let read = values(&bytes, &columns[4..], 0).unwrap();
        assert!(matches!(&read[0], Values::Tensor(x) if x[0] == 0.5 && x[1].is_nan() && x[2] == -2.0), "{read:?}");
        assert!(matches!(read[1], Values::Number(None)));
        assert!(numbers(&bytes, &columns[5]).unwrap()[0].is_nan());
        assert!(look(&bytes, &shard(2), &columns, None).is_some_and(|said| said.contains("1 samples")));
        // Every byte of a member or of its header counts; a file that ends early breaks nothing.
        let place = |member: &[u8]| member.as_ptr() as usize - bytes.as_ptr() as usize;
        let counts = found.iter().flat_map(|(_, member)| place(member) - 512..place(member) + member.len());
        for at in counts {
            let mut other = bytes.clone();
            other[at] ^= 0x11;
            assert!(look(&other, &shard(1), &columns, Some(&[12])).is_some(), "byte {at}");
            assert!(look(&bytes[..at], &shard(1), &columns, None).is_some(), "{at} bytes");
        }
        let (other, _) = encode(&columns, &[Type::Text], &[sample(Some(1.0))]).unwrap();
        let said = look(&other, &shard(1), &columns, Some(&[12])).unwrap();
        assert_eq!(said, "row 0 (sample 00000012): its values were changed");

        let tensor =
            |value| Sample { values: vec![Values::Tensor(vec![value; 3]), Values::Number(None)], ..sample(None) };
        assert!(encode(&columns, &[Type::Text], &[tensor(1e-6)]).unwrap_err().contains("dtype: float32"));
        let short = Sample { values: vec![Values::Tensor(vec![0.0]), Values::Number(None)], ..sample(None) };
        assert!(encode(&columns, &[Type::Text], &[short]).unwrap_err().contains("`map` is not"));
    }
}
