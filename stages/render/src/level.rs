//! Which vector instructions the lane kernels use. Their results do not depend on it: every lane computes what a scalar would.

use std::sync::OnceLock;

use fearless_simd::Level;

/// The best that this machine has, or what `TURBID_SIMD=baseline|v3|v4` asks for (for tests) where the machine has it.
pub fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| named(std::env::var("TURBID_SIMD").as_deref().unwrap_or("")))
}

/// `baseline` (what every machine has), `v3` (AVX2), `v4` or anything else (the best that this machine has, AVX-512 at most).
pub fn named(name: &str) -> Level {
    let best = Level::new();
    match name {
        "baseline" => Level::baseline(),
        #[cfg(target_arch = "x86_64")]
        "v3" => best.as_avx2().map_or(best, Level::Avx2),
        _ => best,
    }
}
