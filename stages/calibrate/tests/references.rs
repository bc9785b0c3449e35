//! What a reference may be said to be: a phantom by a table over wavelength, a plate, an object that is seen; arms of which one has no frame of even light.

use turbid_calibrate::Calibrate;
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{CONDITIONS, Conditions, Modulation, Reflectance, Rig, SaidBy, Seen};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{ImageStack, LayerInfo, StageRow};
use turbid_optics::{Medium, PhaseFunction};

/// Name, f_x and value of a layer.
type OfLayer = (&'static str, f64, f32);

/// One pixel at each wavelength.
fn arm(of: &[(f64, &[OfLayer])]) -> Modulation {
    let mut stack = ImageStack::new(1, 1);
    for (nm, layers) in of {
        for &(name, f_x, value) in *layers {
            let info = LayerInfo::value(name, "counts").with_f_x(f_x);
            stack.push(LayerInfo { wavelength_nm: Some(*nm), ..info }, Array2::from_elem((1, 1), value));
        }
    }
    Modulation(stack)
}

const SAMPLE: &[OfLayer] = &[("m_ac", 0.0, 0.4), ("m_ac", 0.1, 0.2)];
const REFERENCE: &[OfLayer] = &[("m_ac", 0.0, 0.5), ("m_ac", 0.1, 0.4)];

fn trial(reference: Value) -> Trial {
    let params = json!({"reference": reference, "model": "diffusion"});
    let arms = |layers| arm(&[(660.0, layers), (850.0, layers)]);
    Trial::of::<Calibrate>(params).input("sample", arms(SAMPLE)).input("reference", arms(REFERENCE))
}

fn made(trial: &Trial) -> ImageStack {
    let Reflectance(stack) = trial.run().unwrap_or_else(|e| panic!("{}: {e}", trial.params)).get("reflectance");
    let form = trial.describe().remove("reflectance").expect("it is described");
    assert_eq!(form.attributes, stack.attributes, "what is described is what is made");
    stack
}

fn values(stack: &ImageStack) -> Vec<f32> {
    let values = stack.layers.iter().filter(|layer| layer.info.name == "r_d");
    values.map(|layer| layer.data[(0, 0)]).collect()
}

/// Interpolated by hand at 660 and 850 nm.
const BY_HAND: [Medium; 2] = [
    Medium { mu_a: 0.018, mu_s_prime: 1.12, phase: PhaseFunction::henyey_greenstein(0.7), n: 1.4 },
    Medium { mu_a: 0.01, mu_s_prime: 0.9, phase: PhaseFunction::henyey_greenstein(0.7), n: 1.4 },
];
const TABLE: &str =
    "# a block of silicone\nwavelength_nm, mu_a, mu_s_prime\n600, 0.03, 1.3\n700, 0.01, 1.0\n850, 0.01, 0.9\n";

/// What a camera's gain (or exposure, or the lamp) does: in both arms it cancels; in one it is a factor of R_d at every f_x, which no frame tells, so that rigs of two
/// names are refused.
#[test]
fn a_gain_cancels_between_arms_and_nowhere_else() {
    let known = json!({"mu_a": 0.02, "mu_s_prime": 1.0, "g": 0.7, "n": 1.4});
    let brighter =
        |layers: &[OfLayer]| -> Vec<OfLayer> { layers.iter().map(|&(name, f_x, v)| (name, f_x, 1.5 * v)).collect() };
    let run = |sample: &[OfLayer], reference: &[OfLayer]| {
        let both = |layers: &[OfLayer]| arm(&[(660.0, layers), (850.0, layers)]);
        let params = json!({"reference": known, "model": "diffusion"});
        let trial = Trial::of::<Calibrate>(params).input("sample", both(sample)).input("reference", both(reference));
        values(&made(&trial))
    };
    let plain = run(SAMPLE, REFERENCE);
    for (cancelled, of) in run(&brighter(SAMPLE), &brighter(REFERENCE)).iter().zip(&plain) {
        assert!((cancelled / of - 1.0).abs() < 1e-6);
    }
    for (one, of) in run(&brighter(SAMPLE), REFERENCE).iter().zip(&plain) {
        assert!((one / of - 1.5).abs() < 1e-6);
    }
    let on = |name: &str, layers| {
        let Modulation(mut stack) = arm(&[(660.0, layers)]);
        Rig::named(name).insert_into(&mut stack.attributes);
        Modulation(stack)
    };
    Trial::of::<Calibrate>(json!({"reference": known, "model": "diffusion"}))
        .input("sample", on("gain 2", SAMPLE))
        .input("reference", on("gain 1", REFERENCE))
        .refuses("in.reference", "gain");
}

/// A table is the phantom that it holds between its rows, in each unit of its columns; the values are those of the same phantom written out.
#[test]
fn a_table_is_read_at_the_wavelengths_of_the_sample() {
    let by_hand = made(&trial(json!({
        "mu_a": BY_HAND.map(|m| m.mu_a), "mu_s_prime": BY_HAND.map(|m| m.mu_s_prime), "g": 0.7, "n": 1.4
    })));
    let per_cm = "wavelength_nm; mu_a_per_cm; mu_s_prime_per_cm; g; n\n600; 0.3; 13; 0.7; 1.4\n700;0.1;10;0.7;1.4\n850;0.1;9;.7;1.4";
    let plain_cm = "wavelength_nm mu_a mu_s_prime\n600 0.3 13\n700 0.1 10\n850 0.1 9\n";
    let given = json!({"table": "x/block.csv", "g": 0.7, "n": 1.4});
    let in_cm = json!({"table": "block.csv", "unit": "per_cm", "g": 0.7, "n": [1.4, 1.4]});
    for (params, text) in [(given, TABLE), (json!({"table": "a.csv"}), per_cm), (in_cm, plain_cm)] {
        let stack = made(&trial(params.clone()).file("reference.table", text.as_bytes()));
        let expected = values(&by_hand);
        let off = values(&stack).iter().zip(&expected).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f32::max);
        // Two roundings to f32.
        assert!(off < 3e-7, "{params}: {:?} {expected:?}", values(&stack));
        assert_eq!((&stack.attributes["g"], &stack.attributes["n"]), (&json!(0.7), &json!(1.4)), "{params}");
        let said: Vec<f64> =
            stack.attributes["reference"]["mu_a"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
        assert!((said[0] / 0.018 - 1.0).abs() < 1e-12 && (said[1] / 0.01 - 1.0).abs() < 1e-12, "{said:?}");
    }
}

/// Where the file lies does not matter for the key, its name and content do.
#[test]
fn the_table_is_in_the_key() {
    let key = |file: &str| {
        let params = json!({"reference": {"table": file, "g": 0.7, "n": 1.4}});
        let job = (StageRow::of::<Calibrate>().prepare)(&params).expect("they are params");
        assert_eq!(
            job.files().iter().map(|f| (f.at.clone(), f.path.clone())).collect::<Vec<_>>(),
            [("reference.table".to_owned(), file.to_owned())]
        );
        job.canonical().expect("they are finite")
    };
    assert_eq!(key("a/block.csv"), key("b/block.csv"));
    assert_ne!(key("a/block.csv"), key("a/other.csv"));
}

#[test]
fn wrong_tables_are_named() {
    let both = json!({"table": "t.csv", "g": 0.8, "n": 1.4});
    for (params, text, words) in [
        (both.clone(), "", "t.csv:1:1: the file holds nothing"),
        (
            both.clone(),
            "wavelength_nm,mu_a\n600,0.1\n",
            "the columns mu_a and mu_s_prime, or reflectance, are wanted; it has mu_a",
        ),
        (
            both.clone(),
            "wavelength_nm,mu_a,mu_s_prime\n600,0.1,1\n700,0.1,0\n",
            "t.csv:3:3: mu_s_prime = 0 must be > 0",
        ),
        (
            both.clone(),
            "wavelength_nm,mu_a,mu_s_prime\n600,0.1,1\n850,0.1,x\n",
            "t.csv:3:3: mu_s_prime = `x` is not a finite number",
        ),
        (
            both.clone(),
            "wavelength_nm,mu_a,mu_s_prime,g\n600,0.1,1,0.8\n850,0.1,1,0.8\n",
            "g is a column, and `reference.g` is given",
        ),
        (
            json!({"table": "t.csv", "g": 0.8}),
            "wavelength_nm,mu_a,mu_s_prime\n600,0.1,1\n",
            "no column n; write `n` beside `table`",
        ),
        (both.clone(), "wavelength_nm,mu_a,mu_a_per_cm,mu_s_prime\n600,0.1,1,1\n", "says again"),
        (
            json!({"table": "t.csv", "unit": "per_m", "g": 0.8, "n": 1.4}),
            "wavelength_nm,mu_a_per_cm,mu_s_prime\n600,0.1,1\n",
            "another unit than `unit`",
        ),
        (
            both.clone(),
            "wavelength_nm,mu_a,mu_s_prime\n660,0.1,1\n700,0.1,1\n",
            "t.csv reaches from 660 to 700 nm, the sample was lit with 850 nm",
        ),
        (both, "wavelength_nm,reflectance\n660,0.9\n850,0.9\n", "a plate has no g and n"),
        (
            json!({"table": "t.csv"}),
            "wavelength_nm,reflectance\n660,0.9\n850,1.6\n",
            "t.csv:3:2: reflectance = 1.6 must lie in (0, 1.5]",
        ),
    ] {
        trial(params).file("reference.table", text.as_bytes()).refuses("reference.table", words);
    }
}

/// A phantom that is written out has the key that it had before tables and plates: what was made of it stays.
#[test]
fn the_key_of_a_phantom_is_what_it_was() {
    let params = json!({"reference": {"mu_a": 0.02, "mu_s_prime": 1.5, "g": 0.8, "n": 1.4}});
    let job = (StageRow::of::<Calibrate>().prepare)(&params).expect("they are params");
    let key = json!({
        "reference": {"mu_a": 0.02, "mu_s_prime": 1.5, "g": 0.8, "n": 1.4}, "model": "rte", "convention": "camera",
        "smooth": 0.0, "smooth_sample": 0.0, "noise_bias": "correct", "rigs": "same"
    });
    assert_eq!(job.canonical().expect("they are finite"), key);
}

/// A plate is what its supplier says, at each f_x or at those of its columns; over f_x nothing is interpolated.
#[test]
fn a_plate_is_as_its_supplier_says() {
    let ratios = [0.4 / 0.5, 0.2 / 0.4];
    let by_f_x = "wavelength_nm,reflectance@0,reflectance@0.1\n600,0.9,0.8\n700,0.8,0.6\n900,0.8,0.6\n";
    let any = "wavelength_nm,reflectance\n600,0.9\n700,0.8\n900,0.8\n";
    for (params, text, r_d) in [
        (json!({"reflectance": 0.99}), "", [[0.99, 0.99], [0.99, 0.99]]),
        (json!({"reflectance": ["98 %", 0.99]}), "", [[0.98, 0.98], [0.99, 0.99]]),
        (json!({"table": "p.csv"}), any, [[0.84, 0.84], [0.8, 0.8]]),
        (json!({"table": "p.csv"}), by_f_x, [[0.84, 0.68], [0.8, 0.6]]),
    ] {
        let trial = trial(params.clone()).file("reference.table", text.as_bytes());
        trial.passes();
        let stack = made(&trial);
        let expected = r_d.iter().flat_map(|r_d| [0, 1].map(|k| r_d[k] * ratios[k]));
        for (found, expected) in values(&stack).into_iter().zip(expected) {
            // Three roundings to f32.
            assert!((f64::from(found) / expected - 1.0).abs() < 4e-7, "{params}: {found} {expected}");
        }
        assert!(stack.attributes["model"] == "none" && !stack.attributes.contains_key("g"), "{params}");
    }
    let lacks = trial(json!({"table": "p.csv"}))
        .file("reference.table", &b"wavelength_nm,reflectance@0\n600,0.9\n900,0.8\n"[..]);
    lacks.refuses("in.sample", "R_d of the reference is given at f_x = 0 mm^-1, the sample has 0.1");
    for (convention, words) in
        [("hemispherical_entered", "what of it enters the sample is not known"), ("relative", "knows no R_d")]
    {
        let params = json!({"reference": {"reflectance": 0.99}, "convention": convention});
        trial(json!({})).with(params).refuses("convention", words);
    }
}

/// One way to say it, and one only.
#[test]
fn what_is_said_twice_or_not_at_all_is_refused() {
    let medium = |more: Value| {
        let mut all = json!({"mu_a": 0.01, "mu_s_prime": 1, "g": 0.8, "n": 1.4});
        all.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        all
    };
    for (params, at, words) in [
        (json!({}), "reference", "is not said"),
        (json!({"mu_a": 0.01, "mu_s_prime": 1, "g": 0.8}), "reference.n", "`n` of the reference is missing"),
        (medium(json!({"reflectance": 0.9})), "reference.reflectance", "said by `mu_a` and by `reflectance`"),
        (medium(json!({"table": "t.csv"})), "reference.table", "said by `mu_a` and by `table`"),
        (medium(json!({"unit": "per_cm"})), "reference.unit", "only the columns of a `table`"),
        (json!({"reflectance": 0.9, "n": 1.4}), "reference.reflectance", "g and n say nothing beside"),
        (json!({"reflectance": 1.6}), "reference.reflectance", "(0, 1.5]"),
        (json!({"reflectance": [0.9, 0.9, 0.9]}), "reference.reflectance", "3 values for the sample's 2 wavelengths"),
        (json!({"object": "block"}), "reference.object", "does not say what it shows"),
    ] {
        trial(params).refuses(at, words);
    }
}

/// An object of the scene is the phantom that the arm says it shows.
#[test]
fn an_object_is_what_the_arm_says_of_it() {
    let [a, b] = BY_HAND;
    let seen = Seen {
        object: "block".to_owned(),
        mu_a: vec![a.mu_a, b.mu_a],
        mu_s_prime: vec![a.mu_s_prime, b.mu_s_prime],
        phase: Some(turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.7)),
        n: Some(1.4),
        ..Seen::default()
    };
    let with = |reference: Value| {
        let mut reference_arm = arm(&[(660.0, REFERENCE), (850.0, REFERENCE)]);
        Conditions { said_by: SaidBy::Scene, seen: vec![seen.clone()] }
            .insert_into(&mut reference_arm.0.attributes, CONDITIONS);
        let params = json!({"reference": reference, "model": "diffusion"});
        let sample = arm(&[(660.0, SAMPLE), (850.0, SAMPLE)]);
        Trial::of::<Calibrate>(params).input("sample", sample).input("reference", reference_arm)
    };
    let by_hand = with(json!({
        "mu_a": BY_HAND.map(|m| m.mu_a), "mu_s_prime": BY_HAND.map(|m| m.mu_s_prime), "g": 0.7, "n": 1.4
    }));
    let by_name = with(json!({"object": "block"}));
    by_name.passes();
    assert_eq!(values(&made(&by_name)), values(&made(&by_hand)));
    with(json!({"object": "blok"})).refuses("reference.object", "shows block, not `blok`");
}

