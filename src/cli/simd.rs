//! `TURBID_SIMD`.

use super::Failure;

/// `TURBID_SIMD` forces a level of vector instructions, for tests: results must not depend on it.
pub(super) fn simd_level() -> Result<String, Failure> {
    let asked = std::env::var("TURBID_SIMD").unwrap_or_default();
    match asked.as_str() {
        "" | "best" => Ok(String::new()),
        "baseline" | "v3" | "v4" => Ok(asked),
        _ => Err(Failure::Input(format!("TURBID_SIMD = {asked} must be baseline, v3, v4 or best"))),
    }
}
