//! A laboratory's measurement, from frames to chromophores with errors: `cargo bench --bench wavelengths`, in half the size
//! `cargo bench --bench wavelengths -- --pixels 1024`.
//!
//! 8 wavelengths, one frame of even light and three phases at f_x = 0.1 mm^-1 (`--phases-at-0 3`: three phases of even light, too), a tissue and a
//! phantom, 16-bit TIFF (0.5 GB, made here in a temporary folder and removed at the end, as are some 6.2 GB of results). For each command CPU seconds, user's and system's, of all its threads, and wall
//! seconds; for each stage the CPU seconds of its own work, the most memory of the process meanwhile, and bytes that it stores. What commands take beyond
//! their stages is reading, storing and hashing of frames and results, and drawing.

use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use serde_json::Value;
use tiff::encoder::{TiffEncoder, colortype};

const WAVELENGTHS_NM: [f64; 8] = [660.0, 730.0, 760.0, 800.0, 850.0, 900.0, 940.0, 970.0];
/// What the tissue sends back at each wavelength; the phantom 0.8.
const TISSUE: [f64; 8] = [0.70, 0.75, 0.73, 0.78, 0.80, 0.79, 0.75, 0.70];
const F_X: [f64; 2] = [0.0, 0.1];
const PIXEL_MM: f64 = 0.05;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let after = |name: &str| arguments.iter().position(|a| a == name).and_then(|at| arguments.get(at + 1));
    let pixels = after("--pixels").map_or(Some(2048), |text| text.parse().ok().filter(|n| (32..=8192).contains(n)));
    let Some(pixels) = pixels else {
        eprintln!("--pixels takes a number from 32 to 8192");
        return ExitCode::FAILURE;
    };
    let phases_at_0 = if after("--phases-at-0").is_some_and(|text| text == "3") { 3 } else { 1 };
    match measure(pixels, phases_at_0) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn measure(pixels: u32, phases_at_0: u32) -> Result<(), String> {
    let space = tempfile::tempdir().map_err(|e| e.to_string())?;
    write_frames(space.path(), pixels, phases_at_0)?;
    fs::write(space.path().join("wavelengths.yaml"), pipeline(phases_at_0)).map_err(|e| e.to_string())?;
    let frames = 2 * 8 * (3 + phases_at_0);
    println!("{pixels} x {pixels} pixels, 8 wavelengths, {frames} frames of 16 bit\n");
    println!("| command | CPU s, user | system | wall s |\n|---|---|---|---|");
    timed(space.path(), "plan", "plan", &[])?;
    // Instances run in turn: the memory of the process is that of the largest, and each begins to count anew.
    timed(space.path(), "run -j 1", "run", &["-j", "1"])?;
    timed(space.path(), "run, nothing to do", "run", &[])?;
    let shown = output(&mut command(space.path(), "show", &["--json"]))?;
    let shown: Value = serde_json::from_str(&shown).map_err(|e| e.to_string())?;
    println!("\n| stage | CPU s | MB at most | MB stored |\n|---|---|---|---|");
    for stage in shown["instances"].as_array().into_iter().flatten() {
        let number = |value: &Value| value.as_f64().unwrap_or(0.0);
        let ports = stage["ports"].as_object().into_iter().flatten();
        let stored: f64 = ports.map(|(_, port)| number(&port["bytes"])).sum();
        println!(
            "| {} | {:.1} | {:.0} | {:.0} |",
            stage["stage"].as_str().unwrap_or("?"),
            number(&stage["cpu_seconds"]),
            number(&stage["peak_bytes"]) / 1e6,
            stored / 1e6
        );
    }
    Ok(())
}

/// Runs a command and prints what it took: the kernel counts what ended children took.
fn timed(space: &Path, name: &str, verb: &str, more: &[&str]) -> Result<(), String> {
    let (before, began) = (Taken::by_children(), Instant::now());
    output(&mut command(space, verb, more))?;
    let (wall, after) = (began.elapsed().as_secs_f64(), Taken::by_children());
    let [user, system] = [after.user_s - before.user_s, after.system_s - before.system_s];
    println!("| {name} | {user:.1} | {system:.1} | {wall:.1} |");
    Ok(())
}

fn command(space: &Path, verb: &str, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
    command.arg(verb).arg("wavelengths.yaml").args(more).current_dir(space).env("NO_COLOR", "1");
    command
}

fn output(command: &mut Command) -> Result<String, String> {
    let done = command.output().map_err(|e| e.to_string())?;
    let said = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    if done.status.success() { Ok(said(done.stdout)) } else { Err(said(done.stderr) + &said(done.stdout)) }
}

