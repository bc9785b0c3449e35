//! The stage as the engine calls it: what cancels, what the errors cover, what is refused.

use turbid_calibrate::{Calibrate, In, Model, NoiseBias, Out, Params, Reference, Rigs};
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{self, Convention, MaskReason, Modulation, Rig};
use turbid_contract::{
    Ctx, Error, Form, ImageStack, Known, LayerInfo, LayerKind, MaxFile, MemoryHost, PerChannel, PerLength, Problems,
    Stage, serde_json,
};
use turbid_optics::{Medium, PhaseFunction, Reflectance};

const PHANTOM: Medium = Medium { mu_a: 0.02, mu_s_prime: 1.5, phase: PhaseFunction::henyey_greenstein(0.8), n: 1.4 };

fn params(smooth: f64) -> Params {
    let Medium { mu_a, mu_s_prime, phase, n } = PHANTOM;
    let reference = Reference {
        mu_a: Some(PerChannel::One(PerLength(mu_a))),
        mu_s_prime: Some(PerChannel::One(PerLength(mu_s_prime))),
        g: Some(PerChannel::One(phase.g())),
        n: Some(PerChannel::One(n)),
        ..Reference::default()
    };
    Params {
        reference,
        model: Model::Diffusion,
        convention: Convention::HemisphericalEntered,
        smooth,
        smooth_sample: 0.0,
        noise_bias: NoiseBias::Correct,
        rigs: Rigs::Same,
        max_file_mb: MaxFile::default(),
    }
}

fn model(f_x: f64) -> Reflectance {
    turbid_optics::diffusion::reflectance(&PHANTOM, None, f_x).expect("a half-space of an ordinary medium")
}

/// Modulation at f_x = 0 and 0.1 with constant standard errors and the covariance of both.
fn modulation(planes: [Array2<f32>; 2], noise: Option<([f64; 2], f64)>) -> Modulation {
    let (rows, columns) = planes[0].dim();
    let mut stack = ImageStack::new(rows, columns);
    let infos = [0.0, 0.1].map(|f_x| LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(f_x));
    for (mut info, plane) in infos.iter().cloned().zip(planes) {
        if let Some((se, _)) = noise {
            let se = se[usize::from(info.f_x_per_mm > Some(0.0))];
            info.mean_se = Some(se / ((rows * columns) as f64).sqrt());
        }
        stack.push(info, plane);
    }
    if let Some((se, covariance)) = noise {
        for (info, se) in infos.iter().zip(se) {
            stack.push(info.standard_error(), Array2::from_elem((rows, columns), se as f32));
        }
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "(W mm^-2 sr^-1)^2");
        info.pair = Some([0, 1]);
        stack.push(info, Array2::from_elem((rows, columns), covariance as f32));
    }
    Modulation(stack)
}

/// One stack of modulations at several wavelengths, nm.
fn lit<const N: usize>(of: [(f64, Modulation); N]) -> Modulation {
    let mut stack = ImageStack::new(of[0].1.0.rows(), of[0].1.0.columns());
    let mut layers: Vec<_> = of
        .into_iter()
        .enumerate()
        .flat_map(|(k, (nm, modulation))| {
            modulation.0.layers.into_iter().map(move |mut layer| {
                layer.info.wavelength_nm = Some(nm);
                layer.info.pair = layer.info.pair.map(|pair| pair.map(|place| place + 2 * k as u32));
                layer
            })
        })
        .collect();
    // Values first.
    layers.sort_by_key(|layer| layer.info.kind != LayerKind::Value);
    layers.into_iter().for_each(|layer| stack.push(layer.info, layer.data));
    Modulation(stack)
}

