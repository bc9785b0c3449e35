//! Ways in which what comes on a port can be wrong.

use std::sync::Arc;

use turbid_contract::payload::{Payload, RIG, Rig, Scene};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Form, Known, LayerInfo, LayerKind, Shared};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrong {
    /// One row of pixels more.
    Size,
    /// Twice the spatial frequency.
    Frequency,
    /// Another wavelength.
    Wavelength,
    /// Fringes turned by a quarter.
    Orientation,
    /// All phases the same.
    Phases,
    /// Values in another unit.
    Unit,
    /// No standard errors and covariances.
    Errors,
    /// Quantities of other names.
    Quantity,
    /// Columns of other names.
    Columns,
    Convention,
    G,
    N,
    /// Lit and seen by another rig.
    OtherRig,
    /// A scene with nothing in it: no camera, no projector, no objects.
    Empty,
}

use Wrong::*;

pub const ALL: [Wrong; 14] = [
    Size,
    Frequency,
    Wavelength,
    Orientation,
    Phases,
    Unit,
    Errors,
    Quantity,
    Columns,
    Convention,
    G,
    N,
    OtherRig,
    Empty,
];

impl Wrong {
    /// What is known of the inputs, with `port` made wrong; `None` where it has nothing to be wrong in this way.
    pub fn on(self, port: &str, known: &Known) -> Option<Known> {
        let mut other = known.clone();
        if self == Empty {
            let scene = known.get::<Scene>(port)?;
            let empty = Scene {
                media: Default::default(),
                objects: Default::default(),
                camera: None,
                projector: None,
                lights: Default::default(),
                detectors: Default::default(),
                wavelengths_nm: scene.wavelengths_nm.clone(),
            };
            other.artifacts.insert(port.to_owned(), Shared::new(empty.into_artifact()));
            return Some(other);
        }
        // The fields of a record are read from the record.
        if known.artifacts.contains_key(port) {
            return None;
        }
        let made: Option<Vec<_>> = known.forms(port).iter().map(|form| self.done_to(form).map(Arc::new)).collect();
        other.forms.insert(port.to_owned(), made.filter(|made| !made.is_empty())?);
        Some(other)
    }

    /// The form made wrong; `None` where it has nothing to be wrong in this way.
    fn done_to(self, form: &Form) -> Option<Form> {
        let mut wrong = form.clone();
        let each = |wrong: &mut Form, change: &dyn Fn(&mut LayerInfo)| {
            wrong.layers.iter_mut().flatten().chain(&mut wrong.perhaps).for_each(change);
        };
        match self {
            Size => wrong.pixels.as_mut()?[0] += 1,
            Frequency => {
                each(&mut wrong, &|info| info.f_x_per_mm = info.f_x_per_mm.map(|f_x| 2.0 * f_x));
                if let Some(Value::Array(all)) = wrong.attributes.get_mut("f_x") {
                    all.iter_mut().for_each(|f_x| *f_x = f_x.as_f64().map_or(Value::Null, |f_x| json!(2.0 * f_x)));
                }
            }
            Wavelength => {
                let other = |nm: Option<f64>| nm.map_or(650.0, |nm| nm + 50.0);
                each(&mut wrong, &|info| info.wavelength_nm = Some(other(info.wavelength_nm)));
                if let Some(Value::Array(all)) = wrong.attributes.get_mut("quantities") {
                    all.iter_mut().for_each(|q| q["wavelength_nm"] = json!(other(q["wavelength_nm"].as_f64())));
                }
            }
            Orientation => {
                each(&mut wrong, &|info| {
                    if info.f_x_per_mm.is_some_and(|f_x| f_x > 0.0) {
                        info.orientation_deg = Some(info.orientation_deg.unwrap_or(0.0) + 90.0);
                    }
                });
            }
            Phases => each(&mut wrong, &|info| info.phase_rad = info.phase_rad.map(|_| 0.0)),
            Unit => {
                each(&mut wrong, &|info| {
                    if info.kind != LayerKind::Mask && info.kind != LayerKind::Condition {
                        info.unit += " wrong";
                    }
                });
                wrong.columns.iter_mut().flatten().for_each(|column| column.unit += " wrong");
            }
            Errors => {
                let known = |info: &LayerInfo| !matches!(info.kind, LayerKind::StandardError | LayerKind::Covariance);
                wrong.layers.as_mut()?.retain(known);
            }
            Quantity => {
                each(&mut wrong, &|info| {
                    if info.kind == LayerKind::Value {
                        info.name += "_wrong";
                    }
                });
            }
            Columns => wrong.columns.as_mut()?.iter_mut().for_each(|column| column.name += "_wrong"),
            Convention => set(&mut wrong, "convention", json!("hemispherical_entered"))?,
            G => set(&mut wrong, "g", json!(0.123))?,
            N => set(&mut wrong, "n", json!(1.234))?,
            OtherRig => {
                wrong.attributes.get(RIG)?;
                Rig::named("another bench").insert_into(&mut wrong.attributes);
            }
            Empty => unreachable!("of scenes, above"),
        }
        (wrong != *form).then_some(wrong)
    }
}

fn set(form: &mut Form, name: &str, value: Value) -> Option<()> {
    *form.attributes.get_mut(name)? = value;
    Some(())
}
