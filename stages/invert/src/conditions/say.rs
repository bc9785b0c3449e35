//! The words: what differs, by how much it moves the maps, and the way out.

use turbid_contract::payload::{Seen, Thickness};
use turbid_optics::PhaseFunction;
use turbid_optics::misreading::Setting;

use super::{Cause, Compared, by_scene, setting};

/// `-11 %`, `+2.3 %`; beyond a factor of two only that.
pub fn percent(x: f64) -> String {
    let x = 100.0 * x;
    match x {
        x if x > 100.0 => "more than +100 %".to_owned(),
        x if x < -50.0 => format!("{x:.0} % or less"),
        x if x.abs() >= 9.95 => format!("{x:+.0} %"),
        x => format!("{x:+.1} %"),
    }
}

/// What the table takes for granted where nobody said anything; `None` where all is said.
pub fn unsaid(compared: &Compared) -> Option<String> {
    if by_scene(&compared.said) {
        return None;
    }
    let table = &compared.table;
    let all = [
        ("view", format!("view at {:.0} deg to the normal", table.view_deg)),
        ("light", format!("light at {:.0} deg", table.incidence_deg)),
        ("thickness", slab(table.thickness)),
        ("g", table.phase.to_string()),
        ("n", format!("n = {}", table.n)),
    ];
    let said = |name: &str| {
        let seen = compared.said.as_ref().and_then(|said| said.seen.first());
        seen.is_some_and(|seen| match name {
            "view" => seen.view_deg.is_some(),
            "light" => seen.incidence_deg.is_some(),
            "thickness" => seen.thickness.is_some(),
            "g" => seen.phase.is_some(),
            _ => seen.n.is_some(),
        })
    };
    let open: Vec<&(&str, String)> = all.iter().filter(|(name, _)| !said(name)).collect();
    if open.is_empty() {
        return None;
    }
    let (names, assumed): (Vec<&str>, Vec<&str>) = open.iter().map(|(name, text)| (*name, text.as_str())).unzip();
    Some(format!(
        "the frames behind the reflectance do not say their {}; the maps assume what the table is of: {} (state it as `conditions` of import_frames)",
        names.join(", "),
        assumed.join(", ")
    ))
}

fn slab(thickness: Option<f64>) -> String {
    thickness.map_or_else(|| "a half-space".to_owned(), |d| format!("a slab of {} mm", short(d)))
}

fn short(x: f64) -> String {
    let rounded: f64 = format!("{x:.3e}").parse().unwrap_or(x);
    rounded.to_string()
}

fn angles(s: &Setting) -> String {
    format!("seen at {:.0} and lit at {:.0} deg to the normal", s.view_deg, s.incidence_deg)
}

fn what(cause: Cause, s: &Setting) -> String {
    match cause {
        Cause::Angles => angles(s),
        Cause::Thickness => slab(s.thickness),
        Cause::Phase => match s.phase {
            PhaseFunction::HenyeyGreenstein { g } => format!("g = {}", short(g)),
            phase @ PhaseFunction::TwoTermHenyeyGreenstein { .. } => format!("the phase function {phase}"),
        },
        Cause::N => format!("n = {}", short(s.n)),
    }
}

/// The message and the way out; `found` is where it was worked out, and what is read.
pub fn differs(
    compared: &Compared,
    seen: &Seen,
    mu: [f64; 2],
    cause: Cause,
    found: Option<(Setting, [f64; 2])>,
) -> (String, String) {
    let at = found.map_or_else(|| setting(seen, &compared.table), |(at, _)| at);
    let object = if seen.object.is_empty() { "what the frames show".to_owned() } else { format!("`{}`", seen.object) };
    let phantom = compared.reference.as_ref().and_then(|(seen, taken)| {
        let seen = seen.as_ref().filter(|seen| compared.differs(cause, seen, taken.mu, &taken.seen, None))?;
        Some(format!(" (the reference phantom {})", what(cause, &setting(seen, &taken.seen))))
    });
    let effect = match found {
        Some((_, [a, s])) => format!("mu_a reads about {}, mu_s_prime {}", percent(a), percent(s)),
        None => "by how much mu_a and mu_s_prime are off is not known".to_owned(),
    };
    let media = format!("mu_a = {}, mu_s_prime = {} mm^-1", short(mu[0]), short(mu[1]));
    let message = format!(
        "{object} is {}{}, the table is of {}: {effect} (at {media})",
        match cause {
            Cause::Angles | Cause::Thickness => what(cause, &at),
            _ => format!("of {}", what(cause, &at)),
        },
        phantom.unwrap_or_default(),
        match cause {
            Cause::Angles if compared.table.view_deg == 0.0 => "view and light along the normal".to_owned(),
            Cause::Angles => format!("phantoms {}", angles(&compared.table)),
            _ => what(cause, &compared.table),
        }
    );
    let way_out = match cause {
        Cause::Angles => {
            "turn camera and light towards the normal, or take a table of phantoms that were seen the same way (build_lut, `model: empirical`)"
                .to_owned()
        }
        Cause::Thickness => match seen.thickness {
            Some(Thickness::Mm([_, d, _])) => format!("write `thickness: {}` in build_lut, for a sample of even thickness", short(d)),
            _ => "leave `thickness` out of build_lut".to_owned(),
        },
        Cause::Phase => match at.phase {
            PhaseFunction::HenyeyGreenstein { g } => {
                format!("write `g: {}` in build_lut and in the reference of calibrate", short(g))
            }
            PhaseFunction::TwoTermHenyeyGreenstein { .. } => {
                "models of build_lut scatter by one g: take a table of phantoms of this medium (build_lut, `model: empirical`)".to_owned()
            }
        },
        Cause::N => format!("write `n: {}` in build_lut and in the reference of calibrate", short(at.n)),
    };
    (message, way_out)
}