/// Several wavelengths in one stack, with a phantom that differs between them, are those that each wavelength gives by itself; in any order of the reference's
/// layers. A list that is too short is named.
#[test]
fn each_wavelength_has_its_phantom() {
    let noise = Some(([1e-3, 2e-3], 5e-7));
    let arm = |dc: f32, ac: f32| modulation([dc, ac].map(|v| Array2::from_elem((2, 3), v)), noise);
    let phantom = |mu_a: &[f64], mu_s_prime: &[f64]| {
        let list = |values: &[f64]| match values {
            [one] => PerChannel::One(PerLength(*one)),
            all => PerChannel::Each(all.iter().map(|&x| PerLength(x)).collect()),
        };
        let reference =
            Reference { mu_a: Some(list(mu_a)), mu_s_prime: Some(list(mu_s_prime)), ..params(0.0).reference };
        Params { reference, ..params(0.0) }
    };
    let sample = || lit([(660.0, arm(0.4, 0.2)), (850.0, arm(0.3, 0.1))]);
    let reference = || lit([(850.0, arm(0.5, 0.3)), (660.0, arm(0.6, 0.35))]);
    let both = calibrate(sample(), reference(), &phantom(&[0.02, 0.03], &[1.5, 1.1])).unwrap().reflectance.0;
    for (nm, of, by, mu_a, mu_s_prime) in
        [(660.0, arm(0.4, 0.2), arm(0.6, 0.35), 0.02, 1.5), (850.0, arm(0.3, 0.1), arm(0.5, 0.3), 0.03, 1.1)]
    {
        let alone =
            calibrate(lit([(nm, of)]), lit([(nm, by)]), &phantom(&[mu_a], &[mu_s_prime])).unwrap().reflectance.0;
        let there: Vec<_> = both.layers.iter().filter(|layer| layer.info.wavelength_nm == Some(nm)).collect();
        assert_eq!(there.len(), alone.layers.len());
        for (there, alone) in there.into_iter().zip(&alone.layers) {
            assert_eq!(
                (&there.info.name, there.info.f_x_per_mm, &there.data),
                (&alone.info.name, alone.info.f_x_per_mm, &alone.data)
            );
        }
    }
    let short =
        calibrate(sample(), reference(), &phantom(&[0.02, 0.03, 0.04], &[1.5])).map(|_| ()).unwrap_err().to_string();
    assert!(
        short.contains("mu_a") && short.contains("3 values for the sample's 2 wavelengths (660, 850 nm)"),
        "{short}"
    );
}

fn masked(mut modulation: Modulation, mask: &[(usize, MaskReason)]) -> Modulation {
    let mut data = Array2::zeros((modulation.0.rows(), modulation.0.columns()));
    for &(column, reason) in mask {
        data[(0, column)] = reason.code();
        for layer in &mut modulation.0.layers {
            layer.data[(0, column)] = 0.0;
        }
    }
    modulation.0.push(LayerInfo::new("mask", LayerKind::Mask, "1"), data);
    modulation
}

fn calibrate(sample: Modulation, reference: Modulation, params: &Params) -> Result<Out, Error> {
    let host = MemoryHost::default();
    let inputs = In { sample: sample.into(), reference: reference.into(), source: std::marker::PhantomData };
    Calibrate::run(params, inputs, Ctx::new(&host))
}

fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    let mut uniform = move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

/// Any source profile, exposure and MTF that both arms share cancels; tolerance: three roundings to f32.
#[test]
fn what_both_arms_share_cancels() {
    let r_sample = [0.3, 0.12];
    for (rows, columns) in [(1, 1), (5, 9)] {
        let profile = |r: usize, c: usize| 1e-3 * (1.0 + 0.3 * (r as f64 + 2.0 * c as f64).sin());
        let mtf = [1.0, 0.4];
        let arm = |reflectance: [f64; 2]| {
            let plane = |k: usize| {
                Array2::from_shape_fn((rows, columns), |(r, c)| (profile(r, c) * mtf[k] * reflectance[k]) as f32)
            };
            modulation([plane(0), plane(1)], None)
        };
        let r_phantom = [model(0.0), model(0.1)].map(|r| r.hemispherical_entered);
        let out = calibrate(arm(r_sample), arm(r_phantom), &params(0.0)).unwrap().reflectance.0;
        for (f_x, want) in [(0.0, 0.3), (0.1, 0.12)] {
            for &got in &out.find("r_d", Some(f_x)).unwrap().data {
                assert!((f64::from(got) / want - 1.0).abs() < 3.0 * 6e-8, "f_x {f_x}: {got} for {want}");
            }
        }
        assert!(out.layers.iter().all(|l| l.info.kind != LayerKind::StandardError));
    }
}

