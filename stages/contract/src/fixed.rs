//! A value that does not change any more, with what was made of it.

use std::any::Any;
use std::fmt;
use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A value that does not change any more, and what was made of it, once for all its copies: a mesh and its tree of boxes.
pub struct Fixed<T>(Arc<Held<T>>);

struct Held<T> {
    value: T,
    made: OnceLock<Arc<dyn Any + Send + Sync>>,
}

impl<T> Fixed<T> {
    pub fn new(value: T) -> Self {
        Self(Arc::new(Held { value, made: OnceLock::new() }))
    }

    /// What `make` makes of the value: at the first call, for this copy or another. One type is kept, that of the first call; what is
    /// asked for as another one is made anew.
    pub fn made<M: Send + Sync + 'static>(&self, make: impl Fn(&T) -> M) -> Arc<M> {
        let kept = self.0.made.get_or_init(|| Arc::new(make(&self.0.value)));
        kept.clone().downcast::<M>().unwrap_or_else(|_| Arc::new(make(&self.0.value)))
    }
}

impl<T: Clone> Fixed<T> {
    /// The value, to be changed in this copy alone; nothing is made of it yet.
    pub fn to_mut(&mut self) -> &mut T {
        *self = Self::new(self.0.value.clone());
        &mut Arc::get_mut(&mut self.0).expect("it was made just now").value
    }
}

impl<T> Clone for Fixed<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Deref for Fixed<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0.value
    }
}

impl<T> From<T> for Fixed<T> {
    fn from(value: T) -> Self {
        Self::new(value)
    }
}

impl<T: PartialEq> PartialEq for Fixed<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.0.value == other.0.value
    }
}

impl<T: fmt::Debug> fmt::Debug for Fixed<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.value.fmt(f)
    }
}

impl<T: Serialize> Serialize for Fixed<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.value.serialize(serializer)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Fixed<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        T::deserialize(deserializer).map(Self::new)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn it_is_made_once_for_all_copies() {
        let list = Fixed::new(vec![1.0, 2.5]);
        let times = Cell::new(0);
        let sum = |of: &Fixed<Vec<f64>>| {
            *of.made(|list| {
                times.set(times.get() + 1);
                list.iter().sum::<f64>()
            })
        };
        assert_eq!([sum(&list), sum(&list.clone()), sum(&list)], [3.5; 3]);
        assert_eq!(times.get(), 1);
        assert_eq!(sum(&Fixed::new(vec![4.0])), 4.0, "another value has its own");
        assert_eq!(*list.made(Vec::len), 2, "and so has another type");
        assert_eq!(sum(&list), 3.5);
    }

    #[test]
    fn it_is_written_as_its_value() {
        let text = serde_json::to_string(&Fixed::new([1, 2])).unwrap();
        assert_eq!((text.as_str(), serde_json::from_str(&text).unwrap()), ("[1,2]", Fixed::new([1, 2])));
    }
}
