//! How many threads a program may start, and the pool for what is done before and after a run.

use std::error::Error;
use std::sync::OnceLock;

/// As many as this are allowed on any machine, so that files and scripts made for a larger one work on a smaller one ...
const ALWAYS: usize = 256;
/// ... and as many for each thread that the machine can run at a time.
const PER_THREAD: usize = 4;

/// Threads that this machine runs at a time; 1 where it does not tell.
pub fn of_machine() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get)
}

/// Reads the number of threads of a run: beyond a few for each of the machine's they only cost memory and time.
pub fn parse(text: &str) -> Result<usize, String> {
    let (machine, most) = (of_machine(), ALWAYS.max(PER_THREAD * of_machine()));
    match text.parse::<usize>() {
        Ok(jobs) if (1..=most).contains(&jobs) => Ok(jobs),
        _ => Err(format!(
            "the number of threads must be a whole number from 1 to {most}; without -j a run takes {machine}, all that this machine runs at a time"
        )),
    }
}

/// Whether work can be shared out among the threads of rayon's global pool; where the system starts none, one has to do it all.
pub fn shared() -> bool {
    static SHARED: OnceLock<bool> = OnceLock::new();
    *SHARED.get_or_init(|| {
        let built = rayon::ThreadPoolBuilder::new().num_threads(of_machine()).build_global();
        // An error without a source: somebody had built it already.
        built.err().is_none_or(|error| error.source().is_none())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_threads_are_bounded() {
        assert_eq!((parse("1"), parse("256")), (Ok(1), Ok(256)));
        for wrong in ["0", "-1", "100000", "1000000", "99999999999999999999", "two", "", "1.5"] {
            assert!(parse(wrong).is_err_and(|e| e.contains("from 1 to")), "{wrong}");
        }
        assert!(shared());
    }
}
