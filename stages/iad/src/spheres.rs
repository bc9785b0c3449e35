//! The energy balance of integrating spheres: from what a slab does to light to what the detectors read, and back.
//!
//! Light that leaves a Lambertian wall falls on every share of its sphere alike. With E the flux that leaves wall and
//! detector, S what the sample sends into the sphere and X = E + k S the flux that falls on the whole surface,
//!
//! ```text
//! E = m X + source,   m = r_wall (1 - sample - third - detector) + r_detector detector,
//! I = sample E        on a flat sample (which does not light itself; k = 1 / (1 - sample)),
//! I = sample X        on a sample that is part of the sphere (k = 1, the textbook's form).
//! ```
//! S follows from the slab: S_R = UR1 + URU I_R + UTU I_T, S_T = UT1 + URU I_T + UTU I_R. All of it is linear, so given
//! URU and UTU the readings yield UR1 and UT1 without iteration.
//!
//! Sources: Pickering et al., Appl. Opt. 32, 399 (1993); Prahl, van Gemert, Welch, Appl. Opt. 32, 559 (1993).

use crate::Error;

/// One sphere; port sizes are shares of the surface of the whole sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    pub sample: f64,
    /// The entrance of the reflectance sphere, or what is left open opposite the sample in the transmittance sphere.
    pub third: f64,
    pub detector: f64,
    /// Diffuse reflectance of the wall, in [0, 1].
    pub wall_reflectance: f64,
    /// What the detector throws back, in [0, 1].
    pub detector_reflectance: f64,
    /// Reflectance of what closes the third port, in [0, 1]; 0 where it is open.
    pub third_reflectance: f64,
    /// Light falls straight from the sample into the detector; false behind a baffle.
    pub sees_sample: bool,
    /// The sample closes its port as a plane, not as a piece of the sphere.
    pub flat: bool,
}

impl Sphere {
    /// A sphere of the diameter `diameter` with round ports of these diameters, a black detector that sees the sample.
    pub fn with_round_ports(diameter: f64, sample: f64, third: f64, detector: f64, wall_reflectance: f64) -> Self {
        // A cap over a port of radius a on a sphere of radius R has the share (1 - sqrt(1 - a^2 / R^2)) / 2.
        let share = |port: f64| {
            let x = port / diameter;
            0.5 * x * x / (1.0 + (1.0 - x * x).max(0.0).sqrt())
        };
        Self {
            sample: share(sample),
            third: share(third),
            detector: share(detector),
            wall_reflectance,
            detector_reflectance: 0.0,
            third_reflectance: 0.0,
            sees_sample: true,
            flat: false,
        }
    }

    fn check(&self) -> Result<(), Error> {
        let shares = [("sample port", self.sample), ("third port", self.third), ("detector port", self.detector)];
        for (name, value) in shares {
            if !(0.0..1.0).contains(&value) {
                return Err(Error::Range { name, value, must: "be a share of the sphere in [0, 1)" });
            }
        }
        let ports = self.sample + self.third + self.detector;
        if ports >= 1.0 {
            return Err(Error::Range {
                name: "ports together",
                value: ports,
                must: "leave some wall (shares below 1)",
            });
        }
        for (name, value) in [
            ("wall reflectance", self.wall_reflectance),
            ("detector reflectance", self.detector_reflectance),
            ("reflectance in the third port", self.third_reflectance),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::Range { name, value, must: "lie in [0, 1]" });
            }
        }
        if self.sample == 0.0 {
            return Err(Error::Range { name: "sample port", value: 0.0, must: "be above 0" });
        }
        if self.wall_reflectance == 0.0 && !self.sees_sample {
            return Err(Error::Range {
                name: "wall reflectance",
                value: 0.0,
                must: "be above 0 where the detector sees the wall only",
            });
        }
        Ok(())
    }

    fn throwback(&self) -> f64 {
        let wall = 1.0 - self.sample - self.third - self.detector;
        self.wall_reflectance * wall + self.detector_reflectance * self.detector + self.third_reflectance * self.third
    }

    fn k(&self) -> f64 {
        if self.flat { 1.0 / (1.0 - self.sample) } else { 1.0 }
    }

    /// (slope, offset) of the light on the sample, I = slope S + offset, under this source.
    fn on_sample(&self, source: f64) -> (f64, f64) {
        let m = self.throwback();
        let own = if self.flat { 0.0 } else { 1.0 };
        (self.sample * (m * self.k() / (1.0 - m) + own), self.sample * source / (1.0 - m))
    }

    /// (slope, offset) of the reading per share of detector, slope S + offset.
    fn reading(&self, source: f64) -> (f64, f64) {
        let m = self.throwback();
        let straight = if self.sees_sample { self.k() } else { 0.0 };
        (m * self.k() / (1.0 - m) + straight, source / (1.0 - m))
    }
}

