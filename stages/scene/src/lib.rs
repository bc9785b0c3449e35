//! turbid scene.
