//! Wrong pipelines of several wavelengths, and the one message that each gets.

use crate::space::Space;
use crate::wrong_files::messages;

/// Without a mistake; each row of [`WRONG`] replaces one thing in it.
const RIGHT: &str = "\
pipeline: colours
stages:
  rig:
    use: scene
    with:
      wavelength_nm: [660, 730, 850]
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12], specular: exclude}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  arm:
    use: scene
    in: {rig: rig}
    with:
      media: {skin: {HbO2: 45, Hb: 15, water: 0.65, scattering: {a: 1.6, b: 1.1}, g: 0.8, n: 1.4}}
      objects: {arm: {slab: {thickness: 2000, top: 0}, medium: skin}}
  phantom:
    use: scene
    in: {rig: rig}
    with:
      media: {silicone: {mu_a: [0.019, 0.016, 0.015], mu_s_prime: [1.18, 1.11, 0.99], g: 0.8, n: 1.4}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: silicone}}
  frames: {use: render, in: {scene: arm}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  phantom_frames: {use: render, in: {scene: phantom}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}}
  phantom_modulation: {use: demodulate, in: {frames: phantom_frames, covariance: phantom_frames.covariance}}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: {object: block}}
  table:
    use: build_lut
    with: {model: rte, f_x: [0, 0.1], g: 0.8, n: 1.4, wavelengths_nm: [660, 730, 850]}
  maps: {use: invert, in: {reflectance: reflectance, lut: table}}
  blood: {use: chromophores, in: {maps: maps}, with: {fixed: {water: 0.65}}}
  metrics:
    use: compare
    in: {estimate: blood, truth: frames.truth}
    with: {concentrations: {arm: {HbO2: 45, Hb: 15}}}
";

/// What is replaced, by what, the message (`line:column: path: rule`), the way out.
#[rustfmt::skip]
const WRONG: &[(&str, &str, &str, &str)] = &[
    ("object: block", "object: blok", "", ""),
    ("object: block", "reflectance: 2", "", ""),
    ("object: block", "reflectance: [0.99, 0.99]", "", ""),
    ("object: block", "mu_a: 0.02, mu_s_prime: 1, g: 0.8", "", ""),
    ("object: block", "mu_a: 0.02, mu_s_prime: 1, g: 0.8, n: 1.4, reflectance: 0.9", "", ""),
    ("object: block", "table: nowhere.csv", "", ""),
    ("object: block", "table: short.csv", "", ""),
    ("object: block", "table: wrong.csv", "", ""),
    ("object: block", "table: plate.csv", "", ""),
    ("{object: block}", "{reflectance: 0.99}, convention: hemispherical_entered", "", ""),
    ("g: 0.8, n: 1.4, wavelengths_nm", "g: [0.8, 0.8], n: 1.4, wavelengths_nm", "", ""),
    ("g: 0.8, n: 1.4, wavelengths_nm: [660, 730, 850]", "g: [0.8, 0.8, 0.7], n: 1.4", "", ""),
    ("g: 0.8, n: 1.4, wavelengths_nm", "g: [0.8, 0.8, 0.7], n: 1.4, wavelengths_nm", "", ""),
    ("wavelengths_nm: [660, 730, 850]", "wavelengths_nm: [660, 740, 850, 940]", "", ""),
    ("{fixed: {water: 0.65}}", "{wavelength_nm: [660, 800]}", "", ""),
    ("{fixed: {water: 0.65}}", "{fixed: {lipid: 0.1, water: 0.65}, chromophores: [HbO2, Hb, melanin, lipid]}", "", ""),
    ("{fixed: {water: 0.65}}", "{chromophores: [dye], spectra: [{file: dye.csv, unit: per_mm}]}", "", ""),
    ("{fixed: {water: 0.65}}", "{chromophores: [ink, soot], spectra: [{file: alike.csv, unit: per_mm}]}", "", ""),
    ("{arm: {HbO2: 45, Hb: 15}}", "{leg: {HbO2: 45, Hb: 15}}", "", ""),
    ("{arm: {HbO2: 45, Hb: 15}}", "{arm: {HbO2: 45, Hbb: 15}}", "", ""),
    ("{arm: {HbO2: 45, Hb: 15}}", "{arm: {HbO2: 45, Hb: 15, StO2: 0.7}}", "", ""),
    ("    with: {concentrations: {arm: {HbO2: 45, Hb: 15}}}\n", "", "", ""),
];

const FILES: [(&str, &str); 5] = [
    ("short.csv", "wavelength_nm, mu_a, mu_s_prime, g, n\n600, 0.02, 1.3, 0.8, 1.4\n800, 0.015, 1, 0.8, 1.4\n"),
    ("wrong.csv", "wavelength_nm, mu_a, mu_s_prime, g, n\n600, 0.02, 1.3, 0.8, 1.4\n900, -0.015, 1, 0.8, 1.4\n"),
    ("plate.csv", "wavelength_nm, reflectance@0, reflectance@0.2\n600, 0.99, 0.8\n900, 0.99, 0.8\n"),
    ("dye.csv", "wavelength_nm dye\n600 1\n700 2\n"),
    ("alike.csv", "wavelength_nm ink soot\n600 1 2.001\n700 0.9 1.8\n900 0.8 1.6\n"),
];

#[test]
fn each_wrong_file_gets_its_one_message() {
    let space = Space::with(RIGHT);
    FILES.iter().for_each(|(name, text)| space.write(name, text));
    space.turbid(&["check", "p.yaml"]).ok();
    let mut failures = String::new();
    for (from, to, message, way_out) in WRONG {
        assert!(RIGHT.contains(from), "{from}");
        space.write("p.yaml", &RIGHT.replacen(from, to, 1));
        let shown = space.turbid(&["check", "p.yaml"]).fails(2);
        if messages(&shown) != [((*message).to_owned(), (*way_out).to_owned())] {
            failures += &format!("{from}  ->  {to}\nexpected: {message}\n        = {way_out}\n{shown}\n");
        }
    }
    assert_eq!(failures, "");
}
