//! The history of one photon: beam, spheres, sample, until it is detected, absorbed or lost.

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;

use crate::direction::{anywhere, in_cap, lambertian};
use crate::plate::{Plate, Ray};
use crate::sphere::{Port, Sphere};
use crate::stream::Stream;
use crate::tally::{Fate, Score};

/// How light in a sphere is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// All bounces on the wall summed in closed form; needs spheres without baffle.
    Summed,
    /// Bounce by bounce, with the detector's share of each added as its expected value.
    Traced,
    /// Bounce by bounce, counting what falls into the detector: slow, and the test of the two others.
    Counted,
}

/// What is at the sample port.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    Medium(Plate),
    /// A Lambertian plate of this reflectance that lets nothing through.
    White(f64),
    /// Nothing, and nothing behind it: light that enters the port is gone.
    Open,
    /// Nothing, and the second sphere behind it.
    Joined,
    /// The sample of the textbooks: a part of the sphere that reflects and transmits by the cosine law, on both sides alike;
    /// reflectance and transmittance for the beam, reflectance and transmittance for diffuse light.
    Cap([f64; 4]),
}

/// The light that comes in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Radius at the entrance, mm; evenly filled.
    pub radius: f64,
    /// Cosine of the half angle of a cone of even intensity; 1 for a parallel beam.
    pub cos_half_angle: f64,
}

/// A double-sphere experiment: reflectance sphere (0) and transmittance sphere (1), each in its own coordinates with the sample below.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    pub spheres: [Sphere; 2],
    pub target: Target,
    pub beam: Beam,
    pub method: Method,
    /// Light ends on the white surfaces of the spheres when it has left them so many times; `None`: never.
    pub bounces: Option<u32>,
}

/// Weights below this play roulette on their way back into the sample or on the wall.
const FAINT: f64 = 0.25;

enum At {
    /// Inside the sphere, on its way.
    Flight {
        r: DVec3,
        u: DVec3,
        falls: Falls,
    },
    /// Leaves the point `r` of the wall by the cosine law.
    Glow {
        r: DVec3,
    },
    /// Between sphere and sample.
    Neck {
        r: DVec3,
        u: DVec3,
    },
    /// On the sample's plane, from above.
    Face {
        r: DVec3,
        u: DVec3,
    },
    End,
}

/// What light that falls into the detector on this flight does there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Falls {
    Counts,
    /// Was already added, as an expected value.
    Counted,
    /// Comes from where the detector does not look.
    Unseen,
}

struct History<'a> {
    setup: &'a Setup,
    /// The sphere in which the photon is.
    side: usize,
    weight: f64,
    /// How often it may still leave a white surface.
    bounces: Option<u32>,
    /// Whether it has met nothing yet.
    direct: bool,
    score: Score,
    random: Stream,
}

impl Setup {
    /// Sends one photon of weight 1.
    pub fn photon(&self, random: Stream) -> Score {
        let mut history = History {
            setup: self,
            side: 0,
            weight: 1.0,
            bounces: self.bounces,
            direct: true,
            score: Score::default(),
            random,
        };
        let (r, u) = history.launch();
        let mut at = At::Flight { r, u, falls: Falls::Counts };
        loop {
            at = match at {
                At::Flight { r, u, falls } => history.fly(r, u, falls),
                At::Glow { r } => history.glow(r),
                At::Neck { r, u } => history.neck(r, u),
                At::Face { r, u } => history.face(r, u),
                At::End => return history.score,
            }
        }
    }
}

/// 1 + q + q^2 + ... + q^n, from the last term.
fn geometric(q: f64, n: u32) -> f64 {
    let mut sum = 1.0;
    for _ in 0..n {
        let longer = 1.0 + q * sum;
        // What no longer changes never will: limits beyond some thousands cost nothing.
        if longer == sum {
            break;
        }
        sum = longer;
    }
    sum
}

