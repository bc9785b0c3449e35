//! The header of an EXR file, from its bytes: what is in it, where, and how large.
//!
//! Read here and not by the library that unpacks the blocks, because sizes are to be known before anything is made of them.
//! Source: openexr.com, "OpenEXR File Layout".

use super::bounded;

/// Channels of a picture that are taken seriously.
const MOST_CHANNELS: usize = 1024;

/// Type of the samples of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    U32,
    F16,
    F32,
}

impl Sample {
    pub fn bytes(self) -> usize {
        if self == Self::F16 { 2 } else { 4 }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct ChannelInfo {
    /// As in the file: any bytes but 0.
    pub name: Vec<u8>,
    pub sample: Sample,
    pub linear: bool,
}

/// A header of a single picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    pub columns: usize,
    pub rows: usize,
    /// The first row's coordinate in the file.
    pub first_row: i32,
    pub channels: Vec<ChannelInfo>,
    /// Number of the packing, as in the file.
    pub compression: u8,
    /// Columns and rows of tiles; rows of pixels, else.
    pub tiles: Option<(usize, usize)>,
    /// Each block says which part it belongs to.
    pub numbered: bool,
    /// Where the table of blocks begins.
    pub table: usize,
}

impl Header {
    /// Bytes of a pixel, all channels.
    pub fn pixel_bytes(&self) -> usize {
        self.channels.iter().map(|c| c.sample.bytes()).sum()
    }
}

/// Reads forward; nothing lies beyond the end.
pub struct Bytes<'a> {
    bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Bytes<'a> {
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    pub fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(n).filter(|&end| end <= self.bytes.len());
        let end = end.ok_or_else(|| wrong(&format!("it ends at byte {}", self.bytes.len())))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    pub fn i32(&mut self) -> Result<i32, String> {
        Ok(i32::from_le_bytes(self.take(4)?.try_into().expect("four were taken")))
    }

    pub fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.take(8)?.try_into().expect("eight were taken")))
    }

    /// A text up to the next 0, which it may not be longer than.
    fn text(&mut self) -> Result<&'a [u8], String> {
        let rest = &self.bytes[self.at..];
        let end =
            rest.iter().take(256).position(|&b| b == 0).ok_or_else(|| wrong("a name in its header has no end"))?;
        self.at += end + 1;
        Ok(&rest[..end])
    }
}

pub fn wrong(what: &str) -> String {
    format!("it is no EXR that can be read: {what}")
}

/// The header of a file with one part.
pub fn read(bytes: &[u8]) -> Result<Header, String> {
    let mut input = Bytes::new(bytes, 4);
    let version = input.i32()?;
    if version & 0xff != 2 {
        return Err(wrong(&format!("version {}", version & 0xff)));
    }
    let flag = |bit: u32| version >> bit & 1 == 1;
    let numbered = flag(12);
    if flag(11) {
        return Err("its pixels are deep (many samples each): flatten it".to_owned());
    }
    let mut found = Fields::read(&mut input)?;
    let mut parts = 1;
    while numbered && input.bytes.get(input.at) != Some(&0) {
        Fields::read(&mut input)?;
        parts += 1;
    }
    input.at += usize::from(numbered);
    if parts > 1 {
        return Err(format!("it has {parts} parts, and a frame is one picture: save each part as a file of its own"));
    }
    let tiled = match found.kind {
        Some(b"scanlineimage") => false,
        Some(b"tiledimage") => true,
        Some(_) => return Err("its pixels are deep (many samples each): flatten it".to_owned()),
        None => flag(9),
    };
    if tiled && found.tiles.is_none() {
        return Err(wrong("its tiles have no size"));
    }
    let [x, y, x_max, y_max] = found.window.ok_or_else(|| wrong("its header has no data window"))?.map(i64::from);
    let positive = |n: i64| u64::try_from(n).unwrap_or(0);
    let (columns, rows) = bounded(positive(x_max - x + 1), positive(y_max - y + 1))?;
    let channels = found.channels.take().ok_or_else(|| wrong("its header names no channels"))?;
    let compression = found.compression.ok_or_else(|| wrong("its header does not say how it is packed"))?;
    let first_row = y as i32;
    let tiles = found.tiles.filter(|_| tiled);
    Ok(Header { columns, rows, first_row, channels, compression, tiles, numbered, table: input.at })
}

/// The attributes that matter.
#[derive(Default)]
struct Fields<'a> {
    kind: Option<&'a [u8]>,
    window: Option<[i32; 4]>,
    channels: Option<Vec<ChannelInfo>>,
    compression: Option<u8>,
    tiles: Option<(usize, usize)>,
}

impl<'a> Fields<'a> {
    fn read(input: &mut Bytes<'a>) -> Result<Self, String> {
        let mut found = Self::default();
        loop {
            let name = input.text()?;
            if name.is_empty() {
                return Ok(found);
            }
            let kind = input.text()?;
            let size = input.i32()?;
            let size = usize::try_from(size).map_err(|_| wrong("an attribute has a negative size"))?;
            let value = input.take(size)?;
            let mut inside = Bytes::new(value, 0);
            match (name, kind) {
                (b"type", b"string") => found.kind = Some(value),
                (b"dataWindow", b"box2i") => {
                    found.window = Some([inside.i32()?, inside.i32()?, inside.i32()?, inside.i32()?]);
                }
                (b"compression", b"compression") => found.compression = Some(inside.take(1)?[0]),
                (b"tiles", b"tiledesc") => {
                    let side = |n: i32| {
                        usize::try_from(n).ok().filter(|&n| n > 0).ok_or_else(|| wrong("its tiles have no size"))
                    };
                    found.tiles = Some((side(inside.i32()?)?, side(inside.i32()?)?));
                }
                (b"channels", b"chlist") => found.channels = Some(channels(&mut inside)?),
                _ => {}
            }
        }
    }
}

fn channels(input: &mut Bytes<'_>) -> Result<Vec<ChannelInfo>, String> {
    let mut found: Vec<ChannelInfo> = Vec::new();
    loop {
        let name = input.text()?;
        if name.is_empty() {
            break;
        }
        if found.len() == MOST_CHANNELS {
            return Err(format!("it has more than {MOST_CHANNELS} channels"));
        }
        let shown = String::from_utf8_lossy(name);
        let sample = match input.i32()? {
            0 => Sample::U32,
            1 => Sample::F16,
            2 => Sample::F32,
            other => return Err(wrong(&format!("its channel `{shown}` holds numbers of kind {other}"))),
        };
        let linear = input.take(4)?[0] == 1;
        if (input.i32()?, input.i32()?) != (1, 1) {
            return Err(format!("its channel `{shown}` has fewer pixels than the picture: save it in full"));
        }
        found.push(ChannelInfo { name: name.to_vec(), sample, linear });
    }
    if found.is_empty() {
        return Err(wrong("it has no channels"));
    }
    Ok(found)
}
