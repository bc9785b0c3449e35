//! Files of laboratories, from bytes: CSV with named columns, and `.rxt`.

mod rxt;

use std::fmt;

use crate::spheres::{Instrument, Sphere};

pub use rxt::read_rxt;

/// A mistake in a file; line and column count from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct FileError {
    pub line: usize,
    pub column: usize,
    pub message: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: {}", self.line, self.column, self.message)
    }
}

fn wrong<T>(line: usize, column: usize, message: impl Into<String>) -> Result<T, FileError> {
    Err(FileError { line, column, message: message.into() })
}

/// Columns of a file, and what its header says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Name of each row.
    pub media: Vec<String>,
    /// Numbers in house units by the column's name.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Line and column where each row begins, from 1; empty for what is no file.
    pub places: Vec<(usize, usize)>,
    pub header: Option<Header>,
}

/// What the header of an `.rxt` file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    pub n_sample: f64,
    /// 1 where there are none.
    pub n_slides: f64,
    pub thickness_mm: f64,
    pub slide_mm: f64,
    /// Diameter of the beam.
    pub beam_mm: f64,
    /// Diameters of the sample ports of the reflectance and of the transmittance sphere.
    pub ports_mm: [f64; 2],
    /// Both spheres, whether they are used or not.
    pub pair: [Sphere; 2],
    pub instrument: Instrument,
}

impl Sheet {
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.0 == name).map(|c| c.1.as_slice())
    }

    pub fn rows(&self) -> usize {
        self.media.len()
    }
}

/// Rows of a file; more are no readings of a laboratory.
pub const MOST_ROWS: usize = 100_000;

/// Bytes of a file; readings of so many rows take less.
const MOST_BYTES: usize = 32 << 20;

