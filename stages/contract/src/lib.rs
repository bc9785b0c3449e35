//! What stages and the engine agree on: the [`Stage`] trait, ports, artifacts, payload types, [`Ctx`], errors.
//!
//! No physics and no files live here. A stage depends on this crate, on `turbid-optics` and on `turbid-geometry`, on nothing else of
//! turbid; the engine knows stages only through [`StageRow`].

pub mod artifact;
pub mod canonical;
pub mod ctx;
pub mod error;
pub mod extent;
pub mod file;
pub mod fixed;
pub mod form;
pub mod guard;
pub mod head;
pub mod joint;
pub mod kit;
pub mod known;
pub mod layers;
pub mod masked;
pub mod parts;
pub mod payload;
pub mod per_channel;
pub mod pilot;
pub mod pitch;
pub mod planes;
pub mod port;
pub mod problem;
pub mod quantity;
pub mod read;
pub mod shared;
pub mod sharing;
pub mod stage;
pub mod suggest;
pub mod usual;

pub use artifact::{
    Artifact, ArtifactKind, Attributes, Cells, Column, ImageStack, Layer, LayerInfo, LayerKind, Record, Table,
};
pub use ctx::{Ctx, Host};
pub use error::Error;
pub use extent::Extent;
pub use file::{FileUse, Files, MaxFile};
pub use fixed::Fixed;
pub use form::{ColumnInfo, Form, Forms};
pub use head::Head;
pub use kit::MemoryHost;
pub use known::Known;
pub use parts::Parts;
pub use payload::Payload;
pub use per_channel::PerChannel;
pub use pilot::Pilot;
pub use port::{Arity, Axes, InPort, InPorts, InputSource, Many, OutPort, OutPorts};
pub use problem::{At, Problem, Problems};
pub use quantity::{AngleDeg, Concentration, Density, Length, PerLength, Power, Ratio, Seconds, Wavelength};
pub use read::{Found, ParamError, ParamMistake, Wanted};
pub use shared::Shared;
pub use stage::{Extents, Job, Made, Stage, StagePlan, StageRow};
pub use usual::Usual;

// One version of these for every stage.
pub use ndarray;
pub use schemars;
pub use serde;
pub use serde_json;
