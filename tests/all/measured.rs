//! Frames as files: what a camera writes to disk is processed like what was rendered.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};

use crate::space::Space;

/// Value layers and masks of an exported stack by name and kind, row by row.
pub fn planes(space: &Space, file: &str, port: &str, settings: &[&str]) -> BTreeMap<(String, String), Vec<f64>> {
    let csv = space.path().join("planes.csv");
    let mut arguments = vec!["export", file, port, "--to", csv.to_str().expect("a temporary folder of UTF-8")];
    arguments.extend(settings);
    space.turbid(&arguments).ok();
    let text = std::fs::read_to_string(&csv).expect("the export");
    let mut planes: BTreeMap<_, Vec<f64>> = BTreeMap::new();
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let value = cells[cells.len() - 1].parse().expect("a number");
        planes.entry((cells[1].to_owned(), cells[2].to_owned())).or_default().push(value);
    }
    planes
}

/// From rendered frames to maps directly, and by way of a camera's TIFF files with dark and flat field: the maps differ by the noise of the
/// camera, which the second way knows as standard errors (electrons, read noise, rounding to 16 bits; it knows nothing of the render's).
#[test]
fn files_of_a_camera_give_the_maps_of_the_frames() {
    let space = Space::new();
    let root = env!("CARGO_MANIFEST_DIR");
    for name in ["measured.yaml", "measured_source.yaml"] {
        let text = std::fs::read_to_string(format!("{root}/pipelines/{name}")).expect("the project has it");
        space.write(name, &text);
    }
    space.write("data/measured/here", "");
    let settings = ["--set", "vars.pixels=24", "--set", "vars.samples=1024"];
    let mut arguments = vec!["run", "measured_source.yaml", "maps"];
    let numbers = ["seen.numbers", "phantom_seen.numbers", "dark_seen.numbers", "flat_seen.numbers"];
    arguments.extend(numbers.iter().chain(&settings));
    space.turbid(&arguments).ok();
    let names = ["tissue_{f_x}_{phase}.tif", "phantom_{f_x}_{phase}.tif", "dark.tif", "flat.tif"];
    for (port, name) in numbers.iter().zip(names) {
        let to = format!("data/measured/{name}");
        let mut arguments = vec!["export", "measured_source.yaml", port, "--bits", "16", "--to", &to];
        arguments.extend(settings);
        space.turbid(&arguments).ok();
    }
    space.turbid(&["run", "measured.yaml"]).ok();
    let direct = planes(&space, "measured_source.yaml", "maps.maps", &settings);
    let measured = planes(&space, "measured.yaml", "maps.maps", &[]);
    let of = |maps: &BTreeMap<_, Vec<f64>>, name: &str, kind: &str| maps[&(name.to_owned(), kind.to_owned())].clone();
    let masks = [of(&direct, "mask", "mask"), of(&measured, "mask", "mask")];
    let good: Vec<usize> = (0..24 * 24).filter(|&i| masks.iter().all(|m| m[i] == 0.0)).collect();
    assert!(good.len() > 560, "{} good pixels of 576", good.len());
    for quantity in ["mu_a", "mu_s_prime"] {
        let (a, b) = (of(&measured, quantity, "value"), of(&direct, quantity, "value"));
        let se = of(&measured, &format!("{quantity}_se"), "standard_error");
        let z: Vec<f64> = good.iter().map(|&i| (a[i] - b[i]) / se[i]).collect();
        let sd = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        let worst = z.iter().fold(0.0_f64, |w, z| w.max(z.abs()));
        let relative = good.iter().map(|&i| se[i] / b[i]).sum::<f64>() / good.len() as f64;
        println!("{quantity}: sd of z {sd:.3}, worst {worst:.2}, mean standard error {:.2} %", 100.0 * relative);
        assert!((sd - 1.0).abs() < 0.15 && worst < 4.5, "{quantity}: sd of z {sd}, worst {worst}");
    }
}

/// The files that come with the project show the carcinoma where it is: the mean of mu_a and mu_s' over its middle (8 mm around) and over
/// the corners. Tolerance: light that crosses the edge and the oblique view make 1.2 % in the ideal frames, the fit of the render 0.5 %, the camera's noise 0.3 %.
#[test]
fn the_shipped_files_show_the_carcinoma() {
    let file = format!("{}/pipelines/measured.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    space.turbid(&["run", &file]).ok();
    let maps = planes(&space, &file, "maps.maps", &[]);
    let r2 = |i: usize| {
        let [x, y] = [(i % 64) as f64 - 31.5, (i / 64) as f64 - 31.5];
        x * x + y * y
    };
    let within = |low: f64, high: f64| (0..64 * 64).filter(move |&i| (low * low..high * high).contains(&r2(i)));
    for (name, pixels, mu_a, mu_s_prime) in [
        ("carcinoma", within(0.0, 8.0).collect::<Vec<_>>(), 0.096, 0.7442),
        ("healthy", within(34.0, 99.0).collect(), 0.025, 0.8472),
    ] {
        for (quantity, truth) in [("mu_a", mu_a), ("mu_s_prime", mu_s_prime)] {
            let map = &maps[&(quantity.to_owned(), "value".to_owned())];
            let mean = pixels.iter().map(|&i| map[i]).sum::<f64>() / pixels.len() as f64;
            assert!((mean / truth - 1.0).abs() < 0.03, "{name}: {quantity} = {mean}, is {truth}");
        }
    }
}

/// A frame that vanishes or changes after the plan has read it, while another stage runs: the stage that wants it says so, and the next run
/// goes by what is there.
#[test]
fn frames_that_vanish_or_change_during_a_run_are_named() {
    let source = format!("{}/pipelines/data/measured/tissue_0_0.tif", env!("CARGO_MANIFEST_DIR"));
    for (change, said) in [("remove", "vanished during the run"), ("replace", "changed during the run")] {
        let space = Space::with(
            "\
pipeline: watched
stages:
  tissue:
    use: scene
    with:
      media: {m: {A_rho: 50, S_rho: 5000, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  before:
    use: render
    in: {scene: tissue}
    with: {f_x: [0], method: path, max_seconds: 2}
  frames:
    use: import_frames
    in: {}
    with: {frames: [{file: frame.tif, f_x: 0}]}
",
        );
        let frame = space.path().join("frame.tif");
        std::fs::copy(&source, &frame).expect("the file is in the repository");
        let mut child =
            space.command(&["run", "p.yaml", "-j", "1"]).stderr(std::process::Stdio::piped()).spawn().unwrap();
        let mut lines =
            BufReader::new(child.stderr.take().expect("it is piped")).lines().map(|line| line.expect("text"));
        let began = lines.by_ref().find(|line| line.starts_with("run") && line.contains("before"));
        assert!(began.is_some(), "the render never began");
        match change {
            "remove" => std::fs::remove_file(&frame).unwrap(),
            _ => std::fs::write(&frame, "not the same").unwrap(),
        }
        let rest: Vec<String> = lines.collect();
        assert_eq!(child.wait().unwrap().code(), Some(1), "{rest:?}");
        assert!(rest.iter().any(|line| line.contains(said) && line.contains("frame.tif")), "{rest:?}");
        // What had run is kept.
        std::fs::copy(&source, &frame).expect("the file is in the repository");
        assert_eq!(crate::space::counts(&space, &[]), (2, 1));
    }
}
