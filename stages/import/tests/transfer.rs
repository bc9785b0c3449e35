//! Photon transfer: a camera's gain and read noise come back from frames with that noise, within the errors that are stated; and every mistake.

use serde_json::{Value, json};
use turbid_contract::kit::Trial;
use turbid_contract::payload::{CameraNoise, Frames, Transfer};
use turbid_import::{ImportFrames, PhotonTransfer};

const SIDE: usize = 96;
/// Electrons per number, electrons of read noise, the number without light.
const GAIN: f64 = 4.0;
const READ: f64 = 9.0;
const BLACK: f64 = 64.0;

/// Numbers in [0, 1), the same for the same seed (SplitMix64).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, variance 1: what matters of shot noise here is its variance.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A `.npy` file of 16 bit.
fn npy(value: impl FnMut(usize) -> u16) -> Vec<u8> {
    let mut header = format!("{{'descr': '<u2', 'fortran_order': False, 'shape': ({SIDE}, {SIDE}), }}");
    header += &" ".repeat((64 - (11 + header.len()) % 64) % 64);
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..SIDE * SIDE).map(value).flat_map(u16::to_le_bytes));
    bytes
}

/// A frame of a scene that grows brighter from 0 to `electrons`, under `lamp` times the light.
fn frame(electrons: f64, lamp: f64, random: &mut Random) -> Vec<u8> {
    npy(|i| {
        let light = lamp * electrons * i as f64 / (SIDE * SIDE) as f64;
        let seen = light + (light + READ * READ).sqrt() * random.normal();
        (BLACK + seen / GAIN).round().clamp(0.0, 65535.0) as u16
    })
}

fn params() -> Value {
    json!({"bursts": [{"files": ["a.npy", "b.npy", "c.npy"]}], "dark": {"files": ["d.npy", "e.npy"]}})
}

fn trial(seed: u64, electrons: f64) -> Trial {
    let mut random = Random(seed);
    let mut trial = Trial::of::<PhotonTransfer>(params());
    for (k, lamp) in [1.0, 1.03, 0.98].into_iter().enumerate() {
        trial = trial.file(&format!("bursts.0.files.{k}"), frame(electrons, lamp, &mut random));
    }
    trial.file("dark.files.0", frame(0.0, 0.0, &mut random)).file("dark.files.1", frame(0.0, 0.0, &mut random))
}

fn noise(trial: &Trial) -> CameraNoise {
    let Transfer(table) = trial.run().unwrap().get("transfer");
    CameraNoise::of(&table.attributes).unwrap()
}

/// Over seeds, errors are as large as stated: the root mean square of n of them is 1 within 3.3 / sqrt(2 n).
#[test]
fn a_camera_comes_back() {
    let seeds = 24;
    let mut squares = [0.0; 2];
    for seed in 0..seeds {
        let trial = trial(seed, 200_000.0);
        if seed == 0 {
            trial.passes();
            trial.keeps_the_rules();
        }
        let found = noise(&trial);
        assert!((found.black_level - BLACK).abs() < 0.1, "{found:?}");
        let z = [
            (found.electrons_per_number - GAIN) / found.electrons_per_number_se,
            (found.read_noise - READ) / found.read_noise_se,
        ];
        squares.iter_mut().zip(z).for_each(|(sum, z)| *sum += z * z);
        assert!((found.electrons_per_number / GAIN - 1.0).abs() < 0.05, "seed {seed}: {found:?}");
    }
    for (what, square) in ["gain", "read noise"].into_iter().zip(squares) {
        let rms = (square / seeds as f64).sqrt();
        assert!((rms - 1.0).abs() < 3.3 / (2.0 * seeds as f64).sqrt(), "{what}: {rms}");
    }
}

