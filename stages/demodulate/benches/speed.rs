//! Demodulation of 2048 x 2048 frames on one thread, beside a loop that only copies them: best of 7.

use std::hint::black_box;
use std::marker::PhantomData;
use std::time::Instant;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Frames;
use turbid_contract::{Ctx, ImageStack, LayerInfo, MemoryHost, Stage};
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

/// CPU seconds of this thread where the system tells (a busy machine shows less), else wall seconds.
fn seconds(work: impl FnOnce()) -> f64 {
    let on_cpu = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let (start, before) = (Instant::now(), on_cpu());
    work();
    match (before, on_cpu()) {
        (Some(before), Some(after)) => (after - before) * 1e-9,
        _ => start.elapsed().as_secs_f64(),
    }
}

fn main() {
    let pixels = (SIDE * SIDE) as f64;
    println!("2048 x 2048 px, one thread; Mpx/s of one frame's pixels, and of all frames read");
    for steps in [3, 4, 8] {
        for (what, se, wanted) in
            [("AC, DC", false, ""), ("AC, DC, phase", false, "phase"), ("AC, DC, errors", true, "")]
        {
            let host = MemoryHost { wanted: vec![wanted.into()], ..MemoryHost::default() };
            let input = frames(steps, se);
            let best = |work: &dyn Fn() -> f64| (0..7).map(|_| work()).fold(f64::INFINITY, f64::min);
            let whole = best(&|| {
                let inputs = In { frames: input.clone(), covariance: None, source: PhantomData };
                seconds(|| drop(black_box(Demodulate::run(&Params::default(), inputs, Ctx::new(&host)))))
            });
            let copying = best(&|| seconds(|| drop(black_box(input.clone()))));
            println!(
                "N = {steps}, {what:15} {:6.0} {:6.0} ({:.1} ms; copying the frames {:.1} ms)",
                pixels / whole * 1e-6,
                steps as f64 * pixels / whole * 1e-6,
                1e3 * whole,
                1e3 * copying
            );
        }
    }
}
