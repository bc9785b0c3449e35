//! What is known of a pixel beforehand: the light on what it looks at, and where in the fringe that lies. Responses without both are
//! *reduced*.

/// What is known of a pixel beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Guide<'a> {
    /// Irradiance at the centre of what is seen, but for the power of the light.
    pub gain: f64,
    /// (sin, cos) of each carrier there.
    pub phases: &'a [(f64, f64)],
}

impl Guide<'_> {
    /// Response i as a sum of weight x reduced response.
    pub fn in_reduced(&self, i: usize) -> [(usize, f64); 2] {
        if i == 0 {
            return [(0, self.gain), (0, 0.0)];
        }
        let re = i - (i - 1) % 2;
        let (sin, cos) = self.phases[(i - 1) / 2];
        let (of_re, of_im) = if i == re { (cos, -sin) } else { (sin, cos) };
        [(re, self.gain * of_re), (re + 1, self.gain * of_im)]
    }

    /// Reduced response a as a sum of weight x response: undoes [`in_reduced`](Self::in_reduced).
    pub fn reduced(&self, a: usize) -> [(usize, f64); 2] {
        if a == 0 {
            return [(0, 1.0 / self.gain), (0, 0.0)];
        }
        let re = a - (a - 1) % 2;
        let (sin, cos) = self.phases[(a - 1) / 2];
        let (of_re, of_im) = if a == re { (cos, sin) } else { (-sin, cos) };
        [(re, of_re / self.gain), (re + 1, of_im / self.gain)]
    }

    /// The sum of weight x response over `terms` by reduced responses, each once.
    pub fn collect(&self, terms: &[(usize, f64)]) -> Vec<(usize, f64)> {
        let mut sums: Vec<(usize, f64)> = Vec::with_capacity(2 * terms.len());
        for &(i, weight) in terms {
            for (a, w) in self.in_reduced(i) {
                match sums.iter_mut().find(|s| s.0 == a) {
                    Some(sum) => sum.1 += weight * w,
                    None => sums.push((a, weight * w)),
                }
            }
        }
        sums
    }
}
