//! Numbers in text: a row of pixels in each line, with commas, semicolons, tabs or spaces between them (`numpy.savetxt`, `writematrix`).

use super::numbers::Numbers;
use super::{Picture, bounded};

/// Bytes of the beginning that tell what a file is.
const BEGINNING: usize = 256;

/// Whether it begins with numbers in text.
pub fn is(bytes: &[u8]) -> bool {
    let beginning = &bytes[..bytes.len().min(BEGINNING)];
    let number = |b: &u8| b.is_ascii_digit() || b"+-.eE,; \t\r\naANnifIF".contains(b);
    !beginning.is_empty() && beginning.iter().all(number) && beginning.iter().any(u8::is_ascii_digit)
}

/// Columns and rows.
pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?;
    let columns = lines(text).next().map_or(0, |(_, line)| cells(line).count());
    bounded(columns as u64, lines(text).count() as u64)
}

/// Error: lines of different length, or what is no number.
pub fn read(bytes: &[u8]) -> Result<Picture, String> {
    let (columns, rows) = size(bytes)?;
    let text = std::str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?;
    let mut numbers: Vec<f64> = Vec::new();
    for (line, cells_of) in lines(text).map(|(line, text)| (line + 1, cells(text))) {
        let before = numbers.len();
        for (cell, text) in cells_of.enumerate() {
            let number = text.parse().map_err(|_| format!("line {line}, cell {}: `{text}` is no number", cell + 1))?;
            numbers.push(number);
        }
        if numbers.len() - before != columns {
            return Err(format!("line {line} has {} cells, the first has {columns}", numbers.len() - before));
        }
    }
    Picture::whole((columns, rows), Numbers::F64(numbers))
}

/// Those that hold something, with their places.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty())
}

/// Empty ones count only between commas, semicolons or tabs.
fn cells(line: &str) -> Box<dyn Iterator<Item = &str> + '_> {
    match line.find([',', ';', '\t']) {
        Some(at) => {
            let separator = line.as_bytes()[at] as char;
            Box::new(line.split(separator).map(str::trim))
        }
        None => Box::new(line.split_whitespace()),
    }
}
