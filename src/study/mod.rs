//! Studies: error against run time. A pipeline at every combination of values of some paths, several times with other random numbers; of each point the
//! error of a result against the truth, the error that the result states of itself, and what it cost.
//!
//! [`points`] says which points there are, [`quantity`] what is looked at, [`found`] what one point says, [`studied`] runs them, [`table`] makes the
//! table and [`plot`] the picture of error over CPU time.

pub mod ahead;
pub mod found;
pub mod plot;
pub mod points;
pub mod quantity;
pub mod studied;
pub mod table;

pub use found::Found;
pub use points::Point;
pub use studied::{Row, Studying, mistakes};
