//! Data sets as a user builds them: whole, grown, killed, side by side, damaged, and asked for wrongly. Studies.

mod damage;
mod full_disk;
mod growth;
mod halves;
mod kills;
mod parts;
mod released;
mod shard;
mod space;
mod statistics;
mod studies;
#[cfg(unix)]
mod submit;
mod webdataset;
mod wrong;
