//! What z scores are judged by.

/// Mean within 4 standard errors of 0, standard deviation within 4 of 1 (its own is 1 / sqrt(2 n)), none above 4.5.
pub fn judge(name: &str, z: &[f64]) {
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let sd = (z.iter().map(|z| (z - mean) * (z - mean)).sum::<f64>() / (n - 1.0)).sqrt();
    let worst = z.iter().fold(0.0f64, |worst, z| worst.max(z.abs()));
    println!("{name}: {n} z scores, mean {mean:.2}, sd {sd:.2}, worst {worst:.2}");
    let ok = mean.abs() < 4.0 / n.sqrt() && (sd - 1.0).abs() < 4.0 / (2.0 * n).sqrt() && worst < 4.5;
    assert!(ok, "{name}: mean {mean}, sd {sd}, z {z:.2?}");
}

/// Mean and standard error of `n` values.
pub fn mean(n: u64, value: impl Fn(u64) -> f64) -> (f64, f64) {
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..n {
        let x = value(i);
        sum += x;
        squares += x * x;
    }
    let mean = sum / n as f64;
    (mean, ((squares / n as f64 - mean * mean) / (n - 1) as f64).sqrt())
}
