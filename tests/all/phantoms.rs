//! Measured single shots of phantoms beside the laboratory's own maps (`pipelines/phantoms_measured.yaml`).

use std::path::{Path, PathBuf};

use turbid_import::{Channel, Picture, Wanted, decode};
use turbid_optics::{Medium, PhaseFunction, rte};

use crate::measured::planes;
use crate::space::Space;

const PHANTOMS: [&str; 12] = ["p01", "p02", "p03", "ph2", "ph3", "ph5", "ph6", "ph7", "ph10", "ph11", "ph12", "ph14"];
/// Rows and columns of the part that is compared: within the crop, a period and more from its ends, on the phantom.
const ROWS: std::ops::Range<usize> = 90..166;
const COLUMNS: std::ops::Range<usize> = 80..176;
/// First column and row of the crop, and its columns.
const CROP: [usize; 3] = [60, 76, 136];

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/data/ganpop")
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The laboratory's mu_a and mu_s' (mm^-1): medians over the part, in the right half of the picture.
fn laboratory(name: &str) -> [f64; 2] {
    let bytes = std::fs::read(data().join(format!("{name}.png"))).expect("the project has it");
    [(Channel::Red, 0.25), (Channel::Green, 2.5)].map(|(channel, full_scale)| {
        let wanted = Wanted { channel: Some(channel), ..Wanted::default() };
        let Picture { values, columns, .. } = decode(&bytes, wanted).expect("a picture");
        let at = |(r, c): (usize, usize)| values.at(r * columns + columns / 2 + c);
        median(places().map(at).collect()) * full_scale / 255.0
    })
}

fn places() -> impl Iterator<Item = (usize, usize)> {
    ROWS.flat_map(|r| COLUMNS.map(move |c| (r, c)))
}

/// Mean and standard deviation.
fn spread(values: &[f64]) -> [f64; 2] {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    [mean, (squares / (values.len() - 1) as f64).sqrt()]
}

/// The two scales that the pictures lack are common to all twelve: what is left is the spread over the phantoms. DC over R_d(0) and AC over R_d(0.2) of
/// the laboratory's own mu_a and mu_s', by transport in its convention, below 1 and 2.5 %; medians of single shots to 2 % in mu_s' and 5 % in mu_a.
#[test]
fn single_shots_of_phantoms_agree_with_the_laboratory() {
    let space = Space::new();
    let text = std::fs::read_to_string(data().join("../../phantoms_measured.yaml")).expect("the project has it");
    space.write("p.yaml", &text);
    let folder = space.path().join("data/ganpop");
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    for name in PHANTOMS {
        let file = format!("{name}.png");
        std::fs::copy(data().join(&file), folder.join(&file)).expect("the project has it");
    }
    space.turbid(&["run", "p.yaml", "maps"]).ok();
    let (mut table, mut ratios) = (String::new(), [const { Vec::new() }; 4]);
    for name in PHANTOMS {
        let [mu_a, mu_s_prime] = laboratory(name);
        let part = |port: &str, layer: &str, pick: fn(Vec<f64>) -> f64| {
            let planes = planes(&space, "p.yaml", &format!("{port}[phantom={name}].{port}"), &[]);
            let [left, top, columns] = CROP;
            let plane = &planes[&(layer.to_owned(), "value".to_owned())];
            // Of several layers of one name the last.
            let plane = &plane[plane.len() - 104 * columns..];
            pick(places().map(|(r, c)| plane[(r - top) * columns + c - left]).collect())
        };
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        let medium = Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(0.9), n: 1.4 };
        let r_d = [0.0, 0.2].map(|f_x| rte::reflectance(&medium, None, f_x).expect("a medium").hemispherical_entered);
        let found = [
            part("modulation", "m_dc", mean) / r_d[0],
            part("modulation", "m_ac", mean) / r_d[1],
            part("maps", "mu_a", median) / mu_a,
            part("maps", "mu_s_prime", median) / mu_s_prime,
        ];
        table += &format!("{name:>5} {mu_a:.4} {mu_s_prime:.3} {found:.4?}\n");
        ratios.iter_mut().zip(found).for_each(|(ratios, found)| ratios.push(found));
    }
    let spreads = ratios.map(|ratios| spread(&ratios));
    println!("{table}{spreads:.4?}");
    for ([mean, sd], most) in spreads.into_iter().zip([0.01, 0.025, 0.05, 0.02]) {
        assert!(sd / mean < most, "{sd} of {mean}, over {most}:\n{table}");
    }
}
