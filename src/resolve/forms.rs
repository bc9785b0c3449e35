//! What artifacts are going to hold, and how that flows through the graph before anything runs.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use serde_json::Value;
use turbid_contract::{Form, Forms};

use super::{AllOutputs, Keyed, Resolver};
use crate::panics::lock;
use crate::plan::{InstanceId, StageId};

/// The forms of an instance's outputs, by port.
pub type Described = BTreeMap<&'static str, Arc<Form>>;

/// The forms that were worked out. Those of a sweep differ in a few values of attributes at most: only these are kept for each instance.
#[derive(Default)]
pub(super) struct KnownForms {
    of: HashMap<InstanceId, Kept>,
    latest: HashMap<StageId, Arc<Described>>,
}

/// The forms of an instance: those of another one of its stage, but for some values.
struct Kept {
    like: Arc<Described>,
    own: Box<[Own]>,
}

/// An attribute of its own.
struct Own {
    port: &'static str,
    /// Its place among the attributes.
    at: usize,
    value: Value,
}

impl Kept {
    fn get(&self, port: &str) -> Option<Arc<Form>> {
        let like = self.like.get(port)?;
        let mut own = self.own.iter().filter(|own| own.port == port).peekable();
        if own.peek().is_none() {
            return Some(like.clone());
        }
        let mut form = Form::clone(like);
        let mut values = form.attributes.values_mut();
        let mut next = 0;
        for Own { at, value, .. } in own {
            let place = values.nth(at - next).expect("both have the same attributes");
            *place = value.clone();
            next = at + 1;
        }
        Some(Arc::new(form))
    }

    fn all(&self) -> Described {
        self.like.keys().filter_map(|port| Some((*port, self.get(port)?))).collect()
    }
}

/// What `forms` have of their own beside `like`; `None` where they differ in more than values of attributes.
fn own_values(like: &Described, forms: &Forms) -> Option<Box<[Own]>> {
    let mut own = Vec::new();
    if like.len() != forms.len() {
        return None;
    }
    for ((&port, form), (name, like)) in forms.iter().zip(like) {
        let names = || form.attributes.keys().eq(like.attributes.keys());
        let Form { pixels, layers, perhaps, rows, columns, attributes } = form;
        let same = port == *name
            && (*pixels, *rows) == (like.pixels, like.rows)
            && (layers, perhaps, columns) == (&like.layers, &like.perhaps, &like.columns);
        if !same || !names() {
            return None;
        }
        let values = attributes.values().zip(like.attributes.values()).enumerate();
        let differing = values.filter(|(_, (value, like))| value != like);
        own.extend(differing.map(|(at, (value, _))| Own { port, at, value: value.clone() }));
    }
    Some(own.into())
}

impl KnownForms {
    fn insert(&mut self, id: InstanceId, stage: StageId, forms: Forms) {
        let alike = self.latest.get(&stage).and_then(|like| Some((like.clone(), own_values(like, &forms)?)));
        let (like, own) = alike.unwrap_or_else(|| {
            let fresh = Arc::new(forms.into_iter().map(|(port, form)| (port, Arc::new(form))).collect::<Described>());
            self.latest.insert(stage, fresh.clone());
            (fresh, Box::default())
        });
        self.of.insert(id, Kept { like, own });
    }
}

