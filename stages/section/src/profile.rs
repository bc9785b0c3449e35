//! What the camera sees along the wall, averaged around it.

/// A pixel of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Arc length, mm.
    pub s: f64,
    pub m_dc: f64,
    pub m_ac: f64,
}

/// Pixels of the wall between two arc lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ring {
    pub pixels: f64,
    /// Sum of M_DC.
    pub m_dc: f64,
    /// Sums of ln M_DC and ln M_AC, and of their squares.
    pub logs: [f64; 2],
    pub squares: [f64; 2],
}

/// Rings of equal length from the mouth on; those without pixels are empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    pub rings: Vec<Ring>,
    /// mm.
    pub ring_mm: f64,
}

/// Rings of a profile: bounds of sections lie between them.
pub const RINGS: usize = 256;

impl Profile {
    /// Of pixels with positive M_DC and M_AC, up to the arc length `length`.
    pub fn of(pixels: &[Pixel], length: f64) -> Self {
        let ring_mm = length / RINGS as f64;
        let mut rings = vec![Ring::default(); RINGS];
        for p in pixels {
            let ring = &mut rings[((p.s / ring_mm) as usize).min(RINGS - 1)];
            ring.pixels += 1.0;
            ring.m_dc += p.m_dc;
            for (k, ln) in [libm::log(p.m_dc), libm::log(p.m_ac)].into_iter().enumerate() {
                ring.logs[k] += ln;
                ring.squares[k] += ln * ln;
            }
        }
        Self { rings, ring_mm }
    }

    /// The falling profile that is nearest to `value` of the rings in the sense of least squares over pixels (isotonic regression by
    /// pooling adjacent violators): light gets less into a tube, and noise must not make sections. An empty ring has the value before it.
    pub fn falling(&self, value: impl Fn(&Ring) -> f64) -> Vec<f64> {
        // (mean, weight, rings).
        let mut blocks: Vec<(f64, f64, usize)> = Vec::new();
        for ring in &self.rings {
            if ring.pixels == 0.0 && !blocks.is_empty() {
                blocks.last_mut().expect("not empty").2 += 1;
                continue;
            }
            let own = if ring.pixels > 0.0 { value(ring) } else { f64::INFINITY };
            let mut block = (own, ring.pixels, 1);
            while let Some(&(mean, weight, rings)) = blocks.last()
                && (mean < block.0 || weight == 0.0)
            {
                blocks.pop();
                let both = weight + block.1;
                let mean = if weight > 0.0 { (mean * weight + block.0 * block.1) / both } else { block.0 };
                block = (mean, both, rings + block.2);
            }
            blocks.push(block);
        }
        blocks.iter().flat_map(|&(mean, _, rings)| std::iter::repeat_n(mean, rings)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(values: &[(f64, f64)]) -> Profile {
        let ring = |&(pixels, mean): &(f64, f64)| Ring { pixels, m_dc: pixels * mean, ..Ring::default() };
        Profile { rings: values.iter().map(ring).collect(), ring_mm: 1.0 }
    }

    /// Falling values stay; neighbours that rise become their mean by pixels; the sum over pixels is kept; empty rings follow.
    #[test]
    fn violators_are_pooled() {
        let mean = |r: &Ring| r.m_dc / r.pixels;
        let falling = profile(&[(2.0, 9.0), (1.0, 7.0), (4.0, 1.0)]);
        assert_eq!(falling.falling(mean), [9.0, 7.0, 1.0]);
        let rising = profile(&[(1.0, 5.0), (3.0, 9.0), (0.0, 0.0), (4.0, 10.0), (2.0, 1.0)]);
        assert_eq!(rising.falling(mean), [9.0, 9.0, 9.0, 9.0, 1.0]);
        let empty_first = profile(&[(0.0, 0.0), (1.0, 5.0), (1.0, 3.0)]);
        assert_eq!(empty_first.falling(mean), [5.0, 5.0, 3.0]);
    }
}