/// Reflectance and transmittance spheres, and whether light passes from one to the other through the sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spheres {
    /// The readings are UR1 and UT1 themselves.
    None,
    /// Each reading is taken with its sphere alone.
    One([Sphere; 2]),
    /// Both spheres stand at the sample.
    Two([Sphere; 2]),
}

/// All that stands between the slab and its readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    pub spheres: Spheres,
    /// Reflectance of the standard that defines M_R, in (0, 1].
    pub r_standard: f64,
    /// What M_T reads without a sample, in (0, 1].
    pub t_standard: f64,
    /// Share of the beam that meets the wall of the reflectance sphere before the sample, in [0, 1).
    pub wall_first: f64,
    /// Shares of the unscattered reflected and transmitted light that are collected, in [0, 1].
    pub unscattered: [f64; 2],
    /// Unscattered transmitted light, and the beam without a sample, first meet the wall of the transmittance sphere
    /// (a real beam); false: they count as diffuse light from the sample (the textbook's form).
    pub straight: bool,
}

impl Instrument {
    /// Readings that need no correction.
    pub const NONE: Self = Self {
        spheres: Spheres::None,
        r_standard: 1.0,
        t_standard: 1.0,
        wall_first: 0.0,
        unscattered: [1.0, 1.0],
        straight: false,
    };

    /// What cannot be: ports that leave no wall, reflectances outside [0, 1].
    pub fn check(&self) -> Result<(), Error> {
        if let Spheres::One(spheres) | Spheres::Two(spheres) = &self.spheres {
            spheres.iter().try_for_each(Sphere::check)?;
        }
        for value in [self.r_standard, self.t_standard] {
            if !(value > 0.0 && value <= 1.0) {
                return Err(Error::Range { name: "standard", value, must: "reflect in (0, 1]" });
            }
        }
        if !(0.0..1.0).contains(&self.wall_first) {
            return Err(Error::Range { name: "wall_first", value: self.wall_first, must: "lie in [0, 1)" });
        }
        for value in self.unscattered {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::Range { name: "unscattered share", value, must: "lie in [0, 1]" });
            }
        }
        Ok(())
    }
}

/// What a slab does to the light, as the spheres need it; index 0 the beam's side, 1 the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Total reflectance and transmittance of the beam.
    pub beam: [f64; 2],
    /// The part of `beam` that was never scattered.
    pub unscattered: [f64; 2],
    /// Reflectance of diffuse light from either side, and its transmittance.
    pub uru: [f64; 2],
    pub utu: f64,
}

/// Light that a wide slab would send into the spheres and the sample on the instrument does not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lost {
    /// Of the beam, reflected and transmitted.
    pub beam: [f64; 2],
    /// Of diffuse light from the spheres.
    pub diffuse: [f64; 2],
}

