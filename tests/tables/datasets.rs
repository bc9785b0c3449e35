//! Data sets as a user builds them: whole, grown, killed, side by side, damaged, and asked for wrongly.

mod damage;
mod full_disk;
mod growth;
mod halves;
mod kills;
mod released;
mod shard;
mod space;
mod statistics;
mod webdataset;
mod wrong;
