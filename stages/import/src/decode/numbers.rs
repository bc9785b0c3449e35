//! The numbers of a picture in the type that the file has, so that a picture takes no more memory than that.

/// Numbers of pixels. `F32` stands for 16 bit floating-point ones, too.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    U8(Vec<u8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Numbers {
    #[allow(clippy::len_without_is_empty, reason = "pictures have pixels")]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    /// Number `i`, exactly.
    pub fn at(&self, i: usize) -> f64 {
        match self {
            Self::U8(v) => f64::from(v[i]),
            Self::U16(v) => f64::from(v[i]),
            Self::I16(v) => f64::from(v[i]),
            Self::U32(v) => f64::from(v[i]),
            Self::F32(v) => f64::from(v[i]),
            Self::F64(v) => v[i],
        }
    }

    /// Those of a picture of 16 bits.
    pub fn of_16_bits(&self) -> Option<&[u16]> {
        if let Self::U16(numbers) = self { Some(numbers) } else { None }
    }

    pub fn iter(&self) -> impl Iterator<Item = f64> {
        (0..self.len()).map(|i| self.at(i))
    }

    /// The highest that the type can hold; none for floating-point numbers.
    pub fn highest(&self) -> Option<f64> {
        match self {
            Self::U8(_) => Some(f64::from(u8::MAX)),
            Self::U16(_) => Some(f64::from(u16::MAX)),
            Self::I16(_) => Some(f64::from(i16::MAX)),
            Self::U32(_) => Some(f64::from(u32::MAX)),
            Self::F32(_) | Self::F64(_) => None,
        }
    }
}

/// The numbers of a type, kept by their places.
macro_rules! kept {
    ($numbers:expr, $at:expr) => {
        match $numbers {
            Numbers::U8(v) => Numbers::U8($at.map(|i| v[i]).collect()),
            Numbers::U16(v) => Numbers::U16($at.map(|i| v[i]).collect()),
            Numbers::I16(v) => Numbers::I16($at.map(|i| v[i]).collect()),
            Numbers::U32(v) => Numbers::U32($at.map(|i| v[i]).collect()),
            Numbers::F32(v) => Numbers::F32($at.map(|i| v[i]).collect()),
            Numbers::F64(v) => Numbers::F64($at.map(|i| v[i]).collect()),
        }
    };
}

impl Numbers {
    /// Those at these places, in this order.
    pub(super) fn pick(&self, places: impl Iterator<Item = usize>) -> Self {
        kept!(self, places)
    }
}

/// Room for so many numbers.
///
/// Error: there is no memory for it.
pub(super) fn room<T>(n: usize) -> Result<Vec<T>, String> {
    let mut numbers = Vec::new();
    match numbers.try_reserve_exact(n) {
        Ok(()) => Ok(numbers),
        Err(_) => Err(format!("there is no memory for its {n} pixels")),
    }
}

/// So many zeros.
///
/// Error: there is no memory for it.
pub(super) fn zeros<T: Copy + Default>(n: usize) -> Result<Vec<T>, String> {
    // Asked for, and given back: zeros from the system take no memory before something is written to them.
    drop(room::<T>(n)?);
    Ok(vec![T::default(); n])
}
