//! Why a pixel has no value.

/// Reasons in mask layers; 0 is a good pixel, a masked pixel holds 0 in every value layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MaskReason {
    Good = 0,
    /// The camera ray meets no object.
    Background = 1,
    /// The signal is not distinguishable from noise, or from zero.
    LowSignal = 2,
    /// The reference's signal is too weak to calibrate with.
    LowReference = 3,
    /// The reflectance lies outside the table: too dark.
    BelowTable = 4,
    /// The reflectance lies outside the table: too bright.
    AboveTable = 5,
    /// The modulation R_ac / R_dc lies outside the table.
    ModulationOutsideTable = 6,
    /// More than one pair of properties has this reflectance.
    Ambiguous = 7,
    /// A frame is saturated.
    Saturated = 8,
    /// An input is not a finite number.
    NotFinite = 9,
    /// The geometry gives no height: near a pole, at a grazing angle, or behind camera or projector.
    NoHeight = 10,
    /// The phase is none that the reference shows inside the image.
    OutsideReference = 11,
    /// The fringes are finer than the projector's pixels can show.
    BeyondProjector = 12,
    /// The surface belongs to no section.
    OutsideSections = 13,
    /// No medium explains the readings.
    NoFit = 14,
    /// The surface is turned too far away from projector or camera.
    TooSteep = 15,
    /// Lit or looked at in another way than the table takes for granted.
    OtherConditions = 16,
}

impl MaskReason {
    pub const ALL: [MaskReason; 17] = [
        Self::Good,
        Self::Background,
        Self::LowSignal,
        Self::LowReference,
        Self::BelowTable,
        Self::AboveTable,
        Self::ModulationOutsideTable,
        Self::Ambiguous,
        Self::Saturated,
        Self::NotFinite,
        Self::NoHeight,
        Self::OutsideReference,
        Self::BeyondProjector,
        Self::OutsideSections,
        Self::NoFit,
        Self::TooSteep,
        Self::OtherConditions,
    ];

    /// The value in the mask layer.
    pub fn code(self) -> f32 {
        self as u8 as f32
    }

    /// What the legend of a picture says.
    pub fn text(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Background => "background",
            Self::LowSignal => "signal too weak",
            Self::LowReference => "reference too weak",
            Self::BelowTable => "darker than the table",
            Self::AboveTable => "brighter than the table",
            Self::ModulationOutsideTable => "modulation outside the table",
            Self::Ambiguous => "ambiguous",
            Self::Saturated => "saturated",
            Self::NotFinite => "not a number",
            Self::NoHeight => "no height from this geometry",
            Self::OutsideReference => "outside the reference",
            Self::BeyondProjector => "finer than the projector's pixels",
            Self::OutsideSections => "outside the sections",
            Self::NoFit => "no fit",
            Self::TooSteep => "surface too steep",
            Self::OtherConditions => "conditions unlike the table's",
        }
    }
}
