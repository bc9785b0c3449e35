//! Small parts of a region, over which the mean residual of a fit tells misfit from noise.

use crate::regions::Region;

/// Rings along the edge of a region that are looked at by themselves.
const RINGS: u32 = 4;
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
    /// Squares of squares, and quarters of rings along the edges.
    pub larger: Vec<Vec<usize>>,
    /// Whole rings, by their numbers.
    pub rings: Vec<(u32, Vec<usize>)>,
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
        let near = || some().filter(|&i| region.rings[i] < RINGS);
        let quarters = by_key(near().map(|i| ((region.rings[i], quarter(i)), i))).into_iter().map(|(_, ring)| ring);
        Self {
            tiles: squares(side).collect(),
            whole: side * side,
            larger: squares(2 * side).chain(squares(4 * side)).chain(quarters).filter(|b| b.len() >= LEAST).collect(),
            rings: by_key(near().map(|i| (region.rings[i], i))).into_iter().filter(|(_, r)| r.len() >= LEAST).collect(),
        }
    }
}

/// Groups of one key each, by key.
fn by_key<K: Ord>(entries: impl Iterator<Item = (K, usize)>) -> Vec<(K, Vec<usize>)> {
    let mut groups = std::collections::BTreeMap::<K, Vec<usize>>::new();
    entries.for_each(|(key, i)| groups.entry(key).or_default().push(i));
    groups.into_iter().collect()
}
