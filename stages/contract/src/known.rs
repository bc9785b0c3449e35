//! What is known of an instance's inputs before anything runs.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::artifact::{Artifact, Attributes, LayerInfo};
use crate::extent::Extent;
use crate::file::Files;
use crate::form::Form;
use crate::payload::Payload;
use crate::port::Axes;
use crate::shared::Shared;

/// What is known of the inputs of an instance before anything runs.
#[derive(Clone, Default)]
pub struct Known {
    /// The artifacts that instant stages made.
    pub artifacts: BTreeMap<String, Shared>,
    /// Content of the input files, by the field that names them.
    pub files: Files,
    /// Names of the input ports that are connected, known or not.
    pub connected: Vec<String>,
    /// Names of the output ports that are wanted.
    pub wanted: Vec<String>,
    /// Payload on each connected port that takes one artifact; empty while the graph is not whole.
    pub payloads: BTreeMap<String, String>,
    /// The forms of the artifacts on each input port, in the order in which a run gets them.
    pub forms: BTreeMap<String, Vec<Arc<Form>>>,
    /// Who makes the artifact on a port, of many the first: `fringes.modulation`.
    pub producers: BTreeMap<String, String>,
    /// The axes of the artifacts on each port that takes many, in the same order.
    pub axes: BTreeMap<String, Vec<Axes>>,
    /// How large the artifacts on the input ports are, as far as that is known before the run: for `plan` only. Of many the largest.
    pub extents: BTreeMap<String, Extent>,
}

impl Known {
    /// Makes `artifact` known on `port`.
    pub fn insert(&mut self, port: impl Into<String>, artifact: Artifact) {
        self.artifacts.insert(port.into(), Shared::new(artifact));
    }

    /// Nothing but `artifact` on `port`.
    pub fn with(port: impl Into<String>, artifact: Artifact) -> Self {
        let mut known = Self::default();
        known.insert(port, artifact);
        known
    }

    pub fn is_connected(&self, port: &str) -> bool {
        self.connected.iter().any(|connected| connected == port)
    }

    pub fn is_wanted(&self, port: &str) -> bool {
        self.wanted.iter().any(|wanted| wanted == port)
    }

    /// The form of the artifact on `port`, of many the first; `None` where it is not connected, or what makes it has mistakes of its own.
    pub fn form(&self, port: &str) -> Option<&Form> {
        self.forms.get(port)?.first().map(|form| &**form)
    }

    /// The forms of all artifacts on `port`.
    pub fn forms(&self, port: &str) -> &[Arc<Form>] {
        self.forms.get(port).map_or(&[], Vec::as_slice)
    }

    /// The axes of the artifacts on `port`, which takes many.
    pub fn axes(&self, port: &str) -> &[Axes] {
        self.axes.get(port).map_or(&[], Vec::as_slice)
    }

    /// The layers of the images on `port`, and how many rows and columns of pixels they have, where both are known.
    pub fn images(&self, port: &str) -> Option<(&[LayerInfo], [u64; 2])> {
        self.form(port)?.images_known()
    }

    /// Who makes what is on `port`, for messages: `fringes.modulation`.
    pub fn producer<'a>(&'a self, port: &'a str) -> &'a str {
        self.producers.get(port).map_or(port, String::as_str)
    }

    /// What is known of the attributes of the artifact on `port`; nothing of one that is not connected.
    pub fn fact(&self, port: &str) -> Attributes {
        self.form(port).map(|form| form.attributes.clone()).unwrap_or_default()
    }

    /// How large the artifact on `port` is; `None` where it is not connected, or not known yet.
    pub fn extent(&self, port: &str) -> Option<Extent> {
        self.extents.get(port).copied()
    }

    /// The artifact on `port`, where it is known already.
    pub fn get<T: Payload>(&self, port: &str) -> Option<Arc<T>> {
        self.artifacts.get(port)?.get()
    }
}
