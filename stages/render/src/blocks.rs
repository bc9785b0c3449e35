//! Small parts of a region, over which the mean residual of a fit tells misfit from noise.

use crate::regions::Region;

/// Rings along the edge of a region that are looked at by themselves ...
const RINGS: u32 = 4;
/// ... in so many sectors around its middle.
const SECTORS: [bool; 2] = [false, true];
/// Tiles at the edge count from this part of a whole one on.
const LEAST_PART: f64 = 0.4;

/// Parts of the `active` pixels of a region, as indices into its pixels.
pub struct Blocks {
    /// Squares of pixels: they share none.
    pub tiles: Vec<Vec<usize>>,
    /// Along the edges, quarter by quarter.
    pub rings: Vec<Vec<usize>>,
    /// Pixels of a whole tile.
    pub whole: usize,
}

impl Blocks {
    /// Some `count` tiles or fewer, of at least 2 x 2 pixels.
    pub fn of(region: &Region, active: &[bool], count: usize) -> Self {
        let some = || (0..region.len()).filter(|&i| active[i]);
        let side = ((some().count() as f64 / count as f64).sqrt() as usize).max(2);
        let whole = side * side;
        let mut tiles = by_key(some().map(|i| (region.cells[i].map(|c| c / side), i)));
        tiles.retain(|tile| tile.len() as f64 >= LEAST_PART * whole as f64);
        let middle = [0, 1].map(|k| some().map(|i| region.cells[i][k] as f64).sum::<f64>() / some().count() as f64);
        let quarter = |i: usize| [0, 1].map(|k| SECTORS[usize::from(region.cells[i][k] as f64 > middle[k])]);
        let near = some().filter(|&i| region.rings[i] < RINGS);
        let mut rings = by_key(near.map(|i| ((region.rings[i], quarter(i)), i)));
        rings.retain(|ring| ring.len() >= 4);
        Self { tiles, rings, whole }
    }

    pub fn all(&self) -> impl Iterator<Item = &Vec<usize>> {
        self.tiles.iter().chain(&self.rings)
    }
}

/// Groups of one key each, by key.
fn by_key<K: Ord>(entries: impl Iterator<Item = (K, usize)>) -> Vec<Vec<usize>> {
    let mut groups = std::collections::BTreeMap::<K, Vec<usize>>::new();
    entries.for_each(|(key, i)| groups.entry(key).or_default().push(i));
    groups.into_values().collect()
}
