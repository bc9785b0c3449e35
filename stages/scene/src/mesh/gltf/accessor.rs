//! Numbers in the buffers of a glTF file: all bounds are known before the first is read.

use super::document::{Accessor, Document, Index, Kind, Whole};

/// A buffer's bytes, or those of the `.glb`.
pub type Buffers<'a> = [std::borrow::Cow<'a, [u8]>];

/// The elements of an accessor.
pub struct Elements<'a> {
    pub count: usize,
    /// `None`: all are 0.
    plain: Option<Run<'a>>,
    /// In ascending order.
    sparse: Option<(Run<'a>, Run<'a>)>,
}

/// Elements at equal distances in a buffer.
struct Run<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: Component,
    count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(Whole(code): Whole) -> Result<Self, String> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => {
                let rule = "it must be 5120 (byte), 5121, 5122 (short), 5123, 5125 (unsigned int) or 5126 (float)";
                return Err(format!("componentType {code} is not known: {rule}"));
            }
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

impl<'a> Elements<'a> {
    /// Those of accessor `i`, which must be of a kind: positions, or indices.
    pub fn of(document: &Document<'_>, buffers: &'a Buffers<'a>, Index(i): Index, kind: Kind) -> Result<Self, String> {
        let there = document.accessors.0.len();
        let accessor = document
            .accessors
            .0
            .get(i as usize)
            .ok_or_else(|| format!("accessor {i} is named, but there are only {there} (from 0)"))?;
        elements(document, buffers, accessor, kind).map_err(|what| format!("accessor {i}: {what}"))
    }

    /// The numbers of an element, as many as its kind has.
    pub fn get<const N: usize>(&self, k: usize) -> [f64; N] {
        if let Some((indices, values)) = &self.sparse
            && let Some(listed) = indices.find(k)
        {
            return values.get(listed);
        }
        self.plain.as_ref().map_or([0.0; N], |run| run.get(k))
    }
}

fn elements<'a>(
    document: &Document<'_>,
    buffers: &'a Buffers<'a>,
    accessor: &Accessor,
    kind: Kind,
) -> Result<Elements<'a>, String> {
    if accessor.kind != kind {
        let wanted = if kind == Kind::Vec3 { "VEC3" } else { "SCALAR" };
        return Err(format!("its type is not {wanted}"));
    }
    if accessor.normalized {
        return Err("its numbers are normalized; export without quantization".to_owned());
    }
    let component = Component::of(accessor.component_type)?;
    let whole = matches!(component, Component::U8 | Component::U16 | Component::U32);
    if kind == Kind::Scalar && !whole {
        return Err("indices must be of unsigned numbers: componentType 5121, 5123 or 5125".to_owned());
    }
    let Whole(n) = accessor.count;
    let count = usize::try_from(n).map_err(|_| format!("count {n} is beyond what a file can hold"))?;
    if count == 0 {
        return Err("count is 0: it must be >= 1".to_owned());
    }
    let width = if kind == Kind::Vec3 { 3 } else { 1 };
    let plain = accessor
        .buffer_view
        .map(|view| Run::of(document, buffers, view, accessor.byte_offset, component, width, count))
        .transpose()?;
    let sparse = accessor.sparse.as_deref().map(|sparse| {
        let Whole(n) = sparse.count;
        let listed = usize::try_from(n).ok().filter(|&listed| listed <= count);
        let listed = listed.ok_or_else(|| format!("sparse.count {n} must be <= its count {count}"))?;
        let (at, values) = (&sparse.indices, &sparse.values);
        let kind = Component::of(at.component_type)?;
        let indices = Run::of(document, buffers, at.buffer_view, at.byte_offset, kind, 1, listed)?;
        let values = Run::of(document, buffers, values.buffer_view, values.byte_offset, component, width, listed)?;
        // They are looked up by halving: that is right only where they ascend.
        let place = |k: usize| indices.get::<1>(k)[0];
        if let Some(k) = (0..listed).find(|&k| place(k) >= count as f64 || (k > 0 && place(k) <= place(k - 1))) {
            return Err(format!("sparse index {k} is {}: they must ascend and be below {count}", place(k)));
        }
        Ok((indices, values))
    });
    let sparse = sparse.transpose()?;
    if plain.is_none() && sparse.is_none() {
        return Err("it has no bufferView, so no data".to_owned());
    }
    Ok(Elements { count, plain, sparse })
}

