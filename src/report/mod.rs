//! `turbid report`: a pipeline, what is there of its results, their errors, what they cost and where they come from, on one page.
//!
//! [`gather`] collects a [`page::Page`], plain data, from plan and store; [`html`] writes it.

pub mod diff;
pub mod figures;
pub mod gather;
mod graph;
pub mod history;
pub mod html;
pub mod measures;
pub mod page;
mod params;
mod pictures;
mod question;
pub mod studies;
