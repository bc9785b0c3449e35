//! `.rxt`: files of the program `iad` (Prahl), header and rows.
//!
//! The line `IAD1` and eighteen numbers, in this order and on any lines: index of sample and slides, thickness of sample and
//! slides (mm), diameter of the beam (mm), reflectance of the standard, number of spheres; diameters of the sphere and of its
//! sample, third (entrance) and detector port (mm) and the reflectance of its wall, of the reflectance and of the transmittance
//! sphere. Then either the number of readings, 1 to 7 of M_R, M_T, M_U, r_wall (both spheres), r_wall of the transmittance
//! sphere, standards of reflectance and of transmittance; or a line of letters, one for each column:
//!
//! | | | | |
//! |---|---|---|---|
//! | `r` `t` `u` | M_R, M_T, M_U | `w` `W` | wall of the reflectance and transmittance sphere |
//! | `R` `T` | standards | `c` `C` | share of unscattered reflected, transmitted light that is collected |
//! | `n` `N` | index of sample, slides | `d` `D` | thickness of sample, slides, mm |
//! | `B` | diameter of the beam, mm | `i` | angle of the beam from the normal, degrees |
//! | `a` `b` | albedo, optical thickness that are known | `A` `F` | mu_a, mu_s that are known, mm^-1 |
//! | `g` | anisotropy | `E` | optical thickness of each slide's absorption |
//! | `L` | wavelength | `S` `M` | number of spheres |
//! | `e` `q` | tolerance and quadrature points of that program: read and not used | | |
//!
//! Rows follow, whole rows on each line; before numbered readings a first number above 1 is a wavelength (nm). `#` begins a
//! comment. A slide of thickness 0 or index 1 or 0 is none. M_T = 0 and M_U = 0 mean that it was not measured.

use super::{FileError, Header, MOST_ROWS, Sheet, bounded, number, too_long, wrong};
use crate::spheres::{Instrument, Sphere, Spheres};

/// A number of the file and where it stands.
#[derive(Clone, Copy)]
struct Word<'a> {
    line: usize,
    column: usize,
    text: &'a str,
}

/// The letters of columns and what the sheet calls them.
const LETTERS: [(char, &str); 26] = [
    ('a', "albedo"),
    ('A', "mu_a"),
    ('b', "optical_thickness"),
    ('B', "beam"),
    ('c', "unscattered_r"),
    ('C', "unscattered_t"),
    ('d', "thickness"),
    ('D', "slide_thickness"),
    ('e', "tolerance"),
    ('E', "slide_tau"),
    ('F', "mu_s"),
    ('g', "g"),
    ('i', "angle"),
    ('L', "wavelength"),
    ('M', "spheres"),
    ('n', "n"),
    ('N', "n_slides"),
    ('q', "points"),
    ('r', "m_r"),
    ('R', "r_standard"),
    ('S', "spheres"),
    ('t', "m_t"),
    ('T', "t_standard"),
    ('u', "m_u"),
    ('w', "wall_r"),
    ('W', "wall_t"),
];

/// Numbered readings, in their order.
const NUMBERED: [&str; 7] = ["m_r", "m_t", "m_u", "wall_r", "wall_t", "r_standard", "t_standard"];

/// An `.rxt` file: see the head of this module.
pub fn read_rxt(bytes: &[u8]) -> Result<Sheet, FileError> {
    let bytes = bounded(bytes)?;
    // Comments may be in any encoding; what is no number is named where it stands.
    let text = String::from_utf8_lossy(bytes);
    let lines = lines(&text);
    let opens = lines.first().and_then(|line| line.strip_prefix("IAD1"));
    if !opens.is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '\t', '#'])) {
        return wrong(1, 1, "an .rxt file opens with the line IAD1");
    }
    let words: Vec<Word<'_>> = lines.iter().enumerate().flat_map(|(i, line)| words(i + 1, line)).skip(1).collect();
    let mut reader = Reader { words: &words, next: 0, end: lines.len() + 1 };
    let (header, instrument_places) = header(&mut reader)?;
    let (names, legend) = legend(&mut reader)?;
    let mut sheet = Sheet::default();
    rows(&mut reader, &names, legend, &mut sheet)?;
    if sheet.media.is_empty() {
        return wrong(reader.end, 1, "no row of readings follows the header");
    }
    instrument_places.check(&header, &sheet)?;
    sheet.header = Some(header);
    Ok(sheet)
}

/// Lines that end in LF, CR LF or CR.
fn lines(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(end) = rest.find(['\n', '\r']) {
        found.push(&rest[..end]);
        rest = rest[end..].strip_prefix("\r\n").unwrap_or(&rest[end + 1..]);
    }
    if !rest.is_empty() {
        found.push(rest);
    }
    found
}