impl Instrument {
    /// M_R and M_T of a slab.
    pub fn readings(&self, seen: &Seen, lost: &Lost) -> [f64; 2] {
        let seen = seen.less(lost);
        let collected = |i: usize| seen.beam[i] - (1.0 - self.unscattered[i]) * seen.unscattered[i];
        match &self.spheres {
            Spheres::None => [collected(0), collected(1)],
            Spheres::One(spheres) => self.read(spheres, &seen, [collected(0), collected(1)], 0.0),
            Spheres::Two(spheres) => self.read(spheres, &seen, [collected(0), collected(1)], 1.0),
        }
    }

    /// UR1 and UT1 that stand behind readings, given all else that the slab does.
    pub fn slab(&self, readings: [f64; 2], seen: &Seen, lost: &Lost) -> [f64; 2] {
        let kept = seen.less(lost);
        let mut beam = match &self.spheres {
            Spheres::None => readings,
            Spheres::One(spheres) => self.unread(spheres, &kept, readings, 0.0),
            Spheres::Two(spheres) => self.unread(spheres, &kept, readings, 1.0),
        };
        for (i, beam) in beam.iter_mut().enumerate() {
            *beam += (1.0 - self.unscattered[i]) * seen.unscattered[i] + lost.beam[i];
        }
        beam
    }

    /// What meets the walls before anything else, of the reflectance and of the transmittance sphere.
    fn sources(&self, spheres: &[Sphere; 2], straight: f64) -> [f64; 2] {
        let wall = |i: usize| spheres[i].wall_reflectance;
        [self.wall_first * wall(0), if self.straight { (1.0 - self.wall_first) * straight * wall(1) } else { 0.0 }]
    }

    fn read(&self, spheres: &[Sphere; 2], seen: &Seen, collected: [f64; 2], joined: f64) -> [f64; 2] {
        let straight = self.unscattered[1] * seen.unscattered[1];
        let sources = self.sources(spheres, straight);
        let from_beam = [collected[0], collected[1] - if self.straight { straight } else { 0.0 }];
        let sent = self.sent(spheres, sources, from_beam, seen, joined);
        let scale = self.scales(spheres, joined);
        std::array::from_fn(|i| {
            let (slope, offset) = spheres[i].reading(sources[i]);
            (slope * sent[i] + offset - scale[i].0) / scale[i].1
        })
    }

    fn unread(&self, spheres: &[Sphere; 2], seen: &Seen, readings: [f64; 2], joined: f64) -> [f64; 2] {
        let straight = self.unscattered[1] * seen.unscattered[1];
        let sources = self.sources(spheres, straight);
        let scale = self.scales(spheres, joined);
        let sent: [f64; 2] = std::array::from_fn(|i| {
            let (slope, offset) = spheres[i].reading(sources[i]);
            (readings[i] * scale[i].1 + scale[i].0 - offset) / slope
        });
        let lit: [f64; 2] = std::array::from_fn(|i| {
            let (slope, offset) = spheres[i].on_sample(sources[i]);
            slope * sent[i] + offset
        });
        let beam: [f64; 2] = std::array::from_fn(|i| {
            (sent[i] - seen.uru[i] * lit[i] - joined * seen.utu * lit[1 - i]) / (1.0 - self.wall_first)
        });
        [beam[0], beam[1] + if self.straight { straight } else { 0.0 }]
    }

    /// Flux that the sample sends into either sphere.
    fn sent(&self, spheres: &[Sphere; 2], sources: [f64; 2], beam: [f64; 2], seen: &Seen, joined: f64) -> [f64; 2] {
        let lit: [(f64, f64); 2] = std::array::from_fn(|i| spheres[i].on_sample(sources[i]));
        let own: [f64; 2] = std::array::from_fn(|i| {
            (1.0 - self.wall_first) * beam[i] + seen.uru[i] * lit[i].1 + joined * seen.utu * lit[1 - i].1
        });
        let keep: [f64; 2] = std::array::from_fn(|i| 1.0 - seen.uru[i] * lit[i].0);
        let cross: [f64; 2] = std::array::from_fn(|i| joined * seen.utu * lit[1 - i].0);
        let determinant = keep[0] * keep[1] - cross[0] * cross[1];
        [(own[0] * keep[1] + cross[0] * own[1]) / determinant, (own[1] * keep[0] + cross[1] * own[0]) / determinant]
    }

