//! Records of paths: one by itself, sixteen in lanes, and columns of them from which lanes are filled and into which they are packed.

use fearless_simd::prelude::*;

use super::lane::{F, LANES, M, U, V};
use crate::lengths::MOST_LENGTHS;

/// Lengths of sixteen paths, mm.
pub type Counts<S> = [F<S>; MOST_LENGTHS];

/// Fields of a record by kind: vectors, floats, words, and the lengths (mm) by which channels that share paths differ.
pub type Fields<A, B, C, const VECTORS: usize, const FLOATS: usize, const WORDS: usize> =
    ([A; VECTORS], [B; FLOATS], [C; WORDS], [B; MOST_LENGTHS]);

/// A kind of record, whose fields are vectors, floats and words: of one path (`[f32; 3]`, `f32`, `u32`) or of sixteen (`V`, `F`, `U`).
pub trait Record<const VECTORS: usize, const FLOATS: usize, const WORDS: usize> {
    type Of<A, B, C>;
    /// With the same in all fields of a kind.
    fn filled<A: Copy, B: Copy, C: Copy>(vector: A, float: B, word: C) -> Self::Of<A, B, C>;
    fn fields<A, B, C>(record: &Self::Of<A, B, C>) -> Fields<&A, &B, &C, VECTORS, FLOATS, WORDS>;
    fn fields_mut<A, B, C>(record: &mut Self::Of<A, B, C>) -> Fields<&mut A, &mut B, &mut C, VECTORS, FLOATS, WORDS>;
}

