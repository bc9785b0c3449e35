//! Data sets as a user builds them: whole, grown, killed, side by side, damaged, and asked for wrongly.

mod damage;
mod growth;
mod kills;
mod space;
mod statistics;
mod wrong;
