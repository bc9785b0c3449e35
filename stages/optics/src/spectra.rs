//! Spectra as laboratories keep them: a table of text, wavelength_nm and a column for each quantity.

use crate::Spectrum;

/// A mistake in a file of spectra: where it stands, from 1, and what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct FileError {
    pub line: usize,
    pub column: usize,
    pub message: String,
}

/// Columns that one file may have: a table of more is another kind of file.
const MOST_COLUMNS: usize = 64;

/// The spectra of a file by name; `value` makes of a cell, with the name of its column, what the spectrum holds, or says which rule it breaks.
///
/// Cells stand between commas, semicolons or white space; `#` begins a comment; the first other line names the columns. Errors: no `wavelength_nm`, no
/// other column, a name twice, a row of another length, what is no finite number, a broken rule, wavelengths that do not rise.
pub fn read(
    bytes: &[u8],
    value: &dyn Fn(&str, f64) -> Result<f64, String>,
) -> Result<Vec<(String, Spectrum)>, FileError> {
    let wrong = |line: usize, column: usize, message: String| Err(FileError { line, column, message });
    let Ok(text) = std::str::from_utf8(bytes) else {
        return wrong(1, 1, "the file is no text: a table with the columns wavelength_nm, NAME.. is wanted".to_owned());
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut rows = text.lines().enumerate().map(|(i, line)| (i + 1, cells(line))).filter(|(_, row)| !row.is_empty());
    let Some((line, names)) = rows.next() else { return wrong(1, 1, "the file holds nothing".to_owned()) };
    let Some(of_wavelength) = names.iter().position(|&name| name == "wavelength_nm") else {
        let found = names.iter().take(8).copied().collect::<Vec<_>>().join(", ");
        return wrong(
            line,
            1,
            format!("no column wavelength_nm: the first line must name the columns, and it reads {found}"),
        );
    };
    if names.len() < 2 || names.len() > MOST_COLUMNS {
        let rule = format!("wavelength_nm and 1 to {} others are wanted", MOST_COLUMNS - 1);
        return wrong(line, 1, format!("{} columns: {rule}", names.len()));
    }
    if let Some(k) = (0..names.len()).find(|&k| names[..k].contains(&names[k])) {
        return wrong(line, k + 1, format!("the column {} stands twice", names[k]));
    }
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for (line, row) in rows {
        if row.len() != names.len() {
            return wrong(
                line,
                row.len().min(names.len()),
                format!("{} cells in a table of {} columns", row.len(), names.len()),
            );
        }
        for (k, cell) in row.iter().enumerate() {
            let Some(number) = cell.parse::<f64>().ok().filter(|v| v.is_finite()) else {
                return wrong(line, k + 1, format!("{} = `{cell}` is not a finite number", names[k]));
            };
            if k != of_wavelength {
                match value(names[k], number) {
                    Ok(value) => columns[k].push(value),
                    Err(rule) => return wrong(line, k + 1, format!("{} = {number} must {rule}", names[k])),
                }
                continue;
            }
            if number < 0.0 {
                return wrong(line, k + 1, format!("wavelength_nm = {number} must be >= 0"));
            }
            if let Some(&before) = columns[k].last()
                && number <= before
            {
                return wrong(
                    line,
                    k + 1,
                    format!("wavelength_nm = {number} nm follows {before} nm: wavelengths must rise"),
                );
            }
            columns[k].push(number);
        }
    }
    if columns[of_wavelength].is_empty() {
        return wrong(line, 1, "no row follows the names of the columns".to_owned());
    }
    let wavelengths = columns[of_wavelength].clone();
    let named = names.iter().zip(columns).enumerate().filter(|(k, _)| *k != of_wavelength);
    let spectra = named.map(|(_, (&name, values))| {
        (name.to_owned(), Spectrum::new(wavelengths.clone(), values).expect("rows are finite and rise"))
    });
    Ok(spectra.collect())
}

/// What stands on a line before its comment.
fn cells(line: &str) -> Vec<&str> {
    let line = line.split('#').next().unwrap_or_default().trim();
    match line {
        "" => Vec::new(),
        _ if line.contains([',', ';']) => line.split([',', ';']).map(str::trim).collect(),
        _ => line.split_whitespace().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn not_negative(_: &str, value: f64) -> Result<f64, String> {
        if value < 0.0 { Err("be >= 0".to_owned()) } else { Ok(value * 0.1) }
    }

    #[test]
    fn tables_are_read_whatever_separates_their_cells() {
        for text in [
            "wavelength_nm,dye,ink\n# made up\n500,1,2\n600,3,4\n",
            "\u{feff}wavelength_nm; dye; ink\r\n500; 1; 2\r\n\r\n600; 3; 4",
            "dye\twavelength_nm\tink\n1 500 2 # first\n3 600 4\n",
        ] {
            let spectra = read(text.as_bytes(), &not_negative).expect("it is a table");
            assert_eq!(spectra.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["dye", "ink"]);
            assert_eq!(spectra[0].1.at(550.0), Some(0.5 * 0.1 + 0.5 * (3.0 * 0.1)));
        }
    }

    /// Each mistake with its place.
    #[test]
    fn wrong_files_are_named() {
        for (text, line, column, words) in [
            (&b""[..], 1, 1, "holds nothing"),
            (b"# only words\n", 1, 1, "holds nothing"),
            (b"\xff\xfe\x00", 1, 1, "no text"),
            (b"nm,dye\n500,1\n", 1, 1, "no column wavelength_nm"),
            (b"500,1\n600,2\n", 1, 1, "it reads 500, 1"),
            (b"wavelength_nm\n500\n", 1, 1, "1 columns"),
            (b"wavelength_nm,a,a\n500,1,1\n", 1, 3, "a stands twice"),
            (b"wavelength_nm,a\n", 1, 1, "no row follows"),
            (b"wavelength_nm,a\n500,1\n600\n", 3, 1, "1 cells in a table of 2"),
            (b"wavelength_nm,a\n500,nan\n", 2, 2, "a = `nan` is not a finite number"),
            (b"wavelength_nm,a\n500,\n", 2, 2, "a = `` is not"),
            (b"wavelength_nm,a\n500,-1\n", 2, 2, "must be >= 0"),
            (b"wavelength_nm,a\n500,1\n# between\n500,2\n", 4, 1, "must rise"),
        ] {
            let error = read(text, &not_negative).expect_err(words);
            assert!(error.message.contains(words), "{words}: {error:?}");
            assert_eq!((error.line, error.column), (line, column), "{words}");
        }
    }
}
