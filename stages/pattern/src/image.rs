//! Pictures from files, shown as they are.

use std::f64::consts::TAU;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::Picture;
use turbid_contract::{AngleDeg, FileUse, LayerInfo, MaxFile, PerLength, Problems};
use turbid_geometry::picture;

/// Pictures in place of fringes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// PNG, grey, 8 or 16 bit, all of one size: a layer each. They cover the projector's field, with as many pixels as they have.
    pub files: Vec<String>,
    /// Where they show a fringe in equal steps of its phase: its spatial frequency, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_x: Option<PerLength>,
    /// Of that fringe: the direction in which it varies, turned from world x towards world y.
    #[serde(default)]
    pub orientation_deg: AngleDeg,
    /// Light = (grey value / highest grey value)^gamma; 1 where left out.
    #[serde(default = "linear")]
    pub gamma: f64,
}

fn linear() -> f64 {
    1.0
}

impl Image {
    pub fn uses(&self, max: MaxFile) -> impl Iterator<Item = FileUse> {
        self.files.iter().enumerate().map(move |(i, path)| FileUse::new(at(i), path.as_str(), max))
    }

    /// Reports what is wrong with params and files; columns and rows of the pictures, where they have one size.
    pub fn check(&self, file: impl Fn(&str) -> Option<Arc<[u8]>>, problems: &mut Problems) -> Option<[u32; 2]> {
        if self.files.is_empty() {
            problems.push_with_hint("image.files", "files is empty: nothing would be shown", "list at least one PNG");
        }
        problems.require(self.gamma > 0.0 && self.gamma <= 10.0, "image.gamma", self.gamma, "", "lie in (0, 10]");
        if let Some(f) = self.f_x {
            problems.require(f.0 > 0.0, "image.f_x", f.0, "mm^-1", "be > 0");
            if self.files.len() < 3 {
                let files = self.files.len();
                problems.push_with_hint(
                    "image.files",
                    format!("{files} phases do not fix mean, amplitude and phase of a fringe of f_x = {f} mm^-1"),
                    "list a picture for each of three or more equal steps of its phase, or leave f_x out",
                );
            }
        }
        let turn = self.orientation_deg.0;
        problems.require(turn.abs() <= 360.0, "image.orientation_deg", turn, "deg", "lie in [-360, 360]");
        let mut first: Option<(&String, [u32; 2])> = None;
        let mut alike = true;
        for (i, path) in self.files.iter().enumerate() {
            let Some(bytes) = file(&at(i)) else { continue };
            match (picture::read(&bytes), first) {
                (Err(what), _) => problems.push(at(i), format!("`{path}`: {what}")),
                (Ok(Picture { columns, rows, .. }), None) => first = Some((path, [columns, rows])),
                (Ok(Picture { columns, rows, .. }), Some((other, [c, r]))) if [columns, rows] != [c, r] => {
                    alike = false;
                    problems.push(at(i), format!("`{path}` has {columns} x {rows} pixels, `{other}` has {c} x {r}"));
                }
                (Ok(_), Some(_)) => {}
            }
        }
        first.filter(|_| alike).map(|(_, size)| size)
    }

    /// What the layer of each file says.
    pub fn infos(&self) -> impl Iterator<Item = LayerInfo> {
        let count = self.files.len() as f64;
        (0..self.files.len()).map(move |i| {
            let info = LayerInfo::value("pattern", "1");
            let Some(f) = self.f_x else { return info };
            let mut info = info.with_f_x(f.0);
            (info.phase_rad, info.orientation_deg) = (Some(TAU * i as f64 / count), Some(self.orientation_deg.0));
            info
        })
    }

    /// Light of each pixel, in [0, 1].
    pub fn values(&self, picture: &Picture) -> Vec<f32> {
        let light = |grey: &u16| libm::pow(f64::from(*grey) / f64::from(u16::MAX), self.gamma) as f32;
        picture.grey.iter().map(light).collect()
    }
}

/// The field that names a file.
pub fn at(i: usize) -> String {
    format!("image.files.{i}")
}
