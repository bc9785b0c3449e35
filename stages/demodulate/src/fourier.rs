//! The discrete Fourier transform of lines whose length is a power of two; the same bits on every machine.

use turbid_optics::elementary::sin_cos_turns;

/// (re, im)
pub type Complex = [f64; 2];

pub fn product([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

/// sum_j x_j e^(-+ 2 pi i jk / n) in place (minus forwards, plus backwards); backwards undoes forwards times n.
pub fn transform(line: &mut [Complex], backwards: bool) {
    let n = line.len();
    assert!(n.is_power_of_two(), "a line of {n}");
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = if bits == 0 { 0 } else { i.reverse_bits() >> (usize::BITS - bits) };
        if j > i {
            line.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        for k in 0..half {
            let (sin, cos) = sin_cos_turns(k as f64 / (2 * half) as f64);
            let turn = [cos, if backwards { sin } else { -sin }];
            for start in (0..n).step_by(2 * half) {
                let (a, b) = (line[start + k], product(turn, line[start + k + half]));
                line[start + k] = [a[0] + b[0], a[1] + b[1]];
                line[start + k + half] = [a[0] - b[0], a[1] - b[1]];
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the sum as it is written, and back again; 1e-13 is the rounding of 64 terms.
    #[test]
    fn it_is_the_sum_and_goes_back() {
        for n in [1, 2, 8, 64] {
            let line: Vec<Complex> = (0..n).map(|i| [libm::sin(i as f64 * 1.7), 0.1 * i as f64]).collect();
            let mut found = line.clone();
            transform(&mut found, false);
            for (k, found) in found.iter().enumerate() {
                let mut sum = [0.0, 0.0];
                for (j, &x) in line.iter().enumerate() {
                    let (s, c) = sin_cos_turns((j * k % n) as f64 / n as f64);
                    let term = product(x, [c, -s]);
                    sum = [sum[0] + term[0], sum[1] + term[1]];
                }
                assert!((found[0] - sum[0]).abs() + (found[1] - sum[1]).abs() < 1e-12, "n = {n}, k = {k}");
            }
            transform(&mut found, true);
            for (found, want) in found.iter().zip(&line) {
                assert!((found[0] / n as f64 - want[0]).abs() + (found[1] / n as f64 - want[1]).abs() < 1e-13);
            }
        }
    }
}
