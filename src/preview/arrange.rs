//! Groups of panels to rows: a group stays together, rows are well filled.

/// Things that belong side by side.
pub type Grouped<T> = Vec<T>;

/// Rows of at most `most` things, in order, with as few holes as can be; wider rows where it is equal.
pub fn arrange<T>(groups: Vec<Grouped<T>>, most: usize) -> Vec<Vec<T>> {
    let sizes: Vec<usize> = groups.iter().map(Vec::len).collect();
    let best = (2..=most.max(2)).rev().min_by_key(|&columns| holes(&sizes, columns)).unwrap_or(most);
    let mut rows: Vec<Vec<T>> = Vec::new();
    for group in groups {
        let room = rows.last().map_or(0, |row| best.saturating_sub(row.len()));
        if group.len() > room {
            rows.push(Vec::new());
        }
        for thing in group {
            if rows.last().is_none_or(|row| row.len() == best) {
                rows.push(Vec::new());
            }
            rows.last_mut().expect("a row was just made").push(thing);
        }
    }
    rows
}

/// Empty cells of the grid that `columns` make; a grid of one row is cut to its width.
fn holes(sizes: &[usize], columns: usize) -> usize {
    let (mut rows, mut used) = (0, columns);
    for &size in sizes {
        if used + size > columns {
            rows += size.div_ceil(columns).max(1);
            used = if size.is_multiple_of(columns) && size > 0 { columns } else { size % columns };
        } else {
            used += size;
        }
    }
    if rows <= 1 { 0 } else { rows * columns - sizes.iter().sum::<usize>() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(sizes: &[usize]) -> Vec<usize> {
        let mut next = 0..;
        let groups = sizes.iter().map(|&n| next.by_ref().take(n).collect()).collect();
        let rows: Vec<Vec<usize>> = arrange(groups, 4);
        let flat: Vec<usize> = rows.iter().flatten().copied().collect();
        assert_eq!(flat, (0..sizes.iter().sum()).collect::<Vec<_>>(), "nothing is lost or swapped");
        rows.iter().map(Vec::len).collect()
    }

    #[test]
    fn rows_are_well_filled_and_groups_whole() {
        assert_eq!(shape(&[1]), [1]);
        assert_eq!(shape(&[1, 3]), [4]);
        assert_eq!(shape(&[3, 3]), [3, 3]);
        assert_eq!(shape(&[2, 2]), [4]);
        assert_eq!(shape(&[1; 9]), [3, 3, 3]);
        assert_eq!(shape(&[1; 7]), [4, 3]);
        assert_eq!(shape(&[12]), [4, 4, 4]);
        assert_eq!(shape(&[1, 1, 1]), [3]);
        assert_eq!(shape(&[]), [] as [usize; 0]);
    }
}
