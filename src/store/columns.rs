//! The columns of a Parquet file, read straight into cells: a set of small results is a hundred thousand such files, and building
//! arrays for each takes longer than all the rest.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt::Display;
use std::sync::Arc;

use arrow_schema::{DataType, Schema};
use bytes::Bytes;
use parquet::arrow::{ARROW_SCHEMA_META_KEY, parquet_to_arrow_schema};
use parquet::basic::{Compression, Type};
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::{ByteArray, ByteArrayType, DataType as Physical};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, ParquetStatisticsPolicy, RowGroupMetaData};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::serialized_reader::{ReadOptionsBuilder, SerializedPageReader};
use parquet::schema::types::ColumnDescriptor;
use turbid_contract::Cells;

/// A column on its way to or from a file.
pub(super) struct RawColumn {
    pub name: String,
    /// Of its field: the unit, and what marks JSON.
    pub metadata: HashMap<String, String>,
    pub cells: Cells,
}

/// A file of which the end was read.
pub(super) struct Columns {
    file: SerializedFileReader<Bytes>,
    bytes: Arc<Bytes>,
}

thread_local! {
    /// The fields of the file that was read last, with the text that says them: those of a set are all alike.
    static FIELDS: RefCell<Option<(String, Arc<Schema>)>> = const { RefCell::new(None) };
    static ZSTD: RefCell<zstd_safe::DCtx<'static>> = RefCell::new(zstd_safe::DCtx::create());
}

impl Columns {
    pub fn open(bytes: &[u8]) -> Result<Self, String> {
        // Nobody asks what is in it before it is read.
        let skip = || ParquetStatisticsPolicy::SkipAll;
        let options = ReadOptionsBuilder::new()
            .with_column_stats_policy(skip())
            .with_size_stats_policy(skip())
            .with_encoding_stats_policy(skip())
            .build();
        let bytes = Bytes::copy_from_slice(bytes);
        let file = SerializedFileReader::new_with_options(bytes.clone(), options).map_err(text)?;
        Ok(Self { file, bytes: Arc::new(bytes) })
    }

    pub fn rows(&self) -> Result<usize, String> {
        usize::try_from(self.file.metadata().file_metadata().num_rows()).map_err(text)
    }

    fn pairs(&self) -> Option<&Vec<KeyValue>> {
        self.file.metadata().file_metadata().key_value_metadata()
    }

    /// What the file says under a key besides its columns.
    pub fn said(&self, key: &str) -> Option<&str> {
        self.pairs()?.iter().find(|pair| pair.key == key)?.value.as_deref()
    }

    /// Types and metadata of the columns.
    fn fields(&self) -> Result<Arc<Schema>, String> {
        let said = self.said(ARROW_SCHEMA_META_KEY).ok_or("it does not say what its columns hold")?;
        FIELDS.with_borrow_mut(|known| match known {
            Some((text, schema)) if text == said => Ok(schema.clone()),
            _ => {
                let types = self.file.metadata().file_metadata().schema_descr();
                let schema = Arc::new(parquet_to_arrow_schema(types, self.pairs()).map_err(text)?);
                *known = Some((said.to_owned(), schema.clone()));
                Ok(schema)
            }
        })
    }

    /// The part of a column in one group of rows.
    fn chunk(&self, group: &RowGroupMetaData, at: usize) -> parquet::errors::Result<ColumnReader> {
        let (column, rows) = (group.column(at), usize::try_from(group.num_rows())?);
        let packed = matches!(column.compression(), Compression::ZSTD(_));
        let as_it_is = column.clone().into_builder().set_compression(Compression::UNCOMPRESSED).build()?;
        let pages = SerializedPageReader::new(self.bytes.clone(), if packed { &as_it_is } else { column }, rows, None)?;
        let pages: Box<dyn PageReader> = if packed { Box::new(Unpacked { pages }) } else { Box::new(pages) };
        Ok(get_column_reader(column.column_descr_ptr(), pages))
    }

    /// All columns in their order.
    pub fn read(&self) -> Result<Vec<RawColumn>, String> {
        let (schema, rows) = (self.fields()?, self.rows()?);
        let types = self.file.metadata().file_metadata().schema_descr();
        if types.num_columns() != schema.fields().len() {
            return Err(format!("it has {} columns, and says {}", types.num_columns(), schema.fields().len()));
        }
        let groups = self.file.metadata().row_groups();
        let column = |(at, field): (usize, &Arc<arrow_schema::Field>)| {
            let name = field.name();
            if !is_of(&types.column(at), name, field.data_type(), field.is_nullable()) {
                return Err(format!("column `{name}` is not what the file says of it"));
            }
            let chunks = groups.iter().map(|group| Ok((group.num_rows(), self.chunk(group, at)?)));
            let cells = cells(chunks, field.data_type(), field.is_nullable(), rows)
                .map_err(|what| format!("column `{name}`: {what}"))?;
            let metadata = field.metadata().iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
            Ok(RawColumn { name: name.clone(), metadata, cells })
        };
        schema.fields().iter().enumerate().map(column).collect()
    }
}

/// Pages that zstd has packed. The reader of Parquet would set up zstd anew for each column, which takes longer than all that a small
/// file holds.
struct Unpacked {
    /// Of the packed bytes.
    pages: SerializedPageReader<Bytes>,
}

