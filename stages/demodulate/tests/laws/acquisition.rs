//! Faults of an acquisition are told in words above their limits, and a good one stays silent.

use std::f64::consts::TAU;

use turbid_contract::ImageStack;
use turbid_contract::payload::Frames;
use turbid_demodulate::Params;

use crate::{noise, push, with};

const N: usize = 128;
const SIGMA: f64 = 0.005;
/// Of the brightest frames: 0.5 (1 + ..) reaches 1.5.
const SATURATION: f64 = 2.0;

/// A frame before its noise, as what makes it faulty: the full field first, then three phases at 0.1 mm^-1.
struct Setting {
    gain: [f64; 4],
    offset: [f64; 4],
    /// Degrees that are added to the phases of the three.
    off_deg: [f64; 3],
    /// Phases that are declared, of those that are meant.
    declared: f64,
    /// Percent of the pixels of frame 1 that are saturated, or no numbers.
    saturated: f64,
    missing: f64,
    /// mm that the sample moves from frame to frame.
    motion: f64,
}

const GOOD: Setting = Setting {
    gain: [1.0; 4],
    offset: [0.0; 4],
    off_deg: [0.0; 3],
    declared: 1.0,
    saturated: 0.0,
    missing: 0.0,
    motion: 0.0,
};

fn warnings(of: &Setting, seed: u64) -> String {
    let mut stack = ImageStack::new(N, N);
    let mut next = noise(seed);
    for frame in 0..4 {
        let (f_x, step) = if frame == 0 { (0.0, 0.0) } else { (0.1, 120.0 * (frame - 1) as f64) };
        let off = if frame == 0 { 0.0 } else { of.off_deg[frame - 1] };
        let lost = |share: f64, r: usize, c: usize| frame == 1 && ((r * N + c) as f64) < 0.01 * share * (N * N) as f64;
        let drawn: Vec<f64> = (0..N * N).map(|_| SIGMA * next()).collect();
        let value = |r: usize, c: usize| {
            let [x, y] = [c, r].map(|k| k as f64);
            let lesion = |width: f64| (-((x - 60.0).powi(2) + (y - 64.0).powi(2)) / width).exp();
            let dc = 1.0 - 0.3 * lesion(900.0);
            let m_ac = if frame == 0 { 0.0 } else { 0.5 * dc * (1.0 - 0.2 * lesion(600.0)) };
            let phase = TAU * f_x * (x - of.motion * frame as f64) + (step + off).to_radians() + 0.4;
            let value = of.gain[frame] * (dc + m_ac * phase.cos()) + of.offset[frame] + drawn[r * N + c];
            if lost(of.saturated, r, c) {
                SATURATION
            } else if lost(of.missing, r, c) {
                f64::NAN
            } else {
                value
            }
        };
        push(&mut stack, f_x, of.declared * step.to_radians(), &value, None);
    }
    let params = Params { saturation: Some(SATURATION), ..Params::default() };
    let (_, host) = with(&params, Frames(stack), None, &[]).unwrap();
    host.warnings.lock().unwrap().join("\n")
}

/// Ten faults at three severities each: silent below the limit, told above it in words that name fault and frame. All rows that are otherwise are printed.
#[test]
fn faults_are_told_above_their_limits() {
    assert_eq!(warnings(&GOOD, 1), "");
    type Fault = (&'static str, &'static str, [(f64, bool); 3], fn(f64) -> Setting);
    let faults: [Fault; 10] = [
        ("one frame brighter", "of 120 deg", [(0.01, false), (0.03, true), (0.1, true)], |s| Setting {
            gain: [1.0, 1.0, 1.0 + s, 1.0],
            ..GOOD
        }),
        ("a background step", "of 240 deg", [(0.01, false), (0.03, true), (0.1, true)], |s| Setting {
            offset: [0.0, 0.0, 0.0, s],
            ..GOOD
        }),
        ("a lamp that drifts", "brightness", [(0.01, false), (0.03, true), (0.1, true)], |s| Setting {
            gain: [1.0, 1.0, 1.0 + 0.5 * s, 1.0 + s],
            ..GOOD
        }),
        ("a room light that drifts", "brightness", [(0.01, false), (0.03, true), (0.1, true)], |s| Setting {
            offset: [0.0, 0.0, 0.5 * s, s],
            ..GOOD
        }),
        ("one phase that is off", "ripples", [(2.0, false), (12.0, true), (40.0, true)], |s| Setting {
            off_deg: [0.0, s, 0.0],
            ..GOOD
        }),
        ("steps that are declared too small", "ripples", [(0.98, false), (0.9, true), (0.75, true)], |s| Setting {
            declared: s,
            ..GOOD
        }),
        ("a lost step", "differ by their noise only", [(-2.0, false), (-119.5, true), (-120.0, true)], |s| Setting {
            off_deg: [0.0, 0.0, s],
            ..GOOD
        }),
        (
            "a full field of another brightness",
            "off that at f_x = 0",
            [(1.02, false), (1.08, true), (1.2, true)],
            |s| Setting { gain: [s, 1.0, 1.0, 1.0], ..GOOD },
        ),
        ("saturated pixels", "are saturated", [(0.5, false), (2.0, true), (10.0, true)], |s| Setting {
            saturated: s,
            ..GOOD
        }),
        ("motion", "ripples", [(0.02, false), (0.3, true), (1.0, true)], |s| Setting { motion: s, ..GOOD }),
    ];
    let mut table = String::new();
    for (name, words, severities, fault) in faults {
        for (severity, expected) in severities {
            let said = warnings(&fault(severity), 2);
            let holds = if expected { said.contains(words) } else { said.is_empty() };
            if !holds {
                table += &format!("{name} {severity}: expected {expected}, said {said:?}\n");
            }
        }
    }
    assert!(table.is_empty(), "\n{table}");
    assert!(warnings(&Setting { missing: 5.0, ..GOOD }, 3).contains("5.0 % of the frame of 0 deg at f_x = 0.1"));
    let dark = warnings(&Setting { gain: [1.0, 0.0, 1.0, 1.0], ..GOOD }, 4);
    assert!(
        dark.contains("the frame of 0 deg at f_x = 0.1 mm^-1 is dark") && dark.contains("cannot be told"),
        "{dark}"
    );
}
