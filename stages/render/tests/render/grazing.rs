//! Light and view along a slab, against photons walked the other way, and lamps close to it.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use turbid_contract::payload::{Lamp, Medium, Projection, Scene, Shape, Specular};
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::refraction::refract;

use crate::setup::*;

/// mu_eff = 0.9 mm^-1: what lies 20 mm off does not show.
const MU_A: f64 = 0.3;
const MU_S: f64 = 2.0;
const G: f64 = 0.7;
const POWER: f64 = 5.0;
/// mm, across a beam, and along the sides of a projector's field.
const BEAM: f64 = 60.0;
const LIT: f64 = 100.0;

/// A slab below z = 0.
#[derive(Clone, Copy, Debug)]
struct Slab {
    thickness: f64,
    n: f64,
}

#[derive(Clone, Copy, Debug)]
enum Lit {
    /// Parallel light so many degrees off the normal.
    Beam(f64),
    /// A projector 1 m away, so many degrees off the normal.
    Projector(f64),
    /// A point lamp at x and z, mm.
    Point(f64, f64),
}

/// What a photon brings to the slab.
struct Start {
    /// On the slab.
    place: DVec2,
    /// Down to it, outside.
    w: DVec3,
    /// W; where the light is even W mm^-2.
    weight: f64,
}

fn tilted(degrees: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(sin, 0.0, cos)
}

/// One pixel of `field` mm that parallel light sees `degrees` off the normal; no lamp reflections.
fn looked_at(slab: Slab, lit: Lit, degrees: f64, field: f64) -> Scene {
    let (mut camera, mut projector) = rig(1000.0, 0.0, field, 1, LIT);
    camera.position = (1000.0 * tilted(degrees)).to_array();
    (camera.projection, camera.specular) = (Projection::Orthographic, Some(Specular::Exclude));
    let medium = Medium { n: slab.n, ..medium(MU_A, MU_S, G) };
    let shape = Shape::Slab { top: 0.0, bottom: -slab.thickness };
    if let Lit::Projector(degrees) = lit {
        projector.position = (1000.0 * tilted(degrees)).to_array();
    }
    let mut scene = scene(&[("m", medium)], vec![object(shape, "m", 0)], (camera, projector));
    let power = vec![POWER];
    let lamp = match lit {
        Lit::Projector(_) => return scene,
        Lit::Beam(degrees) => {
            let position = (1e5 * tilted(degrees)).to_array();
            Lamp::Collimated { position, look_at: [0.0; 3], diameter: BEAM, power }
        }
        Lit::Point(x, z) => Lamp::Point { position: [x, 0.0, z], power },
    };
    scene.projector = None;
    scene.lights = [("lamp".to_owned(), lamp)].into();
    scene
}

/// Uniform random numbers, in sequence.
struct Numbers {
    seed: u32,
    drawn: u32,
}

impl Numbers {
    fn next(&mut self) -> [f64; 4] {
        self.drawn += 1;
        philox4x32([self.drawn, 0, 0, 0], [self.seed, 77]).map(unit)
    }
}

/// Radiance towards `view` degrees, W mm^-2 sr^-1, and its standard error: photons walk from the light; at each collision what goes on towards the
/// camera is added, after any number of reflections in the slab, which is a geometric series. Over a square of `field` mm, or, where the light is
/// even, anywhere.
fn by_photons(
    slab: Slab,
    view: f64,
    field: Option<f64>,
    photons: u32,
    mut start: impl FnMut([f64; 4]) -> Start,
) -> (f64, f64) {
    let Slab { thickness, n } = slab;
    let mu_t = MU_A + MU_S;
    let inside = DVec2::new(tilted(view).x / n, 0.0);
    let cos = (1.0 - inside.length_squared()).sqrt();
    let up = inside.extend(cos);
    let reflected = if n == 1.0 { 0.0 } else { refract(up, DVec3::Z, n, 1.0).reflectance };
    let round = reflected * reflected * (-2.0 * mu_t * thickness / cos).exp();
    let area = field.map_or(1.0, |field| field * field);
    let seen = |place: DVec2| field.is_none_or(|field| place.abs().max_element() < 0.5 * field);
    // What a collision at r of a photon that comes along w brings.
    let score = |r: DVec3, w: DVec3| {
        let mut sum = 0.0;
        let above = (up, -r.z, 1.0);
        let below = (inside.extend(-cos), r.z + 2.0 * thickness, reflected);
        for (along, height, passed) in [above, below] {
            let (mut height, mut left) = (height, passed * (-mu_t * height / cos).exp() * hg::density(G, w.dot(along)));
            while left > 1e-12 {
                if seen(r.truncate() + inside * (height / cos)) {
                    sum += left;
                }
                (height, left) = (height + 2.0 * thickness, left * round);
            }
        }
        sum * (1.0 - reflected) / (cos * n * n * area)
    };
    let (mut sum, mut square) = (0.0, 0.0);
    let mut numbers = Numbers { seed: 5, drawn: 0 };
    for _ in 0..photons {
        let Start { place, w, weight } = start(numbers.next());
        let met = refract(w, DVec3::Z, 1.0, n);
        let mut weight = weight * (1.0 - met.reflectance);
        let (mut r, mut w) = (place.extend(0.0), met.refracted.expect("into the denser"));
        let (mut found, least) = (0.0, 0.01 * weight);
        loop {
            let [a, b, c, d] = numbers.next();
            let to_interface = if w.z < 0.0 { (-thickness - r.z) / w.z } else { -r.z / w.z };
            let s = -a.ln() / mu_t;
            if s >= to_interface {
                r += to_interface * w;
                let met = refract(w, DVec3::Z, n, 1.0);
                if n == 1.0 || d >= met.reflectance {
                    break;
                }
                // Rounding must not put it outside.
                r.z = if w.z < 0.0 { -thickness } else { 0.0 };
                w = met.reflected;
                continue;
            }
            r += s * w;
            weight *= MU_S / mu_t;
            found += weight * score(r, w);
            if weight < least {
                if d < 0.8 {
                    break;
                }
                weight *= 5.0;
            }
            w = hg::sample(G, w, b, c);
        }
        (sum, square) = (sum + found, square + found * found);
    }
    let n = f64::from(photons);
    (sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt())
}