/// A good camera is not warned of; one with a curve is, and so are files whose black level nobody tells.
#[test]
fn what_is_no_straight_line_is_warned_of() {
    let said = |trial: &Trial| trial.run().unwrap().host.warned().join("\n");
    let good = trial(1, 200_000.0);
    assert_eq!(said(&good), "");
    let mut random = Random(3);
    let curved = |random: &mut Random| {
        npy(|i| {
            let light = 200_000.0 * i as f64 / (SIDE * SIDE) as f64;
            let seen = (light + (light + READ * READ).sqrt() * random.normal()).max(0.0) / 200_000.0;
            (BLACK + 50_000.0 * seen.sqrt()).round() as u16
        })
    };
    let bent = json!({"bursts": [{"files": ["a.npy", "b.npy"]}], "black_level": BLACK});
    let bent = Trial::of::<PhotonTransfer>(bent)
        .file("bursts.0.files.0", curved(&mut random))
        .file("bursts.0.files.1", curved(&mut random));
    match bent.run() {
        Ok(made) => assert!(made.host.warned().join("\n").contains("no straight line"), "{:?}", made.host.warned()),
        Err(error) => assert!(error.to_string().contains("does not rise"), "{error}"),
    }
    let unknown = json!({"bursts": [{"files": ["a.npy", "b.npy", "c.npy"]}]});
    assert!(said(&good.with(unknown)).contains("the black level is taken as 0"));
}

/// Standard errors of frames are the same whether a data sheet or a photon transfer tells of the camera.
#[test]
fn frames_take_the_noise_from_the_port() {
    let mut random = Random(7);
    let picture = frame(200_000.0, 1.0, &mut random);
    let Transfer(table) = trial(2, 200_000.0).run().unwrap().get("transfer");
    let found = CameraNoise::of(&table.attributes).unwrap();
    let files = json!([{"file": "f.npy", "f_x": 0}]);
    let by_port = Trial::of::<ImportFrames>(json!({"frames": files, "black_level": BLACK}))
        .input("transfer", Transfer(table))
        .file("frames.0.file", picture.clone());
    let params = json!({
        "frames": files, "black_level": BLACK, "full_well": found.full_well.unwrap(), "read_noise": found.read_noise,
    });
    let by_sheet = Trial::of::<ImportFrames>(params.clone()).file("frames.0.file", picture);
    let frames = |trial: &Trial| {
        let Frames(stack) = trial.run().unwrap().get("frames");
        stack
    };
    let (a, b) = (frames(&by_port), frames(&by_sheet));
    assert_eq!(a.layers.len(), b.layers.len());
    let se = |stack: &turbid_contract::ImageStack| stack.find("radiance_se", None).unwrap().pixels().into_owned();
    assert!(se(&a).iter().zip(se(&b)).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
    let both = by_port.with(params);
    let (mistakes, _) = both.check();
    let told: Vec<String> = mistakes.iter().map(ToString::to_string).collect();
    assert!(told.len() == 2 && told.iter().all(|m| m.contains("the port `transfer`")), "{told:?}");
}

#[test]
fn mistakes_are_named() {
    let burst = |files: &[&str]| json!({"bursts": [{"files": files}]});
    let with = |params: Value| {
        let mut random = Random(1);
        let mut trial = Trial::of::<PhotonTransfer>(params);
        for k in 0..2 {
            trial = trial.file(&format!("bursts.0.files.{k}"), frame(1e5, 1.0, &mut random));
        }
        trial
    };
    Trial::of::<PhotonTransfer>(json!({})).refuses("bursts", "no frames are named");
    with(burst(&["a.npy"])).refuses("bursts.0.files", "a burst of 1 frames");
    with(burst(&["a.npy", "a.npy"])).refuses("bursts.0.files.1", "stands at bursts.0.files.0 too");
    with(burst(&["a.npy", "b.npy"]))
        .file("bursts.0.files.1", b"GIF89a".to_vec())
        .refuses("bursts.0.files.1", "`b.npy`");
    let more = |field: &str, value: Value| {
        let mut params = burst(&["a.npy", "b.npy"]);
        params[field] = value;
        with(params)
    };
    more("black_level", json!(-1)).refuses("black_level", "be a finite number >= 0");
    more("saturation", json!(0)).refuses("saturation", "(0, 1]");
    more("bits", json!(40)).refuses("bits", "[1, 32]");
    // An even scene has one level and no line.
    let mut random = Random(5);
    let mut even = || npy(|_| (1000.0 + 20.0 * random.normal()).round() as u16);
    let flat = with(burst(&["a.npy", "b.npy"])).file("bursts.0.files.0", even()).file("bursts.0.files.1", even());
    let error = flat.run().err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.contains("no gain can be told"), "{error}");
}
