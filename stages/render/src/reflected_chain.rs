//! Specular chains through parallel planes that some of these reflect, one of them at random.

use glam::DVec3;
use turbid_optics::refraction::Crossing;

use crate::ahead::OTHER_CONNECTIONS;
use crate::connect::{Draws, Target};
use crate::connection::{Connection, SpecularChain};
use crate::lamp::Source;
use crate::random::Dice;
use crate::strata::{Bending, Strata};
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// The least and the most probable reflection of a chain.
const RARE: f64 = 0.05;
const OFTEN: f64 = 0.95;
/// What is less than this part of the light goes on by roulette, through a layer at least with the probability `FAINT`, be it never so dark.
const WEAK: f64 = 0.1;
const FAINT: f64 = 1e-3;
/// Chains by more planes than this go on from each with this probability. At grazing slopes between close planes chains of dozens matter.
const LONG: usize = 64;
const SHORTENED: f64 = 0.8;

impl Walker<'_> {
    /// One of the other lit chains, at random.
    #[inline]
    pub(crate) fn reflected_connection(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        draws: &Draws<'_>,
    ) -> Option<Connection> {
        if !matches!(self.bending, Bending::AtPlanes(_)) {
            return None;
        }
        if draws.whether(source)[0] >= OTHER_CONNECTIONS {
            return None;
        }
        let mut dice = draws.which(source);
        self.on_scratch(|walker, chain| {
            let probability = walker.with_reflections(source, r, surface_point, chain, &mut dice)?;
            walker.along(source, r, surface_point, chain, OTHER_CONNECTIONS * probability)
        })
        .filter(|connection| connection.lit)
    }

    /// A chain with reflections, and its probability.
    ///
    /// At a plane it is reflected with a probability near the reflectance at the slope of the least steep chain that can follow, and where upright light has been lost in
    /// layers it goes on with a probability near what is left: every further stretch makes chains steeper and longer, so none weighs more than it brings but for the few
    /// beyond `LONG`, and most end soon. Those that do not end by roulette: hardly one in 1e6 is twice as long.
    fn with_reflections(
        &self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        chain: &mut SpecularChain,
        dice: &mut Dice,
    ) -> Option<f64> {
        let Bending::AtPlanes(strata) = &self.bending else { return None };
        let target = Target::of(source);
        let [upwards, ..] = dice.throw();
        let mut up = upwards < 0.5;
        let mut probability = 0.5;
        let (mut layer, mut z) = (self.layer(strata, r, surface_point, up), r.z);
        let last = strata.layer(target.origin.z, !target.is_above(r.z));
        let mut passed = std::mem::take(&mut chain.passed);
        passed.clear();
        passed.resize(strata.layers.len(), 0.0);
        let mut left = 1.0;
        let found = loop {
            let [ends, reflects, goes_on, _] = dice.throw();
            let onward = strata.onward(layer, up).filter(|&(_, next)| !strata.layers[next].opaque);
            if layer == last && up == target.is_above(z) {
                let ends = onward.is_none() || ends < 0.5;
                probability *= if onward.is_none() { 1.0 } else { 0.5 };
                if ends {
                    chain.go(strata.layers[last].n, z, target.origin.z, up);
                    break true;
                }
            }
            let Some((edge, next)) = onward else { break false };
            let before = (left / WEAK).min(1.0);
            // The first stretch begins within its layer.
            if chain.is_bent() {
                left *= self.clear[layer].max(FAINT);
            }
            let mut kept = (left / WEAK).min(1.0) / before;
            if chain.turns() >= LONG {
                kept *= SHORTENED;
            }
            if goes_on >= kept {
                break false;
            }
            probability *= kept;
            passed[layer] += (edge - z).abs();
            let (n, beyond) = (strata.layers[layer].n, strata.layers[next].n);
            let likely = match target.reflected(strata, &passed, (layer, edge, up), (r, last)) {
                Some(slope) => slope.reflectance(n, beyond).clamp(RARE, OFTEN),
                None => 0.0,
            };
            let reflected = reflects < likely;
            probability *= if reflected { likely } else { 1.0 - likely };
            chain.go(n, z, edge, up);
            chain.meet(n, beyond, reflected);
            z = edge;
            if reflected {
                up = !up;
            } else {
                layer = next;
            }
        };
        chain.passed = passed;
        // Without a reflection it is the direct connection.
        (found && chain.is_reflected()).then_some(probability)
    }
}

