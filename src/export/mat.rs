//! MATLAB 5 MAT-files, uncompressed: `load` gives matrices, structures and texts.

use serde_json::Value;
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Artifact, Cells, ImageStack, LayerInfo, Table};

use super::heads::Stacked;
use super::names::Names;
use super::{TooLarge, json};

/// Data types of elements.
const INT8: u32 = 1;
const UINT8: u32 = 2;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const SINGLE: u32 = 7;
const DOUBLE: u32 = 9;
const INT64: u32 = 12;
const MATRIX: u32 = 14;
const UTF8: u32 = 16;

/// Room for a field's name in a structure, with its closing zero.
const FIELD: usize = 64;

/// Images: `images` (single, row x column x layer), `layers` (structure array), `attributes` (structure), `pixel_pitch_mm` (row vector: along
/// a row, along a column) where it is known.
/// Tables: a column vector (or cell array of texts) per column, `units`, `attributes`. Records: a variable per field.
pub fn encode(artifact: &Artifact) -> Result<Vec<u8>, TooLarge> {
    file(variables(artifact))
}

/// Image stacks of many instances: `images` (single, row x column x layer x instance), `layers` (structure array, 1 x layer, or instance x
/// layer where they differ), `mean_se` (instance x layer), `axes` (structure of columns), `instances` (the first and the last, from 1),
/// `attributes` (structure, or a cell array of them where they differ), `pixel_pitch_mm` (a row, or a row for each).
pub(super) fn encode_stacked(stacks: &Stacked) -> Result<Vec<u8>, TooLarge> {
    let (heads, [layer_count, rows, columns]) = (&stacks.heads, stacks.heads.shape());
    let n = heads.values.len();
    let images = Content::Numbers { class: 7, kind: SINGLE, logical: false, data: stacks.pixels.clone() };
    let same = heads.same_layers();
    let infos = if same { &heads.layers[..1] } else { &heads.layers[..] };
    // Down the columns: all instances of a layer, then of the next.
    let infos = (0..layer_count).flat_map(|k| infos.iter().map(move |layers| &layers[k]));
    let layers = structures(vec![if same { 1 } else { n }, layer_count], infos);
    let mean_se = (0..layer_count).flat_map(|k| heads.mean_se.iter().map(move |of| of[k]));
    let mut names = Names::default();
    let (fields, values) = heads.axes().iter().map(|(axis, cells)| (names.matlab(axis), Array::column(cells))).unzip();
    let attributes = match heads.same_attributes() {
        true => Array::of(&json(&heads.attributes[0])),
        false => Array::cells([n, 1], heads.attributes.iter().map(|own| Array::of(&json(own)))),
    };
    let first = stacks.first as f64;
    let mut out = vec![
        ("images".into(), Array { dims: vec![rows, columns, layer_count, n], content: images }),
        ("layers".into(), layers),
        ("mean_se".into(), Array::doubles([n, layer_count], mean_se)),
        ("axes".into(), Array { dims: vec![1, 1], content: Content::Structure { fields, values } }),
        ("instances".into(), Array::doubles([1, 2], [first + 1.0, first + n as f64].into_iter())),
        ("attributes".into(), attributes),
    ];
    if let Some(pitches) = heads.pitches() {
        let down = (0..2).flat_map(|k| pitches.iter().map(move |pitch| pitch[k]));
        out.push((PIXEL_PITCH_MM.into(), Array::doubles([pitches.len(), 2], down)));
    }
    file(out)
}

fn file(variables: Vec<(String, Array)>) -> Result<Vec<u8>, TooLarge> {
    let mut out = format!("{:<116}", "MATLAB 5.0 MAT-file, written by turbid").into_bytes();
    // No subsystem data; version 1.0; "IM" tells little-endian readers that nothing needs swapping.
    out.extend([0; 8]);
    out.extend(b"\x00\x01IM");
    for (name, array) in variables {
        array.write(&name, &mut out)?;
    }
    Ok(out)
}

