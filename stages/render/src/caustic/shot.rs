//! Rays that interfaces refract and reflect as given events say, and how they are turned to meet a source.

use glam::DVec3;
use turbid_optics::ray_differential::{NewtonStep, RayDifferential};

use super::Next;
use crate::connection::SAME;
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, sum};
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// A ray behind the last interface of its chain.
pub(super) struct Shot {
    pub differential: RayDifferential,
    pub surface_point: Option<SurfacePoint>,
    /// Refractive index there.
    pub n: f64,
    /// What the interfaces let through or reflect.
    pub passed: f64,
    /// Optical depth, and mm in each medium that tells channels apart.
    pub tau: f64,
    pub lengths: Lengths,
    /// As of a [`Connection`](crate::connection::Connection).
    pub exit: Option<DVec3>,
}

/// By which normals interfaces turn a ray.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum SurfaceNormals {
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
    pub(super) fn walk_from(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        w: DVec3,
        events: &[bool],
        surface_normals: SurfaceNormals,
    ) -> Option<(Shot, NewtonStep)> {
        let shot = self.shoot(begin, w, events, surface_normals)?;
        let newton = shot.newton(source)?;
        self.manifold_walk(source, begin, (shot, newton), events, surface_normals)
    }

    /// The same, of a ray that has been shot.
    pub(super) fn manifold_walk(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        (mut shot, mut newton): (Shot, NewtonStep),
        events: &[bool],
        surface_normals: SurfaceNormals,
    ) -> Option<(Shot, NewtonStep)> {
        for _ in 0..MOST_STEPS {
            let size = newton.turn.length();
            if size < SETTLED {
                return Some((shot, newton));
            }
            let mut step = newton.turn * (LARGEST_STEP / size).min(1.0);
            let mut next = None;
            for _ in 0..MOST_HALVINGS {
                let tried = self.shoot(begin, shot.differential.turned(step), events, surface_normals);
                let better = tried.and_then(|shot| shot.newton(source).map(|newton| (shot, newton)));
                next = better.filter(|(_, a)| a.miss < newton.miss);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            let Some((better, better_newton)) = next else {
                // As near as rounding lets it come.
                return (size < SAME).then_some((shot, newton));
            };
            (shot, newton) = (better, better_newton);
        }
        None
    }

    /// A ray through its events; `None` where one of them cannot be.
    pub(super) fn shoot(
        &mut self,
        (r, surface_point): (DVec3, Option<SurfacePoint>),
        w: DVec3,
        events: &[bool],
        surface_normals: SurfaceNormals,
    ) -> Option<Shot> {
        let world = self.setting.world;
        let differential = RayDifferential::new(r, w);
        let mut shot =
            Shot { differential, surface_point, n: f64::NAN, passed: 1.0, tau: 0.0, lengths: NO_LENGTHS, exit: None };
        for &reflected in events {
            let Next::Edge(edge) = self.next_edge(shot.differential.r, shot.differential.w, shot.surface_point) else {
                return None;
            };
            let differential = &mut shot.differential;
            differential.fly(edge.distance);
            let (interface, p) = (edge.interface, differential.r);
            let solid = &world.bodies[interface.body].solid;
            let normal = solid.normal(interface.face, p);
            let inside = normal.dot(differential.w) > 0.0;
            let indices = (edge.n, edge.beyond);
            let reflectance = match surface_normals {
                SurfaceNormals::AsTheyAre => {
                    differential.meet(normal, |d| solid.bends(interface.face, p, d), indices, reflected)?
                }
                SurfaceNormals::Rounded => {
                    let rounded = solid.rounded_normal(interface.face, p);
                    let met = differential.meet(
                        rounded,
                        |d| solid.rounded_bends(interface.face, p, d),
                        indices,
                        reflected,
                    )?;
                    // It may not have met the facet and gone on behind it.
                    (inside == ((normal.dot(differential.w) > 0.0) != reflected)).then_some(met)?
                }
            };
            shot.passed *= match (edge.is_mirror(), reflected) {
                (true, true) => 1.0,
                (true, false) => return None,
                (false, true) => reflectance,
                (false, false) => 1.0 - reflectance,
            };
            shot.n = if reflected { edge.n } else { edge.beyond };
            shot.surface_point = Some(SurfacePoint { interface, inside: inside == reflected });
            shot.tau += edge.tau;
            shot.lengths = sum(&shot.lengths, &edge.lengths);
            shot.exit.get_or_insert(edge.exit);
        }
        Some(shot)
    }
}

impl Shot {
    pub fn newton(&self, source: Source<'_>) -> Option<NewtonStep> {
        match source.origin() {
            (_, Some(along)) => self.differential.newton_step_along(-along),
            (origin, None) => self.differential.newton_step_to(origin),
        }
    }
}
