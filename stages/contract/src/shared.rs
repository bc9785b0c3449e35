//! Artifacts in memory that several stages read.

use std::any::Any;
use std::fmt;
use std::sync::{Arc, OnceLock};

use crate::artifact::Artifact;
use crate::payload::Payload;

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
