//! Scenes for the tests, and ways to run them.

use std::collections::BTreeMap;

use serde_json::{Value, json};
pub use turbid_contract::MemoryHost;
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Camera, Lamp, Medium, Object, Profile, Projection, Projector, Scene, Shape, Surface};
use turbid_contract::{Artifact, Cells, Ctx, Error, Host, ImageStack, StageRow, Table};
use turbid_render::RenderStage;

pub fn medium(mu_a: f64, mu_s: f64, g: f64) -> Medium {
    Medium {
        mu_a: vec![mu_a],
        mu_s: vec![mu_s],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(g),
        n: 1.0,
    }
}

pub fn object(shape: Shape, medium: &str, priority: i32) -> Object {
    Object { shape, medium: Some(medium.to_owned()), priority, surface: Surface::Smooth }
}

pub fn lambertian(shape: Shape, rho: f64) -> Object {
    Object { shape, medium: None, priority: 0, surface: Surface::Lambertian(rho) }
}

pub const FLOOR: Shape = Shape::Slab { top: 0.0, bottom: -2000.0 };

/// Camera and projector `distance` above the origin, `apart` from each other along y.
pub fn rig(distance: f64, apart: f64, field: f64, pixels: u32, lit: f64) -> (Camera, Projector) {
    let camera = Camera {
        position: [0.0, 0.0, distance],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [field; 2],
        pixels: [pixels; 2],
        specular: None,
        projection: Projection::Pinhole,
        distortion: None,
        aperture: None,
    };
    let projector = Projector {
        position: [0.0, apart, distance],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [lit; 2],
        power: vec![5.0],
        profile: Profile::Flat,
        pixels: None,
        distortion: None,
    };
    (camera, projector)
}

pub fn scene(media: &[(&str, Medium)], objects: Vec<Object>, (camera, projector): (Camera, Projector)) -> Scene {
    let name = |i| char::from(b'a' + i as u8).to_string();
    Scene {
        wavelengths_nm: Vec::new(),
        media: media.iter().map(|(name, m)| ((*name).to_owned(), m.clone())).collect(),
        objects: objects.into_iter().enumerate().map(|(i, o)| (name(i), o)).collect(),
        camera: Some(camera),
        projector: Some(projector),
        lights: BTreeMap::new(),
        detectors: BTreeMap::new(),
    }
}

/// The scene on the one input port.
pub fn input(scene: Scene) -> Inputs {
    Inputs::none().with("scene", scene)
}

/// All ports by name.
pub fn run_on(host: &dyn Host, scene: &Scene, params: &Value) -> Result<BTreeMap<&'static str, ImageStack>, Error> {
    let ports = StageRow::of::<RenderStage>().run(params, &input(scene.clone()), Ctx::new(host))?;
    let stack = |artifact| if let Artifact::Images(stack) = artifact { stack } else { panic!("images were expected") };
    Ok(ports.into_iter().map(|(name, artifact)| (name, stack(artifact))).collect())
}

pub fn run(scene: &Scene, params: &Value, seed: u64) -> BTreeMap<&'static str, ImageStack> {
    run_on(&MemoryHost::new(seed, &["covariance", "truth", "white"], 2), scene, params).unwrap()
}

/// Mean over the image, and its standard error, of the first radiance layer at f_x = 0 (radiance at half the pattern).
pub fn dc(scene: &Scene, samples: u32, seed: u64) -> (f64, f64) {
    let frames = &run(scene, &json!({"f_x": [0], "samples": samples}), seed)["frames"];
    let layer = frames.find("radiance", Some(0.0)).unwrap();
    // Where the paths do not hold the tail the error of the mean is unknown; that of the paths is a lower bound.
    let of_paths = || {
        let se = frames.standard_error(&layer.info).unwrap().data.mapv(|se| f64::from(se).powi(2));
        se.sum().sqrt() / se.len() as f64
    };
    (layer.data.mapv(f64::from).mean().unwrap(), layer.info.mean_se.unwrap_or_else(of_paths))
}

/// M_DC, M_AC and the standard error of M_AC of the only pixel at the only f_x > 0.
pub fn amplitude(ports: &BTreeMap<&'static str, ImageStack>, f_x: f64) -> (f64, f64, f64) {
    let frames: Vec<f64> = ports["frames"]
        .layers
        .iter()
        .filter(|l| l.info.name == "radiance" && l.info.f_x_per_mm == Some(f_x))
        .map(|l| f64::from(l.data[(0, 0)]))
        .collect();
    let [a, b, c] = frames[..] else { panic!("three phases") };
    let (re, im) = ((2.0 * a - b - c) / 3.0, (c - b) / 3f64.sqrt());
    let cov = |i: u32, j: u32| {
        let layer = ports["covariance"].layers.iter().find(|l| l.info.pair == Some([i, j])).unwrap();
        f64::from(layer.data[(0, 0)])
    };
    let quantities = ports["covariance"].attributes["quantities"].as_array().unwrap();
    let at = quantities.iter().position(|q| q["part"] == "re" && q["f_x_per_mm"] == json!(f_x)).unwrap() as u32;
    let m = (re * re + im * im).sqrt();
    let along = re * re * cov(at, at) + 2.0 * re * im * cov(at, at + 1) + im * im * cov(at + 1, at + 1);
    ((a + b + c) / 3.0, m, along.sqrt() / m)
}

/// detector -> (power, share, share_se), an unknown error as 0.
pub fn power(scene: &Scene, photons: u32, seed: u64) -> Vec<(String, f64, f64, f64)> {
    let table = power_table(scene, photons, seed);
    let Cells::Text(names) = &table.columns[0].cells else { panic!("names") };
    let column = |name: &str| table.f64s(name).unwrap().to_vec();
    let (p, s, se) = (column("power"), column("share"), table.maybe_f64s("share_se").unwrap());
    names.iter().enumerate().map(|(i, name)| (name.clone(), p[i], s[i], se[i].unwrap_or(0.0))).collect()
}

pub fn power_table(scene: &Scene, photons: u32, seed: u64) -> Table {
    let host = MemoryHost::new(seed, &["power"], 2);
    let params = json!({"f_x": [0], "samples": 2, "photons": photons});
    let ports = StageRow::of::<RenderStage>().run(&params, &input(scene.clone()), Ctx::new(&host)).unwrap();
    let table = ports.into_iter().find(|p| p.0 == "power").unwrap().1;
    let Artifact::Table(table) = table else { panic!("a table") };
    table
}

/// The scene under a beam along its normal, with nothing else to light it.
pub fn beam_on(mut scene: Scene) -> Scene {
    scene.projector = None;
    let beam = Lamp::Collimated { position: [0.0, 0.0, 50.0], look_at: [0.0; 3], diameter: 2.0, power: vec![2.0] };
    scene.lights = [("beam".to_owned(), beam)].into();
    scene
}
