//! Divided differences, over the square of the decay constant k, of what a mode does across a slab of depth l.
//!
//! `k coth(kl)` is its slope at the lit surface, `k / sinh(kl)` what reaches the other. The integral of two modes over the
//! depth is such a difference, [f(x_i) - f(x_j)] / (x_i - x_j) with x = k^2; equal modes make it the derivative.

/// A function of x = k^2 at one mode.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// k^2.
    pub x: f64,
    /// kl; may be infinite.
    y: f64,
    pub value: f64,
}

/// Taylor coefficients of y coth y in u = y^2, 2^2n B_2n / (2n)!.
const COTH: [f64; 11] = [
    1.0,
    1.0 / 3.0,
    -1.0 / 45.0,
    2.0 / 945.0,
    -1.0 / 4725.0,
    2.0 / 93_555.0,
    -1382.0 / 638_512_875.0,
    4.0 / 18_243_225.0,
    -3617.0 / 162_820_783_125.0,
    87_734.0 / 38_979_295_480_125.0,
    -349_222.0 / 1_531_329_465_290_625.0,
];

/// Those of y / sinh y, -2 (2^(2n-1) - 1) B_2n / (2n)!.
const SINH: [f64; 11] = [
    1.0,
    -1.0 / 6.0,
    7.0 / 360.0,
    -31.0 / 15_120.0,
    127.0 / 604_800.0,
    -73.0 / 3_421_440.0,
    1_414_477.0 / 653_837_184_000.0,
    -8191.0 / 37_362_124_800.0,
    16_931_177.0 / 762_187_345_920_000.0,
    -5_749_691_557.0 / 2_554_547_108_585_472_000.0,
    91_546_277_357.0 / 401_428_831_349_145_600_000.0,
];

/// Up to this y the series hold to the last bit: their terms fall as (y / pi)^2n.
const SERIES: f64 = 0.3;
/// Closer than this in ln x and in y the derivative halfway is the difference to 1e-10, and a difference of values is not.
const CLOSE: f64 = 3e-5;
/// Beyond, sinh y counts as infinite.
const DEEP: f64 = 350.0;

/// What a mode does across the slab.
#[derive(Clone, Copy, Debug)]
pub enum Across {
    /// k coth(kl)
    Slope,
    /// k / sinh(kl)
    Reach,
}

impl Across {
    pub fn at(self, k: f64, depth: f64) -> Point {
        let (x, y) = (k * k, k * depth);
        let value = match self {
            _ if y < SERIES => series(self.coefficients(), y * y, y * y).0 / depth,
            Self::Slope if y > DEEP => k,
            Self::Slope => k / libm::tanh(y),
            Self::Reach if y > DEEP => 0.0,
            Self::Reach => k / libm::sinh(y),
        };
        Point { x, y, value }
    }

    fn coefficients(self) -> &'static [f64] {
        match self {
            Self::Slope => &COTH,
            Self::Reach => &SINH,
        }
    }

    /// [f(a) - f(b)] / (a - b) over x.
    pub fn difference(self, a: &Point, b: &Point, depth: f64) -> f64 {
        if a.y < SERIES && b.y < SERIES {
            return depth * series(self.coefficients(), a.y * a.y, b.y * b.y).1;
        }
        let apart = (a.x - b.x).abs();
        if apart <= CLOSE * a.x / (1.0 + 0.5 * a.y) || a.y > DEEP && b.y > DEEP {
            return self.derivative(a, b, depth);
        }
        (a.value - b.value) / (a.x - b.x)
    }

    /// The derivative halfway; of the pure square root, to which the slope tends in the deep, exactly the difference.
    fn derivative(self, a: &Point, b: &Point, depth: f64) -> f64 {
        let k = (0.5 * (a.x + b.x)).sqrt();
        let y = k * depth;
        match self {
            Self::Slope if y > DEEP => 1.0 / (a.x.sqrt() + b.x.sqrt()),
            Self::Reach if y > DEEP => 0.0,
            Self::Slope => {
                let sinh = libm::sinh(y);
                (1.0 / libm::tanh(y) - y / (sinh * sinh)) / (2.0 * k)
            }
            Self::Reach => (1.0 - y / libm::tanh(y)) / (2.0 * k * libm::sinh(y)),
        }
    }
}

/// The value at `v` and the divided difference between `u` and `v` of a polynomial.
fn series(coefficients: &[f64], u: f64, v: f64) -> (f64, f64) {
    let (mut value, mut difference) = (0.0, 0.0);
    for c in coefficients.iter().rev() {
        (value, difference) = (c + v * value, value + u * difference);
    }
    (value, difference)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Series and closed form meet: 1e-15 is a few roundings of a value near 1.
    #[test]
    fn series_meet_the_functions() {
        for y in [0.05, 0.2, 0.29] {
            let (coth, _) = series(&COTH, y * y, y * y);
            let (sinh, _) = series(&SINH, y * y, y * y);
            assert!((coth * libm::tanh(y) / y - 1.0).abs() < 1e-15 && (sinh * libm::sinh(y) / y - 1.0).abs() < 1e-15);
        }
    }

    /// Along any way between two modes the differences add up: (f(c) - f(a)) = (f(c) - f(b)) + (f(b) - f(a)). Steps of all
    /// sizes, so every branch is held against the others; 1e-9 is the derivative's share at the switch.
    #[test]
    fn differences_add_up() {
        for depth in [1e-3, 1.0, 30.0, 2000.0] {
            for across in [Across::Slope, Across::Reach] {
                for k in [1e-4, 0.01, 0.29, 0.31, 1.0, 20.0] {
                    for step in [1e-12, 1e-7, 1e-5, 1e-4, 0.01] {
                        let [a, b, c] = [1.0, 1.0 + step, 1.0 + 2.7 * step].map(|f| across.at(k * f, depth));
                        let way = |a: &Point, b: &Point| across.difference(a, b, depth) * (a.x - b.x);
                        let (whole, parts) = (way(&a, &c), way(&a, &b) + way(&b, &c));
                        // A value has its last bits from those of kl, so a plain difference has no more.
                        let bits = 1e-15 * (1.0 + k * depth) * a.value.abs();
                        assert!(
                            (whole - parts).abs() <= 1e-9 * whole.abs() + bits,
                            "{across:?} l {depth} k {k} step {step}: {whole:e} {parts:e}"
                        );
                        let plain = a.value - c.value;
                        assert!(
                            (whole - plain).abs() <= 1e-9 * whole.abs() + bits,
                            "{across:?} l {depth} k {k} step {step}: {whole:e}, plainly {plain:e}"
                        );
                    }
                }
            }
        }
    }
}
