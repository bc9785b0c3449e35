//! Why a wrong joint may pass the check, and what makes that certain.

use turbid::registry::Registry;
use turbid_contract::payload::Quantity;

use super::wrong::Wrong;

/// What a wrong input makes of the outputs that are said before a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effect {
    None,
    Shows,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The producer's payload declares it (units, columns): a run that makes another is itself the one that fails.
    Declared,
    /// Carried on to what is made of it, and compared where that is read.
    CarriedOn,
    /// Less is known of the result, and it says so: nothing is wrong.
    LessKnown,
    /// The stage does not read it.
    NotRead,
    /// It may be so, as the words say.
    May(&'static str),
}

impl Reason {
    /// Panics where the reason cannot be that one.
    pub fn assert(self, wrong: Wrong, effect: Effect, producer: &str, consumer: &str) {
        let told = format!("{consumer} < {producer}: {wrong:?} passes as {self:?}, but ");
        match self {
            Self::Declared => assert!(declares(producer, wrong), "{told}{producer} does not declare it"),
            Self::CarriedOn => assert_eq!(effect, Effect::Shows, "{told}it does not show in what is made of it"),
            Self::LessKnown => assert_eq!(wrong, Wrong::Errors, "{told}it is no error"),
            Self::NotRead => assert_eq!(effect, Effect::None, "{told}it shows in what is made of it"),
            Self::May(why) => assert_eq!(effect, Effect::None, "{told}it shows in what is made of it: {why}"),
        }
    }
}

/// Whether the payload of an output declares what is wrong: all units, or all names.
fn declares(producer: &str, wrong: Wrong) -> bool {
    let (stage, port) = producer.split_once('.').expect("a stage and its port");
    let registry = Registry::builtin();
    let outputs = (registry.find(stage).expect("a stage").outputs)();
    let holds: &[Quantity] = outputs.iter().find(|out| out.name == port).expect("an output").holds;
    match wrong {
        Wrong::Unit => !holds.is_empty() && holds.iter().all(|q| q.unit.is_some() || q.name == "cov"),
        Wrong::Quantity | Wrong::Columns => !holds.is_empty(),
        _ => false,
    }
}
