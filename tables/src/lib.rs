//! Tables of data sets, made by polars: statistics of columns by split ([`summary`]), costs joined with what became of
//! each sample ([`costs`]), counts ([`counts`]). Of studies: error against run time over repeats ([`study`]).
//!
//! In and out go turbid's own tables ([`turbid_contract::Table`]); nothing of polars is seen outside of this crate, and no
//! other crate depends on it. Rows come in the order of their keys, whatever the number of threads. Means and standard
//! deviations are sums in polars' order: of what is shown, not of what is kept under a digest. Quantiles, extrema and counts
//! are exact.

pub mod costs;
pub mod counts;
mod frame;
pub mod study;
pub mod summary;

/// Why a table cannot be made, in words.
#[derive(Clone, Debug, PartialEq)]
pub struct Error(pub String);

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Error {}

impl From<polars::error::PolarsError> for Error {
    fn from(error: polars::error::PolarsError) -> Self {
        Self(error.to_string())
    }
}
