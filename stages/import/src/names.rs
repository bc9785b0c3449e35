//! Names of files by a pattern: what stands between braces is put in.

/// The name of a file without its folders: where files lie does not matter, their content and names are in the key.
pub fn base(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned()
}

/// The place in a list that a field such as `darks.3.file` means.
pub fn place_in(at: &str, list: &str) -> Option<usize> {
    at.strip_prefix(list)?.strip_prefix('.')?.split('.').next()?.parse().ok()
}

/// What a file shows, and which it is.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub f_x: f64,
    pub f_x_index: usize,
    pub phase: u32,
    pub phases: u32,
    pub wavelength_nm: Option<f64>,
    pub wavelength_index: usize,
    /// Of all files.
    pub n: usize,
}

/// What a pattern may hold.
pub const KNOWN: &str = "known: {f_x}, {f_x_index}, {phase}, {phase_deg}, {wavelength} (or {wavelength_nm}), {wavelength_index} and {n}; counts as {phase:1} (from 1) or {n:02} (two digits)";

/// The name of a file.
///
/// Error: something between braces that is not known.
pub fn fill(pattern: &str, place: &Place) -> Result<String, String> {
    let mut name = String::new();
    let mut rest = pattern;
    while let Some((before, from)) = rest.split_once('{') {
        let (inside, behind) = from.split_once('}').ok_or("a `{` without its `}`")?;
        name.push_str(before);
        name.push_str(&value(inside, place)?);
        rest = behind;
    }
    Ok(name + rest)
}

fn value(inside: &str, place: &Place) -> Result<String, String> {
    let (name, format) = inside.split_once(':').map_or((inside, None), |(name, format)| (name, Some(format)));
    let count = match name {
        "f_x_index" => place.f_x_index,
        "phase" => place.phase as usize,
        "wavelength_index" => place.wavelength_index,
        "n" => place.n,
        _ => {
            let number = match name {
                "f_x" => place.f_x,
                // Degrees to a millionth: thirds of a turn are no round numbers.
                "phase_deg" => (1e6 * 360.0 * f64::from(place.phase) / f64::from(place.phases)).round() / 1e6,
                "wavelength" | "wavelength_nm" => place.wavelength_nm.unwrap_or(0.0),
                _ => return Err(format!("nothing stands for {{{inside}}}")),
            };
            return match format {
                None => Ok(number.to_string()),
                Some(_) => Err(format!("{{{inside}}} is no count, and is written as it stands in the params")),
            };
        }
    };
    // DIGITS with a zero before them, a first number, or both: 02, 1, 02+1.
    let format = format.unwrap_or("0");
    let (digits, first) = match format.split_once('+') {
        Some((digits, first)) => (digits, first),
        None if format.len() > 1 && format.starts_with('0') => (format, "0"),
        None => ("0", format),
    };
    let numbers = digits.parse::<usize>().ok().zip(first.parse::<usize>().ok()).filter(|(digits, _)| *digits <= 20);
    let (digits, first) = numbers.ok_or_else(|| format!("`{format}` in {{{inside}}} is no way to write a count"))?;
    let count = count + first;
    Ok(format!("{count:0digits$}"))
}

/// Whether one of these is in a pattern.
pub fn has(pattern: &str, names: &[&str]) -> bool {
    let inside = pattern.split('{').skip(1).filter_map(|part| part.split_once('}')).map(|(inside, _)| inside);
    inside.map(|inside| inside.split(':').next().unwrap_or(inside)).any(|name| names.contains(&name))
}

/// Whether files of different phases have different names.
pub fn has_phase(pattern: &str) -> bool {
    has(pattern, &["phase", "phase_deg", "n"])
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Place =
        Place { f_x: 0.1, f_x_index: 1, phase: 2, phases: 3, wavelength_nm: Some(659.5), wavelength_index: 4, n: 17 };

    #[test]
    fn patterns_are_filled() {
        for (pattern, name) in [
            ("a_{f_x}_{phase}.tif", "a_0.1_2.tif"),
            ("{wavelength}/{wavelength_nm}", "659.5/659.5"),
            ("{phase:1}{f_x_index}{wavelength_index:1}", "315"),
            ("{phase_deg}", "240"),
            ("{n:04}.png", "0017.png"),
            ("{n:04+1}.png", "0018.png"),
            ("{n:1}", "18"),
            ("plain", "plain"),
        ] {
            assert_eq!(fill(pattern, &PLACE).as_deref(), Ok(name), "{pattern}");
        }
        let seventh = Place { phase: 1, phases: 7, ..PLACE };
        assert_eq!(fill("{phase_deg}", &seventh).as_deref(), Ok("51.428571"));
        assert!(has_phase("{n:03}.tif") && has_phase("{phase:1}") && !has_phase("{f_x}_{wavelength_index}"));
    }

    #[test]
    fn what_is_not_known_is_named() {
        for (pattern, said) in [
            ("{phi}", "nothing stands for {phi}"),
            ("{f_x", "a `{` without"),
            ("{f_x:02}", "is no count"),
            ("{n:x}", "is no way to write a count"),
            ("{n:099}", "is no way"),
        ] {
            assert!(fill(pattern, &PLACE).unwrap_err().contains(said), "{pattern}");
        }
    }
}
