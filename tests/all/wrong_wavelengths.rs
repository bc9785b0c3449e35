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
    ("object: block", "object: blok", "28:32: stages.reflectance.with.reference.object: `phantom_modulation.modulation`: the reference arm shows block, not `blok`", ""),
    ("object: block", "reflectance: 2", "28:37: stages.reflectance.with.reference.reflectance: reflectance = 2 must lie in (0, 1.5]", ""),
    ("object: block", "reflectance: [0.99, 0.99]", "28:37: stages.reflectance.with.reference.reflectance: `modulation.modulation`: 2 values for the sample's 3 wavelengths (660, 730, 850 nm); give one for each, or one number for all", ""),
    ("object: block", "mu_a: 0.02, mu_s_prime: 1, g: 0.8", "28:12: stages.reflectance.with.reference.n: `n` of the reference is missing", "say it in one way: `mu_a`, `mu_s_prime`, `g` and `n`; or `table: FILE`; or `object: NAME`; or `reflectance: 0.99` of a plate"),
    ("object: block", "mu_a: 0.02, mu_s_prime: 1, g: 0.8, n: 1.4, reflectance: 0.9", "28:80: stages.reflectance.with.reference.reflectance: the reference is said by `mu_a` and by `reflectance`", "say it in one way: `mu_a`, `mu_s_prime`, `g` and `n`; or `table: FILE`; or `object: NAME`; or `reflectance: 0.99` of a plate"),
    ("object: block", "table: nowhere.csv", "28:31: stages.reflectance.with.reference.table: nowhere.csv: No such file or directory (os error 2)", "its folder has alike.csv, dye.csv, p.yaml, plate.csv, short.csv, …"),
    ("object: block", "table: short.csv", "28:31: stages.reflectance.with.reference.table: short.csv reaches from 600 to 800 nm, the sample was lit with 850 nm; nothing is extrapolated", "give a table that covers the wavelengths of the frames"),
    ("object: block", "table: wrong.csv", "28:31: stages.reflectance.with.reference.table: wrong.csv:3:2: mu_a = -0.015 must be >= 0", "a table of text is wanted: `wavelength_nm, mu_a, mu_s_prime, g, n` in mm^-1, or `wavelength_nm, reflectance`, then a row for each wavelength, rising"),
    ("object: block", "table: plate.csv", "27:18: stages.reflectance.in.sample: `modulation.modulation`: R_d of the reference is given at f_x = 0, 0.2 mm^-1, the sample has 0.1", "nothing is interpolated over f_x: add the column `reflectance@F_X`, or `reflectance` for all f_x"),
    ("{object: block}", "{reflectance: 0.99}, convention: hemispherical_entered", "28:56: stages.reflectance.with.convention: beside a plate R_d is over the light that falls in, and what of it enters the sample is not known", "take `camera` for a Lambertian plate seen by a camera, or `hemispherical_incident`"),
    ("g: 0.8, n: 1.4, wavelengths_nm", "g: [0.8, 0.8], n: 1.4, wavelengths_nm", "31:42: stages.table.with.g: 2 values of g for 3 wavelengths", "give one for each wavelength, or one number for all"),
    ("g: 0.8, n: 1.4, wavelengths_nm: [660, 730, 850]", "g: [0.8, 0.8, 0.7], n: 1.4", "31:42: stages.table.with.g: g is a list, and for which wavelengths is not said", "wavelengths_nm: [660, 850], or one number for all"),
    ("g: 0.8, n: 1.4, wavelengths_nm", "g: [0.8, 0.8, 0.7], n: 1.4, wavelengths_nm", "32:59: stages.maps.in.lut: `table.lut`: the reflectance has g = 0.8 at 850 nm, the table g = 0.7", "calibrate and build_lut must be given the same convention, g and n"),
    ("wavelengths_nm: [660, 730, 850]", "wavelengths_nm: [660, 740, 850, 940]", "32:59: stages.maps.in.lut: `table.lut`: the reflectance is of 730 nm, the table is for 660, 740, 850, 940 nm; the table is also for 740, 940 nm, the reflectance is not", "`wavelengths_nm` of build_lut must name each wavelength of the frames"),
    ("{fixed: {water: 0.65}}", "{wavelength_nm: [660, 800]}", "33:41: stages.blood.in.maps: `maps.maps`: there is no mu_a at 800 nm; there is at 660, 730, 850 nm", "name wavelengths that the maps have in `wavelength_nm`"),
    ("{fixed: {water: 0.65}}", "{chromophores: [HbO2, Hb, melanin, lipid]}", "33:69: stages.blood.with.chromophores: 4 chromophores are looked for at 3 wavelengths, 660, 730, 850 nm", "name fewer, write known amounts in `fixed`, or measure at more wavelengths"),
    ("{fixed: {water: 0.65}}", "{chromophores: [dye], spectra: [{file: dye.csv, unit: per_mm}]}", "33:70: stages.blood.with.chromophores.0: the spectrum of dye reaches from 600 to 700 nm, not to 730, 850 nm", "nothing is extrapolated: leave these wavelengths out (`wavelength_nm: [..]`), or give a spectrum that covers them"),
    ("{fixed: {water: 0.65}}", "{chromophores: [ink, soot], spectra: [{file: alike.csv, unit: per_mm}]}", "33:69: stages.blood.with.chromophores: 660, 730, 850 nm do not tell the chromophores apart: condition number 19403.6 is above 100; ink and soot are most alike, cosine 1.00000", "look for fewer, write known amounts in `fixed`, or measure at other wavelengths (`design` says which); `largest_condition` is the limit"),
    ("{arm: {HbO2: 45, Hb: 15}}", "{leg: {HbO2: 45, Hb: 15}}", "37:34: stages.metrics.with.concentrations.leg: the scene has no object `leg`; it has arm", ""),
    ("{arm: {HbO2: 45, Hb: 15}}", "{arm: {HbO2: 45, Hbb: 15}}", "37:50: stages.metrics.with.concentrations.arm.Hbb: the estimate has no `Hbb`: did you mean `Hb`?", ""),
    ("{arm: {HbO2: 45, Hb: 15}}", "{arm: {HbO2: 45, Hb: 15, StO2: 0.7}}", "37:59: stages.metrics.with.concentrations.arm.StO2: StO2 = 0.7 contradicts HbO2 and Hb, which make it 0.750000", "leave it out: it follows from them"),
    ("    with: {concentrations: {arm: {HbO2: 45, Hb: 15}}}\n", "", "34:3: stages.metrics.with.concentrations: the estimate is concentrations, and what they should be is not said", "concentrations: {OBJECT: {HbO2: 45, Hb: 15}}, by object of the scene, or `all`"),
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