impl Resolver<'_> {
    /// The forms of the artifacts on the input ports, in the order in which a run gets them.
    pub(super) fn forms_of_inputs(&self, id: InstanceId, outputs: &AllOutputs) -> BTreeMap<String, Vec<Arc<Form>>> {
        let open = Arc::new(Form::default());
        let of = |&(source, port): &(InstanceId, &'static str)| {
            self.work_out(source, outputs);
            self.form(source, port).unwrap_or_else(|| open.clone())
        };
        let wires = self.plan.wires(id);
        wires.iter().map(|wire| (wire.port.to_owned(), wire.from.iter().map(of).collect())).collect()
    }

    /// Remembers what a stage says of its outputs; nothing of one with mistakes in it.
    pub(super) fn note_forms(&self, id: InstanceId, forms: Forms) {
        lock(&self.forms).insert(id, self.plan.stage_of(id), forms);
    }

    /// Whether a stage reads what an instance makes: only then is that described before anything runs, and kept.
    pub(super) fn is_read(&self, id: InstanceId) -> bool {
        !self.plan.consumers(self.plan.stage_of(id)).is_empty()
    }

    /// Describes what an instance is going to make that nobody reads, until it is [forgotten](Self::forget): what came of it is held against that.
    pub fn describe(&self, id: InstanceId, keyed: &Keyed, outputs: &AllOutputs) {
        if !self.is_read(id)
            && let Ok(lent) = self.files.lend(&keyed.files, false)
        {
            let mut known = self.known(id, outputs);
            known.files = lent.files.clone();
            self.note_forms(id, keyed.job.describe(&known));
        }
    }

    /// The instance has ended.
    pub fn forget(&self, id: InstanceId) {
        if !self.is_read(id) {
            lock(&self.forms).of.remove(&id);
        }
    }

    /// What is known of an output before its instance runs; `None` where nothing was asked.
    pub fn form(&self, id: InstanceId, port: &str) -> Option<Arc<Form>> {
        lock(&self.forms).of.get(&id)?.get(port)
    }

    /// The forms of all outputs of an instance, as far as they were asked for.
    pub fn made(&self, id: InstanceId) -> Option<Described> {
        lock(&self.forms).of.get(&id).map(Kept::all)
    }

    /// Sees to it that the forms of an instance's outputs are known, whether or not the store holds them.
    fn work_out(&self, id: InstanceId, outputs: &AllOutputs) {
        let is_known = |id: InstanceId| lock(&self.forms).of.contains_key(&id);
        // An explicit stack: a chain of a million stages must not end the process.
        let mut path = vec![id];
        while let Some(&last) = path.last() {
            if is_known(last) {
                path.pop();
                continue;
            }
            let sources = self.plan.sources(last).map(|from| from.0);
            let open: Vec<InstanceId> = sources.filter(|&source| !is_known(source)).collect();
            if open.is_empty() {
                self.note_forms(last, self.own_forms(last, outputs));
            }
            path.extend(open);
        }
    }

    /// The forms of its outputs, those of its inputs being known.
    fn own_forms(&self, id: InstanceId, outputs: &AllOutputs) -> Forms {
        // Mistakes in params are told where the stage is checked.
        let Ok(prepared) = self.prepare(id) else { return Forms::new() };
        let mut known = self.known(id, outputs);
        let stage = self.plan.stage_of(id);
        if let Ok(files) = self.input_files(stage, &prepared.job.files())
            && let Ok(lent) = self.files.lend(&files, false)
        {
            known.files = lent.files.clone();
            return prepared.job.describe(&known);
        }
        Forms::new()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::plan::Id;

    fn lut(n: f64, rows: u64) -> Forms {
        let attributes =
            [("convention", json!("camera")), ("f_x", json!([0, 0.1])), ("g", json!(n - 1.0)), ("n", json!(n))];
        let attributes = attributes.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let lut = Form::table(Some(rows), &[("mu_a", "mm^-1")]).with(attributes);
        Forms::from([("design", Form::default()), ("lut", lut)])
    }

    /// Of a sweep each instance has its own form again, and keeps only what is its own.
    #[test]
    fn forms_of_a_sweep_are_kept_as_differences() {
        let (mut known, stage) = (KnownForms::default(), StageId::new(0));
        let all: Vec<Forms> = (0..9).map(|i| lut(1.3 + 0.1 * f64::from(i / 2), if i < 6 { 4 } else { 5 })).collect();
        for (i, forms) in all.iter().enumerate() {
            known.insert(InstanceId::new(i), stage, forms.clone());
        }
        for (i, forms) in all.iter().enumerate() {
            let kept = &known.of[&InstanceId::new(i)];
            let again: Forms = kept.all().into_iter().map(|(port, form)| (port, (*form).clone())).collect();
            assert_eq!(again, *forms, "{i}");
            assert_eq!(kept.own.len(), if matches!(i, 0 | 1 | 6 | 7) { 0 } else { 2 }, "{i}: g and n");
        }
        known.insert(InstanceId::new(9), stage, Forms::new());
        assert_eq!(known.of[&InstanceId::new(9)].all(), Described::new(), "one with mistakes");
    }
}
