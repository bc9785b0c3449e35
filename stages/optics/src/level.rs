//! Which vector instructions the lane kernels use. Their results do not depend on it: every lane computes what a scalar would.

use fearless_simd::Level;

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
