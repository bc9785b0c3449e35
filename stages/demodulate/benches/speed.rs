//! Demodulation of 2048 x 2048 frames on one thread, the sweep and the whole stage, beside a loop that only copies: best of 5 x 8.

use std::hint::black_box;
use std::marker::PhantomData;
use std::time::Instant;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Frames;
use turbid_contract::{Ctx, ImageStack, LayerInfo, MemoryHost, Stage};
use turbid_demodulate::fused::{Planes, amplitudes};
use turbid_demodulate::level::named;
use turbid_demodulate::phase_shift::Weights;
use turbid_demodulate::{Demodulate, In, Params};

const SIDE: usize = 2048;

fn frames(steps: usize, se: bool) -> Frames {
    let mut stack = ImageStack::new(SIDE, SIDE);
    for k in 0..steps {
        let phase = std::f64::consts::TAU * k as f64 / steps as f64;
        let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(0.1);
        info.phase_rad = Some(phase);
        let value = |(r, c): (usize, usize)| (0.5 + 0.2 * ((r + c) as f64 * 0.1 + phase).cos()) as f32;
        stack.push(info.clone(), Array2::from_shape_fn((SIDE, SIDE), value));
        if se {
            stack.push(info.standard_error(), Array2::from_elem((SIDE, SIDE), 1e-3));
        }
    }
    Frames(stack)
}

/// CPU seconds of this thread where the system tells (a busy machine shows less), else wall seconds; of one of 8 rounds,
/// since some systems count in ticks of 4 ms.
fn seconds(mut work: impl FnMut()) -> f64 {
    with_own(|| (), |()| work())
}

/// The same where each round uses up something that is made beforehand.
fn with_own<T>(make: impl Fn() -> T, mut work: impl FnMut(T)) -> f64 {
    const ROUNDS: usize = 8;
    let on_cpu = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let best = (0..5).map(|_| {
        let own: Vec<T> = (0..ROUNDS).map(|_| make()).collect();
        let (start, before) = (Instant::now(), on_cpu());
        own.into_iter().for_each(&mut work);
        match (before, on_cpu()) {
            (Some(before), Some(after)) => (after - before) * 1e-9,
            _ => start.elapsed().as_secs_f64(),
        }
    });
    best.fold(f64::INFINITY, f64::min) / ROUNDS as f64
}

fn main() {
    let pixels = (SIDE * SIDE) as f64;
    let line = |what: &str, steps: usize, seconds: f64| {
        let (one, all) = (pixels / seconds * 1e-6, steps as f64 * pixels / seconds * 1e-6);
        println!("N = {steps}, {what:28} {one:6.0} {all:6.0} ({:.1} ms)", 1e3 * seconds);
    };
    println!("2048 x 2048 px, one thread; Mpx/s of one frame's pixels, and of all frames read");
    for steps in [3, 8] {
        let input = frames(steps, false);
        let planes: Vec<&[f32]> = input.0.layers.iter().map(|l| l.data.as_slice().expect("row-major")).collect();
        let phases: Vec<f64> = input.0.layers.iter().map(|l| l.info.phase_rad.expect("given")).collect();
        let weights = Weights::least_squares(&phases).expect("equal steps");
        let mut out: [Vec<f32>; 3] = [const { Vec::new() }; 3].map(|_: Vec<f32>| vec![1.0; SIDE * SIDE]);
        // As many bytes as the sweep for AC + DC reads and writes.
        let copying = seconds(|| {
            for k in 0..2 {
                out[k].copy_from_slice(black_box(planes[k]));
            }
            black_box(planes[2].iter().fold(0_u32, |sum, v| sum ^ v.to_bits()));
        });
        line("copy loop", steps, copying);
        // What the stage cannot do without: M_DC, M_AC and mask in memory that nobody has touched.
        let fresh = seconds(|| {
            drop(black_box([0, 1, 2].map(|k| black_box(planes[k]).to_vec())));
        });
        line("copy into fresh planes", steps, fresh);
        for level in ["baseline", "v3", "v4"] {
            for wanted in ["AC, DC", "AC, DC, phase"] {
                let sweep = seconds(|| {
                    let [m_dc, m_ac, phase] = &mut out;
                    let phase = if wanted == "AC, DC" { &mut [][..] } else { phase };
                    amplitudes(named(level), black_box(&planes), &weights, Planes { m_dc, m_ac, phase });
                });
                line(&format!("sweep {level}: {wanted}"), steps, sweep);
            }
        }
        for (what, se, wanted, low_signal) in [
            ("AC, DC", false, "", 3.0),
            ("AC, DC, phase", false, "phase", 3.0),
            ("AC, DC, errors", true, "", 3.0),
            ("the same, low_signal: 0", true, "", 0.0),
        ] {
            let params = Params { low_signal, ..Params::default() };
            let host = MemoryHost { wanted: vec![wanted.into()], ..MemoryHost::default() };
            let input = frames(steps, se);
            let whole = with_own(
                || input.clone(),
                |frames| {
                    let inputs = In { frames: frames.into(), covariance: None, scene: None, source: PhantomData };
                    drop(black_box(Demodulate::run(&params, inputs, Ctx::new(&host))));
                },
            );
            line(&format!("stage: {what}"), steps, whole);
        }
    }
}
