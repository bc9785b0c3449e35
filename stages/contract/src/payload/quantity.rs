//! What a payload may hold: layers of images or columns of tables, each with its unit, said once for checks, manual and docs.

use crate::artifact::{Artifact, LayerKind};

/// A layer or a column by its name; standard errors (`NAME_se`) and flags of unknown ones (`NAME_se_unknown`) go without saying.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantity {
    pub name: &'static str,
    /// "1" for pure numbers, "" for text; `None` where the data say it: frames may be radiances or counts.
    pub unit: Option<&'static str>,
    pub about: &'static str,
}

/// A quantity of one unit.
pub const fn quantity(name: &'static str, unit: &'static str, about: &'static str) -> Quantity {
    Quantity { name, unit: Some(unit), about }
}

/// A quantity whose unit the data say.
pub const fn in_own_unit(name: &'static str, about: &'static str) -> Quantity {
    Quantity { name, unit: None, about }
}

/// Reasons against pixels.
pub const MASK: Quantity = quantity("mask", "1", "0 where the pixel is good, else the code of the reason");
/// Covariances of pairs of layers.
pub const COV: Quantity = in_own_unit("cov", "covariance of two quantities, which `pair` names");
/// How pixels were lit and looked at.
pub const VIEW: Quantity = quantity("view_deg", "deg", "between the normal of the surface and the way to the camera");
pub const INCIDENCE: Quantity =
    quantity("incidence_deg", "deg", "between the normal of the surface and the way to the projector");
pub const THICKNESS: Quantity = quantity("thickness", "mm", "of what is seen, along the normal of its surface");

/// What of an artifact its payload does not declare: the first layer or column, with its unit. Payloads that declare nothing hold anything.
pub fn undeclared(holds: &[Quantity], artifact: &Artifact) -> Option<String> {
    if holds.is_empty() {
        return None;
    }
    let known = |name: &str, unit: &str| {
        let of = |q: &Quantity| {
            let rest = name.strip_prefix(q.name);
            let own = rest == Some("");
            let error = matches!(rest, Some("_se" | "_se_unknown"));
            // A covariance has the square of its unit, a flag none.
            own && q.unit.is_none_or(|wanted| wanted == unit)
                || error && (unit == "1" || q.unit.is_none_or(|u| u == unit))
        };
        holds.iter().any(of)
    };
    match artifact {
        Artifact::Images(stack) => {
            let other = |kind: LayerKind, name: &str, unit: &str| kind != LayerKind::Covariance && !known(name, unit);
            let found = stack.layers.iter().map(|l| &l.info).find(|i| other(i.kind, &i.name, &i.unit));
            found.map(|info| format!("layer {} ({})", info.name, info.unit))
        }
        Artifact::Table(table) => {
            let found = table.columns.iter().find(|c| !known(&c.name, &c.unit));
            found.map(|column| format!("column {} ({})", column.name, column.unit))
        }
        Artifact::Record(_) => None,
    }
}
