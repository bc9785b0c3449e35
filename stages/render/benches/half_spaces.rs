//! Camera reflectance of half-spaces against all 600 rows of the transport table, as z scores:
//! `cargo bench -p turbid-render --bench half_spaces [-- paths]`.
//!
//! g 0 and 0.8, n 1 and 1.4, mu_a 0.001 to 0.5, mu_s' 0.3 to 5 mm^-1, f_x 0 to 0.5 mm^-1; camera and projector in one place 1 km above the surface, so that light and
//! view are parallel to 1e-6, one pixel of 1 um, the lit field 10 / mu_eff wide on each side, the specular part excluded. The six f_x of a medium share their paths.

#[path = "../../optics/tests/truth/mod.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod truth;

use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec2, DVec3};
use turbid_optics::Medium;
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

use truth::{Quantity, Truth, half_spaces};

/// Paths between two tests of the sums.
const BATCH: u32 = 1024;

fn main() {
    let paths = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(16 * BATCH);
    let rows: Vec<Truth> = half_spaces().into_iter().filter(|t| matches!(t.quantity, Quantity::Camera)).collect();
    let media: Vec<&[Truth]> = rows.chunk_by(|a, b| a.medium == b.medium).collect();
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let (mut scores, mut seconds) = (vec![Vec::new(); media.len()], 0.0);
    std::thread::scope(|scope| {
        let work = || {
            let (began, mut found) = (cpu_seconds(), Vec::new());
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(rows) = media.get(i) else { return (found, cpu_seconds() - began) };
                found.push((i, z_scores(rows, i as u32, paths)));
            }
        };
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        for worker in workers {
            let (found, spent) = worker.join().expect("no worker panics");
            seconds += spent;
            found.into_iter().for_each(|(i, z)| scores[i] = z);
        }
    });
    println!("{paths} paths for each of {} media, {seconds:.0} CPU s", media.len());
    for (medium, z) in media.iter().map(|rows| rows[0].medium).zip(&scores) {
        if let Some(z) = z.iter().find(|z| z.abs() > 3.5) {
            println!("z = {z:+.2} in {medium:?}");
        }
    }
    let all = |name: &str, wanted: &dyn Fn(&Medium) -> bool| {
        let of: Vec<&Vec<f64>> =
            media.iter().zip(&scores).filter(|(rows, _)| wanted(&rows[0].medium)).map(|(_, z)| z).collect();
        report(name, &of);
    };
    println!("| rows | values | mean z | sd | worst | spread of the mean |\n| --- | --- | --- | --- | --- | --- |");
    all("all", &|_| true);
    for (n, g) in [(1.0, 0.0), (1.0, 0.8), (1.4, 0.0), (1.4, 0.8)] {
        all(&format!("n = {n}, g = {g}"), &|m| {
            m.n == n && m.phase == turbid_optics::PhaseFunction::henyey_greenstein(g)
        });
    }
}

fn report(name: &str, media: &[&Vec<f64>]) {
    let z: Vec<f64> = media.iter().flat_map(|z| z.iter().copied()).collect();
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let sd = (z.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let worst = z.iter().fold(0.0, |w: f64, z| w.max(z.abs()));
    // Values of one medium share paths: the mean of means of media, which are independent.
    let of_media: Vec<f64> = media.iter().map(|z| z.iter().sum::<f64>() / z.len() as f64).collect();
    let spread = (of_media.iter().map(|m| (m - mean).powi(2)).sum::<f64>()).sqrt() / of_media.len() as f64;
    println!("| {name} | {n} | {mean:+.3} | {sd:.3} | {worst:.2} | {spread:.3} |");
}

/// (rendered - table) / sqrt(se^2 + error of the table^2) of each row of a medium.
fn z_scores(rows: &[Truth], seed: u32, paths: u32) -> Vec<f64> {
    let Medium { mu_a, mu_s_prime, phase, n } = rows[0].medium;
    let lit = (20.0 / (3.0 * mu_a * (mu_a + mu_s_prime)).sqrt()).max(40.0);
    let view = |field: f64| View::new(1e6 * DVec3::Z, DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y");
    let camera = Camera { view: view(0.001), columns: 1, rows: 1 };
    let light = Light::new(view(lit), 1.0, true);
    let carriers: Vec<Carrier> = rows.iter().filter(|r| r.f_x > 0.0).map(|r| Carrier::new(r.f_x, 0.0)).collect();
    let bodies = vec![Body { solid: Solid::Slab { bottom: -5000.0, top: 0.0 }, material: 1 }];
    let materials = vec![Material::VOID, Material::medium(mu_a, rows[0].medium.mu_s(), phase, n)];
    let world = World { bodies, materials, textures: Vec::new() };
    let setting = Setting {
        world: &world,
        camera: &camera,
        light: &light,
        steady: &Steady::NONE,
        carriers: &carriers,
        projected_images: &ProjectedImages::NONE,
        key: [seed, 0],
        channel: 0,
        nee: Nee::Line,
        shared: None,
    };
    let mut walker = Walker::new(setting, named(""));
    walker.excludes_specular = true;
    let mut moments = Moments::new(1, 1 + 2 * carriers.len());
    for first in (0..paths).step_by(BATCH as usize) {
        let batch = first..paths.min(first + BATCH);
        packet::walk(&mut walker, 0..1, batch.clone());
        (0..batch.len()).for_each(|path| moments.add(0, walker.response(path)));
    }
    let scale = PI * lit * lit;
    let mut carrier = 0;
    let score = |row: &Truth| {
        // The pixel is where all fringes are brightest: re is the whole amplitude, without the bias of a modulus.
        let response = if row.f_x == 0.0 { 0 } else { 1 + 2 * carrier };
        carrier += usize::from(row.f_x > 0.0);
        let value = scale * moments.mean(0, response, paths);
        let se = scale * moments.covariance(0, response, response, paths).sqrt();
        (value - row.value) / se.hypot(row.error)
    };
    rows.iter().map(score).collect()
}

/// Seconds that this thread has had a core (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
