//! The field's notation for the names, numbers and units of layers.

use turbid_contract::LayerInfo;

use super::number::plain;
use super::text::Text;

/// Endings of names and what a reader sees.
const ROLES: [(&str, &str); 10] = [
    ("_error_percent", "relative error of "),
    ("_bias_percent", "bias of "),
    ("_relative_error", "relative error of "),
    ("_error", "error of "),
    ("_bias", "bias of "),
    ("_difference", "difference of "),
    ("_estimate", "estimate of "),
    ("_truth", "true "),
    ("_true", "true "),
    ("_se", "standard error of "),
];

/// The quantity that a layer is about: `mu_a` of `mu_a`, `mu_a_se`, `mu_a_truth`, `mu_a_error`.
pub fn base(name: &str) -> &str {
    ROLES.iter().find_map(|(ending, _)| name.strip_suffix(ending)).unwrap_or(name)
}

/// Whether the layer is a difference, from the truth or between two results, whose natural middle is zero.
pub fn is_error(name: &str) -> bool {
    ROLES[..6].iter().any(|(ending, _)| name.ends_with(ending))
}

/// Whether the layer holds what should have been found, which no table has touched.
pub fn is_truth(name: &str) -> bool {
    name.ends_with("_truth") || name.ends_with("_true")
}

/// Name of a quantity, as `μ_a` or `true μ_s′`.
pub fn quantity(name: &str) -> Text {
    if let Some((base, said)) = ROLES.iter().find_map(|(ending, said)| Some((name.strip_suffix(ending)?, said))) {
        return Text::plain(*said).join(quantity(base));
    }
    match name {
        "mu_a" => Text::symbol("μ").sub("a"),
        "mu_s" => Text::symbol("μ").sub("s"),
        "mu_s_prime" => Text::symbol("μ").sub("s").then("′"),
        "mu_eff" => Text::symbol("μ").sub("eff"),
        "r_d" => Text::symbol("R").sub("d"),
        "m_dc" => Text::symbol("M").sub("DC"),
        "m_ac" => Text::symbol("M").sub("AC"),
        "f_x" => Text::symbol("f").sub("x"),
        "normal_x" => Text::plain("normal ").join(Text::symbol("n").sub("x")),
        "normal_y" => Text::plain("normal ").join(Text::symbol("n").sub("y")),
        "normal_z" => Text::plain("normal ").join(Text::symbol("n").sub("z")),
        other => Text::plain(other.replace('_', " ")),
    }
}

/// A unit with its powers raised: `W mm⁻² sr⁻¹`; empty for pure numbers.
pub fn unit(unit: &str) -> Text {
    let mut text = Text::new();
    let mut rest = if unit == "1" { "" } else { unit };
    while let Some((before, after)) = rest.split_once('^') {
        let end = after.find(|c: char| !(c.is_ascii_digit() || c == '-' || c == '+')).unwrap_or(after.len());
        text = text.then(before).sup(after[..end].replace('-', "−"));
        rest = &after[end..];
    }
    text.then(rest)
}

/// ` (unit)` behind a quantity; empty for pure numbers.
pub fn in_unit(unit_name: &str) -> Text {
    let unit = unit(unit_name);
    if unit.is_empty() { unit } else { Text::plain(" (").join(unit).then(")") }
}

/// `f_x = 0.1 mm⁻¹`.
pub fn f_x(per_mm: f64) -> Text {
    quantity("f_x").then(format!(" = {} mm", plain(per_mm))).sup("−1")
}

/// What tells a layer from others of its name: spatial frequency, phase, orientation, wavelength.
pub fn particulars(info: &LayerInfo) -> Text {
    let degrees = |rad: f64| plain((rad * (180.0 / std::f64::consts::PI) * 100.0).round() / 100.0);
    let parts = [
        info.f_x_per_mm.map(f_x),
        // Where the fringe has no frequency its phase says nothing.
        info.phase_rad
            .filter(|_| info.f_x_per_mm != Some(0.0))
            .map(|p| Text::symbol("φ").then(format!(" = {}°", degrees(p)))),
        info.orientation_deg.filter(|d| *d != 0.0).map(|d| Text::symbol("θ").then(format!(" = {}°", plain(d)))),
        info.wavelength_nm.map(|w| Text::symbol("λ").then(format!(" = {} nm", plain(w)))),
    ];
    let joined = parts.into_iter().flatten().reduce(|all, part| all.then(", ").join(part));
    joined.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_units_read_as_in_the_literature() {
        for (name, seen) in [
            ("mu_a", "μa"),
            ("mu_s_prime_se", "standard error of μs′"),
            ("mu_a_truth", "true μa"),
            ("mu_a_error_percent", "relative error of μa"),
            ("r_d", "Rd"),
            ("noise_gain", "noise gain"),
        ] {
            assert_eq!(quantity(name).letters(), seen);
        }
        assert_eq!(unit("W mm^-2 sr^-1").letters(), "W mm−2 sr−1");
        assert_eq!(unit("mm^2"), Text::new().then("mm").sup("2").then(""));
        assert!(in_unit("1").is_empty() && in_unit("").is_empty());
        let mut info = LayerInfo::value("radiance", "1").with_f_x(0.1);
        info.phase_rad = Some(2.0 * std::f64::consts::PI / 3.0);
        info.wavelength_nm = Some(650.0);
        assert_eq!(particulars(&info).letters(), "fx = 0.1 mm−1, φ = 120°, λ = 650 nm");
    }

    #[test]
    fn roles_belong_to_their_quantity() {
        assert!(["mu_a", "mu_a_se", "mu_a_truth", "mu_a_estimate", "mu_a_error"].iter().all(|n| base(n) == "mu_a"));
        assert!(is_truth("mu_a_truth") && !is_truth("mu_a") && !is_truth("mu_a_error"));
        assert!(is_error("mu_a_error") && !is_error("mu_a_truth") && !is_error("mu_a_se"));
    }
}