/// M_DC of fringes is M_DC: either arm may lack the frame of even light, and then the mean of its fringes stands for it.
#[test]
fn the_mean_of_fringes_is_even_light_in_either_arm() {
    let phantom = json!({"mu_a": 0.02, "mu_s_prime": 1.5, "g": 0.8, "n": 1.4});
    let with_frame: &[OfLayer] = &[("m_dc", 0.0, 0.5), ("m_ac", 0.0, 0.5), ("m_dc", 0.1, 0.9), ("m_ac", 0.1, 0.4)];
    let fringes: &[OfLayer] = &[("m_dc", 0.1, 0.5), ("m_ac", 0.1, 0.4)];
    let two: &[OfLayer] = &[("m_dc", 0.2, 0.9), ("m_ac", 0.2, 0.3), ("m_dc", 0.1, 0.5), ("m_ac", 0.1, 0.4)];
    let of = |sample, reference| {
        let params = json!({"reference": phantom, "model": "diffusion"});
        let trial = Trial::of::<Calibrate>(params).input("sample", arm(&[(660.0, sample)]));
        let trial = trial.input("reference", arm(&[(660.0, reference)]));
        let (mistakes, warnings) = trial.check();
        assert!(mistakes.is_empty(), "{mistakes:?}");
        let told: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        let stack = made(&trial);
        let f_x: Vec<Option<f64>> =
            stack.layers.iter().filter(|l| l.info.name == "r_d").map(|l| l.info.f_x_per_mm).collect();
        assert_eq!(f_x, [Some(0.0), Some(0.1)]);
        // Even light that is not half of the full one would be a factor: that is told.
        let stands_in = told.len() == 1 && told[0].contains("the mean of fringes and even light are taken for one");
        assert!(stands_in || told.is_empty(), "{told:?}");
        (values(&stack), stands_in)
    };
    let (both, quiet) = of(with_frame, with_frame);
    assert!(!quiet);
    for [sample, reference] in [[with_frame, fringes], [with_frame, two]] {
        assert_eq!(of(sample, reference), (both.clone(), true));
    }
    // The sample lacks it: the mean of the same fringes of the reference comes first.
    let (own, told) = of(fringes, with_frame);
    assert!(!told && (own[0] / both[0] - 0.5 / 0.9).abs() < 1e-6 && own[1] == both[1], "{own:?} {both:?}");
    assert_eq!(of(fringes, &[("m_ac", 0.0, 0.5), ("m_dc", 0.0, 0.5), ("m_ac", 0.1, 0.4)]), (both, true));
    let none = Trial::of::<Calibrate>(json!({"reference": phantom})).input("sample", arm(&[(660.0, with_frame)]));
    none.input("reference", arm(&[(660.0, &[("m_ac", 0.1, 0.4)])]))
        .refuses("in.reference", "the sample has m_ac at f_x = 0 mm^-1");
}

#[test]
fn a_reference_darker_than_its_dark_is_refused() {
    let dark: &[OfLayer] = &[("m_ac", 0.0, -0.5), ("m_ac", 0.1, 0.4)];
    let phantom = json!({"reference": {"mu_a": 0.02, "mu_s_prime": 1.5, "g": 0.8, "n": 1.4}});
    let trial = Trial::of::<Calibrate>(phantom)
        .input("sample", arm(&[(660.0, SAMPLE)]))
        .input("reference", arm(&[(660.0, dark)]));
    let error = trial.run().map(|_| ()).unwrap_err().to_string();
    for words in ["darker than its dark", "-0.5 counts", "f_x = 0 mm^-1, 660 nm", "exposure"] {
        assert!(error.contains(words), "{words}: {error}");
    }
}
