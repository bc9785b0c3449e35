//! Inputs in memory: what is connected to the ports of a stage.

use std::collections::BTreeMap;

use crate::artifact::Artifact;
use crate::error::Error;
use crate::payload::Payload;
use crate::port::{Axes, InputSource};

/// Artifacts on input ports, those of a `many` port with their axes.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    /// By port, in the order of the port.
    pub ports: BTreeMap<String, Vec<(Axes, Artifact)>>,
}

impl Inputs {
    /// Nothing is connected.
    pub fn none() -> Self {
        Self::default()
    }

    /// With `payload` on `port`.
    #[must_use]
    pub fn with(self, port: &str, payload: impl Payload) -> Self {
        self.with_at(port, Axes::new(), payload)
    }

    /// With one more `payload` on the `many` port `port`, which has these axes. Their order is that of the port.
    #[must_use]
    pub fn with_at(mut self, port: &str, axes: Axes, payload: impl Payload) -> Self {
        self.ports.entry(port.to_owned()).or_default().push((axes, payload.into_artifact()));
        self
    }

    /// Names of the ports that are connected.
    pub fn connected(&self) -> impl Iterator<Item = &str> {
        self.ports.keys().map(String::as_str)
    }

    /// All artifacts on a port, with their axes.
    pub fn all(&self, port: &str) -> &[(Axes, Artifact)] {
        self.ports.get(port).map_or(&[], Vec::as_slice)
    }

    /// The first artifact on a port.
    pub fn first(&self, port: &str) -> Option<&Artifact> {
        Some(&self.ports.get(port)?.first()?.1)
    }
}

impl InputSource for Inputs {
    fn one(&self, port: &str) -> Result<Option<Artifact>, Error> {
        Ok(self.first(port).cloned())
    }
    fn many(&self, port: &str) -> Vec<Axes> {
        self.ports.get(port).into_iter().flatten().map(|(axes, _)| axes.clone()).collect()
    }
    fn load(&self, port: &str, index: usize) -> Result<Artifact, Error> {
        let found = self.ports.get(port).and_then(|all| all.get(index));
        found
            .map(|(_, artifact)| artifact.clone())
            .ok_or_else(|| Error::failed(format!("nothing on `{port}`, {index}")))
    }
}