/// Declares a record by its fields: `$Record` with named ones, `$Row` for one path, `$Lanes` for sixteen and `$Rows` for columns of it.
macro_rules! record {
    (
        $(#[$doc:meta])*
        $Record:ident, $Row:ident, $Lanes:ident, $Rows:ident: $vectors:literal, $floats:literal, $words:literal;
        vectors { $($(#[$of_vector:meta])* $vector:ident,)* }
        floats { $($(#[$of_float:meta])* $float:ident,)* }
        words { $($(#[$of_word:meta])* $word:ident,)* }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $Record<A, B, C> {
            $($(#[$of_vector])* pub $vector: A,)*
            $($(#[$of_float])* pub $float: B,)*
            $($(#[$of_word])* pub $word: C,)*
            /// By which channels differ, mm.
            pub lengths: [B; MOST_LENGTHS],
        }
        pub type $Row = $Record<[f32; 3], f32, u32>;
        pub type $Lanes<S> = $Record<V<S>, F<S>, U<S>>;
        pub type $Rows = Rows<$Row, $vectors, $floats, $words>;
        impl<S: Simd> $Lanes<S> {
            #[inline(always)]
            pub fn zeros(simd: S) -> Self {
                let zero = F::splat(simd, 0.0);
                $Row::filled(V { x: zero, y: zero, z: zero }, zero, U::splat(simd, 0))
            }
        }
        impl Record<$vectors, $floats, $words> for $Row {
            type Of<A, B, C> = $Record<A, B, C>;
            #[inline(always)]
            fn filled<A: Copy, B: Copy, C: Copy>(vector: A, float: B, word: C) -> $Record<A, B, C> {
                let lengths = [float; MOST_LENGTHS];
                $Record { $($vector: vector,)* $($float: float,)* $($word: word,)* lengths }
            }
            #[inline(always)]
            fn fields<A, B, C>(record: &$Record<A, B, C>) -> Fields<&A, &B, &C, $vectors, $floats, $words> {
                let $Record { $($vector,)* $($float,)* $($word,)* lengths } = record;
                ([$($vector),*], [$($float),*], [$($word),*], lengths.each_ref())
            }
            #[inline(always)]
            fn fields_mut<A, B, C>(
                record: &mut $Record<A, B, C>,
            ) -> Fields<&mut A, &mut B, &mut C, $vectors, $floats, $words> {
                let $Record { $($vector,)* $($float,)* $($word,)* lengths } = record;
                ([$($vector),*], [$($float),*], [$($word),*], lengths.each_mut())
            }
        }
    };
}

record! {
    /// A path in a medium.
    Path, PathRow, PathLanes, Paths: 2, 10, 6;
    vectors {
        /// Where it stands, mm from the local origin.
        r,
        /// Unit vector along which it goes on.
        w,
    }
    floats {
        /// What is left of the optical depth of absorption at which it ends, and what rounding has lost of that.
        absorption_depth,
        absorption_lost,
        weight,
        /// Of its medium, mm and mm^-1.
        free_path,
        mu_a,
        mu_s,
        g,
        /// WINDOW mu_eff, mm^-1: how fast the roulette of deep paths sets in.
        window,
        /// Distance (mm) within which there is no surface that lanes do not know.
        known_clear,
        /// Of light that its next flight sees, where a light-directed branch may see it too.
        mis_weight,
    }
    words {
        /// Block of random numbers of its next flight.
        number,
        sample,
        pixel,
        /// To which it adds.
        response,
        material,
        body,
    }
}

record! {
    /// A path vertex that waits for next-event estimation one scattering ahead.
    Vertex, VertexRow, VertexLanes, Vertices: 3, 6, 5;
    vectors {
        /// Where it is, mm from the local origin.
        r,
        /// Unit vectors along which the path came, and along which it goes on.
        came,
        own,
    }
    floats {
        weight,
        /// The uniform random number of the roulette by which estimates deep inside are left out.
        roulette,
        mu_a,
        mu_s,
        g,
        /// Optical distance of the nearest surface.
        least,
    }
    words {
        /// Block of random numbers, with the marks of `limits.rs`.
        number,
        sample,
        pixel,
        response,
        body,
    }
}

record! {
    /// The place of the next scattering on a line, that waits to be connected through interfaces.
    Place, PlaceRow, PlaceLanes, Places: 2, 4, 6;
    vectors {
        /// mm from the local origin.
        r,
        /// Unit vector along which the path comes there.
        e,
    }
    floats {
        g,
        /// What is scattered there.
        fraction,
        /// Optical depth of the line, which that does not count.
        passed,
        /// With which probability connections other than the likeliest are tried.
        others,
    }
    words {
        /// Random numbers of the estimate: its block, and its place on the ray.
        block,
        place,
        sample,
        pixel,
        response,
        body,
    }
}

impl<S: Simd> PathLanes<S> {
    /// The same in all lanes.
    #[inline(always)]
    pub fn splat(simd: S, row: &PathRow) -> Self {
        let mut lanes = Self::zeros(simd);
        let (vectors, floats, words, lengths) = PathRow::fields_mut(&mut lanes);
        let (of_vectors, of_floats, of_words, of_lengths) = PathRow::fields(row);
        for (v, of) in vectors.into_iter().zip(of_vectors) {
            let [x, y, z] = of.map(|x| F::splat(simd, x));
            *v = V { x, y, z };
        }
        for (x, of) in floats.into_iter().zip(of_floats).chain(lengths.into_iter().zip(of_lengths)) {
            *x = F::splat(simd, *of);
        }
        for (x, of) in words.into_iter().zip(of_words) {
            *x = U::splat(simd, *of);
        }
        lanes
    }
}

/// 31 records at most, and room behind them for a whole vector.
const ROOM: usize = 3 * LANES;

/// At most 31 records.
#[derive(Clone, Debug)]
pub struct Rows<R, const VECTORS: usize, const FLOATS: usize, const WORDS: usize> {
    vectors: [[[f32; ROOM]; 3]; VECTORS],
    floats: [[f32; ROOM]; FLOATS],
    words: [[u32; ROOM]; WORDS],
    lengths: [[f32; ROOM]; MOST_LENGTHS],
    /// Whether lengths are kept; where they are not, those of a record are any numbers.
    counted: bool,
    len: usize,
    record: std::marker::PhantomData<R>,
}

impl<R: Record<VECTORS, FLOATS, WORDS>, const VECTORS: usize, const FLOATS: usize, const WORDS: usize>
    Rows<R, VECTORS, FLOATS, WORDS>
{
    /// None yet.
    pub fn new(counted: bool) -> Self {
        Self {
            vectors: [[[0.0; ROOM]; 3]; VECTORS],
            floats: [[0.0; ROOM]; FLOATS],
            words: [[0; ROOM]; WORDS],
            lengths: [[0.0; ROOM]; MOST_LENGTHS],
            counted,
            len: 0,
            record: std::marker::PhantomData,
        }
    }

    pub fn len(&self) -> usize {
        self.len
    }

    /// Appends one record.
    #[inline]
    pub fn push(&mut self, row: &R::Of<[f32; 3], f32, u32>) {
        self.set(self.len, row);
        self.len += 1;
    }

    #[inline]
    pub fn set(&mut self, i: usize, row: &R::Of<[f32; 3], f32, u32>) {
        let (vectors, floats, words, lengths) = R::fields(row);
        for (columns, v) in self.vectors.iter_mut().zip(vectors) {
            for (column, &x) in columns.iter_mut().zip(v) {
                column[i] = x;
            }
        }
        for (column, &x) in self.floats.iter_mut().zip(floats).chain(self.lengths.iter_mut().zip(lengths)) {
            column[i] = x;
        }
        for (column, &x) in self.words.iter_mut().zip(words) {
            column[i] = x;
        }
    }

    pub fn get(&self, i: usize) -> R::Of<[f32; 3], f32, u32> {
        let mut row = R::filled([0.0; 3], 0.0, 0);
        let (vectors, floats, words, lengths) = R::fields_mut(&mut row);
        for (v, columns) in vectors.into_iter().zip(&self.vectors) {
            for (x, column) in v.iter_mut().zip(columns) {
                *x = column[i];
            }
        }
        for (x, column) in floats.into_iter().zip(&self.floats).chain(lengths.into_iter().zip(&self.lengths)) {
            *x = column[i];
        }
        for (x, column) in words.into_iter().zip(&self.words) {
            *x = column[i];
        }
        row
    }

    /// Appends the lanes in `mask`, in their order; there is room for 16.
    #[inline(always)]
    pub fn pack<S: Simd>(&mut self, mask: M<S>, lanes: &R::Of<V<S>, F<S>, U<S>>) {
        let at = self.len..self.len + LANES;
        let (vectors, floats, words, lengths) = R::fields(lanes);
        for ([a, b, c], v) in self.vectors.iter_mut().zip(vectors) {
            v.x.compress(mask).store_slice(&mut a[at.clone()]);
            v.y.compress(mask).store_slice(&mut b[at.clone()]);
            v.z.compress(mask).store_slice(&mut c[at.clone()]);
        }
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        if self.counted {
            for (column, x) in self.lengths.iter_mut().zip(lengths) {
                x.compress(mask).store_slice(&mut column[at.clone()]);
            }
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        self.len += mask.to_bitmask().count_ones() as usize;
    }

    /// Overwrites the first 16.
    #[inline(always)]
    pub fn store<S: Simd>(&mut self, lanes: &R::Of<V<S>, F<S>, U<S>>) {
        let (vectors, floats, words, lengths) = R::fields(lanes);
        for ([a, b, c], v) in self.vectors.iter_mut().zip(vectors) {
            v.x.store_slice(&mut a[..LANES]);
            v.y.store_slice(&mut b[..LANES]);
            v.z.store_slice(&mut c[..LANES]);
        }
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.store_slice(&mut column[..LANES]);
        }
        if self.counted {
            for (column, x) in self.lengths.iter_mut().zip(lengths) {
                x.store_slice(&mut column[..LANES]);
            }
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.store_slice(&mut column[..LANES]);
        }
    }

    /// The first 16 records.
    #[inline(always)]
    pub fn load<S: Simd>(&self, simd: S, lanes: &mut R::Of<V<S>, F<S>, U<S>>) {
        let (vectors, floats, words, lengths) = R::fields_mut(lanes);
        for (v, [a, b, c]) in vectors.into_iter().zip(&self.vectors) {
            v.x = F::from_slice(simd, &a[..LANES]);
            v.y = F::from_slice(simd, &b[..LANES]);
            v.z = F::from_slice(simd, &c[..LANES]);
        }
        for (x, column) in floats.into_iter().zip(&self.floats) {
            *x = F::from_slice(simd, &column[..LANES]);
        }
        if self.counted {
            for (x, column) in lengths.into_iter().zip(&self.lengths) {
                *x = F::from_slice(simd, &column[..LANES]);
            }
        }
        for (x, column) in words.into_iter().zip(&self.words) {
            *x = U::from_slice(simd, &column[..LANES]);
        }
    }

    /// Moves the last records into the lanes of `mask`, which holds as many at most.
    #[inline(always)]
    pub fn unpack<S: Simd>(&mut self, simd: S, mask: M<S>, lanes: &mut R::Of<V<S>, F<S>, U<S>>) {
        self.len -= mask.to_bitmask().count_ones() as usize;
        let at = self.len..self.len + LANES;
        let (vectors, floats, words, lengths) = R::fields_mut(lanes);
        for (v, [a, b, c]) in vectors.into_iter().zip(&self.vectors) {
            v.x = F::from_slice(simd, &a[at.clone()]).expand_merge(mask, v.x);
            v.y = F::from_slice(simd, &b[at.clone()]).expand_merge(mask, v.y);
            v.z = F::from_slice(simd, &c[at.clone()]).expand_merge(mask, v.z);
        }
        for (x, column) in floats.into_iter().zip(&self.floats) {
            *x = F::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
        if self.counted {
            for (x, column) in lengths.into_iter().zip(&self.lengths) {
                *x = F::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
            }
        }
        for (x, column) in words.into_iter().zip(&self.words) {
            *x = U::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
    }

    /// Removes the first 16, or all if there are fewer.
    #[inline(always)]
    pub fn drop_first<S: Simd>(&mut self, simd: S) {
        for column in self.vectors.iter_mut().flatten() {
            F::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
        }
        for column in &mut self.floats {
            F::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
        }
        if self.counted {
            for column in &mut self.lengths {
                F::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
            }
        }
        for column in &mut self.words {
            U::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
        }
        self.len = self.len.saturating_sub(LANES);
    }
}