/// A reference calibrated with itself gives the model's reflectance, in the convention that was asked for.
#[test]
fn the_reference_reflects_what_the_model_says() {
    for convention in
        [Convention::Camera, Convention::HemisphericalIncident, Convention::HemisphericalEntered, Convention::Relative]
    {
        let one = || modulation([Array2::ones((1, 1)), Array2::ones((1, 1))], None);
        let out = calibrate(one(), one(), &Params { convention, ..params(0.0) }).unwrap().reflectance.0;
        for f_x in [0.0, 0.1] {
            let want = match convention {
                Convention::Camera => model(f_x).camera,
                Convention::HemisphericalIncident => model(f_x).hemispherical_incident,
                Convention::HemisphericalEntered => model(f_x).hemispherical_entered,
                Convention::Relative => 1.0,
            };
            assert_eq!(out.find("r_d", Some(f_x)).unwrap().data[(0, 0)], want as f32);
        }
        assert_eq!(out.attributes["convention"], serde_json::to_value(convention).unwrap());
        assert_eq!(out.attributes["n"], 1.4);
    }
}

/// Standard errors, covariance and the error of the mean against the spread of noisy pairs of arms, with and without
/// smoothing of either. 60 x 60 pixels, 40 repeats: a sampled deviation over 144,000 pixels is off by 0.2 % (more with
/// smoothing, where some 113 pixels share one number: 2 %), over 40 means by 11 %; limits at 4 sigma.
#[test]
fn errors_cover_the_noise_of_both_arms() {
    let (side, repeats) = (60, 40);
    let (value, se, rho) = ([0.8, 0.3], [0.008, 0.006], 0.6);
    for (smooth, smooth_sample) in [(0.0, 0.0), (3.0, 0.0), (0.0, 3.0), (3.0, 2.0)] {
        let params = Params { smooth_sample, ..params(smooth) };
        let mut next = noise(11);
        let mut arm = |value: [f64; 2]| {
            let mut planes = [Array2::zeros((side, side)), Array2::zeros((side, side))];
            for i in 0..side * side {
                let (a, b) = (next(), next());
                let errors = [se[0] * a, se[1] * (rho * a + (1.0_f64 - rho * rho).sqrt() * b)];
                for k in 0..2 {
                    planes[k][(i / side, i % side)] = (value[k] + errors[k]) as f32;
                }
            }
            modulation(planes, Some((se, rho * se[0] * se[1])))
        };
        let (mut squares, mut product, mut means, mut stated) = ([0.0; 2], 0.0, [vec![], vec![]], None);
        for _ in 0..repeats {
            let out = calibrate(arm([0.5, 0.2]), arm(value), &params).unwrap().reflectance.0;
            let layers = [0.0, 0.1].map(|f| out.find("r_d", Some(f)).unwrap());
            let truth = [0.5 / 0.8 * model(0.0).hemispherical_entered, 0.2 / 0.3 * model(0.1).hemispherical_entered];
            for (&a, &b) in layers[0].data.iter().zip(&layers[1].data) {
                let (a, b) = (f64::from(a) - truth[0], f64::from(b) - truth[1]);
                squares[0] += a * a;
                squares[1] += b * b;
                product += a * b;
            }
            for k in 0..2 {
                means[k].push(layers[k].data.iter().map(|&v| f64::from(v)).sum::<f64>() / (side * side) as f64);
            }
            stated.get_or_insert_with(|| {
                let se = [0.0, 0.1].map(|f| out.find("r_d_se", Some(f)).unwrap().data.clone());
                let cov = out.find("cov", None).unwrap().data.clone();
                (se, cov, layers.map(|l| l.info.mean_se.unwrap()))
            });
        }
        let ([se_0, se_1], cov, mean_se) = stated.unwrap();
        let n = (side * side * repeats) as f64;
        let mean_of = |plane: &Array2<f32>| plane.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.len() as f64;
        let limit = if smooth + smooth_sample > 0.0 { 0.08 } else { 0.02 };
        for (k, plane) in [se_0, se_1].iter().enumerate() {
            let (spread, se) = ((squares[k] / n).sqrt(), mean_of(&plane.mapv(|v| v * v)).sqrt());
            assert!(
                (se / spread - 1.0).abs() < limit,
                "smooth {smooth}, {smooth_sample}, r_d {k}: se {se}, spread {spread}"
            );
            let mean = means[k].iter().sum::<f64>() / repeats as f64;
            let spread = (means[k].iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (repeats - 1) as f64).sqrt();
            assert!(
                (mean_se[k] / spread).ln().abs() < 0.45,
                "smooth {smooth}, {smooth_sample}: mean_se {}, spread {spread}",
                mean_se[k]
            );
        }
        assert!((mean_of(&cov) / (product / n) - 1.0).abs() < 2.0 * limit, "smooth {smooth}, {smooth_sample}");
    }
}

