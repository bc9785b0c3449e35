//! What is known of an instance's inputs before anything runs.

use std::any::Any;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, OnceLock};

use crate::artifact::{Artifact, Attributes, LayerInfo};
use crate::extent::Extent;
use crate::file::Files;
use crate::form::Form;
use crate::payload::Payload;
use crate::port::Axes;

/// An artifact that is in memory, and its typed view, which is made once for all who ask.
#[derive(Clone)]
pub struct Shared(Arc<Held>);

struct Held {
    artifact: Artifact,
    typed: OnceLock<Option<Arc<dyn Any + Send + Sync>>>,
}

impl Shared {
    pub fn new(artifact: Artifact) -> Self {
        Self(Arc::new(Held { artifact, typed: OnceLock::new() }))
    }

    /// The artifact of a payload, which stays at hand: nobody reads it out of its artifact again.
    pub fn of<T: Payload>(payload: T) -> Self {
        let typed: Arc<dyn Any + Send + Sync> = Arc::new(payload.clone());
        Self(Arc::new(Held { artifact: payload.into_artifact(), typed: OnceLock::from(Some(typed)) }))
    }

    pub fn artifact(&self) -> &Artifact {
        &self.0.artifact
    }

    /// As payload `T`; `None` where it is of another shape. A port has one payload: the view is kept of the type that asks first.
    pub fn get<T: Payload>(&self) -> Option<Arc<T>> {
        let read = || T::from_artifact(self.0.artifact.clone()).ok().map(Arc::new);
        let kept = self.0.typed.get_or_init(|| read().map(|typed| typed as Arc<dyn Any + Send + Sync>));
        kept.clone()?.downcast::<T>().ok().or_else(read)
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.artifact.fmt(f)
    }
}

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
