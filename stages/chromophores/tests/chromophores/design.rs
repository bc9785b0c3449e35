//! Which wavelengths are best: against all choices tried one by one with textbook formulas.

use turbid_chromophores::{Chromophores, Wavelengths};
use turbid_contract::kit::Trial;
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Cells, Table};
use turbid_optics::chromophore::Chromophore;

use crate::maps;

fn trial(params: Value) -> Trial {
    let maps = maps(1, &[660.0, 730.0, 850.0, 940.0], &["mu_a"], &mut |_, _, _| (0.01, Some(1e-4)));
    Trial::of::<Chromophores>(params).input("maps", maps).wants("design")
}

fn design(params: Value) -> Table {
    trial(params).run().expect("it runs").get::<Wavelengths>("design").0
}

fn texts(table: &Table) -> Vec<String> {
    match &table.columns[0].cells {
        Cells::Text(texts) => texts.clone(),
        other => panic!("{other:?}"),
    }
}

/// Inverse by Gauss and Jordan.
fn inverse<const N: usize>(mut m: [[f64; N]; N]) -> [[f64; N]; N] {
    let mut out: [[f64; N]; N] = std::array::from_fn(|i| std::array::from_fn(|k| f64::from(u8::from(i == k))));
    for i in 0..N {
        let pivot = m[i][i];
        (0..N).for_each(|k| (m[i][k], out[i][k]) = (m[i][k] / pivot, out[i][k] / pivot));
        for r in (0..N).filter(|&r| r != i) {
            let by = m[r][i];
            (0..N).for_each(|k| (m[r][k], out[r][k]) = (m[r][k] - by * m[i][k], out[r][k] - by * out[i][k]));
        }
    }
    out
}