/// The mean of the ratio to a reference with 10 % of noise comes back: what is left is of fourth order, 3 x 0.1^4 = 0.03 %, and its
/// own error, 0.1 / 200 = 0.05 %. Uncorrected it is 0.1^2 = 1 % too high, up to the same order.
#[test]
fn a_noisy_reference_does_not_move_the_mean() {
    let (side, se) = (200, 0.1);
    for (noise_bias, want) in [(NoiseBias::Correct, 0.0), (NoiseBias::Keep, se * se)] {
        let mut next = noise(4);
        let flat = || [Array2::ones((side, side)), Array2::ones((side, side))];
        let noisy = Array2::from_shape_fn((side, side), |_| (1.0 + se * next()) as f32);
        let reference = modulation([noisy.clone(), noisy], Some(([se, se], se * se)));
        let sample = modulation(flat(), Some(([1e-3, 1e-3], 0.0)));
        let out = calibrate(sample, reference, &Params { noise_bias, ..params(0.0) }).unwrap().reflectance.0;
        let good: Vec<f64> =
            out.find("r_d", Some(0.0)).unwrap().data.iter().map(|&v| f64::from(v)).filter(|&v| v > 0.0).collect();
        let bias = good.iter().sum::<f64>() / good.len() as f64 / model(0.0).hemispherical_entered - 1.0;
        assert!((bias - want).abs() < 0.0003 + 4.0 * 0.0005, "{noise_bias:?}: {bias} for {want}");
        assert_eq!(good.len(), 40_000);
    }
}

/// Without a frame at f_x = 0 the mean of the fringes stands for it.
#[test]
fn the_mean_of_the_fringes_serves_as_f_x_0() {
    let arm = |m_dc: f32, m_ac: f32| {
        let mut stack = ImageStack::new(1, 1);
        for (name, value) in [("m_dc", m_dc), ("m_ac", m_ac)] {
            stack.push(LayerInfo::value(name, "1").with_f_x(0.1), Array2::from_elem((1, 1), value));
        }
        Modulation(stack)
    };
    let out = calibrate(arm(0.5, 0.1), arm(1.0, 0.4), &params(0.0)).unwrap().reflectance.0;
    let r_d = |f_x| f64::from(out.find("r_d", Some(f_x)).unwrap().data[(0, 0)]);
    assert!((r_d(0.0) / model(0.0).hemispherical_entered - 0.5).abs() < 1e-7);
    assert!((r_d(0.1) / model(0.1).hemispherical_entered - 0.25).abs() < 1e-7);
}

/// Reasons of the sample are carried on; a reference that is masked or below 5 standard errors is named; zeros everywhere else.
#[test]
fn masked_pixels_hold_zero_and_the_reason() {
    use MaskReason::{Background, Good, LowReference, NotFinite, Saturated};
    let noise = Some(([0.01, 0.01], 0.0));
    let plane = |values: [f32; 6]| Array2::from_shape_vec((1, 6), values.to_vec()).unwrap();
    let ones = [1.0; 6];
    let sample = modulation([plane(ones), plane([1.0, 1.0, 1.0, 1.0, 1.0, f32::INFINITY])], noise);
    let reference = modulation([plane(ones), plane([1.0, 1.0, 1.0, 0.04, -1.0, 1.0])], noise);
    let sample = masked(sample, &[(1, Saturated)]);
    let reference = masked(reference, &[(1, Background), (2, Background)]);
    let out = calibrate(sample, reference, &params(0.0)).unwrap().reflectance.0;
    let want = [Good, Saturated, LowReference, LowReference, LowReference, NotFinite].map(MaskReason::code);
    assert_eq!(out.find("mask", None).unwrap().data.as_slice().unwrap(), want);
    for layer in out.layers.iter().filter(|l| l.info.kind != LayerKind::Mask) {
        assert!(layer.data.iter().skip(1).all(|&v| v == 0.0), "{}", layer.info.name);
        assert!(layer.data[(0, 0)] != 0.0 || layer.info.kind == LayerKind::Covariance);
    }
}

