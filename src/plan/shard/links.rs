//! What the split into shards looks at: what feeds what, and at which point of the axes each instance is.

use std::collections::{HashMap, HashSet};

use serde_json::Value;

use crate::key::value_text;
use crate::plan::{Id, IdVec, InstanceId, Plan};

/// The needed instances of a plan as nodes, each after those that feed it.
#[derive(Clone, Default)]
pub struct Links {
    pub ids: Vec<InstanceId>,
    /// The stage of each node, and how many nodes each stage has.
    pub stages: Vec<usize>,
    pub counts: Vec<usize>,
    /// The point of each node: a place in `values`.
    pub points: Vec<usize>,
    /// For each point, in the order in which points follow each other in the plan, and for each axis of the plan: 0 where the
    /// point does not have it, else the number of the value from 1.
    pub values: Vec<Box<[u32]>>,
    feeds: Vec<Feed>,
    /// Where the feeds of a node end.
    ends: Vec<usize>,
}

/// A node that feeds another one.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Feed {
    pub node: usize,
    /// Whether others feed the same port.
    pub gathered: bool,
}

impl Links {
    pub fn of(plan: &Plan) -> Self {
        let mut links = Self { counts: vec![0; plan.spec.stages.len()], ..Self::default() };
        let mut node_of = IdVec::<InstanceId, _>::filled(u32::MAX, plan.instances().len());
        let mut points = Points::of(plan);
        for id in plan.needed_instances() {
            node_of[id] = u32::try_from(links.len()).expect("there are not more nodes than instances");
            let mut fed = HashSet::new();
            for wire in &plan.wires(id) {
                let gathered = wire.many && wire.from.len() > 1;
                let feeds = wire.from.iter().map(|(from, _)| Feed { node: node_of[*from] as usize, gathered });
                links.feeds.extend(feeds.filter(|feed| fed.insert((feed.node, gathered))));
            }
            links.add(id, plan.stage_of(id).place(), points.place(plan.point(id)));
        }
        links.values = points.values;
        links.put_points_in_order();
        links
    }

    /// A node whose feeds were added before it.
    fn add(&mut self, id: InstanceId, stage: usize, point: usize) {
        self.ids.push(id);
        self.stages.push(stage);
        self.counts[stage] += 1;
        self.points.push(point);
        self.ends.push(self.feeds.len());
    }

    /// By the value of the first axis, then by that of the second; what lacks an axis comes first.
    fn put_points_in_order(&mut self) {
        let mut order: Vec<usize> = (0..self.values.len()).collect();
        order.sort_unstable_by(|a, b| self.values[*a].cmp(&self.values[*b]));
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(new, old)| place[*old] = new);
        self.points.iter_mut().for_each(|point| *point = place[*point]);
        self.values = order.into_iter().map(|old| std::mem::take(&mut self.values[old])).collect();
    }

    pub fn len(&self) -> usize {
        self.ids.len()
    }

    pub fn feeds(&self, node: usize) -> impl Iterator<Item = Feed> + '_ {
        let start = node.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.feeds[start..self.ends[node]].iter().copied()
    }

    /// Whether a node has all axes of another one, with the same values.
    pub fn extends(&self, node: usize, other: usize) -> bool {
        let (own, other) = (&self.values[self.points[node]], &self.values[self.points[other]]);
        own.iter().zip(other).all(|(own, other)| *other == 0 || own == other)
    }

    /// Nodes by stage, values on the axes, and what feeds them.
    #[cfg(test)]
    pub fn of_test(nodes: &[(usize, Vec<u32>, Vec<Feed>)]) -> Self {
        let stages = nodes.iter().map(|(stage, ..)| stage + 1).max().unwrap_or(0);
        let mut links = Self { counts: vec![0; stages], ..Self::default() };
        let mut places = HashMap::new();
        for (node, (stage, values, feeds)) in nodes.iter().enumerate() {
            links.feeds.extend(feeds);
            let point = *places.entry(values).or_insert_with(|| {
                links.values.push(values.clone().into());
                links.values.len() - 1
            });
            links.add(InstanceId::new(node), *stage, point);
        }
        links.put_points_in_order();
        links
    }
}

/// The points that are known so far.
struct Points<'a> {
    axes: HashMap<&'a str, usize>,
    /// Of each axis the values, numbered from 1 as they come.
    numbers: Vec<HashMap<String, u32>>,
    places: HashMap<Box<[u32]>, usize>,
    values: Vec<Box<[u32]>>,
}

impl<'a> Points<'a> {
    /// The axes in the order of the plan: those that are brought first, and of one stage those that vary slowest.
    fn of(plan: &'a Plan) -> Self {
        let mut axes = HashMap::new();
        for name in plan.needed.iter().flat_map(|&stage| &plan.spec.stages[stage].foreach.names) {
            let next = axes.len();
            axes.entry(name.as_str()).or_insert(next);
        }
        let numbers = vec![HashMap::new(); axes.len()];
        Self { axes, numbers, places: HashMap::new(), values: Vec::new() }
    }

    fn place<'v>(&mut self, axes: impl IntoIterator<Item = (&'v String, &'v Value)>) -> usize {
        let mut point = vec![0; self.numbers.len()];
        for (name, value) in axes {
            let axis = self.axes[name.as_str()];
            let numbers = &mut self.numbers[axis];
            let next = u32::try_from(numbers.len() + 1).expect("there are not more values than instances");
            point[axis] = *numbers.entry(value_text(value)).or_insert(next);
        }
        if let Some(place) = self.places.get(point.as_slice()) {
            return *place;
        }
        let point: Box<[u32]> = point.into();
        self.values.push(point.clone());
        self.places.insert(point, self.values.len() - 1);
        self.values.len() - 1
    }
}