/// What stands on a line before its comment.
fn words(line: usize, text: &str) -> Vec<Word<'_>> {
    let text = text.split('#').next().unwrap_or_default();
    let mut found = Vec::new();
    let mut column = 1;
    for word in text.split(char::is_whitespace) {
        if !word.is_empty() {
            found.push(Word { line, column, text: word });
        }
        column += word.chars().count() + 1;
    }
    found
}

struct Reader<'a> {
    words: &'a [Word<'a>],
    next: usize,
    end: usize,
}

/// A number with its place.
type Placed = (f64, (usize, usize));

impl<'a> Reader<'a> {
    fn peek(&self) -> Option<Word<'a>> {
        self.words.get(self.next).copied()
    }

    fn take(&mut self) -> Option<Word<'a>> {
        let word = self.peek();
        self.next += usize::from(word.is_some());
        word
    }

    fn number(&mut self, name: &str) -> Result<Placed, FileError> {
        match self.take() {
            Some(Word { line, column, text }) => Ok((number(text, line, column, name)?, (line, column))),
            None => wrong(self.end, 1, format!("the file ends where {name} should stand")),
        }
    }

    fn ruled(&mut self, name: &str, holds: impl Fn(f64) -> bool, rule: &str) -> Result<f64, FileError> {
        let (value, at) = self.number(name)?;
        ruled(name, value, at, holds(value), rule)
    }
}

fn ruled(name: &str, value: f64, at: (usize, usize), holds: bool, rule: &str) -> Result<f64, FileError> {
    if holds { Ok(value) } else { wrong(at.0, at.1, format!("{name} = {value} must {rule}")) }
}

/// Where the numbers of the spheres stand: they count only if spheres are used.
struct Places([[Placed; 5]; 2]);

const SPHERES: [&str; 2] = ["reflectance sphere", "transmittance sphere"];
const OF_SPHERE: [&str; 5] = ["diameter", "sample port", "third port", "detector port", "wall reflectance"];

fn header(reader: &mut Reader<'_>) -> Result<(Header, Places), FileError> {
    let n_sample = reader.ruled("n_sample", |x| x >= 1.0, "be an index >= 1")?;
    let n_slides = reader.ruled("n_slides", |x| x >= 1.0 || x == 0.0, "be an index >= 1, or 0 for no slides")?;
    let thickness_mm = reader.ruled("sample thickness", |x| x > 0.0, "be > 0 mm")?;
    let slide_mm = reader.ruled("slide thickness", |x| x >= 0.0, "be >= 0 mm")?;
    let beam_mm = reader.ruled("beam diameter", |x| x >= 0.0, "be >= 0 mm")?;
    let r_standard = reader.ruled("reflectance of the standard", |x| x > 0.0 && x <= 1.0, "lie in (0, 1]")?;
    let count = reader.ruled("number of spheres", |x| [0.0, 1.0, 2.0].contains(&x), "be 0, 1 or 2")?;
    let mut places = [[(0.0, (0, 0)); 5]; 2];
    for (sphere, of) in SPHERES.iter().zip(&mut places) {
        for (what, place) in OF_SPHERE.iter().zip(of) {
            *place = reader.number(&format!("{what} of the {sphere}"))?;
        }
    }
    let pair = places.map(|of| {
        let [diameter, sample, third, detector, wall] = of.map(|(value, _)| value);
        Sphere::with_round_ports(diameter, sample, third, detector, wall)
    });
    let spheres = match count as usize {
        1 => Spheres::One(pair),
        2 => Spheres::Two(pair),
        _ => Spheres::None,
    };
    let header = Header {
        n_sample,
        n_slides: if slide_mm == 0.0 || n_slides == 0.0 { 1.0 } else { n_slides },
        thickness_mm,
        slide_mm,
        beam_mm,
        ports_mm: places.map(|of| of[1].0),
        pair,
        instrument: Instrument { spheres, r_standard, ..Instrument::NONE },
    };
    Ok((header, Places(places)))
}