impl Unpacked {
    fn unpacked(page: Page) -> parquet::errors::Result<Page> {
        Ok(match page {
            Page::DataPage { buf, num_values, encoding, def_level_encoding, rep_level_encoding, statistics } => {
                let buf = unpack(&buf)?;
                Page::DataPage { buf, num_values, encoding, def_level_encoding, rep_level_encoding, statistics }
            }
            Page::DictionaryPage { buf, num_values, encoding, is_sorted } => {
                Page::DictionaryPage { buf: unpack(&buf)?, num_values, encoding, is_sorted }
            }
            // Of version 2, which no turbid wrote.
            Page::DataPageV2 { .. } => return Err(ParquetError::NYI("a page of version 2".to_owned())),
        })
    }
}

impl Iterator for Unpacked {
    type Item = parquet::errors::Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

impl PageReader for Unpacked {
    fn get_next_page(&mut self) -> parquet::errors::Result<Option<Page>> {
        self.pages.get_next_page()?.map(Self::unpacked).transpose()
    }

    fn peek_next_page(&mut self) -> parquet::errors::Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> parquet::errors::Result<()> {
        self.pages.skip_next_page()
    }
}

/// The bytes that zstd has packed, whose number it says.
fn unpack(packed: &[u8]) -> parquet::errors::Result<Bytes> {
    let wrong = || ParquetError::General("a page that zstd did not pack whole".to_owned());
    // A page without a value.
    if packed.is_empty() {
        return Ok(Bytes::new());
    }
    let size = zstd_safe::get_frame_content_size(packed).ok().flatten().ok_or_else(wrong)?;
    // No page is longer.
    let size = i32::try_from(size).ok().and_then(|size| usize::try_from(size).ok()).ok_or_else(wrong)?;
    let mut bytes = Vec::with_capacity(size);
    let done = ZSTD.with_borrow_mut(|zstd| zstd.decompress(&mut bytes, packed));
    done.map_err(|_| wrong())?;
    if bytes.len() == size { Ok(bytes.into()) } else { Err(wrong()) }
}

/// Whether a column of the file is one for such cells.
fn is_of(column: &ColumnDescriptor, name: &str, kind: &DataType, nullable: bool) -> bool {
    let physical = match kind {
        DataType::Float64 => Type::DOUBLE,
        DataType::Int64 => Type::INT64,
        DataType::Boolean => Type::BOOLEAN,
        DataType::Utf8 => Type::BYTE_ARRAY,
        _ => return false,
    };
    let flat = column.path().parts().len() == 1 && column.max_rep_level() == 0;
    flat && column.name() == name && column.physical_type() == physical && column.max_def_level() == i16::from(nullable)
}

type Chunk = parquet::errors::Result<(i64, ColumnReader)>;

/// The cells of all chunks of a column.
fn cells(chunks: impl Iterator<Item = Chunk>, kind: &DataType, nullable: bool, rows: usize) -> Result<Cells, String> {
    let (mut floats, mut wholes, mut truths, mut texts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut levels, mut known) = (Vec::new(), 0);
    for chunk in chunks {
        let (more, reader) = chunk.map_err(text)?;
        let more = usize::try_from(more).map_err(text)?;
        known += match reader {
            ColumnReader::DoubleColumnReader(reader) => take(reader, more, &mut levels, &mut floats)?,
            ColumnReader::Int64ColumnReader(reader) => take(reader, more, &mut levels, &mut wholes)?,
            ColumnReader::BoolColumnReader(reader) => take(reader, more, &mut levels, &mut truths)?,
            ColumnReader::ByteArrayColumnReader(reader) => take_text(reader, more, &mut levels, &mut texts)?,
            _ => return Err("it is of no kind that a table has".to_owned()),
        };
    }
    if known != rows {
        return Err(format!("it has {known} cells, not {rows}"));
    }
    match kind {
        DataType::Float64 if nullable => {
            let mut values = floats.into_iter();
            Ok(Cells::MaybeF64(levels.iter().map(|&level| (level > 0).then(|| values.next()).flatten()).collect()))
        }
        _ if nullable => Err("cells of this kind are never missing".to_owned()),
        DataType::Float64 => Ok(Cells::F64(floats)),
        DataType::Int64 => Ok(Cells::I64(wholes)),
        DataType::Boolean => Ok(Cells::Bool(truths)),
        _ => Ok(Cells::Text(texts)),
    }
}

/// Appends the cells of a chunk, and whether each of them is there. How many they are.
fn take<T: Physical>(
    mut reader: ColumnReaderImpl<T>,
    rows: usize,
    levels: &mut Vec<i16>,
    values: &mut Vec<T::T>,
) -> Result<usize, String> {
    Ok(reader.read_records(rows, Some(levels), None, values).map_err(text)?.0)
}

fn take_text(
    reader: ColumnReaderImpl<ByteArrayType>,
    rows: usize,
    levels: &mut Vec<i16>,
    texts: &mut Vec<String>,
) -> Result<usize, String> {
    let mut bytes: Vec<ByteArray> = Vec::new();
    let known = take(reader, rows, levels, &mut bytes)?;
    for cell in &bytes {
        texts.push(cell.as_utf8().map_err(text)?.to_owned());
    }
    Ok(known)
}

fn text(error: impl Display) -> String {
    error.to_string()
}