    /// (dark, scale) of each reading: M_R = (R - R_open) / ((R_standard - R_open) / r_standard), the standard on the
    /// reflectance sphere alone; M_T = T t_standard / T_straight, the last without a sample.
    fn scales(&self, spheres: &[Sphere; 2], joined: f64) -> [(f64, f64); 2] {
        let sources = self.sources(spheres, 0.0);
        let r = self.r_standard;
        let white = Seen { beam: [r, 0.0], unscattered: [0.0; 2], uru: [r, 0.0], utu: 0.0 };
        let standard = self.sent(spheres, sources, white.beam, &white, 0.0)[0];
        let (slope, open) = spheres[0].reading(sources[0]);
        // Without a sample light passes the open port unchanged; a sphere alone loses it.
        let sources = self.sources(spheres, 1.0);
        let from_beam = [0.0, if self.straight { 0.0 } else { 1.0 }];
        let hole = Seen { beam: from_beam, unscattered: [0.0; 2], uru: [0.0; 2], utu: 1.0 };
        let sent = self.sent(spheres, sources, from_beam, &hole, joined)[1];
        let (t_slope, t_offset) = spheres[1].reading(sources[1]);
        [(open, slope * standard / r), (0.0, (t_slope * sent + t_offset) / self.t_standard)]
    }
}

impl Seen {
    fn less(&self, lost: &Lost) -> Self {
        Self {
            beam: [self.beam[0] - lost.beam[0], self.beam[1] - lost.beam[1]],
            uru: self.uru.map(|u| u - lost.diffuse[0]),
            utu: self.utu - lost.diffuse[1],
            ..*self
        }
    }
}

#[cfg(test)]
#[allow(clippy::needless_range_loop, reason = "two spheres, each a number in many arrays")]
mod tests {
    use super::*;

    fn sphere(flat: bool, sees_sample: bool, detector_reflectance: f64) -> Sphere {
        let open = Sphere::with_round_ports(100.0, 20.0, 15.0, 10.0, 0.96);
        Sphere { flat, sees_sample, detector_reflectance, third_reflectance: 2.0 * detector_reflectance, ..open }
    }

    const SEEN: Seen = Seen { beam: [0.4, 0.3], unscattered: [0.03, 0.1], uru: [0.5, 0.45], utu: 0.25 };
    const LOST: Lost = Lost { beam: [0.01, 0.02], diffuse: [0.03, 0.01] };

    fn each(check: impl Fn(&Instrument)) {
        for spheres in [Spheres::One, Spheres::Two] {
            for flat in [false, true] {
                for sees in [false, true] {
                    for straight in [false, true] {
                        let spheres = spheres([sphere(flat, sees, 0.1), sphere(flat, sees, 0.05)]);
                        let rest = Instrument {
                            r_standard: 0.9,
                            t_standard: 0.97,
                            wall_first: 0.1,
                            unscattered: [0.3, 0.8],
                            ..Instrument::NONE
                        };
                        check(&Instrument { spheres, straight, ..rest });
                    }
                }
            }
        }
        check(&Instrument { unscattered: [0.3, 0.8], ..Instrument::NONE });
    }

    /// The way back undoes the way there; a few roundings of numbers of order 1.
    #[test]
    fn the_balance_inverts() {
        each(|instrument| {
            let read = instrument.readings(&SEEN, &LOST);
            let back = instrument.slab(read, &SEEN, &LOST);
            assert!((back[0] - 0.4).abs() < 1e-13 && (back[1] - 0.3).abs() < 1e-13, "{instrument:?}: {back:?}");
        });
    }