impl Places {
    /// Spheres that are used are ones that can be.
    fn check(&self, header: &Header, sheet: &Sheet) -> Result<(), FileError> {
        let used = sheet
            .column("spheres")
            .map_or(header.instrument.spheres != Spheres::None, |c| c.iter().any(|&count| count > 0.0));
        if !used {
            return Ok(());
        }
        // A sphere that has no reading may be anything.
        let read = [sheet.column("m_r"), sheet.column("m_t")].map(|c| c.is_some_and(|c| c.iter().any(|&m| m != 0.0)));
        let two = matches!(header.instrument.spheres, Spheres::Two(_))
            || sheet.column("spheres").is_some_and(|c| c.contains(&2.0));
        for (i, sphere) in SPHERES.iter().enumerate().filter(|(i, _)| two || read[*i]) {
            let [(diameter, at), ports @ .., (wall, wall_at)] = self.0[i];
            ruled(&format!("diameter of the {sphere}"), diameter, at, diameter > 0.0, "be > 0 mm")?;
            for ((port, at), name) in ports.into_iter().zip(&OF_SPHERE[1..4]) {
                ruled(&format!("{name} of the {sphere}"), port, at, port >= 0.0, "be >= 0 mm")?;
                // A port is a chord of the sphere: as wide as the sphere it is no port.
                if port >= diameter {
                    let message = format!("a port of {port} mm does not fit the {sphere} of {diameter} mm");
                    return wrong(at.0, at.1, message);
                }
            }
            let name = format!("wall reflectance of the {sphere}");
            ruled(&name, wall, wall_at, (0.0..=1.0).contains(&wall), "lie in [0, 1]")?;
        }
        Ok(())
    }
}

/// Names of the columns; before numbered readings a wavelength may stand.
fn legend(reader: &mut Reader<'_>) -> Result<(Vec<&'static str>, Legend), FileError> {
    let Some(first) = reader.take() else {
        return wrong(reader.end, 1, "the file ends where the number of readings should stand");
    };
    if first.text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) {
        let count = number(first.text, first.line, first.column, "number of readings")?;
        let at = (first.line, first.column);
        let holds = (1.0..=7.0).contains(&count) && count.fract() == 0.0;
        ruled("number of readings", count, at, holds, "be 1 to 7 (M_R, M_T, M_U, r_w, t_w, r_std, t_std)")?;
        return Ok((NUMBERED[..count as usize].to_vec(), Legend::Numbered));
    }
    let mut names = Vec::new();
    let mut word = Some(first);
    while let Some(Word { line, column, text }) = word {
        for (i, letter) in text.chars().enumerate().filter(|(_, c)| *c != '-') {
            let known = LETTERS.iter().find(|l| l.0 == letter);
            let Some((_, name)) = known else {
                let letters: String = LETTERS.iter().map(|l| l.0).collect();
                let message = format!("column `{letter}` is not known; the letters are {letters}");
                return wrong(line, column + i, message);
            };
            if names.contains(name) {
                return wrong(line, column + i, format!("column `{letter}` ({name}) stands twice"));
            }
            names.push(*name);
        }
        word = reader.peek().filter(|next| next.line == line);
        reader.next += usize::from(word.is_some());
    }
    if !["m_r", "m_t", "m_u"].iter().any(|m| names.contains(m)) {
        return wrong(first.line, first.column, "no column holds a reading: one of r, t, u is needed");
    }
    Ok((names, Legend::Letters))
}

#[derive(Clone, Copy, PartialEq)]
enum Legend {
    Numbered,
    Letters,
}

fn rows(reader: &mut Reader<'_>, names: &[&'static str], legend: Legend, sheet: &mut Sheet) -> Result<(), FileError> {
    sheet.columns = names.iter().map(|n| ((*n).to_owned(), Vec::new())).collect();
    let mut wavelengths = Vec::new();
    while let Some(first) = reader.peek() {
        let (row, column) = (first.line, first.column);
        if wavelengths.len() == MOST_ROWS {
            return too_long(row);
        }
        let mut wavelength = None;
        if legend == Legend::Numbered && number(first.text, row, column, "m_r")? > 1.0 {
            wavelength = Some(reader.number("wavelength")?.0);
        }
        for (k, name) in names.iter().enumerate() {
            match reader.take() {
                Some(Word { line, column, text }) if line == row => {
                    sheet.columns[k].1.push(number(text, line, column, name)?);
                }
                _ => return wrong(row, column, format!("a row of {} numbers lacks {name}", names.len())),
            }
        }
        sheet.places.push((row, column));
        wavelengths.push(wavelength);
    }
    let labelled = sheet.column("wavelength").map(<[f64]>::to_vec);
    let named = |i: usize| labelled.as_ref().map(|l| l[i]).or(wavelengths[i]);
    sheet.media = (0..wavelengths.len())
        .map(|i| named(i).map_or_else(|| format!("row {}", i + 1), |wavelength| format!("{wavelength} nm")))
        .collect();
    if let Some(all) = wavelengths.iter().copied().collect::<Option<Vec<f64>>>()
        && legend == Legend::Numbered
    {
        sheet.columns.insert(0, ("wavelength".to_owned(), all));
    }
    // One numbered wall is that of both spheres; the letter w is that of one.
    if legend == Legend::Numbered
        && let (Some(wall), None) = (sheet.column("wall_r"), sheet.column("wall_t"))
    {
        let wall = wall.to_vec();
        sheet.columns.push(("wall_t".to_owned(), wall));
    }
    Ok(())
}