fn variables(artifact: &Artifact) -> Vec<(String, Array)> {
    match artifact {
        Artifact::Images(stack) => {
            let pitch = stack.pixel_pitch_mm();
            let pitch = pitch.map(|pitch| (PIXEL_PITCH_MM.into(), Array::doubles([1, 2], pitch.into_iter())));
            let mut out = vec![
                ("images".into(), images(stack)),
                ("layers".into(), layers(stack)),
                ("attributes".into(), Array::of(&json(&stack.attributes))),
            ];
            out.extend(pitch);
            out
        }
        Artifact::Table(table) => table_variables(table),
        Artifact::Record(record) => {
            let mut names = Names::default();
            record.fields.iter().map(|(field, value)| (names.matlab(field), Array::of(value))).collect()
        }
    }
}

fn images(stack: &ImageStack) -> Array {
    let mut data = Vec::with_capacity(4 * stack.layers.len() * stack.rows() * stack.columns());
    for layer in &stack.layers {
        // MATLAB counts down the columns.
        data.extend(layer.data.t().iter().flat_map(|v| v.to_le_bytes()));
    }
    let dims = vec![stack.rows(), stack.columns(), stack.layers.len()];
    Array { dims, content: Content::Numbers { class: 7, kind: SINGLE, logical: false, data } }
}

/// A structure array with every field of a layer's description; what a layer does not say is `[]`.
fn layers(stack: &ImageStack) -> Array {
    structures(vec![1, stack.layers.len()], stack.layers.iter().map(|layer| &layer.info))
}

fn structures<'a>(dims: Vec<usize>, infos: impl Iterator<Item = &'a LayerInfo>) -> Array {
    let full = LayerInfo {
        f_x_per_mm: Some(0.0),
        phase_rad: Some(0.0),
        orientation_deg: Some(0.0),
        wavelength_nm: Some(0.0),
        pair: Some([0; 2]),
        mean_se: Some(0.0),
        ..LayerInfo::value("", "")
    };
    let Value::Object(fields) = json(&full) else { unreachable!("a structure becomes an object") };
    let fields: Vec<String> = fields.into_iter().map(|(name, _)| name).collect();
    let values = infos
        .map(json)
        .flat_map(|info| fields.iter().map(|f| Array::of(&info[f.as_str()])).collect::<Vec<_>>())
        .collect();
    Array { dims, content: Content::Structure { fields, values } }
}

fn table_variables(table: &Table) -> Vec<(String, Array)> {
    let mut names = Names::default();
    let mut out: Vec<(String, Array)> = Vec::new();
    for column in &table.columns {
        out.push((names.matlab(&column.name), Array::column(&column.cells)));
    }
    let units = out.iter().zip(&table.columns).map(|((name, _), c)| (name.clone(), Array::text(&c.unit))).unzip();
    let (fields, values): (Vec<String>, Vec<Array>) = units;
    out.push((names.matlab("units"), Array { dims: vec![1, 1], content: Content::Structure { fields, values } }));
    out.push((names.matlab("attributes"), Array::of(&json(&table.attributes))));
    out
}

/// A MATLAB array.
struct Array {
    /// At least two.
    dims: Vec<usize>,
    content: Content,
}

enum Content {
    /// Little-endian numbers, down the columns.
    Numbers {
        class: u32,
        kind: u32,
        logical: bool,
        data: Vec<u8>,
    },
    /// One row.
    Text(String),
    Cells(Vec<Array>),
    /// All fields of the first structure, then of the next.
    Structure {
        fields: Vec<String>,
        values: Vec<Array>,
    },
}

impl Array {
    fn doubles(dims: [usize; 2], values: impl Iterator<Item = f64>) -> Self {
        let data = values.flat_map(f64::to_le_bytes).collect();
        Self { dims: dims.to_vec(), content: Content::Numbers { class: 6, kind: DOUBLE, logical: false, data } }
    }

    fn logicals(dims: [usize; 2], values: impl Iterator<Item = bool>) -> Self {
        let data = values.map(u8::from).collect();
        Self { dims: dims.to_vec(), content: Content::Numbers { class: 9, kind: UINT8, logical: true, data } }
    }

    fn text(text: &str) -> Self {
        // MATLAB counts UTF-16 units; texts without letters are 0 x 0 there.
        let letters = text.encode_utf16().count();
        Self { dims: vec![usize::from(letters > 0), letters], content: Content::Text(text.to_owned()) }
    }

    fn cells(dims: [usize; 2], items: impl Iterator<Item = Self>) -> Self {
        Self { dims: dims.to_vec(), content: Content::Cells(items.collect()) }
    }

