//! Data sets as a user builds them.