/// What all children that ended took.
struct Taken {
    user_s: f64,
    system_s: f64,
}

impl Taken {
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    fn by_children() -> Self {
        use nix::sys::resource::{UsageWho, getrusage};
        use nix::sys::time::TimeValLike;
        let usage = getrusage(UsageWho::RUSAGE_CHILDREN).expect("the system tells");
        let seconds = |time: nix::sys::time::TimeVal| time.num_microseconds() as f64 / 1e6;
        Self { user_s: seconds(usage.user_time()), system_s: seconds(usage.system_time()) }
    }

    #[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
    fn by_children() -> Self {
        Self { user_s: f64::NAN, system_s: f64::NAN }
    }
}

fn pipeline(phases_at_0: u32) -> String {
    let nm: Vec<String> = WAVELENGTHS_NM.iter().map(f64::to_string).collect();
    let frames = |name: &str| {
        format!(
            "{{use: import_frames, with: {{pattern: \"data/{name}_{{wavelength_nm}}_{{f_x}}_{{phase}}.tif\", f_x: [0, 0.1], phases: 3, phases_at_0: {phases_at_0}, \
             wavelength_nm: [{}], full_well: 30000, read_noise: 8, pixel_mm: {PIXEL_MM}, rig: a}}}}",
            nm.join(", ")
        )
    };
    format!(
        "pipeline: wavelengths
stages:
  frames: {}
  phantom_frames: {}
  modulation: {{use: demodulate, in: {{frames: frames}}}}
  phantom_modulation: {{use: demodulate, in: {{frames: phantom_frames}}}}
  reflectance:
    use: calibrate
    in: {{sample: modulation, reference: phantom_modulation}}
    with: {{reference: {{mu_a: 0.02, mu_s_prime: 1.0, g: 0.8, n: 1.4}}, model: rte, convention: camera, smooth: 5}}
  table:
    use: build_lut
    with: {{model: rte, f_x: [0, 0.1], mu_a: {{logspace: [0.002, 0.3, 25]}}, mu_s_prime: {{logspace: [0.3, 3, 25]}}, g: 0.8, n: 1.4, convention: camera}}
  maps: {{use: invert, in: {{reflectance: reflectance, lut: table}}}}
  oxygen: {{use: chromophores, in: {{maps: maps}}, with: {{chromophores: [HbO2, Hb, water]}}}}
",
        frames("tissue"),
        frames("phantom")
    )
}

/// Fringes with noise of some 50 counts, a little black level in every pixel.
fn write_frames(space: &Path, pixels: u32, phases_at_0: u32) -> Result<(), String> {
    let folder = space.join("data");
    fs::create_dir(&folder).map_err(|e| e.to_string())?;
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1_u64 << 24) as f64 * 180.0 - 90.0
    };
    for (name, dc, ac) in [("tissue", 0.45, 0.16), ("phantom", 0.55, 0.2)] {
        for (nm, tissue) in WAVELENGTHS_NM.into_iter().zip(TISSUE) {
            let light = if name == "tissue" { tissue } else { 0.8 };
            let phases = |f_x: f64| if f_x == 0.0 { phases_at_0 } else { 3 };
            for (f_x, phase) in F_X.into_iter().flat_map(|f_x| (0..phases(f_x)).map(move |phase| (f_x, phase))) {
                let turn = f64::from(phase) / 3.0;
                let row: Vec<f64> = (0..pixels)
                    .map(|x| {
                        let cosine = (2.0 * std::f64::consts::PI * (f_x * f64::from(x) * PIXEL_MM + turn)).cos();
                        let even = if phases_at_0 == 1 { dc } else { dc * (1.0 + cosine) };
                        let seen = if f_x == 0.0 { even } else { dc + ac * cosine };
                        65535.0 * light * (0.02 + seen / 2.0)
                    })
                    .collect();
                let rows = (0..pixels).flat_map(|_| &row);
                let counts: Vec<u16> = rows.map(|mean| (mean + noise()).clamp(0.0, 65535.0) as u16).collect();
                let file = folder.join(format!("{name}_{nm}_{f_x}_{phase}.tif"));
                let write = || -> Result<(), Box<dyn std::error::Error>> {
                    let mut encoder = TiffEncoder::new(std::io::BufWriter::new(fs::File::create(&file)?))?;
                    Ok(encoder.write_image::<colortype::Gray16>(pixels, pixels, &counts)?)
                };
                write().map_err(|e| format!("{}: {e}", file.display()))?;
            }
        }
    }
    Ok(())
}