    fn column(cells: &Cells) -> Self {
        let dims = [cells.len(), 1];
        match cells {
            Cells::F64(v) => Self::doubles(dims, v.iter().copied()),
            // MATLAB has no null: NaN is what `omitnan` reads as unknown.
            Cells::MaybeF64(v) => Self::doubles(dims, v.iter().map(|x| x.unwrap_or(f64::NAN))),
            Cells::I64(v) => {
                let data = v.iter().flat_map(|x| x.to_le_bytes()).collect();
                Self { dims: dims.to_vec(), content: Content::Numbers { class: 14, kind: INT64, logical: false, data } }
            }
            Cells::Bool(v) => Self::logicals(dims, v.iter().copied()),
            Cells::Text(v) => Self::cells(dims, v.iter().map(|t| Self::text(t))),
        }
    }

    /// JSON as MATLAB would hold it: lists of numbers are row vectors, other lists cell arrays, `null` is `[]`.
    fn of(value: &Value) -> Self {
        match value {
            Value::Null => Self::doubles([0, 0], std::iter::empty()),
            Value::Bool(b) => Self::logicals([1, 1], std::iter::once(*b)),
            Value::Number(n) => Self::doubles([1, 1], n.as_f64().into_iter()),
            Value::String(text) => Self::text(text),
            Value::Array(items) if items.iter().all(Value::is_number) => {
                Self::doubles([1, items.len()], items.iter().filter_map(Value::as_f64))
            }
            Value::Array(items) => Self::cells([1, items.len()], items.iter().map(Self::of)),
            Value::Object(map) => {
                let mut names = Names::default();
                let (fields, values) = map.iter().map(|(name, v)| (names.matlab(name), Self::of(v))).unzip();
                Self { dims: vec![1, 1], content: Content::Structure { fields, values } }
            }
        }
    }

    fn write(&self, name: &str, out: &mut Vec<u8>) -> Result<(), TooLarge> {
        let (class, logical) = match &self.content {
            Content::Cells(_) => (1, false),
            Content::Structure { .. } => (2, false),
            Content::Text(_) => (4, false),
            Content::Numbers { class, logical, .. } => (*class, *logical),
        };
        let mut body = Vec::new();
        let flags = [class | if logical { 0x200 } else { 0 }, 0];
        element(UINT32, &flags.map(u32::to_le_bytes).concat(), &mut body)?;
        let dims: Result<Vec<[u8; 4]>, TooLarge> =
            self.dims.iter().map(|&n| size_u32(n).map(u32::to_le_bytes)).collect();
        element(INT32, &dims?.concat(), &mut body)?;
        element(INT8, name.as_bytes(), &mut body)?;
        match &self.content {
            Content::Numbers { kind, data, .. } => element(*kind, data, &mut body)?,
            Content::Text(text) => element(UTF8, text.as_bytes(), &mut body)?,
            Content::Cells(items) => items.iter().try_for_each(|item| item.write("", &mut body))?,
            Content::Structure { fields, values } => {
                element(INT32, &(FIELD as u32).to_le_bytes(), &mut body)?;
                let padded = fields.iter().flat_map(|f| f.bytes().chain(std::iter::repeat(0)).take(FIELD));
                element(INT8, &padded.collect::<Vec<u8>>(), &mut body)?;
                values.iter().try_for_each(|value| value.write("", &mut body))?;
            }
        }
        out.extend(MATRIX.to_le_bytes());
        out.extend(size_u32(body.len())?.to_le_bytes());
        out.append(&mut body);
        Ok(())
    }
}

/// Sizes in these files are 32-bit numbers.
fn size_u32(bytes: usize) -> Result<u32, TooLarge> {
    u32::try_from(bytes).map_err(|_| TooLarge)
}

/// Type, size, data, padded to 8 bytes; up to 4 bytes stand inside the tag, as the format wants it.
fn element(kind: u32, data: &[u8], out: &mut Vec<u8>) -> Result<(), TooLarge> {
    let size = size_u32(data.len())?;
    if (1..=4).contains(&size) {
        out.extend((kind | size << 16).to_le_bytes());
        out.extend(data);
    } else {
        out.extend(kind.to_le_bytes());
        out.extend(size.to_le_bytes());
        out.extend(data);
    }
    out.resize(out.len().next_multiple_of(8), 0);
    Ok(())
}