/// All 3 of 10 for three chromophores beside a fixed one: the order of the table and its errors are those of normal equations.
#[test]
fn the_best_wavelengths_are_the_best_of_all() {
    let candidates = [500.0, 530.0, 560.0, 600.0, 660.0, 700.0, 760.0, 800.0, 850.0, 940.0];
    let amounts = [40.0, 20.0, 0.7];
    let species = [Chromophore::HbO2, Chromophore::Hb, Chromophore::Water];
    let absorbed = |c: Chromophore, nm: f64| c.mu_a_per_mm(nm).expect("in the table");
    let mut all: Vec<(f64, f64, String)> = Vec::new();
    for (a, b, c) in (0..10).flat_map(|a| (a + 1..10).flat_map(move |b| (b + 1..10).map(move |c| (a, b, c)))) {
        let chosen = [a, b, c].map(|i: usize| candidates[i]);
        let mut normal = [[0.0; 3]; 3];
        for nm in chosen {
            let of_three = (0..3).map(|k| amounts[k] * absorbed(species[k], nm)).sum::<f64>();
            let mu_a = of_three + 0.02 * absorbed(Chromophore::Melanin, nm);
            for (i, row) in normal.iter_mut().enumerate() {
                for (k, sum) in row.iter_mut().enumerate() {
                    *sum += absorbed(species[i], nm) * absorbed(species[k], nm) / (0.03_f64 * mu_a).powi(2);
                }
            }
        }
        let c = inverse(normal);
        let (x, y) = (20.0 / 3600.0, -40.0 / 3600.0);
        let of_st_o2 = f64::sqrt(x * x * c[0][0] + y * y * c[1][1] + 2.0 * x * y * c[0][1]);
        let of_thb = f64::sqrt(c[0][0] + c[1][1] + 2.0 * c[0][1]);
        all.push((of_st_o2, of_thb, chosen.map(|nm| nm.to_string()).join(", ")));
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let params = |list: u32| {
        json!({
            "chromophores": ["HbO2", "Hb", "water"], "fixed": {"melanin": "2 %"}, "largest_condition": 1e9,
            "design": {
                "candidates": candidates, "choose": 3, "typical": {"HbO2": "40 uM", "Hb": 20, "water": 0.7},
                "relative_error": "3 %", "list": list,
            },
        })
    };
    let table = design(params(200));
    assert_eq!((table.rows(), all.len()), (120, 120));
    for (k, (of_st_o2, of_thb, at)) in all.iter().enumerate() {
        let is = ["StO2_se", "THb_se"].map(|name| table.f64s(name).expect("a column")[k]);
        // The normal equations lose twice the digits of the condition number.
        assert!((is[0] / of_st_o2 - 1.0).abs() < 1e-6, "{k}: {is:?}, {of_st_o2} at {at}");
        // Where two choices are equal to rounding, either may be first.
        let differs = |other: Option<&(f64, f64, String)>| other.is_none_or(|o| (o.0 / of_st_o2 - 1.0).abs() > 1e-6);
        if differs(k.checked_sub(1).and_then(|k| all.get(k))) && differs(all.get(k + 1)) {
            assert_eq!(&texts(&table)[k], at);
            assert!((is[1] / of_thb - 1.0).abs() < 1e-6, "{k}");
        }
    }
    let short = design(params(5));
    assert_eq!(texts(&short), texts(&table)[..5]);
    assert_eq!(short.attributes["choices"], json!(120));
}

/// Two of four candidates: red with infrared, as in pulse oximetry.
#[test]
fn red_and_infrared_tell_saturation() {
    let candidates = [660, 790, 800, 940];
    let table = design(json!({"design": {"choose": 2, "typical": {"HbO2": 40, "Hb": 20}, "candidates": candidates}}));
    println!("{:?} {:?}", texts(&table), table.f64s("StO2_se"));
    assert_eq!(texts(&table)[0], "660, 940");
}

/// Without candidates the maps' wavelengths are those to choose from; the table does not depend on threads.
#[test]
fn maps_name_the_candidates() {
    let params = json!({"design": {"choose": 2, "typical": {"HbO2": 40, "Hb": 20}}});
    assert_eq!(design(params.clone()).attributes["candidates_nm"], json!([660.0, 730.0, 850.0, 940.0]));
    trial(params).keeps_the_rules();
}

#[test]
fn mistakes_of_designs_are_named() {
    let of = |design: Value| json!({"design": design});
    let typical = json!({"HbO2": 40, "Hb": 20});
    trial(json!({})).refuses("design", "not said what for");
    let many: Vec<u32> = (500..540).collect();
    let without = json!({"chromophores": ["Hb", "water"], "design": {"choose": 2, "typical": {"Hb": 1, "water": 1}}});
    for (params, at, text) in [
        (of(json!({"choose": 1, "typical": typical})), "design.choose", "[2, 4]"),
        (of(json!({"choose": 5, "typical": typical})), "design.choose", "[2, 4]"),
        (of(json!({"choose": 2, "typical": {"HbO2": 40}})), "design.typical", "says nothing of Hb"),
        (of(json!({"choose": 2, "typical": {"HbO2": 0, "Hb": 0}})), "design.typical", "without haemoglobin"),
        (
            of(json!({"choose": 2, "typical": {"HbO2": 40, "Hb": 20, "watr": 1}})),
            "design.typical.watr",
            "mean `water`?",
        ),
        (of(json!({"choose": 2, "typical": {"HbO2": "40 %", "Hb": 20}})), "design.typical.HbO2", "uM is wanted"),
        (of(json!({"choose": 2, "typical": typical, "relative_error": 0})), "design.relative_error", "(0, 1)"),
        (of(json!({"choose": 2, "typical": typical, "list": 0})), "design.list", ">= 1"),
        (of(json!({"choose": 2, "typical": typical, "candidates": [660, 660, 700]})), "design.candidates", "twice"),
        (
            of(json!({"choose": 2, "typical": typical, "candidates": [660, 1064]})),
            "design.candidates",
            "not to 1064 nm",
        ),
        (of(json!({"choose": 12, "typical": typical, "candidates": many})), "design.candidates", "5586853480 ways"),
        (without, "design", "not both"),
    ] {
        let (mistakes, _) = trial(params.clone()).check();
        let told = mistakes.iter().map(ToString::to_string).find(|told| told.starts_with(&format!("{at}: ")));
        assert!(told.as_ref().is_some_and(|told| told.contains(text)), "{at}, {text}: {mistakes:#?}");
    }
}