    /// The closed balance is the sum of its bounces: follow the light generation by generation.
    #[test]
    fn the_balance_sums_the_bounces() {
        each(|instrument| {
            let (Spheres::One(spheres) | Spheres::Two(spheres)) = &instrument.spheres else { return };
            let joined = if matches!(instrument.spheres, Spheres::Two(_)) { 1.0 } else { 0.0 };
            // Light in flight: from walls and from the sample, in each sphere.
            let trace = |mut wall: [f64; 2], mut sample: [f64; 2], uru: [f64; 2], utu: f64, joined: f64| {
                let mut read = [0.0; 2];
                for _ in 0..4000 {
                    let mut next = ([0.0; 2], [0.0; 2]);
                    let mut onto = [0.0; 2];
                    for i in 0..2 {
                        let s = &spheres[i];
                        let k = if s.flat { 1.0 / (1.0 - s.sample) } else { 1.0 };
                        let falls = wall[i] + k * sample[i];
                        read[i] += wall[i] + if s.sees_sample { k * sample[i] } else { 0.0 };
                        next.0[i] = falls
                            * (s.wall_reflectance * (1.0 - s.sample - s.third - s.detector)
                                + s.detector_reflectance * s.detector
                                + s.third_reflectance * s.third);
                        onto[i] = s.sample * if s.flat { wall[i] } else { falls };
                    }
                    for i in 0..2 {
                        next.1[i] = uru[i] * onto[i] + joined * utu * onto[1 - i];
                    }
                    (wall, sample) = next;
                }
                read
            };
            let f = instrument.wall_first;
            let first = |sphere: usize, light: f64| spheres[sphere].wall_reflectance * light;
            let seen = SEEN.less(&LOST);
            let straight = 0.8 * seen.unscattered[1];
            let beam = [seen.beam[0] - 0.7 * 0.03, seen.beam[1] - 0.2 * 0.1];
            let split = |through: f64, straight: f64| {
                if instrument.straight { (through - straight, first(1, straight)) } else { (through, 0.0) }
            };
            let (diffuse, on_wall) = split(beam[1], straight);
            let sources = [first(0, f), (1.0 - f) * on_wall];
            let sample = trace(sources, [(1.0 - f) * beam[0], (1.0 - f) * diffuse], seen.uru, seen.utu, joined);
            let standard = trace([first(0, f), 0.0], [(1.0 - f) * 0.9, 0.0], [0.9, 0.0], 0.0, 0.0);
            let open = trace([first(0, f), 0.0], [0.0; 2], [0.0; 2], 0.0, 0.0);
            let (diffuse, on_wall) = split(1.0, 1.0);
            let none = trace([first(0, f), (1.0 - f) * on_wall], [0.0, (1.0 - f) * diffuse], [0.0; 2], 1.0, joined);
            let wanted = [0.9 * (sample[0] - open[0]) / (standard[0] - open[0]), 0.97 * sample[1] / none[1]];
            let got = instrument.readings(&SEEN, &LOST);
            assert!((0..2).all(|i| (got[i] - wanted[i]).abs() < 1e-12), "{instrument:?}: {got:?} {wanted:?}");
        });
    }

    #[test]
    fn what_cannot_be_is_named() {
        let two = |change: fn(&mut Sphere)| {
            let mut bad = sphere(false, true, 0.0);
            change(&mut bad);
            Instrument { spheres: Spheres::Two([bad, sphere(false, true, 0.0)]), ..Instrument::NONE }.check()
        };
        assert!(two(|_| ()).is_ok());
        assert!(matches!(two(|s| s.wall_reflectance = 1.01), Err(Error::Range { name: "wall reflectance", .. })));
        assert!(matches!(two(|s| s.wall_reflectance = f64::NAN), Err(Error::Range { .. })));
        assert!(matches!(two(|s| s.third = 0.995), Err(Error::Range { name: "ports together", .. })));
        assert!(matches!(two(|s| s.sample = 0.0), Err(Error::Range { name: "sample port", .. })));
    }
}
