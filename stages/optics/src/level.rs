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

/// Runs an expression with the vector instructions of a level, as `fearless_simd::dispatch!` does, in fewer copies: a processor
/// without AVX2 takes those that every x86-64 has (SSE2), whatever it has beyond them.
///
/// ```
/// use turbid_optics::{at_level, level};
///
/// fn wide<S: fearless_simd::Simd>(_: S) -> bool {
///     true
/// }
/// assert!(at_level!(level::named("baseline"), simd => wide(simd)));
/// ```
#[macro_export]
macro_rules! at_level {
    ($level:expr, $simd:ident => $op:expr) => {{
        let level: fearless_simd::Level = $level;
        #[cfg(target_arch = "x86_64")]
        {
            if let Some($simd) = level.as_avx512() {
                $op
            } else if let Some($simd) = level.as_avx2() {
                $op
            } else {
                let $simd = level.as_sse2().expect("every x86-64 has SSE2");
                $op
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            fearless_simd::dispatch!(level, $simd => $op)
        }
    }};
}
