//! The stages that this program knows, one row each.

use turbid_contract::{Stage, StageRow};

/// A table of stages by the name that `use:` takes.
#[derive(Clone, Default)]
pub struct Registry {
    rows: Vec<StageRow>,
}

impl Registry {
    /// The stages that turbid ships.
    pub fn builtin() -> Self {
        Self::default()
            .with::<turbid_calibrate::Calibrate>()
            .with::<turbid_chromophores::Chromophores>()
            .with::<turbid_compare::Compare>()
            .with::<turbid_demodulate::Demodulate>()
            .with::<turbid_dis::CalibrateDis>()
            .with::<turbid_iad::CalibrateIad>()
            .with::<turbid_import::ImportFrames>()
            .with::<turbid_import::ImportMaps>()
            .with::<turbid_import::ImportModulation>()
            .with::<turbid_import::ImportReflectance>()
            .with::<turbid_invert::Invert>()
            .with::<turbid_lut::BuildLut>()
            .with::<turbid_pattern::PatternStage>()
            .with::<turbid_import::PhotonTransfer>()
            .with::<turbid_pattern::Predistort>()
            .with::<turbid_profilometry::Profilometry>()
            .with::<turbid_render::RenderStage>()
            .with::<turbid_scene::SceneStage>()
            .with::<turbid_sensor::Sensor>()
            .with::<turbid_section::SectionTube>()
            .with::<turbid_compare::Summarize>()
            .with::<turbid_compare::Tabulate>()
    }

    /// Adds a stage; one of the same name replaces it.
    #[must_use]
    pub fn with<S: Stage>(mut self) -> Self {
        self.rows.retain(|row| row.name != S::NAME);
        self.rows.push(StageRow::of::<S>());
        self.rows.sort_by_key(|row| row.name);
        self
    }

    pub fn find(&self, name: &str) -> Option<&StageRow> {
        self.rows.iter().find(|row| row.name == name)
    }

    pub fn rows(&self) -> &[StageRow] {
        &self.rows
    }
}