impl History<'_> {
    fn sphere(&self) -> &Sphere {
        &self.setup.spheres[self.side]
    }

    fn launch(&mut self) -> (DVec3, DVec3) {
        let Beam { radius, cos_half_angle } = self.setup.beam;
        let distance = radius * self.random.uniform().sqrt();
        let (sin, cos) = sin_cos_turns(self.random.uniform());
        let (x, y) = (distance * cos, distance * sin);
        let sphere = self.sphere().radius;
        let r = DVec3::new(x, y, (sphere * sphere - x * x - y * y).sqrt());
        let u =
            if cos_half_angle < 1.0 { in_cap(DVec3::NEG_Z, cos_half_angle, &mut self.random) } else { DVec3::NEG_Z };
        (r, u)
    }

    fn fly(&mut self, r: DVec3, u: DVec3, falls: Falls) -> At {
        let q = self.sphere().far(r, u);
        if let Some(distance) = self.sphere().to_baffle(r, u, (q - r).length()) {
            return self.baffle(r + distance * u, u);
        }
        match self.sphere().port_at(q) {
            Some(Port::Sample) => match self.setup.target {
                Target::Cap(shares) => self.cap(q, shares),
                _ => At::Neck { r: q, u },
            },
            Some(Port::Detector) => match falls {
                Falls::Counts => {
                    self.score.detected[self.side] += self.weight;
                    At::End
                }
                Falls::Counted => At::End,
                Falls::Unseen => self.end(Fate::Unseen),
            },
            Some(Port::Entrance) => self.end(Fate::Entrance),
            Some(Port::Exit) => self.end(Fate::Exit),
            None => self.meet_white(At::Glow { r: q }),
        }
    }

    fn end(&mut self, fate: Fate) -> At {
        self.score.book(fate, self.weight);
        At::End
    }

    /// The photon meets a white surface and goes on to `then` with what is reflected.
    fn meet_white(&mut self, then: At) -> At {
        self.direct = false;
        let reflectance = self.sphere().reflectance;
        match &mut self.bounces {
            Some(0) => return self.end(Fate::Wall),
            Some(left) => *left -= 1,
            None => {}
        }
        if self.setup.method == Method::Counted {
            return if self.random.uniform() < reflectance { then } else { self.end(Fate::Wall) };
        }
        self.score.book(Fate::Wall, self.weight * (1.0 - reflectance));
        self.weight *= reflectance;
        if self.weight > 0.0 { then } else { At::End }
    }

    /// Whether the photon goes on; a faint one does so with more weight or not at all.
    fn survives(&mut self) -> bool {
        if self.weight >= FAINT || self.setup.method == Method::Counted {
            return true;
        }
        if self.random.uniform() * FAINT < self.weight {
            self.score.book(Fate::Roulette, self.weight - FAINT);
            self.weight = FAINT;
            return true;
        }
        self.score.book(Fate::Roulette, self.weight);
        false
    }

    /// The photon leaves a point of the wall. Light that leaves a sphere's wall by the cosine law falls evenly on the whole sphere, wherever
    /// it starts: each port gets its share of the surface.
    fn glow(&mut self, r: DVec3) -> At {
        match self.setup.method {
            Method::Summed => self.glow_summed(r),
            Method::Traced => {
                self.detect_from_wall(r);
                if !self.survives() {
                    return At::End;
                }
                let u = (self.sphere().radius * anywhere(&mut self.random) - r).normalize();
                At::Flight { r, u, falls: Falls::Counted }
            }
            Method::Counted => {
                let inwards = -r.normalize();
                At::Flight { r, u: lambertian(inwards, &mut self.random), falls: Falls::Counts }
            }
        }
    }

    /// What the wall has sent out after all bounces is a geometric series; what of it falls on the sample goes on.
    fn glow_summed(&mut self, r: DVec3) -> At {
        let sphere = &self.setup.spheres[self.side];
        let (reflectance, wall) = (sphere.reflectance, sphere.wall_fraction());
        let again = reflectance * wall;
        // 1 + again + again^2 + ..., to the last bounce.
        let series = match self.bounces {
            None => 1.0 / (1.0 - again),
            Some(left) => geometric(again, left),
        };
        let sent = self.weight * series;
        self.score.detected[self.side] += sent * sphere.port_fraction(Port::Detector);
        self.score.book(Fate::Entrance, sent * sphere.port_fraction(Port::Entrance));
        self.score.book(Fate::Exit, sent * sphere.port_fraction(Port::Exit));
        self.score.book(Fate::Wall, self.weight - sent * (1.0 - wall));
        self.weight = sent * sphere.sample.fraction;
        if !self.survives() {
            return At::End;
        }
        // Which bounce sends it to the sample: the first is where it is; from the second on, all of the wall is alike.
        let mut chance = self.random.uniform() * series - 1.0;
        let first = chance < 0.0;
        if let Some(left) = &mut self.bounces {
            let mut share = again;
            while chance >= 0.0 && *left > 0 {
                *left -= 1;
                chance -= share;
                share *= again;
            }
        }
        let from = if first {
            r
        } else {
            loop {
                let r = sphere.radius * anywhere(&mut self.random);
                if sphere.port_at(r).is_none() {
                    break r;
                }
            }
        };
        let q = sphere.sample.point(&mut self.random);
        if let Target::Cap(shares) = self.setup.target {
            return self.cap(q, shares);
        }
        At::Neck { r: q, u: (q - from).normalize() }
    }

    fn detect_from_wall(&mut self, r: DVec3) {
        let sphere = &self.setup.spheres[self.side];
        if let Some(detector) = sphere.detector() {
            // Without a baffle every point of the detector is seen.
            if sphere.baffle.is_none() || sphere.sees(r, detector.point(&mut self.random)) {
                self.score.detected[self.side] += self.weight * detector.fraction;
            }
        }
    }

    fn baffle(&mut self, r: DVec3, u: DVec3) -> At {
        let sphere = &self.setup.spheres[self.side];
        let Some(baffle) = sphere.baffle else { return At::End };
        let normal = if u.dot(baffle.normal) < 0.0 { baffle.normal } else { -baffle.normal };
        let onward = lambertian(normal, &mut self.random);
        let falls = if self.setup.method == Method::Counted { Falls::Counts } else { Falls::Counted };
        let next = self.meet_white(At::Flight { r, u: onward, falls });
        if falls == Falls::Counted
            && let (At::Flight { .. }, Some(detector)) = (&next, sphere.detector())
        {
            let q = detector.point(&mut self.random);
            let way = q - r;
            let distance2 = way.length_squared();
            // cos cos' A / (pi d^2), with A the share of 4 pi R^2; both cosines still hold one factor d.
            let cosines = (way.dot(normal) * way.dot(q) / sphere.radius).max(0.0) / distance2;
            let area = 4.0 * sphere.radius * sphere.radius * detector.fraction;
            self.score.detected[self.side] += self.weight * cosines * area / distance2;
        }
        if matches!(next, At::End) || !self.survives() { At::End } else { next }
    }

    /// The textbook sample: chance decides whether the photon is reflected, transmitted or absorbed.
    fn cap(&mut self, q: DVec3, [r_beam, t_beam, r, t]: [f64; 4]) -> At {
        let [reflected, transmitted] = if self.direct { [r_beam, t_beam] } else { [r, t] };
        self.direct = false;
        let chance = self.random.uniform();
        if chance >= reflected + transmitted {
            return self.end(Fate::Sample);
        }
        if chance >= reflected {
            self.side = 1 - self.side;
        }
        At::Glow { r: q }
    }

    /// From the wall's surface to the sample's plane or back, past the neck's sides.
    fn neck(&mut self, mut r: DVec3, mut u: DVec3) -> At {
        let setup = self.setup;
        let sphere = &setup.spheres[self.side];
        loop {
            // The flat sample cuts off the bulge of the sphere: light that has reached the bulge met the plane before (distance < 0).
            let to_plane = if u.z < 0.0 { (r.z + sphere.plane) / -u.z } else { f64::INFINITY };
            let (b, c) = (r.dot(u), r.length_squared() - sphere.radius * sphere.radius);
            // Inside the sphere already; but not what has just come to its surface on the way out (rounding leaves 1e-16).
            let inside = c < -1e-9 * sphere.radius * sphere.radius;
            let to_sphere = if u.z > 0.0 && (inside || (c <= 0.0 && b < 0.0)) {
                0.0
            } else if b < 0.0 && c > 0.0 && b * b > c {
                -b - (b * b - c).sqrt()
            } else {
                f64::INFINITY
            };
            let (to_side, normal) = sphere.sample.wall(r, u);
            if to_plane.min(to_sphere) > to_side {
                // A hair inside: a point on the edge of sphere and side would be in neither.
                r += to_side * u + 1e-12 * sphere.radius * normal;
                if matches!(self.meet_white(At::Neck { r, u }), At::End) || !self.survives() {
                    return At::End;
                }
                u = lambertian(normal, &mut self.random);
            } else if to_sphere < to_plane {
                let falls = if sphere.sees_sample { Falls::Counts } else { Falls::Unseen };
                return At::Flight { r: r + to_sphere * u, u, falls };
            } else {
                r += to_plane * u;
                r.z = -sphere.plane;
                return At::Face { r, u };
            }
        }
    }

    fn face(&mut self, r: DVec3, u: DVec3) -> At {
        match self.setup.target {
            Target::Medium(plate) => self.medium(&plate, r, u),
            Target::White(reflectance) => {
                self.direct = false;
                self.score.book(Fate::Sample, self.weight * (1.0 - reflectance));
                self.weight *= reflectance;
                if self.weight == 0.0 || !self.survives() {
                    return At::End;
                }
                At::Neck { r, u: lambertian(DVec3::Z, &mut self.random) }
            }
            Target::Open => self.end(Fate::Rim),
            Target::Joined => {
                self.side = 1 - self.side;
                At::Neck { r, u: DVec3::new(u.x, u.y, -u.z) }
            }
            Target::Cap(_) => unreachable!("a cap is met on the sphere"),
        }
    }

    fn medium(&mut self, plate: &Plate, r: DVec3, u: DVec3) -> At {
        if r.x.abs() > 0.5 * plate.size[0] || r.y.abs() > 0.5 * plate.size[1] {
            return self.end(Fate::Rim);
        }
        // Depth grows away from the first sphere.
        let entry = if self.side == 0 {
            Ray { r: DVec3::new(r.x, r.y, 0.0), u: DVec3::new(u.x, u.y, -u.z) }
        } else {
            Ray { r: DVec3::new(r.x, r.y, plate.thickness), u }
        };
        let passage = plate.pass(entry, &mut self.random);
        let incident = self.weight;
        self.score.book(Fate::Sample, incident * passage.absorbed);
        self.score.book(Fate::Sides, incident * passage.sides);
        self.score.book(Fate::Roulette, incident * passage.roulette);
        let from = self.side;
        let mut collected = [0.0; 2];
        self.weight = incident * passage.out;
        let next = match passage.ray {
            None => At::End,
            Some(leaving) => {
                self.side = usize::from(leaving.u.z > 0.0);
                let sphere = &self.setup.spheres[self.side];
                let r = DVec3::new(leaving.r.x, leaving.r.y, -sphere.plane);
                if sphere.sample.frames(r) {
                    collected[self.side] = passage.out;
                    At::Neck { r, u: DVec3::new(leaving.u.x, leaving.u.y, leaving.u.z.abs()) }
                } else {
                    self.end(Fate::Rim)
                }
            }
        };
        let lost = [0, 1].map(|side| incident * (passage.wide[side] - collected[side]));
        let entered = if self.direct { &mut self.score.beam } else { &mut self.score.diffuse };
        entered.incident += incident;
        entered.lost_r += lost[from];
        entered.lost_t += lost[1 - from];
        self.direct = false;
        if matches!(next, At::End) || !self.survives() { At::End } else { next }
    }
}