impl<'a> Run<'a> {
    /// `count` elements of `width` numbers from `offset` on in a view. Where they begin need not be a multiple of their size: they are copied.
    fn of(
        document: &Document<'_>,
        buffers: &'a Buffers<'a>,
        Index(view): Index,
        Whole(offset): Whole,
        component: Component,
        width: usize,
        count: usize,
    ) -> Result<Self, String> {
        let (bytes, stride) =
            self::view(document, buffers, view as usize).map_err(|what| format!("bufferView {view}: {what}"))?;
        let element = component.size() * width;
        let stride = match stride {
            None => element,
            Some(Whole(stride)) => {
                let rule =
                    || format!("bufferView {view}: byteStride {stride} must be >= the {element} bytes of an element");
                usize::try_from(stride).ok().filter(|&s| s >= element).ok_or_else(rule)?
            }
        };
        let offset_there = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..));
        // The last element ends before its stride does.
        let needed = count.checked_sub(1).map_or(Some(0), |steps| steps.checked_mul(stride)?.checked_add(element));
        match offset_there {
            Some(bytes) if needed.is_some_and(|needed| needed <= bytes.len()) => {
                Ok(Self { bytes, stride, component, count })
            }
            _ => Err(format!(
                "{count} elements of {element} bytes, {stride} apart from byte {offset} on, reach beyond the {} bytes of bufferView {view}: it is torn",
                bytes.len()
            )),
        }
    }

    fn get<const N: usize>(&self, k: usize) -> [f64; N] {
        std::array::from_fn(|c| {
            let size = self.component.size();
            let at = k * self.stride + c * size;
            let mut four = [0; 4];
            four[..size].copy_from_slice(&self.bytes[at..at + size]);
            let bits = u32::from_le_bytes(four);
            match self.component {
                Component::I8 => f64::from(bits as u8 as i8),
                Component::I16 => f64::from(bits as u16 as i16),
                Component::F32 => f64::from(f32::from_bits(bits)),
                Component::U8 | Component::U16 | Component::U32 => f64::from(bits),
            }
        })
    }

    /// Where `value` stands among ascending numbers.
    fn find(&self, value: usize) -> Option<usize> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low.midpoint(high);
            if self.get::<1>(middle)[0] < value as f64 { low = middle + 1 } else { high = middle }
        }
        (low < self.count && self.get::<1>(low)[0] == value as f64).then_some(low)
    }
}

/// The bytes of a view, and the distance of its elements where it says one.
fn view<'a>(document: &Document<'_>, buffers: &'a Buffers<'a>, i: usize) -> Result<(&'a [u8], Option<Whole>), String> {
    let views = &document.views.0;
    let view = views.get(i).ok_or_else(|| format!("it is named, but there are only {} (from 0)", views.len()))?;
    if view.extensions.meshopt.is_some() {
        return Err("it is compressed (meshopt); export it without compression".to_owned());
    }
    let Index(b) = view.buffer;
    let buffer = buffers.get(b as usize);
    let buffer = buffer.ok_or_else(|| format!("it names buffer {b}, but there are only {} (from 0)", buffers.len()))?;
    let (Whole(offset), Whole(length)) = (view.byte_offset, view.byte_length);
    let place = |x: u64| usize::try_from(x).ok();
    let range = place(offset).and_then(|from| Some(from..from.checked_add(place(length)?)?));
    let bytes = range.and_then(|range| buffer.get(range)).ok_or_else(|| {
        format!(
            "its {length} bytes from byte {offset} on reach beyond the {} bytes of buffer {b}: it is torn",
            buffer.len()
        )
    })?;
    Ok((bytes, view.byte_stride))
}
