//! Rays through given walls, and how they are turned to meet a source.

use glam::DVec3;
use turbid_optics::pencil::{Aim, Pencil};

use super::Next;
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, sum};
use crate::walker::Walker;
use crate::way::SAME;
use crate::world::Skin;

/// A ray behind the last wall of its way.
pub(super) struct Shot {
    pub pencil: Pencil,
    pub skin: Option<Skin>,
    /// Refractive index there.
    pub n: f64,
    /// What the walls let through or reflect.
    pub passed: f64,
    /// Optical depth, and mm in each medium that tells channels apart.
    pub tau: f64,
    pub lengths: Lengths,
    /// As of a [`Link`](crate::link::Link).
    pub exit: Option<DVec3>,
}

/// By which normals walls turn a ray.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Walls {
    AsTheyAre,
    /// Meshes by those of the smooth surfaces that they stand for: the ray knows about where to go on facets that it has not met yet.
    Rounded,
}

/// Newton's method doubles the digits, from some way off.
const MOST_STEPS: usize = 12;
/// A step is halved as often before the trial is given up.
const MOST_HALVINGS: usize = 4;
/// The largest step, rad.
const LARGEST_STEP: f64 = 0.5;
/// Rad; what is left after a step of so much is its square.
const SETTLED: f64 = 1e-8;

impl Walker<'_> {
    /// Turns a ray along w with these events until it meets the source; `None` where it does not come to that.
    pub(super) fn connect(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<Skin>),
        w: DVec3,
        events: &[bool],
        walls: Walls,
    ) -> Option<(Shot, Aim)> {
        let shot = self.shoot(begin, w, events, walls)?;
        let aim = shot.aim(source)?;
        self.steer(source, begin, (shot, aim), events, walls)
    }

    /// The same, of a ray that has been shot.
    pub(super) fn steer(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<Skin>),
        (mut shot, mut aim): (Shot, Aim),
        events: &[bool],
        walls: Walls,
    ) -> Option<(Shot, Aim)> {
        for _ in 0..MOST_STEPS {
            let size = aim.turn.length();
            if size < SETTLED {
                return Some((shot, aim));
            }
            let mut step = aim.turn * (LARGEST_STEP / size).min(1.0);
            let mut next = None;
            for _ in 0..MOST_HALVINGS {
                let tried = self.shoot(begin, shot.pencil.turned(step), events, walls);
                let better = tried.and_then(|shot| shot.aim(source).map(|aim| (shot, aim)));
                next = better.filter(|(_, a)| a.miss < aim.miss);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            let Some((better, better_aim)) = next else {
                // As near as rounding lets it come.
                return (size < SAME).then_some((shot, aim));
            };
            (shot, aim) = (better, better_aim);
        }
        None
    }

    /// A ray through its events; `None` where one of them cannot be.
    pub(super) fn shoot(
        &mut self,
        (r, skin): (DVec3, Option<Skin>),
        w: DVec3,
        events: &[bool],
        walls: Walls,
    ) -> Option<Shot> {
        let world = self.setting.world;
        let pencil = Pencil::new(r, w);
        let mut shot = Shot { pencil, skin, n: f64::NAN, passed: 1.0, tau: 0.0, lengths: NO_LENGTHS, exit: None };
        for &reflected in events {
            let Next::Edge(edge) = self.next_edge(shot.pencil.r, shot.pencil.w, shot.skin) else { return None };
            let pencil = &mut shot.pencil;
            pencil.fly(edge.distance);
            let (wall, p) = (edge.wall, pencil.r);
            let solid = &world.bodies[wall.body].solid;
            let normal = solid.normal(wall.face, p);
            let inside = normal.dot(pencil.w) > 0.0;
            let indices = (edge.n, edge.beyond);
            let reflectance = match walls {
                Walls::AsTheyAre => pencil.meet(normal, |d| solid.bends(wall.face, p, d), indices, reflected)?,
                Walls::Rounded => {
                    let rounded = solid.rounded_normal(wall.face, p);
                    let met = pencil.meet(rounded, |d| solid.rounded_bends(wall.face, p, d), indices, reflected)?;
                    // It may not have met the facet and gone on behind it.
                    (inside == ((normal.dot(pencil.w) > 0.0) != reflected)).then_some(met)?
                }
            };
            shot.passed *= match (edge.is_mirror(), reflected) {
                (true, true) => 1.0,
                (true, false) => return None,
                (false, true) => reflectance,
                (false, false) => 1.0 - reflectance,
            };
            shot.n = if reflected { edge.n } else { edge.beyond };
            shot.skin = Some(Skin { wall, inside: inside == reflected });
            shot.tau += edge.tau;
            shot.lengths = sum(&shot.lengths, &edge.lengths);
            shot.exit.get_or_insert(edge.exit);
        }
        Some(shot)
    }
}

impl Shot {
    pub fn aim(&self, source: Source<'_>) -> Option<Aim> {
        match source.origin() {
            (_, Some(along)) => self.pencil.aim_along(-along),
            (origin, None) => self.pencil.aim_at(origin),
        }
    }
}
