//! Ideal spheres against the energy balance of the textbooks.

use turbid_dis::{Beam, Method, Normals, Opening, Outline, Port, Setup, Sphere, Stream, Tally, Target};

const PARALLEL: Beam = Beam { radius: 0.0, cos_half_angle: 1.0 };

/// The round outline whose cap has this share of the sphere.
fn cap(fraction: f64, sphere: f64) -> Outline {
    Outline::Round { radius: 2.0 * sphere * (fraction * (1.0 - fraction)).sqrt() }
}

fn sphere(radius: f64, reflectance: f64, sample: Outline, ports: Vec<(Port, Opening)>) -> Sphere {
    let plane = Sphere::rim(radius, sample);
    Sphere {
        radius,
        reflectance,
        plane,
        sample: Opening::new(sample, 0.0, radius),
        ports,
        baffle: None,
        sees_sample: true,
    }
}

fn tally(setup: &Setup, photons: u64, stream: u32) -> Tally {
    let mut tally = Tally::default();
    for i in 0..photons {
        tally.add(&setup.photon(Stream::new(11, stream, i)));
    }
    tally
}

/// Rows of the energy balance table: sphere diameter, port diameter, wall reflectance, albedo, optical thickness, M_R, M_T.
fn table() -> Vec<[f64; 7]> {
    include_str!("reference/dis_energy_balance.csv")
        .lines()
        .filter(|line| !line.starts_with(['#', 'D']))
        .map(|line| {
            let row: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
            row.try_into().expect("seven columns")
        })
        .collect()
}

/// UR1, UT1, URU, UTU of the slabs of the table, recovered from it: with them the balance gives all its rows to 6e-9.
fn slab(albedo: f64) -> [f64; 4] {
    match albedo {
        0.99 => [0.307471119, 0.532679374, 0.368332875, 0.468579289],
        0.9 => [0.101237164, 0.563684664, 0.166739468, 0.446797657],
        0.999 => [0.589631910, 0.332792129, 0.624105869, 0.303375374],
        0.5 => [0.041433275, 0.516229649, 0.093609298, 0.408856191],
        other => panic!("no slab of albedo {other}"),
    }
}

/// Readings less what the table says, in standard errors, each from this many photons.
///
/// The table takes the area of a port's disc for that of its cap, so the ports here are those whose caps have that area; entrance as wide as the
/// sample, detectors of 3 mm.
pub fn departures_from_the_table(photons: u64) -> Vec<f64> {
    let mut z = Vec::new();
    for (k, row) in table().into_iter().enumerate() {
        let [diameter, port, reflectance, albedo, _, m_r, m_t] = row;
        let radius = 0.5 * diameter;
        let share = |d: f64| cap(0.25 * (d / diameter) * (d / diameter), radius);
        let detector = (Port::Detector, Opening::new(share(3.0), 0.25, radius));
        let entrance = (Port::Entrance, Opening::new(share(port), 0.5, radius));
        let spheres = [
            sphere(radius, reflectance, share(port), vec![entrance, detector]),
            sphere(radius, reflectance, share(port), vec![detector]),
        ];
        let read = |target, stream| {
            let setup =
                Setup { spheres: spheres.clone(), target, beam: PARALLEL, method: Method::Summed, bounces: None };
            tally(&setup, photons, 8 * k as u32 + stream)
        };
        let normals = Normals {
            standard: read(Target::Cap([0.9, 0.0, 0.9, 0.0]), 1),
            open: read(Target::Open, 2),
            straight: read(Target::Cap([0.0, 1.0, 0.0, 1.0]), 3),
            blocked: Tally::default(),
            r_standard: 0.9,
        };
        let found = normals.measure(&read(Target::Cap(slab(albedo)), 4)).expect("readings");
        z.push((found.m_r - m_r) / found.m_r_se.expect("light was counted"));
        z.push((found.m_t - m_t) / found.m_t_se.expect("light was counted"));
    }
    z
}

/// Ideal spheres: Lambertian walls and sample, cap ports, no baffle.
#[test]
fn readings_meet_the_energy_balance() {
    crate::statistics::judge("energy balance", &departures_from_the_table(20_000));
}