/// Where the light of a scene comes in near the origin.
fn starts(lit: Lit) -> impl FnMut([f64; 4]) -> Start {
    // Most of what is seen comes in near by: density exp(-r / near) / (2 pi r near).
    let near = 2.0;
    move |[a, b, ..]: [f64; 4]| {
        let r = -near * a.ln();
        let (sin, cos) = (2.0 * PI * b).sin_cos();
        let place = r * DVec2::new(cos, sin);
        let inverse_density = 2.0 * PI * r * near * (r / near).exp();
        match lit {
            Lit::Beam(degrees) => {
                let across = POWER / (0.25 * PI * BEAM * BEAM);
                Start { place: DVec2::ZERO, w: -tilted(degrees), weight: across * tilted(degrees).z }
            }
            Lit::Projector(degrees) => {
                let w = (place.extend(0.0) - 1000.0 * tilted(degrees)).normalize();
                // Half the pattern.
                let inside = place.abs().max_element() < 0.5 * LIT;
                let weight = if inside { 0.5 * POWER / (LIT * LIT) * inverse_density } else { 0.0 };
                Start { place, w, weight }
            }
            Lit::Point(x, z) => {
                let d = place.extend(0.0) - DVec3::new(x, 0.0, z);
                let irradiance = POWER / (4.0 * PI) * z / d.length().powi(3);
                Start { place, w: d.normalize(), weight: irradiance * inverse_density }
            }
        }
    }
}

/// Renders agree with photons, light at 80 to 89.9 degrees and views at 0 to 89.9, n from 1 to 2.5, thin and thick slabs, by beams, projectors and point
/// lamps: each to 4.5 standard errors of both (16 cases: one false alarm in 10^4), and in the mean of all, weighed by their errors, within 3.5, which are
/// less than 2.5 %.
#[test]
fn grazing_light_and_views_agree_with_photons() {
    let slab = |thickness: f64, n: f64| Slab { thickness, n };
    let cases = [
        (slab(10.0, 1.0), Lit::Beam(89.0), 89.0),
        (slab(0.3, 1.0), Lit::Beam(89.9), 85.0),
        (slab(10.0, 1.4), Lit::Beam(89.9), 0.0),
        (slab(10.0, 1.4), Lit::Beam(85.0), 89.9),
        (slab(0.3, 1.4), Lit::Beam(89.9), 89.9),
        (slab(0.3, 2.5), Lit::Beam(85.0), 85.0),
        (slab(0.05, 2.5), Lit::Beam(89.0), 89.0),
        (slab(0.3, 1.33), Lit::Projector(85.0), 85.0),
        (slab(0.3, 1.4), Lit::Projector(89.9), 0.0),
        (slab(10.0, 1.0), Lit::Projector(89.9), 89.9),
        (slab(0.3, 2.5), Lit::Projector(89.0), 89.0),
        (slab(10.0, 1.4), Lit::Point(200.0, 2.0), 0.0),
        (slab(10.0, 1.4), Lit::Point(200.0, 5.0), 85.0),
        (slab(0.3, 1.4), Lit::Point(200.0, 2.0), 0.0),
        (slab(0.3, 2.5), Lit::Point(30.0, 1.0), 89.0),
        (slab(0.1, 1.0), Lit::Point(200.0, 0.5), 85.0),
    ];
    let (mut sum, mut weights) = (0.0, 0.0);
    for (slab, lit, view) in cases {
        let field = 4.0;
        // Where n > 1 and the view grazes, few paths come in.
        let paths = match view {
            89.5.. => 120_000,
            80.0.. => 60_000,
            _ => 15_000,
        };
        let (mean, se) = dc(&looked_at(slab, lit, view, field), paths, 3);
        let (even, photons) = if matches!(lit, Lit::Beam(_)) { (None, 30_000) } else { (Some(field), 100_000) };
        let (walked, walked_se) = by_photons(slab, view, even, photons, starts(lit));
        let error = se.hypot(walked_se) / walked;
        let off = mean / walked - 1.0;
        println!("{slab:?} {lit:?} from {view}: {mean:.4e} +- {:.4}, {off:+.4} +- {error:.4}", se / mean);
        assert!(off.abs() < 4.5 * error, "{slab:?} {lit:?} from {view}: {off} +- {error}");
        assert!(error < 0.1, "{slab:?} {lit:?} from {view}: too noisy to tell: {error}");
        (sum, weights) = (sum + off / (error * error), weights + 1.0 / (error * error));
    }
    let (bias, error) = (sum / weights, weights.sqrt().recip());
    println!("all: {bias:+.5} +- {error:.5}");
    assert!(bias.abs() < 3.5 * error && error < 0.025 / 3.5, "all: {bias} +- {error}");
}

