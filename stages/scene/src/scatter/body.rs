//! Convex bodies, and whether two of them keep a distance.

use glam::DVec3;
use turbid_optics::solid::Frame;

/// Steps towards the nearest points of two bodies. What is not decided then touches, or is nearer to the wanted distance than a part in 500
/// (`distances_are_known`).
const STEPS: usize = 100;
/// Shifts of weight in each step.
const SHIFTS: usize = 12;

/// A body about the origin, mm.
#[derive(Clone, Copy, Debug)]
pub enum Body {
    Ellipsoid { radii: DVec3, frame: Frame },
    Cylinder { radius: f64, half_length: f64, axis: DVec3 },
}

impl Body {
    /// Its point that lies farthest along the unit vector `n`.
    pub fn farthest(&self, n: DVec3) -> DVec3 {
        match *self {
            Self::Ellipsoid { radii, frame } => {
                let n = radii * frame.direction_into(n);
                frame.direction_out(radii * n.normalize_or_zero())
            }
            Self::Cylinder { radius, half_length, axis } => {
                let along = axis.dot(n);
                radius * (n - along * axis).normalize_or_zero() + half_length.copysign(along) * axis
            }
        }
    }

    /// Half its extents along x, y and z.
    pub fn half(&self) -> DVec3 {
        DVec3::new(self.farthest(DVec3::X).x, self.farthest(DVec3::Y).y, self.farthest(DVec3::Z).z)
    }

    /// Radii of the balls about its middle that it holds, and that hold it.
    fn balls(&self) -> [f64; 2] {
        match *self {
            Self::Ellipsoid { radii, .. } => [radii.min_element(), radii.max_element()],
            Self::Cylinder { radius, half_length, .. } => {
                [radius.min(half_length), libm::sqrt(radius * radius + half_length * half_length)]
            }
        }
    }
}

/// Whether the surfaces of two bodies, with their middles at `p` and `q`, are `least` mm or more apart; never true where they are not.
///
/// Decided by balls where these tell, else by the point of the bodies' difference that is nearest to the origin: a mean of a few of its
/// points that lie farthest in some direction, which take weight from each other until it is. Each step bounds the distance from both
/// sides. Source: Gilbert, SIAM J. Control 4, 61 (1966); steps between two points by Mitchell, Dem'yanov and Malozemov, SIAM J. Control
/// 12, 19 (1974).
pub fn keep_apart((a, p): (&Body, DVec3), (b, q): (&Body, DVec3), least: f64) -> bool {
    let (between, [a_in, a_out], [b_in, b_out]) = ((p - q).length(), a.balls(), b.balls());
    if between >= a_out + b_out + least {
        return true;
    }
    if between < a_in + b_in + least {
        return false;
    }
    // From a point of b to one of a.
    let mut mean = Mean { points: vec![(p - q, 1.0)] };
    for _ in 0..STEPS {
        let v = mean.value();
        let length = v.length();
        if length < least || length == 0.0 {
            return false;
        }
        let towards = v / length;
        let w = p + a.farthest(-towards) - q - b.farthest(towards);
        // No point of the difference lies nearer to the origin than the plane through w across v.
        let bound = towards.dot(w);
        if bound > 0.0 && bound >= least {
            return true;
        }
        mean.add(w);
    }
    false
}

/// A weighted mean of points.
struct Mean {
    points: Vec<(DVec3, f64)>,
}

impl Mean {
    fn value(&self) -> DVec3 {
        self.points.iter().map(|(point, weight)| *weight * *point).sum()
    }

