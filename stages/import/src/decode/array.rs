//! Arrays of numbers as mathematical programs write them, and the pictures in them.

use super::numbers::Numbers;
use super::{Picture, bounded, no_page};

/// What stands in one piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// A row: (rows, columns) or (pages, rows, columns), as NumPy writes it.
    Rows,
    /// A column: (rows, columns) or (rows, columns, pages), as MATLAB writes it.
    Columns,
    /// A pixel of all pages: (pages, rows, columns), as NumPy writes what came from Fortran.
    Pages,
}

/// Pages of rows and columns.
#[derive(Clone, Debug)]
pub struct Array {
    pub pages: usize,
    pub rows: usize,
    pub columns: usize,
    order: Order,
    numbers: Numbers,
}

impl Array {
    /// One without its numbers.
    ///
    /// Error: no pictures, or more than can be.
    pub fn new(shape: &[u64], order: Order) -> Result<Self, String> {
        let (pages, rows, columns) = match (shape, order) {
            (&[rows, columns], _) => (1, rows, columns),
            (&[rows, columns, pages], Order::Columns) if pages > 0 => (pages, rows, columns),
            (&[pages, rows, columns], Order::Rows | Order::Pages) if pages > 0 => (pages, rows, columns),
            (other, _) => {
                let known = match order {
                    Order::Columns => "(rows, columns) and (rows, columns, pages)",
                    _ => "(rows, columns) and (pages, rows, columns)",
                };
                return Err(format!("it has the shape {other:?}; {known} are read"));
            }
        };
        let (columns, rows) = bounded(columns, rows)?;
        let pages = usize::try_from(pages).ok().filter(|p| p.checked_mul(columns * rows).is_some_and(|n| n <= 1 << 40));
        let pages = pages.ok_or_else(|| "it has more pages than can be".to_owned())?;
        Ok(Self { pages, rows, columns, order, numbers: Numbers::U8(Vec::new()) })
    }

    /// The same with its numbers.
    pub fn with(self, numbers: Numbers) -> Self {
        Self { numbers, ..self }
    }

    /// Numbers of all pages.
    pub fn count(&self) -> usize {
        self.pages * self.rows * self.columns
    }

    /// Whether the page, which is there, is a piece of the numbers in its own order.
    pub fn page_in_one_piece(&self, page: Option<usize>) -> bool {
        let named = if page.is_none() { self.pages == 1 } else { page < Some(self.pages) };
        named && self.order == Order::Rows
    }

    /// Error: there is no such page, or several and none is named.
    pub fn picture(self, page: Option<usize>) -> Result<Picture, String> {
        let Self { pages, rows, columns, order, numbers } = self;
        if page.is_none() && pages > 1 {
            return Err(format!(
                "it has {pages} pages, and a frame is one picture: name each by `page`, or leave {{phase}} out of the pattern"
            ));
        }
        let page = page.unwrap_or(0);
        if page >= pages {
            return Err(no_page(page, pages));
        }
        let place = move |r: usize, c: usize| match order {
            Order::Rows => (page * rows + r) * columns + c,
            Order::Columns => (page * columns + c) * rows + r,
            Order::Pages => (c * rows + r) * pages + page,
        };
        let own = if pages == 1 && order == Order::Rows {
            numbers
        } else {
            numbers.pick((0..rows).flat_map(|r| (0..columns).map(move |c| place(r, c))))
        };
        Picture::whole((columns, rows), own)
    }
}
