//! Inputs of a running instance: loaded from the store when asked for, dropped by the stage when done.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex};

use turbid_contract::{Artifact, ArtifactKind, Axes, Error, Head, ImageStack, InputSource, LayerInfo, Shared};

use crate::brief::Outputs;
use crate::panics::lock;
use crate::plan::{InstanceId, Plan, Wire};
use crate::store::{Blob, OpenedImages, Store, StoreError};

pub struct StoredInputs<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub wires: Vec<Wire>,
    pub outputs: HashMap<InstanceId, Outputs>,
    /// Tables that several instances of the run read.
    pub kept: &'a Kept,
    /// The producer of a blob that turned out damaged.
    pub damaged: Mutex<Option<InstanceId>>,
    /// Image stacks of which parts are asked for, by port.
    pub opened: Mutex<HashMap<String, Arc<OpenedImages>>>,
}

impl StoredInputs<'_> {
    fn wire(&self, port: &str) -> Option<&Wire> {
        self.wires.iter().find(|w| w.port == port)
    }

    /// The image stack on a `one` port, compared with its digest once.
    fn images(&self, port: &str) -> Result<Arc<OpenedImages>, Error> {
        let mut opened = lock(&self.opened);
        if let Some(known) = opened.get(port) {
            return Ok(known.clone());
        }
        let wire = self.wire(port).ok_or_else(|| Error::failed(format!("input `{port}` is not connected")))?;
        let (producer, out) = wire.from[0];
        let images = self.store.open_images(&self.outputs[&producer][out]);
        let images = Arc::new(images.map_err(|error| self.lost(port, producer, &error))?);
        opened.insert(port.to_owned(), images.clone());
        Ok(images)
    }

    fn lost(&self, port: &str, producer: InstanceId, error: &StoreError) -> Error {
        if error.is_lost_blob() {
            *lock(&self.damaged) = Some(producer);
        }
        Error::failed(format!("input `{port}`: {error}"))
    }
}

/// Tables that several instances read, the latest ones.
#[derive(Default)]
pub struct Kept(Mutex<VecDeque<(Blob, Shared)>>);

/// So many are kept ...
const MOST: usize = 8;
/// ... of at most so many bytes each.
const LARGEST: u64 = 64 << 20;

impl Kept {
    fn get(&self, blob: &Blob) -> Option<Shared> {
        lock(&self.0).iter().find(|(kept, _)| kept == blob).map(|(_, shared)| shared.clone())
    }

    fn keep(&self, blob: Blob, artifact: Artifact) -> Shared {
        let mut kept = lock(&self.0);
        // Another instance may have been faster.
        if let Some((_, shared)) = kept.iter().find(|(known, _)| *known == blob) {
            return shared.clone();
        }
        if kept.len() == MOST {
            kept.pop_front();
        }
        let shared = Shared::new(artifact);
        kept.push_back((blob, shared.clone()));
        shared
    }
}

impl InputSource for StoredInputs<'_> {
    fn shared(&self, port: &str) -> Result<Option<Shared>, Error> {
        let Some(wire) = self.wire(port).filter(|wire| !wire.many) else { return Ok(None) };
        let (producer, out) = wire.from[0];
        let blob = self.outputs[&producer][out];
        let stage = self.plan.stage_of(producer);
        let readers = self.plan.consumers(stage).iter().map(|&consumer| self.plan.instances_of(consumer).len()).max();
        let is_shared = readers > Some(self.plan.instances_of(stage).len());
        if !is_shared || blob.kind != ArtifactKind::Table || blob.bytes > LARGEST {
            return Ok(None);
        }
        if let Some(shared) = self.kept.get(&blob) {
            return Ok(Some(shared));
        }
        Ok(Some(self.kept.keep(blob, self.load(port, 0)?)))
    }

    fn one(&self, port: &str) -> Result<Option<Artifact>, Error> {
        match self.wire(port) {
            Some(_) => self.load(port, 0).map(Some),
            None => Ok(None),
        }
    }

    fn many(&self, port: &str) -> Vec<Axes> {
        let from = self.wire(port).map_or(&[][..], |w| &w.from);
        from.iter().map(|(id, _)| self.plan.values(*id)).collect()
    }

    fn load(&self, port: &str, index: usize) -> Result<Artifact, Error> {
        let (producer, out) = self.wire(port).expect("a stage asks for its own ports").from[index];
        let blob = &self.outputs[&producer][out];
        self.store.get(blob).map_err(|error| self.lost(port, producer, &error))
    }

    fn head(&self, port: &str) -> Result<Head, Error> {
        Ok(self.images(port)?.head().clone())
    }

    fn part(&self, port: &str, wanted: &dyn Fn(usize, &LayerInfo) -> bool) -> Result<ImageStack, Error> {
        let producer = self.wire(port).expect("a stage asks for its own ports").from[0].0;
        self.images(port)?.part(wanted).map_err(|error| self.lost(port, producer, &error))
    }
}
