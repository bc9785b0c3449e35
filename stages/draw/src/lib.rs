//! Points of a data set: which values the drawn quantities of each sample take.
//!
//! A [`Draw`] is read from the map that a pipeline file states: named distributions, groups, derived numbers, conditions.
//! [`Draw::point`] gives the values of one point as a function of the seed and its index alone, so that a sample keeps
//! its values whatever else is drawn. The points fill the unit cube by a Sobol sequence with Owen scrambling, as a Latin
//! hypercube, or at random; each distribution is read off its quantile function.

mod beta;
mod condition;
mod directions;
mod distribution;
mod draw;
mod expression;
mod hash;
mod mistake;
mod normal;
mod read;
mod sobol;
mod unit;

pub use condition::{Condition, Relation};
pub use distribution::Distribution;
pub use draw::{Draw, Skipped, Type};
pub use expression::Expression;
pub use hash::stream;
pub use mistake::Mistake;
pub use normal::quantile as normal_quantile;
pub use sobol::{DIMENSIONS, scrambled, sobol};
pub use unit::Method;