/// A point lamp 1 mm above 10 mm of n = 1.4 in fields of 64 and 16 mm, as photons from all of its lower half say.
#[test]
fn a_lamp_close_to_a_slab_agrees_with_photons() {
    let slab = Slab { thickness: 10.0, n: 1.4 };
    let start = |[a, b, ..]: [f64; 4]| {
        let (sin_phi, cos_phi) = (2.0 * PI * b).sin_cos();
        let sin = (1.0 - a * a).sqrt();
        let w = DVec3::new(sin * cos_phi, sin * sin_phi, -a);
        Start { place: w.truncate() / a, w, weight: 0.5 * POWER }
    };
    // A view that is brightest by far below the lamp.
    for (field, paths) in [(64.0, 200_000), (16.0, 100_000)] {
        let (mean, se) = dc(&looked_at(slab, Lit::Point(0.0, 1.0), 0.0, field), paths, 3);
        let (walked, walked_se) = by_photons(slab, 0.0, Some(field), 100_000, start);
        let (error, off) = (se.hypot(walked_se) / walked, mean / walked - 1.0);
        println!("{field} mm: {mean:.4e} +- {:.4}, {off:+.4} +- {error:.4}", se / mean);
        assert!(off.abs() < 4.0 * error, "{field} mm: {off} +- {error}");
        assert!(error < 0.1, "{field} mm: too noisy to tell: {error}");
    }
}

/// A lamp's lamp reflection on a clear sheet, seen as steeply as it is lit, over that on a thick absorber of the same n: with the reflectance R of one plane
/// (1 + (1 - R)^2 / (1 - R^2)) = 2 / (1 + R), whatever the many reflections within. At 89.9 degrees some 1600 of them are followed, within 1e-10 of the light
/// each; the sheet of 1e-6 mm shifts them by as little. f32 images: 1e-6.
#[test]
fn lamp_reflections_on_a_sheet_add_up_at_grazing_angles() {
    for (degrees, n) in [(0.1, 1.5), (85.0, 1.0001), (85.0, 1.5), (85.0, 2.5), (89.0, 1.4), (89.9, 1.4)] {
        let seen = |thickness: f64, mu_a: f64| {
            let at = 100.0 * tilted(degrees);
            let mut scene = looked_at(Slab { thickness, n }, Lit::Point(at.x, at.z), degrees, 10.0);
            let camera = scene.camera.as_mut().expect("it has one");
            camera.position = [-at.x, 0.0, at.z];
            (camera.projection, camera.specular) = (Projection::Pinhole, Some(Specular::Include));
            scene.media.insert("m".to_owned(), Medium { n, ..medium(mu_a, 0.0, 0.0) });
            dc(&scene, 8, 1).0
        };
        let reflected = refract(-tilted(degrees), DVec3::Z, 1.0, n).reflectance;
        let (ratio, expected) = (seen(1e-6, 0.0) / seen(10.0, 100.0), 2.0 / (1.0 + reflected));
        assert!((ratio / expected - 1.0).abs() < 1e-6, "{degrees} degrees, n = {n}: {ratio}, expected {expected}");
    }
}
