//! A store in S3 as a user has it: pushed, pulled, behind runs; with every fault that a network, a service or a user makes.

mod count;
mod faults;
mod kills;
mod secrets;
mod service;
mod space;
mod usual;
