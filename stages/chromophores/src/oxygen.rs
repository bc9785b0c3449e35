//! Total haemoglobin and its oxygen saturation, with standard errors.

/// HbO2 + Hb with its variance, of the covariance of (HbO2, Hb).
pub fn total(hbo2: f64, hb: f64, covariance: Option<[[f64; 2]; 2]>) -> (f64, Option<f64>) {
    (hbo2 + hb, covariance.map(|c| c[0][0] + c[1][1] + 2.0 * c[0][1]))
}

/// StO2 = HbO2 / (HbO2 + Hb) with its variance to first order:
///
/// var(StO2) = (Hb^2 var(HbO2) + HbO2^2 var(Hb) - 2 HbO2 Hb cov(HbO2, Hb)) / THb^4
///
/// `None` where the total is not above 0: without haemoglobin there is no saturation.
pub fn saturation(hbo2: f64, hb: f64, covariance: Option<[[f64; 2]; 2]>) -> Option<(f64, Option<f64>)> {
    let total = hbo2 + hb;
    (total > 0.0).then(|| {
        let [by_hbo2, by_hb] = [hb / total / total, -hbo2 / total / total];
        let variance =
            |c: [[f64; 2]; 2]| by_hbo2 * by_hbo2 * c[0][0] + by_hb * by_hb * c[1][1] + 2.0 * by_hbo2 * by_hb * c[0][1];
        // Errors that go together leave a rounding of either sign.
        (hbo2 / total, covariance.map(|c| variance(c).max(0.0)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error common to both, in proportion, leaves the saturation; opposite errors leave the total.
    #[test]
    fn errors_cancel_where_they_must() {
        let scaled = Some([[16.0, 8.0], [8.0, 4.0]]);
        let (st_o2, variance) = saturation(40.0, 20.0, scaled).expect("there is haemoglobin");
        assert!((st_o2 - 2.0 / 3.0).abs() < 1e-15 && variance.expect("it is known") < 1e-18);
        let opposite = Some([[4.0, -4.0], [-4.0, 4.0]]);
        assert_eq!(total(40.0, 20.0, opposite), (60.0, Some(0.0)));
        // d(StO2) = 2 uM / 60 uM.
        let (_, variance) = saturation(40.0, 20.0, opposite).expect("there is haemoglobin");
        assert!((variance.expect("it is known").sqrt() - 2.0 / 60.0).abs() < 1e-15);
        assert_eq!(saturation(0.0, 0.0, None), None);
        assert_eq!(saturation(5.0, -5.0, None), None);
    }
}
