//! The figures that stages measure of themselves: of their error, and of what they know nothing.

use crate::brief::{ERROR, Measure, UNKNOWN};

use super::figures::{short, with_unit};

/// What the measures of a stage's instances say of their error: of each unit the first that an instance measured, the worst of all of them; then of
/// how much nothing is known.
pub fn errors<'a>(instances: impl Iterator<Item = &'a [Measure]>) -> String {
    let mut worst: Vec<(&str, &str, f64)> = Vec::new();
    let mut unknown: Vec<(&str, f64)> = Vec::new();
    for measures in instances {
        let mut own: Vec<&str> = Vec::new();
        for (name, value, unit) in measures {
            if let Some(what) = name.strip_prefix(ERROR)
                && !own.contains(&unit.as_str())
            {
                own.push(unit);
                match worst.iter_mut().find(|(_, known, _)| known == unit) {
                    None => worst.push((what, unit, *value)),
                    Some(known) if *value > known.2 => *known = (what, unit, *value),
                    Some(_) => {}
                }
            } else if let Some(what) = name.strip_prefix(UNKNOWN) {
                match unknown.iter_mut().find(|(known, _)| *known == what) {
                    None => unknown.push((what, *value)),
                    Some(known) => known.1 += value,
                }
            }
        }
    }
    let worst = worst.into_iter().map(|(what, unit, value)| {
        // Two decimals, but for what they would show as next to nothing.
        let number = if value == 0.0 || value >= 0.01 { format!("{value:.2}") } else { short(value) };
        format!("{} {what}", with_unit(&number, unit))
    });
    worst.chain(unknown.into_iter().map(|(what, count)| format!("{what}: {count}"))).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of maps and heights both are told, each the worst of all instances in its own unit; a small error is not 0.00, and nothing known is said.
    #[test]
    fn errors_are_told_in_their_units() {
        let measures = |own: &[(&str, f64, &str)]| -> Vec<Measure> {
            own.iter().map(|&(name, value, unit)| (name.to_owned(), value, unit.to_owned())).collect()
        };
        let instances = [
            measures(&[
                ("error: worst bias", 2.5, "%"),
                ("error: other", 90.0, "%"),
                ("error: worst RMSE", 1.87, "mm"),
            ]),
            measures(&[("error: worst bias", 12.5, "%"), ("unknown: media without a fit", 2.0, "1")]),
            measures(&[("masked", 100.0, "%"), ("unknown: media without a fit", 3.0, "1")]),
        ];
        let said = |instances: &[Vec<Measure>]| errors(instances.iter().map(Vec::as_slice));
        assert_eq!(said(&instances), "12.50 % worst bias, 1.87 mm worst RMSE, media without a fit: 5");
        assert_eq!(said(&instances[2..]), "media without a fit: 3");
        assert_eq!(said(&[measures(&[("error: worst RMSE", 0.00412, "mm")])]), "0.0041 mm worst RMSE");
        assert_eq!(said(&[measures(&[("error: rest", 0.0, "1")])]), "0.00 rest");
        assert_eq!(said(&[measures(&[("masked", 1.0, "%")])]), "");
    }
}
