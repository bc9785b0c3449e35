//! Numbers of stages and of instances, each a type of its own, and lists that only such a number looks into.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

/// A place in a list that is made once.
pub trait Id: Copy + Ord {
    /// # Panics
    /// Beyond 2^32 - 1: files with so many stages or instances are refused.
    fn new(place: usize) -> Self;
    fn place(self) -> usize;
}

/// A stage of a pipeline: its place in `Spec::stages`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct StageId(u32);

/// A stage at one point of its axes: its place among `Plan::instances`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct InstanceId(u32);

impl Id for StageId {
    fn new(place: usize) -> Self {
        Self(narrow(place))
    }
    fn place(self) -> usize {
        self.0 as usize
    }
}

impl InstanceId {
    /// Its neighbour: mostly another one of its stage.
    pub fn before(self) -> Option<Self> {
        self.0.checked_sub(1).map(Self)
    }
}

impl Id for InstanceId {
    fn new(place: usize) -> Self {
        Self(narrow(place))
    }
    fn place(self) -> usize {
        self.0 as usize
    }
}

fn narrow(place: usize) -> u32 {
    u32::try_from(place).unwrap_or_else(|_| panic!("{place} stages or instances"))
}

/// Neighbours, in order.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct IdRange<I> {
    next: usize,
    end: usize,
    id: PhantomData<I>,
}

impl<I: Id> IdRange<I> {
    pub fn new(start: usize, end: usize) -> Self {
        Self { next: start, end, id: PhantomData }
    }

    /// The place of the first.
    pub fn start(&self) -> usize {
        self.next
    }
}

impl<I: Id> Iterator for IdRange<I> {
    type Item = I;
    fn next(&mut self) -> Option<I> {
        let place = self.next;
        (place < self.end).then(|| {
            self.next += 1;
            I::new(place)
        })
    }
    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.end.saturating_sub(self.next);
        (left, Some(left))
    }
}

impl<I: Id> ExactSizeIterator for IdRange<I> {}

/// A list with an item for each stage, or for each instance.
#[derive(Clone, PartialEq)]
pub struct IdVec<I, T> {
    items: Vec<T>,
    id: PhantomData<I>,
}

impl<I: Id, T> IdVec<I, T> {
    pub fn new() -> Self {
        Self { items: Vec::new(), id: PhantomData }
    }

    /// The same for each.
    pub fn filled(item: T, count: usize) -> Self
    where
        T: Clone,
    {
        vec![item; count].into()
    }

    pub fn len(&self) -> usize {
        self.items.len()
    }

    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    pub fn push(&mut self, item: T) {
        self.items.push(item);
    }

    pub fn append(&mut self, more: Vec<T>) {
        self.items.extend(more);
    }

    pub fn ids(&self) -> IdRange<I> {
        IdRange::new(0, self.items.len())
    }

    pub fn iter(&self) -> std::slice::Iter<'_, T> {
        self.items.iter()
    }

    pub fn iter_ids(&self) -> impl Iterator<Item = (I, &T)> {
        self.ids().zip(&self.items)
    }
}

impl<I: Id, T> Default for IdVec<I, T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<I, T: fmt::Debug> fmt::Debug for IdVec<I, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.items.fmt(f)
    }
}

impl<I, T> From<Vec<T>> for IdVec<I, T> {
    fn from(items: Vec<T>) -> Self {
        Self { items, id: PhantomData }
    }
}

impl<I, T> FromIterator<T> for IdVec<I, T> {
    fn from_iter<F: IntoIterator<Item = T>>(items: F) -> Self {
        items.into_iter().collect::<Vec<T>>().into()
    }
}

impl<I, T> IntoIterator for IdVec<I, T> {
    type Item = T;
    type IntoIter = std::vec::IntoIter<T>;
    fn into_iter(self) -> Self::IntoIter {
        self.items.into_iter()
    }
}

impl<'a, I: Id, T> IntoIterator for &'a IdVec<I, T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<I: Id, T> Index<I> for IdVec<I, T> {
    type Output = T;
    fn index(&self, id: I) -> &T {
        &self.items[id.place()]
    }
}

impl<I: Id, T> IndexMut<I> for IdVec<I, T> {
    fn index_mut(&mut self, id: I) -> &mut T {
        &mut self.items[id.place()]
    }
}

/// What some stages, or some instances, have: looked up by place, which takes less time and memory than by hash where many have it.
#[derive(Clone, Debug, PartialEq)]
pub struct IdMap<I, T>(IdVec<I, Option<T>>);

impl<I: Id, T> IdMap<I, T> {
    pub fn get(&self, id: &I) -> Option<&T> {
        self.0.items.get(id.place())?.as_ref()
    }

    pub fn contains_key(&self, id: &I) -> bool {
        self.get(id).is_some()
    }

    pub fn insert(&mut self, id: I, item: T) {
        let place = id.place();
        if place >= self.0.len() {
            self.0.items.resize_with(place + 1, || None);
        }
        self.0.items[place] = Some(item);
    }

    pub fn iter(&self) -> impl Iterator<Item = (I, &T)> {
        self.0.iter_ids().filter_map(|(id, item)| Some((id, item.as_ref()?)))
    }

    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.0.iter().flatten()
    }
}

impl<I: Id, T> Default for IdMap<I, T> {
    fn default() -> Self {
        Self(IdVec::new())
    }
}

impl<I: Id, T> Index<&I> for IdMap<I, T> {
    type Output = T;
    fn index(&self, id: &I) -> &T {
        self.get(id).unwrap_or_else(|| panic!("nothing at {}", id.place()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_looked_into_by_their_own_numbers() {
        let mut list: IdVec<StageId, char> = "abc".chars().collect();
        let ids: Vec<StageId> = list.ids().collect();
        list[ids[1]] = 'x';
        assert_eq!(list.iter_ids().map(|(id, &c)| (id.place(), c)).collect::<Vec<_>>(), [(0, 'a'), (1, 'x'), (2, 'c')]);
        assert_eq!(
            (list.ids().len(), IdRange::<StageId>::new(2, 5).len(), IdRange::<StageId>::new(5, 2).len()),
            (3, 3, 0)
        );
        assert!(ids[0] < ids[1] && InstanceId::new(7) == InstanceId(7));
        let mut map: IdMap<StageId, char> = IdMap::default();
        [(2, 'c'), (0, 'a'), (2, 'd')].into_iter().for_each(|(place, c)| map.insert(StageId::new(place), c));
        let [first, second, none] = [0, 1, 9].map(StageId::new);
        assert_eq!((map.get(&first), map.get(&second), map.contains_key(&none)), (Some(&'a'), None, false));
        assert_eq!(map.iter().map(|(id, &c)| (id.place(), c)).collect::<Vec<_>>(), [(0, 'a'), (2, 'd')]);
        assert_eq!(map.values().collect::<String>(), "ad");
    }
}