    /// Takes a point in, and shifts weight between points so that the mean comes nearer to the origin.
    fn add(&mut self, point: DVec3) {
        self.points.push((point, 0.0));
        for _ in 0..SHIFTS {
            let v = self.value();
            let order = |i: &usize, j: &usize| v.dot(self.points[*i].0).total_cmp(&v.dot(self.points[*j].0));
            let held = |i: &usize| self.points[*i].1 > 0.0;
            let (Some(to), Some(from)) =
                ((0..self.points.len()).min_by(order), (0..self.points.len()).filter(held).max_by(order))
            else {
                break;
            };
            let way = self.points[to].0 - self.points[from].0;
            if to == from || way.length_squared() == 0.0 {
                break;
            }
            let most = self.points[from].1;
            let shift = (-v.dot(way) / way.length_squared()).clamp(0.0, most);
            self.points[to].1 += shift;
            self.points[from].1 = if shift == most { 0.0 } else { most - shift };
        }
        self.points.retain(|(_, weight)| *weight > 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(radius: f64) -> Body {
        Body::Ellipsoid { radii: DVec3::splat(radius), frame: Frame::turned(DVec3::ZERO, [0.0; 3]) }
    }

    /// Pairs with a known distance d: apart by 0.998 d (but for d = 0), not by 1.002 d.
    #[test]
    fn distances_are_known() {
        let spheroid = |turn: f64| Body::Ellipsoid {
            radii: DVec3::new(1.0, 2.0, 4.0),
            frame: Frame::turned(DVec3::ZERO, [0.0, turn, 0.0]),
        };
        let rod = |axis: DVec3| Body::Cylinder { radius: 1.0, half_length: 5.0, axis };
        let cases = [
            ("balls", ball(1.0), ball(2.0), DVec3::new(3.0, 0.0, 4.0), 2.0),
            ("ball on a tip", spheroid(0.0), ball(1.0), 7.0 * DVec3::Z, 2.0),
            ("ball at a side", spheroid(90.0), ball(1.0), 7.0 * DVec3::Z, 5.0),
            ("tip to tip", spheroid(90.0), spheroid(90.0), 9.0 * DVec3::X, 1.0),
            ("crossed rods", rod(DVec3::X), rod(DVec3::Y), 3.0 * DVec3::Z, 1.0),
            ("parallel rods", rod(DVec3::X), rod(DVec3::X), DVec3::new(7.0, 3.0, 0.0), 1.0),
            ("rods end to end", rod(DVec3::X), rod(DVec3::X), DVec3::new(10.5, 0.7, 0.0), 0.5),
            ("rods edge to edge", rod(DVec3::X), rod(DVec3::X), DVec3::new(13.0, 6.0, 0.0), 5.0),
        ];
        for (name, a, b, at, d) in cases {
            for (least, expected) in [(0.0, true), (0.998 * d, true), (1.002 * d, false)] {
                assert_eq!(keep_apart((&a, at), (&b, DVec3::ZERO), least), expected, "{name}, {least} of {d}");
                assert_eq!(keep_apart((&b, DVec3::ZERO), (&a, at), least), expected, "{name}, the other way");
            }
        }
        assert!(
            !keep_apart((&rod(DVec3::X), DVec3::Z), (&rod(DVec3::Y), DVec3::ZERO), 0.0),
            "they run through each other"
        );
        assert!(!keep_apart((&rod(DVec3::X), DVec3::ZERO), (&ball(0.1), 4.5 * DVec3::X), 0.0), "one holds the other");
    }

    /// The extents of a turned spheroid and of an aslant rod, in closed form.
    #[test]
    fn extents_are_exact() {
        let frame = Frame::turned(DVec3::ZERO, [0.0, 30.0, 0.0]);
        let spheroid = Body::Ellipsoid { radii: DVec3::new(1.0, 2.0, 4.0), frame };
        // sqrt(1^2 cos^2 + 4^2 sin^2) along x.
        let expected = DVec3::new((0.75f64 + 16.0 * 0.25).sqrt(), 2.0, (0.25f64 + 16.0 * 0.75).sqrt());
        assert!((spheroid.half() - expected).length() < 1e-12, "{}", spheroid.half());
        let rod = Body::Cylinder { radius: 1.0, half_length: 5.0, axis: DVec3::new(0.6, 0.0, 0.8) };
        assert!((rod.half() - DVec3::new(0.8 + 3.0, 1.0, 0.6 + 4.0)).length() < 1e-12, "{}", rod.half());
    }
}