/// The content behind the byte order mark, if it is not too much.
fn bounded(bytes: &[u8]) -> Result<&[u8], FileError> {
    if bytes.len() > MOST_BYTES {
        let message = format!("the file has {} bytes, more than the {MOST_BYTES} that readings may have", bytes.len());
        return wrong(1, 1, message);
    }
    Ok(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

fn too_long<T>(line: usize) -> Result<T, FileError> {
    wrong(line, 1, format!("the file has more than {MOST_ROWS} rows of readings; split it"))
}

/// Columns that a CSV may have, and the dimension of each: a fraction, a coefficient, or a wavelength.
const COLUMNS: [(&str, &str); 23] = [
    ("m_r", "1"),
    ("m_r_se", "1"),
    ("m_t", "1"),
    ("m_t_se", "1"),
    ("m_rt_cov", "1"),
    ("m_u", "1"),
    ("m_u_se", "1"),
    ("lost_r", "1"),
    ("lost_r_se", "1"),
    ("lost_t", "1"),
    ("lost_t_se", "1"),
    ("lost_r_diffuse", "1"),
    ("lost_r_diffuse_se", "1"),
    ("lost_t_diffuse", "1"),
    ("lost_t_diffuse_se", "1"),
    ("g", "1"),
    ("n", "1"),
    ("albedo", "1"),
    ("optical_thickness", "1"),
    ("mu_a", "mm^-1"),
    ("mu_s", "mm^-1"),
    ("mu_s_prime", "mm^-1"),
    ("wavelength", "nm"),
];

/// Units that stand behind a column's name in brackets, with the factor to the house unit.
const UNITS: [(&str, &str, f64); 8] = [
    ("1", "1", 1.0),
    ("%", "1", 0.01),
    ("nm", "nm", 1.0),
    ("um", "nm", 1000.0),
    ("µm", "nm", 1000.0),
    ("mm^-1", "mm^-1", 1.0),
    ("1/mm", "mm^-1", 1.0),
    ("cm^-1", "mm^-1", 0.1),
];

/// Lines `medium,m_r [%],m_t,...`: names from the table of readings, units in brackets (fractions without), `#` comments.
///
/// `medium` is text; `wavelength` (nm) may stand for it. `m_r` and `m_t` are needed; a cell may not be empty.
pub fn read_csv(bytes: &[u8]) -> Result<Sheet, FileError> {
    let text = text(bytes)?;
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#'));
    let Some((first, head)) = lines.next() else { return wrong(1, 1, "the file holds no line of column names") };
    let mut sheet = Sheet::default();
    let mut factors = Vec::new();
    let named = head.split(',').count();
    if named > COLUMNS.len() + 1 {
        return wrong(first + 1, 1, format!("{named} columns are named; a file has at most {}", COLUMNS.len() + 1));
    }
    for (column, cell) in cells(head) {
        let (name, unit) = match cell.split_once('[') {
            None => (cell, None),
            Some((name, unit)) => match unit.strip_suffix(']') {
                Some(unit) => (name.trim(), Some(unit.trim())),
                None => return wrong(first + 1, column, format!("`{cell}` lacks a closing bracket")),
            },
        };
        if factors.iter().any(|(known, _)| *known == name) {
            return wrong(first + 1, column, format!("column `{name}` stands twice"));
        }
        if name == "medium" {
            factors.push((name, 0.0));
            continue;
        }
        let Some((_, dimension)) = COLUMNS.iter().find(|c| c.0 == name) else {
            let known: Vec<&str> = COLUMNS.iter().map(|c| c.0).collect();
            return wrong(first + 1, column, format!("column `{name}` is not known: medium, {}", known.join(", ")));
        };
        let unit = unit.unwrap_or(dimension);
        let Some((_, _, factor)) = UNITS.iter().find(|u| u.0 == unit && u.1 == *dimension) else {
            return wrong(first + 1, column, format!("unit `{unit}` does not fit `{name}`, which is in {dimension}"));
        };
        // A covariance of two readings in % carries the factor twice.
        factors.push((name, if name == "m_rt_cov" { factor * factor } else { *factor }));
        sheet.columns.push((name.to_owned(), Vec::new()));
    }
    for needed in ["m_r", "m_t"] {
        if sheet.column(needed).is_none() {
            return wrong(first + 1, 1, format!("column `{needed}` is missing"));
        }
    }
    for (index, line) in lines {
        if sheet.media.len() == MOST_ROWS {
            return too_long(index + 1);
        }
        let has = line.split(',').count();
        if has != factors.len() {
            let message = format!("{has} cells, but {} columns are named in line {}", factors.len(), first + 1);
            return wrong(index + 1, 1, message);
        }
        let row = cells(line);
        let mut medium = None;
        let mut numbers = sheet.columns.iter_mut();
        for ((column, cell), (name, factor)) in row.into_iter().zip(&factors) {
            if *name == "medium" {
                medium = Some(cell.to_owned());
            } else if let Some((_, values)) = numbers.next() {
                values.push(number(cell, index + 1, column, name)? * factor);
            }
        }
        let wavelength = sheet.column("wavelength").and_then(|c| c.last()).map(|w| format!("{w} nm"));
        let named = medium.or(wavelength).unwrap_or_else(|| format!("row {}", sheet.media.len() + 1));
        sheet.media.push(named);
        sheet.places.push((index + 1, 1));
    }
    if sheet.media.is_empty() {
        return wrong(first + 2, 1, "no row of readings follows the column names");
    }
    Ok(sheet)
}

/// Cells of a line with the column (in characters) where each begins.
fn cells(line: &str) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    let mut at = 1;
    for cell in line.split(',') {
        let lead = cell.chars().take_while(|c| c.is_whitespace()).count();
        found.push((at + lead, cell.trim()));
        at += cell.chars().count() + 1;
    }
    found
}

fn text(bytes: &[u8]) -> Result<&str, FileError> {
    let bytes = bounded(bytes)?;
    std::str::from_utf8(bytes).or_else(|error| {
        let before = &bytes[..error.valid_up_to()];
        let line = before.iter().filter(|&&b| b == b'\n').count();
        let column = before.iter().rev().take_while(|&&b| b != b'\n').count();
        wrong(line + 1, column + 1, "not UTF-8 text")
    })
}

fn number(cell: &str, line: usize, column: usize, name: &str) -> Result<f64, FileError> {
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(value) => wrong(line, column, format!("{name} = {value} must be a finite number")),
        Err(_) if cell.is_empty() => wrong(line, column, format!("{name} is empty; a number is wanted")),
        Err(_) => wrong(line, column, format!("{name} = `{cell}` is not a number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spheres::Spheres;

    const RXT: &str = "IAD1  # a comment\n# sample\n1.40 1.50\n1.0 1.0 5 # mm\n0.985\n2\n101.6 25.4 12.7 5 0.97\n101.6 25.4 0 5 0.97\n3\n\
        633 0.30 0.25 0.001\n650 0.31 0.26 0.002\n";

    #[test]
    fn rxt_is_read() {
        let sheet = read_rxt(RXT.as_bytes()).expect("well formed");
        let header = sheet.header.clone().expect("an rxt has one");
        assert_eq!((header.n_sample, header.n_slides, header.thickness_mm), (1.4, 1.5, 1.0));
        assert_eq!(header.instrument.r_standard, 0.985);
        assert!(matches!(header.instrument.spheres, Spheres::Two([a, b]) if a.third > 0.0 && b.third == 0.0));
        assert_eq!(sheet.column("m_t"), Some(&[0.25, 0.26][..]));
        assert_eq!((sheet.media[1].as_str(), sheet.column("m_u")), ("650 nm", Some(&[0.001, 0.002][..])));
    }

    #[test]
    fn csv_is_read() {
        let sheet = read_csv(b"# of today\n medium, m_r [%], m_t,wavelength [um]\nmilk,30,0.2,0.633\nink,5,0.01,0.7\n")
            .expect("well formed");
        assert_eq!(sheet.media, ["milk", "ink"]);
        assert!((sheet.column("m_r").expect("there")[0] - 0.3).abs() < 1e-15);
        assert_eq!(sheet.column("wavelength"), Some(&[633.0, 700.0][..]));
    }

    #[test]
    fn rows_are_bounded() {
        let csv = |rows: usize| read_csv(format!("m_r,m_t\n{}", "0.3,0.2\n".repeat(rows)).as_bytes());
        assert_eq!(csv(MOST_ROWS).expect("so many are read").rows(), MOST_ROWS);
        assert_eq!(csv(MOST_ROWS + 1).expect_err("one more").line, MOST_ROWS + 2);
        let rxt = format!("{RXT}{}", "0.30 0.25 0.001\n".repeat(MOST_ROWS - 1));
        assert!(read_rxt(rxt.as_bytes()).expect_err("one more").message.contains("more than 100000 rows"));
    }

    /// Each mistake is found where it stands.
    #[test]
    fn mistakes_have_a_place() {
        let csv = |text: &str| read_csv(text.as_bytes()).map(|_| ()).expect_err(text);
        let place = |e: &FileError| (e.line, e.column);
        assert_eq!(place(&csv("m_r,m_t\n0.1,0.2\n0.3, x\n")), (3, 6));
        assert_eq!(place(&csv("m_r,m_t\n0.1,nan\n")), (2, 5));
        assert_eq!(place(&csv("m_r,m_t\n0.1,\n")), (2, 5));
        assert_eq!(place(&csv("m_r,m_t\n0.1,0.2,0.3\n")), (2, 1));
        assert_eq!(place(&csv("m_r,m_x\n0.1,0.2\n")), (1, 5));
        assert_eq!(place(&csv("m_r,m_t [mm]\n0.1,0.2\n")), (1, 5));
        assert_eq!(place(&csv("m_r,m_r\n")), (1, 5));
        assert_eq!(place(&csv("m_r\n1\n")), (1, 1));
        assert_eq!(place(&csv("")), (1, 1));
        assert_eq!(place(&csv("m_r,m_t\n")), (2, 1));
        assert_eq!(read_csv(b"m_r,m_t\n0.1,\xff\n").map_err(|e| place(&e)), Err((2, 5)));
        let rxt =
            |from: &str, to: &str| place(&read_rxt(RXT.replacen(from, to, 1).as_bytes()).map(|_| ()).expect_err(to));
        assert_eq!(rxt("IAD1", "IAD2"), (1, 1));
        assert_eq!(rxt("1.40", "0.90"), (3, 1));
        assert_eq!(rxt("0.985", "1.2"), (5, 1));
        assert_eq!(rxt("\n2\n", "\n3\n"), (6, 1));
        assert_eq!(rxt("25.4 12.7", "25.4 127"), (7, 12));
        assert_eq!(rxt("5 0.97", "5 1.02"), (7, 19));
        assert_eq!(rxt("0.25 0.001", "0.25 x"), (10, 15));
        assert_eq!(rxt("0.25 0.001", "0.25"), (10, 1));
        assert_eq!(rxt("0.25 0.001", "0.25 0.001 7"), (10, 21));
        assert_eq!(rxt("\n3\n", "\n8\n"), (9, 1));
        assert_eq!(rxt("\n3\n", "\nr t x\n"), (9, 5));
        assert_eq!(rxt("\n3\n", "\nL r t r\n"), (9, 7));
        assert_eq!(rxt("\n3\n", "\nL R w\n"), (9, 1));
        assert_eq!(rxt("\n3\n", "\nL r t u w\n"), (10, 1));
    }
}