/// Arms that do not belong together are named.
#[test]
fn mismatches_are_named() {
    let arm = |rows: usize| modulation([Array2::ones((rows, 2)), Array2::ones((rows, 2))], None);
    let message = |a, b| calibrate(a, b, &params(0.0)).map(|_| ()).unwrap_err().to_string();
    assert!(message(arm(1), arm(3)).contains("2 x 1 pixels, the reference 2 x 3 pixels"));
    let mut other = arm(1);
    other.0.layers[1].info.f_x_per_mm = Some(0.2);
    let text = message(arm(1), other);
    assert!(text.contains("m_ac at f_x = 0.1 mm^-1") && text.contains("f_x = 0.2 mm^-1"), "{text}");
    let mut coloured = arm(1);
    coloured.0.layers.iter_mut().for_each(|l| l.info.wavelength_nm = Some(630.0));
    assert!(message(coloured, arm(1)).contains("630 nm"));
    let two = lit([630.0, 660.0].map(|nm| (nm, arm(1))));
    let text = message(two, lit([(630.0, arm(1))]));
    assert!(text.contains("lit with 660 nm, the reference was not"), "{text}");
    assert!(message(Modulation(ImageStack::new(1, 2)), arm(1)).contains("no layer `m_ac`"));
}

/// Arms of two rigs are refused before the run and in it, with both producers, both values and the way out; unless they may differ, or one
/// does not say what its rig is. The reflectance carries the sample's on.
#[test]
fn arms_of_different_rigs_are_refused() {
    let arm = |rig: Option<Rig>| {
        let mut arm = modulation([Array2::ones((1, 2)), Array2::ones((1, 2))], None);
        rig.iter().for_each(|rig| rig.insert_into(&mut arm.0.attributes));
        arm
    };
    let bench = |nm: f64| Some(Rig { wavelengths_nm: vec![nm], ..Rig::default() });
    let may_differ = Params { rigs: Rigs::MayDiffer, ..params(0.0) };
    for (sample, reference, differs) in [
        (bench(635.0), bench(660.0), Some("wavelengths_nm 635 nm against 660 nm")),
        (bench(635.0), bench(635.0), None),
        (Some(Rig::named("old")), Some(Rig::named("new")), Some("`old` against `new`")),
        (Some(Rig::named("old")), bench(635.0), Some("`old` against that of a scene")),
        (Some(Rig::named("old")), Some(Rig::named("old")), None),
        (bench(635.0), None, None),
    ] {
        let (sample, reference) = (arm(sample), arm(reference));
        let mut known = Known::default();
        for (port, producer, arm) in [("sample", "fringes", &sample), ("reference", "phantom_fringes", &reference)] {
            known.forms.insert(port.to_owned(), vec![Form::said(arm.0.attributes.clone()).into()]);
            known.producers.insert(port.to_owned(), producer.to_owned());
        }
        let check = |params: &Params| {
            let mut problems = Problems::default();
            Calibrate::check(params, &known, &mut problems);
            problems.into_parts().0
        };
        let mistakes = check(&params(0.0));
        assert_eq!((mistakes.len(), check(&may_differ).len()), (usize::from(differs.is_some()), 0), "{mistakes:?}");
        if let Some(what) = differs {
            let text = mistakes[0].to_string();
            let words =
                ["in.reference: ", "`fringes`", "`phantom_fringes`", what, "in: {rig: STAGE}", "rigs: may_differ"];
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        }
        let ran = calibrate(sample.clone(), reference.clone(), &params(0.0));
        match (ran, differs) {
            (Ok(out), None) => assert_eq!(Rig::of(&out.reflectance.0.attributes), Rig::of(&sample.0.attributes)),
            (Err(error), Some(what)) => assert!(error.to_string().contains(what), "{error}"),
            (ran, _) => panic!("{differs:?}: {:?}", ran.map(|_| ())),
        }
        assert!(calibrate(sample, reference, &may_differ).is_ok());
    }
}

