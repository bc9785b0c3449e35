//! What a plain YAML scalar means: the core schema of YAML 1.2, and the look-alikes that it reads as text.

use serde_json::{Number, Value};
use turbid_contract::quantity::meant_number;

/// The meaning of a plain (unquoted) scalar.
#[derive(Clone, Debug, PartialEq)]
pub enum Plain {
    Null,
    Bool(bool),
    Number(Number),
    /// `.nan`, `.inf`, or a number beyond the range of a double.
    NotFinite,
    Text,
}

/// Reads a plain scalar. Integers stay integers where they fit 64 bits.
pub fn plain(text: &str) -> Plain {
    match text {
        "" | "~" | "null" | "Null" | "NULL" => return Plain::Null,
        "true" | "True" | "TRUE" => return Plain::Bool(true),
        "false" | "False" | "FALSE" => return Plain::Bool(false),
        _ => {}
    }
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
    match unsigned {
        ".inf" | ".Inf" | ".INF" => return Plain::NotFinite,
        ".nan" | ".NaN" | ".NAN" if unsigned == text => return Plain::NotFinite,
        _ => {}
    }
    if !unsigned.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return Plain::Text;
    }
    for (prefix, radix) in [("0x", 16), ("0o", 8)] {
        if let Some(digits) = text.strip_prefix(prefix) {
            return match u64::from_str_radix(digits, radix) {
                Ok(n) if !digits.starts_with('+') => Plain::Number(n.into()),
                _ => Plain::Text,
            };
        }
    }
    if unsigned.bytes().all(|b| b.is_ascii_digit()) {
        if let Ok(n) = text.parse::<u64>() {
            return Plain::Number(n.into());
        }
        match text.parse::<i64>() {
            // -0 is the same number as 0.
            Ok(n) => return Plain::Number(n.into()),
            Err(_) => return float(text),
        }
    }
    if is_decimal(unsigned) { float(text) } else { Plain::Text }
}

fn float(text: &str) -> Plain {
    match text.parse::<f64>().ok().and_then(Number::from_f64) {
        Some(n) => Plain::Number(n),
        None => Plain::NotFinite,
    }
}

/// `digits [. digits] [e [sign] digits]` with a digit on at least one side of the point.
fn is_decimal(unsigned: &str) -> bool {
    let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, Some(exponent)),
        None => (unsigned, None),
    };
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let exponent_holds = exponent.is_none_or(|e| {
        let e = e.strip_prefix(['+', '-']).unwrap_or(e);
        !e.is_empty() && digits(e)
    });
    digits(whole) && digits(fraction) && !(whole.is_empty() && fraction.is_empty()) && exponent_holds
}

/// The way out where text was probably meant as a number (`1_000`, `1e`, `0,5`, `NaN`) or as a boolean (`yes`).
pub fn look_alike(text: &str, wants_bool: bool) -> Option<String> {
    let reads = |as_what: &str| Some(format!("YAML reads `{text}` as text; write {as_what}"));
    match text.to_ascii_lowercase().as_str() {
        "yes" | "on" if wants_bool => return reads("`true`"),
        "no" | "off" if wants_bool => return reads("`false`"),
        "nan" | "inf" | "+inf" | "-inf" | "infinity" => return Some("numbers must be finite".to_owned()),
        _ => {}
    }
    if text.len() > 40 || !text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) {
        return None;
    }
    if matches!(plain(text), Plain::Number(_)) {
        return Some(format!("write `{text}` without quotes"));
    }
    if let Some(meant) = meant_number(text) {
        return reads(&format!("`{meant}`"));
    }
    let tried = [
        text.replace(['\'', ' '], ""),
        text.trim_end_matches(['e', 'E', '+', '-']).to_owned(),
        text.replace(['d', 'D'], "e"),
    ];
    let meant = tried.into_iter().find(|t| t != text && matches!(plain(t), Plain::Number(_)))?;
    reads(&format!("`{meant}`"))
}

/// 2.0 and 2 are one value of an axis, and -0.0 is 0: whole numbers become integers.
pub fn normal(n: &Number) -> Value {
    const EXACT: f64 = 9_007_199_254_740_992.0;
    match n.as_f64() {
        Some(x) if n.is_f64() && x == x.trunc() && x.abs() <= EXACT => Value::from(x as i64),
        _ => Value::Number(n.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_scalars_have_the_types_of_yaml_1_2() {
        let int = |n: i64| Plain::Number(n.into());
        let float = |x: f64| Plain::Number(Number::from_f64(x).unwrap());
        for (text, meaning) in [
            ("", Plain::Null),
            ("~", Plain::Null),
            ("true", Plain::Bool(true)),
            ("yes", Plain::Text),
            ("0", int(0)),
            ("-0", int(0)),
            ("+7", int(7)),
            ("007", int(7)),
            ("-12", int(-12)),
            ("0x1F", int(31)),
            ("0o17", int(15)),
            ("0x", Plain::Text),
            ("18446744073709551615", Plain::Number(u64::MAX.into())),
            ("18446744073709551616", float(18446744073709551616.0)),
            ("1.0", float(1.0)),
            (".5", float(0.5)),
            ("5.", float(5.0)),
            ("1e3", float(1000.0)),
            ("-2.5E-3", float(-0.0025)),
            ("1e", Plain::Text),
            ("1_000", Plain::Text),
            (".", Plain::Text),
            ("1.2.3", Plain::Text),
            ("-", Plain::Text),
            ("e5", Plain::Text),
            ("nan", Plain::Text),
            (".nan", Plain::NotFinite),
            ("-.inf", Plain::NotFinite),
            ("1e999", Plain::NotFinite),
            ("2 mm", Plain::Text),
        ] {
            assert_eq!(plain(text), meaning, "{text}");
        }
    }

    #[test]
    fn look_alikes_get_a_way_out() {
        for (text, way_out) in [
            ("1_000", Some("`1000`")),
            ("1e", Some("`1`")),
            ("0,5", Some("`0.5`")),
            ("1,000,000", Some("`1000000`")),
            ("0,5 mm", Some("`0.5 mm`")),
            ("64", Some("`64` without quotes")),
            ("1d-3", Some("`1e-3`")),
            ("yes", Some("`true`")),
            ("Off", Some("`false`")),
            ("NaN", Some("finite")),
            ("2 mm", None),
            ("tissue", None),
            ("", None),
        ] {
            let found = look_alike(text, true);
            match way_out {
                Some(w) => assert!(found.as_deref().is_some_and(|f| f.contains(w)), "{text}: {found:?}"),
                None => assert_eq!(found, None, "{text}"),
            }
        }
    }
}
