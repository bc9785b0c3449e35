//! Small parts of a region, over which the mean residual of a fit tells misfit from noise.

use crate::regions::Region;

/// Rings along the edge of a region that are looked at by themselves.
pub const RINGS: u32 = 4;
/// Rings in which what a fit leaves is told apart.
const ALL_RINGS: u32 = 6;
/// What is outside of them is no more than one of so many parts of the pixels.
const EDGE: usize = 3;
/// Tiles at the edge count from this part of a whole one on.
const LEAST_PART: f64 = 0.4;
/// The fewest pixels of other blocks.
const LEAST: usize = 4;

/// Parts of the `active` pixels of a region, as indices into its pixels.
pub struct Blocks {
    /// Squares of pixels: they share none.
    pub tiles: Vec<Vec<usize>>,
    /// Pixels of a whole tile.
    pub whole: usize,
    /// Squares of tiles.
    pub larger: Vec<Vec<usize>>,
    /// Rings along the edges, whole and by quarters of the image.
    pub rings: Vec<Ring>,
    pub quarters: Vec<Ring>,
}

/// Pixels at one distance from the edge.
pub struct Ring {
    pub number: u32,
    pub pixels: Vec<usize>,
    /// These and all nearer to the edge.
    pub outside: Vec<usize>,
    /// Whether they are few enough to be left out.
    pub is_edge: bool,
}

impl Blocks {
    /// Some `count` tiles or fewer, of at least 2 x 2 pixels.
    pub fn of(region: &Region, active: &[bool], count: usize) -> Self {
        let some = || (0..region.len()).filter(|&i| active[i]);
        let pixels = some().count();
        let side = ((pixels as f64 / count as f64).sqrt() as usize).max(2);
        let squares = |side: usize| {
            let mut tiles = by_key(some().map(|i| (region.cells[i].map(|c| c / side), i)));
            tiles.retain(|(_, tile)| tile.len() as f64 >= LEAST_PART * (side * side) as f64);
            tiles.into_iter().map(|(_, tile)| tile)
        };
        let middle = [0, 1].map(|k| some().map(|i| region.cells[i][k] as f64).sum::<f64>() / pixels as f64);
        let quarter = |i: usize| [0, 1].map(|k| region.cells[i][k] as f64 > middle[k]);
        Self {
            tiles: squares(side).collect(),
            whole: side * side,
            larger: squares(2 * side).chain(squares(4 * side)).filter(|b| b.len() >= LEAST).collect(),
            rings: rings(region, some().collect()),
            quarters: by_key(some().map(|i| (quarter(i), i))).into_iter().flat_map(|(_, q)| rings(region, q)).collect(),
        }
    }
}

/// Those of some pixels.
fn rings(region: &Region, pixels: Vec<usize>) -> Vec<Ring> {
    let near = |number: u32| pixels.iter().copied().filter(move |&i| region.rings[i] <= number);
    let of = |number: u32| {
        let outside: Vec<usize> = near(number).collect();
        let is_edge = number < RINGS && EDGE * outside.len() <= pixels.len();
        let pixels = outside.iter().copied().filter(|&i| region.rings[i] == number).collect();
        Ring { number, pixels, outside, is_edge }
    };
    (0..ALL_RINGS).map(of).filter(|ring| ring.pixels.len() >= LEAST).collect()
}

/// Groups of one key each, by key.
fn by_key<K: Ord>(entries: impl Iterator<Item = (K, usize)>) -> Vec<(K, Vec<usize>)> {
    let mut groups = std::collections::BTreeMap::<K, Vec<usize>>::new();
    entries.for_each(|(key, i)| groups.entry(key).or_default().push(i));
    groups.into_iter().collect()
}
