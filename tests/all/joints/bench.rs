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
  others_maps:
    use: import_maps
    with:
      layers:
        - {quantity: mu_a, file: &numbers data/measured/tissue_0_0.tif, scale: 1.0e-6, wavelength_nm: 660}
        - {quantity: mu_a, file: *numbers, scale: 1.0e-6, wavelength_nm: 850}
        - {quantity: mu_s_prime, file: *numbers, scale: 1.0e-4, wavelength_nm: 660}
        - {quantity: mu_s_prime, file: *numbers, scale: 1.0e-4, wavelength_nm: 850}
        - {quantity: mu_a_se, file: *numbers, scale: 1.0e-8, wavelength_nm: 660}
        - {quantity: mu_a_se, file: *numbers, scale: 1.0e-8, wavelength_nm: 850}
      crop: &small [0, 0, 12, 12]
  others_height:
    use: import_maps
    with: {layers: [{quantity: height, file: *numbers, scale: 1.0e-4}, {quantity: height_se, file: *numbers, scale: 1.0e-5}], crop: *small}
  others_modulation: &others
    use: import_modulation
    with:
      layers:
        - {quantity: m_dc, f_x: 0, file: *numbers}
        - {quantity: m_dc_se, f_x: 0, file: *numbers, scale: 0.01}
        - {quantity: m_ac, f_x: 0.1, file: *numbers, scale: 0.5}
        - {quantity: m_ac_se, f_x: 0.1, file: *numbers, scale: 0.01}
      crop: *small
  others_phantoms: {<<: *others, foreach: {A_rho: [1, 100], S_rho: [5000, 20000]}}
  others_reflectance:
    use: import_reflectance
    with:
      layers:
        - {quantity: r_d, f_x: 0, file: *numbers, scale: 1.0e-5}
        - {quantity: r_d, f_x: 0.1, orientation_deg: 90, file: *numbers, scale: 0.5e-5}
        - {quantity: r_d_se, f_x: 0, file: *numbers, scale: 1.0e-7}
        - {quantity: r_d_se, f_x: 0.1, orientation_deg: 90, file: *numbers, scale: 1.0e-7}
      crop: *small
      convention: camera
      conditions: {g: 0.8, n: 1.0}
  noise:
    use: photon_transfer
    with: {bursts: [{files: [data/measured/tissue_0.1_0.tif, data/measured/tissue_0.1_1.tif]}], black_level: 0}
  metrics: {use: compare, in: {estimate: maps, truth: frames.truth}}
  means: {use: tabulate, in: {values: frames}}
  summary: {use: summarize, in: {metrics: metrics}}
";

/// Joints that no shipped pipeline has.
const CONSUMERS: &str = "
  compare_absorbers: {use: compare, in: {estimate: absorbers, truth: frames_of_two.truth}, with: {concentrations: {block: {HbO2: 45, Hb: 15}}}}
  compare_others: {use: compare, in: {estimate: others_maps, truth: frames_of_two.truth}}
  against_others: {use: compare, in: {estimate: maps_of_two, truth: others_maps}}
  against_ours: {use: compare, in: {estimate: others_maps, truth: maps_of_two}}
  against_ourselves: {use: compare, in: {estimate: maps_of_two, truth: maps_of_two}}
  against_height: {use: compare, in: {estimate: others_height, truth: shape}}
  against_normals: {use: compare, in: {estimate: shape.normals, truth: shape.normals}}
  absorbers_of_others: {use: chromophores, in: {maps: others_maps}}
  calibrated_others:
    use: calibrate
    in: {sample: others_modulation, reference: others_modulation}
    with: {reference: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}, model: diffusion}
  phantom_readings:
    use: calibrate_dis
    foreach: {A_rho: [1, 100], S_rho: [5000, 20000]}
    with:
      media: {m: {A_rho: \"${A_rho}\", S_rho: \"${S_rho}\", g: 0.8, n: 1.0}}
      spheres: {diameter: 100, wall_reflectance: 0.98, ports: {entrance: {round: {diameter: 10}}, sample: {round: {diameter: 10}}, detector: {round: {diameter: 10}, sees: wall}}}
      sample: {thickness: 1, size: [10, 10]}
      beam: {collimated: {diameter: 1}}
      standard: {reflectance: 0.99}
      samples: 1000
  phantom_fit: {use: calibrate_iad, in: {readings: phantom_readings}}
  empirical:
    use: build_lut
    in: {phantoms: others_phantoms, references: others_modulation, properties: phantom_fit}
    with: {model: empirical, f_x: [0, 0.1], g: 0.8, n: 1.0, reference: {mu_a: 0.001, mu_s_prime: 4}}
  sections_of_others: {use: section_tube, in: {modulation: others_modulation, truth: frames.truth}, with: {method: intensity_steps, count: 2}}
  inverted_others: {use: invert, in: {reflectance: others_reflectance, lut: table}}
  others_on_a_shape:
    use: invert
    in: {reflectance: others_reflectance, lut: table, height: shape, normals: shape.normals, scene: tissue}
  on_the_height_of_others:
    use: invert
    in: {reflectance: reflectance, lut: table, height: others_height, normals: shape.normals, scene: tissue}
  shots_of_known_noise:
    use: import_frames
    in: {transfer: noise}
    with: {pattern: \"data/measured/tissue_{f_x}_{phase}.tif\", f_x: [0, 0.1], phases: 3, dark: data/measured/dark.tif}
  summary_of_rows: {use: summarize, in: {metrics: summary.over_axes}}
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
const STACKS: [&str; 15] = [
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
    "others_maps",
    "others_modulation",
    "others_reflectance",
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

pub const SENSELESS: [Senseless; 11] = [
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
    (
        "invert.normals",
        "import_maps.maps",
        "{use: invert, in: {reflectance: reflectance, lut: table, height: shape, normals: others_maps, scene: tissue}}",
        "no layer `normal_x`",
    ),
    ("summarize.metrics", "tabulate.metrics", "{use: summarize, in: {metrics: means}}", "no column `truth`"),
];

/// The pipeline with the joints that make no sense, each as a stage `wrong_0`, `wrong_1`, ...
pub fn senseless() -> String {
    let stages = SENSELESS.iter().enumerate().map(|(k, (.., stage, _))| format!("  wrong_{k}: {stage}\n"));
    // Of what a covariance is asked only where it is read.
    let read = "  seen: {use: demodulate, in: {frames: wrong_7, covariance: wrong_7.covariance}}\n".to_owned();
    std::iter::once(PRODUCERS.to_owned()).chain(stages).chain([read]).collect()
}