/// Every wrong value is found at once, with its path.
/// An arm without standard errors beside one that has them leaves the reflectance without: told at the port of the arm that lacks them, with both
/// producers, and only then.
#[test]
fn errors_of_one_arm_alone_are_warned_of() {
    let arm = |knows: bool| {
        let noise = knows.then_some(([0.01, 0.01], 0.0));
        modulation([Array2::from_elem((2, 2), 1.0), Array2::from_elem((2, 2), 0.5)], noise)
    };
    for (knows, port) in
        [([true, true], None), ([false, false], None), ([true, false], Some(1)), ([false, true], Some(0))]
    {
        let params = serde_json::to_value(params(0.0)).expect("they are JSON");
        let trial = Trial::of::<Calibrate>(params).input("sample", arm(knows[0])).input("reference", arm(knows[1]));
        let (mistakes, warnings) = trial.check();
        assert!(mistakes.is_empty(), "{mistakes:?}");
        let told: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        let Some(port) = port else {
            assert!(told.is_empty(), "{knows:?}: {told:?}");
            continue;
        };
        let (lacks, has) = (["sample", "reference"][port], ["sample", "reference"][1 - port]);
        let words = format!(
            "in.{lacks}: `made.{lacks}` has no standard error of m_ac at f_x = 0 mm^-1, `made.{has}` has one: the reflectance will have none"
        );
        assert!(told.len() == 1 && told[0].starts_with(&words) && told[0].contains("full_well"), "{told:?}");
        let made: payload::Reflectance = trial.run().expect("it is sound").get("reflectance");
        assert!(made.0.layers.iter().all(|layer| layer.info.kind != LayerKind::StandardError));
    }
}

#[test]
fn check_finds_every_mistake() {
    let reference = Reference {
        mu_a: Some(PerChannel::One(PerLength(-1.0))),
        mu_s_prime: Some(PerChannel::Each(vec![PerLength(1.0), PerLength(0.0)])),
        g: Some(PerChannel::One(1.0)),
        n: Some(PerChannel::One(0.9)),
        ..Reference::default()
    };
    let mut problems = Problems::default();
    Calibrate::check(&Params { reference, smooth_sample: 101.0, ..params(-1.0) }, &Known::default(), &mut problems);
    let paths: Vec<String> = problems.into_parts().0.into_iter().map(|p| p.path).collect();
    assert_eq!(
        paths,
        ["reference.mu_a", "reference.mu_s_prime.1", "reference.g", "reference.n", "smooth", "smooth_sample"]
    );
}

/// A pixel whose error either arm does not know has none in the reflectance of that f_x; a smoothed reference passes a flag on to the pixels of which it makes more
/// than a tenth, and keeps it to itself where it makes less. The values stay, and without a mean that is known the error of the mean is unknown too.
#[test]
fn unknown_errors_are_passed_on() {
    let flat = || modulation([0.4, 0.2].map(|v| Array2::from_elem((21, 21), v)), Some(([1e-3, 1e-3], 0.0)));
    let flagged = |mut modulation: Modulation, at: (usize, usize)| {
        let info = modulation.0.layers[1].info.clone();
        let mut flags = Array2::zeros((21, 21));
        flags[at] = 1.0;
        modulation.0.push(info.se_unknown(), flags);
        modulation
    };
    let plain = calibrate(flat(), flat(), &params(0.0)).unwrap().reflectance.0;
    let of = |sample: Modulation, reference: Modulation, smooth: f64| {
        let found = calibrate(sample, reference, &params(smooth)).unwrap().reflectance.0;
        let [low, high] = [0, 1].map(|k| found.se_unknown(&found.layers[k].info).map(|l| l.data.clone()));
        assert!(low.is_none(), "f_x = 0 knows its errors");
        for k in 0..2 {
            let off = found.layers[k].data.iter().zip(&plain.layers[k].data).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 1e-4, "values stay");
        }
        high.map_or(0.0, |flags| flags.sum())
    };
    assert_eq!(of(flagged(flat(), (3, 4)), flagged(flat(), (9, 9)), 0.0), 2.0);
    assert_eq!(of(flat(), flat(), 0.0), 0.0);
    // A Gaussian of 1 px: 0.159 in the middle, 0.096 beside it; of 3 px: 0.018.
    assert_eq!(of(flat(), flagged(flat(), (10, 10)), 1.0), 1.0);
    assert_eq!(of(flat(), flagged(flat(), (10, 10)), 3.0), 0.0);
    let mut silent = flagged(flat(), (3, 4));
    silent.0.layers[1].info.mean_se = None;
    let found = calibrate(silent, flat(), &params(0.0)).unwrap().reflectance.0;
    assert_eq!([0, 1].map(|k| found.layers[k].info.mean_se.is_some()), [true, false]);
}