impl Target {
    /// The least steep chain to here from r that has `passed` so much of each layer, is at the `edge` of one, going `up` or down, and is reflected there. `None`
    /// where it does not come here any more.
    fn reflected(
        &self,
        strata: &Strata,
        passed: &[f64],
        (layer, edge, up): (usize, f64, bool),
        (r, last): (DVec3, usize),
    ) -> Option<Crossing> {
        // Through the whole layer, to be reflected again, if it would go away from here.
        let away = up == self.is_above(edge);
        let across = if away { 2.0 * (strata.onward(layer, !up)?.0 - edge).abs() } else { 0.0 };
        self.least_steep(strata, passed, (edge, layer, across), (r, last))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use turbid_optics::solid::Solid;
    use turbid_optics::view::View;

    use super::*;
    use crate::camera::Camera;
    use crate::lamp::{Lamp, Steady};
    use crate::level::named;
    use crate::light::Light;
    use crate::projected_images::ProjectedImages;
    use crate::random::{NeeSite, Stream};
    use crate::setting::{Nee, Setting};
    use crate::world::{Body, Material, World};

    /// Thickness, mu_t, n.
    type Sheet = (f64, f64, f64);

    /// Slabs from z = 0 downwards.
    fn slabs(layers: &[Sheet]) -> World {
        let mut world = World { bodies: Vec::new(), materials: vec![Material::VOID], textures: Vec::new() };
        let mut top = 0.0;
        for &(thickness, mu_t, n) in layers {
            world.materials.push(Material::medium(0.0, mu_t, turbid_optics::PhaseFunction::ISOTROPIC, n));
            let solid = Solid::Slab { bottom: top - thickness, top };
            world.bodies.push(Body { solid, material: world.materials.len() - 1 });
            top -= thickness;
        }
        world
    }

    fn beam(degrees: f64) -> Lamp {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let along = DVec3::new(-sin, 0.0, -cos);
        Lamp::beam(-1e5 * along, along, 50.0, 1.0)
    }

    /// The mean of what reflected chains bring is the sum over all of them, one after the other, at slopes from upright to grazing (where
    /// numbers that repeat went to and fro for ever): to 4.5 standard errors, which are below 5 % of the light that comes in all. 13 cases; and what was
    /// cut off the sum, 1e-9 of it. The longest chains have some hundreds of planes, and most are short.
    #[test]
    fn reflected_chains_bring_what_all_reflections_bring() {
        let point = |x: f64, z: f64| Lamp::point(DVec3::new(x, 0.0, z), 1.0);
        let (tissue, thin) = ([(10.0, 0.05, 1.4)], [(1.0, 0.3, 1.4)]);
        let glass = [(1.0, 0.0, 1.5), (2.0, 0.2, 1.4), (0.5, 0.0, 2.5)];
        let cases: [(&str, &[Sheet], Lamp, DVec3); 13] = [
            ("from above", &tissue, point(0.0, 500.0), DVec3::new(3.0, 1.0, -2.0)),
            ("1 mm above, near", &tissue, point(0.0, 1.0), DVec3::new(2.0, 1.0, -0.3)),
            ("1 mm above, far", &tissue, point(0.0, 1.0), DVec3::new(30.0, 1.0, -1.0)),
            ("200 mm aside, 5 mm high", &tissue, point(200.0, 5.0), DVec3::new(0.0, 1.0, -1.0)),
            ("200 mm aside, 2 mm high", &tissue, point(200.0, 2.0), DVec3::new(0.0, 1.0, -9.0)),
            ("200 mm aside, 0.1 mm high", &tissue, point(200.0, 0.1), DVec3::new(0.0, 1.0, -1.0)),
            ("thin, 200 mm aside", &thin, point(200.0, 2.0), DVec3::new(0.0, 1.0, -0.5)),
            ("below, 200 mm aside", &thin, point(200.0, -3.0), DVec3::new(0.0, 1.0, -0.5)),
            ("under glass", &glass, point(50.0, 2.0), DVec3::new(0.0, 1.0, -1.5)),
            ("under glass, grazing", &glass, point(60.0, 2.0), DVec3::new(0.0, 1.0, -1.1)),
            ("dense", &[(10.0, 5.0, 1.4)], point(200.0, 2.0), DVec3::new(0.0, 1.0, -0.2)),
            ("beam at 85 degrees", &[(0.4, 0.2, 2.5)], beam(85.0), DVec3::new(0.0, 1.0, -0.1)),
            ("beam at 89.9 degrees", &[(0.4, 0.2, 1.4)], beam(89.9), DVec3::new(0.0, 1.0, -0.1)),
        ];
        for (name, layers, lamp, r) in cases {
            let (world, steady) = (slabs(layers), Steady { lamps: vec![lamp], ambient: 0.0 });
            let view = View::new(100.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, DVec2::ONE).unwrap();
            let (camera, light) = (Camera { view, columns: 1, rows: 1 }, Light::none());
            let setting = Setting {
                world: &world,
                camera: &camera,
                light: &light,
                steady: &steady,
                carriers: &[],
                projected_images: &ProjectedImages::NONE,
                key: [3, 0],
                channel: 0,
                nee: Nee::Line,
                shared: None,
            };
            let mut walker = Walker::new(setting, named(""));
            let source = Source::Lamp(0, &lamp);
            let strength = |connection: &Connection| connection.irradiance * libm::exp(-connection.tau);
            let all: f64 = walker.chains_through_planes(source, r).expect("not too many").iter().map(strength).sum();
            let straight = walker.connect(source, r, None, true).map_or(0.0, |connection| strength(&connection));
            let draws = 60_000;
            let (mut sum, mut square, mut turns, mut longest) = (0.0, 0.0, 0, 0);
            for i in 0..draws {
                let stream = Stream::new([3, 0], 0, i, 0);
                let draws = Draws { stream: &stream, flight: 2, site: NeeSite::Here, others: OTHER_CONNECTIONS };
                let found = walker
                    .reflected_connection(source, r, None, &draws)
                    .map_or(0.0, |connection| strength(&connection));
                (sum, square) = (sum + found, square + found * found);
                (turns, longest) = (turns + walker.chain.turns(), longest.max(walker.chain.turns()));
                walker.on_scratch(|_, _| None::<()>);
            }
            let n = f64::from(draws);
            let (mean, turns) = (sum / n, turns as f64 / (OTHER_CONNECTIONS * n));
            let se = ((square / n - mean * mean) / n).sqrt();
            let expected = all - straight;
            println!(
                "{name}: {:.4} +- {:.4} of {:.4}; {turns:.1} turns, {longest}",
                mean / all,
                se / all,
                expected / all
            );
            assert!((mean - expected).abs() <= 4.5 * se + 1e-9 * all, "{name}: {mean:e} +- {se:e}, all {expected:e}");
            assert!(se < 0.05 * all, "{name}: {se:e} of {all:e}");
            assert!(turns < 30.0 && longest < 400, "{name}: {turns} turns, {longest} at most");
        }
    }
}
