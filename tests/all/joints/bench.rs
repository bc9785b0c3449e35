//! A small pipeline that makes every output there is, and the joints that no shipped pipeline has.

/// One producer for each output that some stage reads. Its files are those of the shipped pipelines.
const PRODUCERS: &str = "\
pipeline: joints
stages:
  rig:
    use: scene
    with:
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  tissue:
    use: scene
    in: {rig: rig}
    with: &block
      media: {m: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
  phantom: {use: scene, in: {rig: rig}, with: *block}
  frames: {use: render, in: {scene: tissue}, with: &fringes {f_x: [0, 0.1], phases: 3, orientation_deg: [90], samples: 64}}
  phantom_frames: {use: render, in: {scene: phantom}, with: *fringes}
  shots:
    use: import_frames
    with: {pattern: \"data/measured/tissue_{f_x}_{phase}.tif\", f_x: [0, 0.1], phases: 3, dark: data/measured/dark.tif}
  camera: {use: sensor, in: {frames: frames, covariance: frames.covariance}, with: {bits: 12}}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}}
  phantom_modulation: {use: demodulate, in: {frames: phantom_frames, covariance: phantom_frames.covariance}}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}, model: diffusion}
  table:
    use: build_lut
    with: {model: diffusion, f_x: [0, 0.1], g: 0.8, n: 1.0, mu_a: [0.01, 0.1], mu_s_prime: [0.5, 2]}
  maps: {use: invert, in: {reflectance: reflectance, lut: table}}
  two_colours:
    use: scene
    with:
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
      wavelength_nm: [660, 850]
      media: {m: {mu_a: [0.05, 0.04], mu_s_prime: 1.2, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
  frames_of_two: {use: render, in: {scene: two_colours}, with: *fringes}
  modulation_of_two: {use: demodulate, in: {frames: frames_of_two, covariance: frames_of_two.covariance}}
  reflectance_of_two:
    use: calibrate
    in: {sample: modulation_of_two, reference: modulation_of_two}
    with: {reference: {mu_a: [0.05, 0.04], mu_s_prime: 1.2, g: 0.8, n: 1.0}, model: diffusion}
  maps_of_two: {use: invert, in: {reflectance: reflectance_of_two, lut: table}}
  shape:
    use: profilometry
    in: {sample: modulation.phase, reference: phantom_modulation.phase, scene: tissue}
    with: {method: triangulation, orientation_deg: 90, heights: [-5, 5]}
  absorbers: {use: chromophores, in: {maps: maps_of_two}}
  metrics: {use: compare, in: {estimate: maps, truth: frames.truth}}
  means: {use: tabulate, in: {values: frames}}
  summary: {use: summarize, in: {metrics: metrics}}
";

/// Joints that no shipped pipeline has.
const CONSUMERS: &str = "
  compare_absorbers: {use: compare, in: {estimate: absorbers, truth: frames_of_two.truth}, with: {concentrations: {block: {HbO2: 45, Hb: 15}}}}
  compare_normals: {use: compare, in: {estimate: shape.normals, truth: frames.truth}}
  second_camera: {use: sensor, in: {frames: camera, covariance: camera.covariance}, with: {bits: 8}}
  behind_two: {use: demodulate, in: {frames: second_camera, covariance: second_camera.covariance}}
  camera_of_numbers: {use: sensor, in: {frames: camera.numbers}, with: {full_scale: 4096}}
  camera_of_shots: {use: sensor, in: {frames: shots}, with: {full_scale: 1}}
  of_numbers: {use: demodulate, in: {frames: camera.numbers}}
  on_a_shape: {use: invert, in: {reflectance: reflectance, lut: table, height: shape, normals: shape.normals, scene: tissue}}
  on_the_truth: {use: invert, in: {reflectance: reflectance, lut: table, height: frames.truth, normals: frames.truth, scene: tissue}}
";

/// Every stack of images can be tabulated, subtracted and divided by: each by itself.
const STACKS: [&str; 12] = [
    "frames",
    "frames.white",
    "shots",
    "camera",
    "camera.numbers",
    "modulation",
    "modulation.phase",
    "reflectance",
    "maps",
    "absorbers",
    "shape",
    "shape.normals",
];

/// The pipeline with the joints that no shipped one has.
pub fn more() -> String {
    let tabulated = STACKS.iter().enumerate().map(|(k, stack)| {
        format!("  means_{k}: {{use: tabulate, in: {{values: {stack}, minus: {stack}, relative_to: {stack}}}}}\n")
    });
    [PRODUCERS, CONSUMERS].map(str::to_owned).into_iter().chain(tabulated).collect()
}

/// A joint of payloads that agree and of contents that cannot: consumer, producer, a stage that makes it, and why it is refused.
pub type Senseless = (&'static str, &'static str, &'static str, &'static str);

pub const SENSELESS: [Senseless; 10] = [
    ("chromophores.maps", "profilometry.height", "{use: chromophores, in: {maps: shape}}", "no layer `mu_a`"),
    ("chromophores.maps", "profilometry.normals", "{use: chromophores, in: {maps: shape.normals}}", "no layer `mu_a`"),
    (
        "demodulate.covariance",
        "invert.covariance",
        "{use: demodulate, in: {frames: frames, covariance: maps.covariance}}",
        "the covariance is",
    ),
    (
        "invert.height",
        "invert.maps",
        "{use: invert, in: {reflectance: reflectance, lut: table, height: maps, scene: tissue}}",
        "no layer `height`",
    ),
    (
        "invert.height",
        "profilometry.normals",
        "{use: invert, in: {reflectance: reflectance, lut: table, height: shape.normals, scene: tissue}}",
        "no layer `height`",
    ),
    (
        "invert.normals",
        "invert.maps",
        "{use: invert, in: {reflectance: reflectance, lut: table, height: shape, normals: maps, scene: tissue}}",
        "no layer `normal_x`",
    ),
    (
        "invert.normals",
        "profilometry.height",
        "{use: invert, in: {reflectance: reflectance, lut: table, height: shape, normals: shape, scene: tissue}}",
        "no layer `normal_x`",
    ),
    (
        "sensor.covariance",
        "invert.covariance",
        "{use: sensor, in: {frames: frames, covariance: maps.covariance}}",
        "the covariance",
    ),
    ("summarize.metrics", "summarize.metrics", "{use: summarize, in: {metrics: summary}}", "no column `mean`"),
    ("summarize.metrics", "tabulate.metrics", "{use: summarize, in: {metrics: means}}", "no column `truth`"),
];

/// The pipeline with the joints that make no sense, each as a stage `wrong_0`, `wrong_1`, ...
pub fn senseless() -> String {
    let stages = SENSELESS.iter().enumerate().map(|(k, (.., stage, _))| format!("  wrong_{k}: {stage}\n"));
    // Of what a covariance is asked only where it is read.
    let read = "  seen: {use: demodulate, in: {frames: wrong_7, covariance: wrong_7.covariance}}\n".to_owned();
    std::iter::once(PRODUCERS.to_owned()).chain(stages).chain([read]).collect()
}
