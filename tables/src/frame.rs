//! Turbid's tables as frames of polars, and back. Columns are copied: an index has some hundred bytes a sample.

use polars::prelude::{Column, DataFrame, DataType, NamedFrom, Series};
use turbid_contract::{Cells, Table};

use crate::Error;

/// A frame with the columns of a table; numbers that are not known are null.
pub fn frame(table: &Table) -> Result<DataFrame, Error> {
    let columns = table.columns.iter().map(|column| {
        let name = column.name.as_str().into();
        Column::from(match &column.cells {
            Cells::F64(cells) => Series::new(name, cells),
            Cells::MaybeF64(cells) => Series::new(name, cells),
            Cells::I64(cells) => Series::new(name, cells),
            Cells::Bool(cells) => Series::new(name, cells),
            Cells::Text(cells) => Series::new(name, cells),
        })
    });
    Ok(DataFrame::new_infer_height(columns.collect())?)
}

/// A table with the columns of a frame and these units; what is null among texts is empty.
pub fn table(frame: &DataFrame, unit: impl Fn(&str) -> &'static str) -> Result<Table, Error> {
    let mut table = Table::default();
    for column in frame.columns() {
        let cells = match column.dtype() {
            DataType::String => {
                let texts = column.str()?.iter();
                Cells::Text(texts.map(|text| text.unwrap_or_default().to_owned()).collect())
            }
            of if of.is_integer() => {
                let numbers = column.cast(&DataType::Int64)?;
                Cells::I64(numbers.i64()?.iter().map(Option::unwrap_or_default).collect())
            }
            _ => Cells::MaybeF64(column.cast(&DataType::Float64)?.f64()?.iter().collect()),
        };
        let name = column.name().as_str();
        table.push(name, unit(name), cells);
    }
    Ok(table)
}

/// The numeric columns of a table.
pub fn numbers(table: &Table) -> impl Iterator<Item = &str> {
    let numeric = |cells: &Cells| matches!(cells, Cells::F64(_) | Cells::MaybeF64(_) | Cells::I64(_));
    table.columns.iter().filter(move |column| numeric(&column.cells)).map(|column| column.name.as_str())
}

/// A column that must be there.
pub fn needs(table: &Table, name: &str) -> Result<(), Error> {
    match table.columns.iter().any(|column| column.name == name) {
        true => Ok(()),
        false => Err(Error(format!("the table has no column `{name}`"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_goes_there_and_back() {
        let mut there = Table::default();
        there.push("id", "", Cells::Text(vec!["a".to_owned(), "é".to_owned()]));
        there.push("n", "", Cells::I64(vec![-1, i64::MAX]));
        there.push("x", "s", Cells::MaybeF64(vec![None, Some(0.1)]));
        let back = table(&frame(&there).unwrap(), |name| if name == "x" { "s" } else { "" }).unwrap();
        assert_eq!(back, there);
        assert_eq!(numbers(&there).collect::<Vec<_>>(), ["n", "x"]);
    }
}
