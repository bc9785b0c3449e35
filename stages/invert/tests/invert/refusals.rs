//! Every reason to mask a pixel, and every refusal of an input.

use super::*;

/// Each side of the table has its name; reasons from before are carried; masked pixels hold 0.
#[test]
fn masked_pixels_hold_zero_and_the_reason() {
    use MaskReason::{AboveTable, BelowTable, Good, LowSignal, ModulationOutsideTable, NotFinite};
    let good = F_X.map(|f| r_d(0.05, 1.0, f));
    let r = [
        good,
        [1e-4, 5e-5],
        [0.99, 0.9],
        [good[0], 0.999 * good[0]],
        [good[0], good[0]],
        [f64::NAN, 0.1],
        [0.2, -0.1],
        good,
    ];
    let mut input = reflectance(&r, Some(([0.01, 0.01], 0.0)));
    let mut mask = Array2::zeros((1, r.len()));
    mask[(0, 7)] = LowSignal.code();
    input.0.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    let (out, _) = invert(input, lut(&F_X, r_d), &Params::default(), &[]).unwrap();
    let want = [
        Good,
        BelowTable,
        AboveTable,
        ModulationOutsideTable,
        ModulationOutsideTable,
        NotFinite,
        ModulationOutsideTable,
        LowSignal,
    ];
    assert_eq!(layer(&out.maps.0, "mask"), want.map(|m| f64::from(m.code())));
    for l in out.maps.0.layers.iter().filter(|l| l.info.kind != LayerKind::Mask) {
        assert!(l.data.iter().skip(1).all(|&v| v == 0.0), "{}", l.info.name);
        assert!(l.data[(0, 0)] > 0.0);
    }
}

/// Where reflectance rises and falls again with mu_s', two media share it: Ambiguous, on the folded part alone.
#[test]
fn a_folded_table_is_ambiguous_where_it_folds() {
    // In x = ln mu_s' / ln 5 from -1.4 to 1: R_1 / R_0 falls with x up to 0.5, then rises again.
    let folded = |a: f64, s: f64, f: f64| {
        let x = libm::log(s) / libm::log(5.0);
        0.5 * libm::pow(a / 0.5, -0.1) * if f == 0.0 { 0.5 } else { 0.1 + 0.05 * (x - 0.5) * (x - 0.5) }
    };
    let at = |s: f64| F_X.map(|f| folded(0.01, s, f));
    let (once, twice) = (at(0.15), at(4.0));
    let (out, _) = invert(reflectance(&[once, twice], None), lut(&F_X, folded), &Params::default(), &[]).unwrap();
    let want = [MaskReason::Good, MaskReason::Ambiguous].map(|m| f64::from(m.code()));
    assert_eq!(layer(&out.maps.0, "mask"), want);
    assert!((layer(&out.maps.0, "mu_s_prime")[0] / 0.15 - 1.0).abs() < 1e-3);
}

/// Only f_x that both sides have can be used, the lowest and highest of the reflectance unless others are named.
#[test]
fn f_x_can_be_chosen() {
    let three = [0.0, 0.1, 0.2];
    let mut input = reflectance(&[F_X.map(|f| r_d(0.05, 1.0, f))], None);
    let last = r_d(0.05, 1.0, 0.2);
    input.0.push(LayerInfo::value("r_d", "1").with_f_x(0.2), Array2::from_elem((1, 1), last as f32));
    for f_x in [None, Some([0.0, 0.1]), Some([0.1, 0.2])] {
        let params = Params { f_x: f_x.map(|f| f.map(PerLength).to_vec()), ..Params::default() };
        let (out, _) = invert(input.clone(), lut(&three, r_d), &params, &[]).unwrap();
        assert!((layer(&out.maps.0, "mu_a")[0] / 0.05 - 1.0).abs() < 1e-3, "{f_x:?}");
        assert_eq!(out.maps.0.attributes["f_x"], serde_json::json!(f_x.unwrap_or([0.0, 0.2])));
    }
}

/// Reflectance and tables that do not belong together are named.
#[test]
fn mismatches_are_named() {
    let good = || reflectance(&[F_X.map(|f| r_d(0.05, 1.0, f))], None);
    let message = |r, l, p: &Params| invert(r, l, p, &[]).map(|_| ()).unwrap_err().to_string();
    let params = Params::default();
    for (name, value) in [("convention", "hemispherical_entered".into()), ("g", 0.9.into()), ("n", 1.33.into())] {
        let mut table = lut(&F_X, r_d);
        table.0.to_mut().attributes.insert(name.into(), value);
        let text = message(good(), table, &params);
        assert!(text.contains(&format!("the reflectance has {name} = ")), "{text}");
        let mut table = lut(&F_X, r_d);
        table.0.to_mut().attributes.remove(name);
        assert!(message(good(), table, &params).contains(&format!("the table does not say its {name}")));
    }
    assert!(
        message(good(), lut(&[0.0, 0.2], r_d), &params)
            .contains("the table has f_x = 0, 0.2 mm^-1, the reflectance needs 0.1")
    );
    let other = Params { f_x: Some([0.0, 0.3].map(PerLength).to_vec()), ..Params::default() };
    assert!(message(good(), lut(&F_X, r_d), &other).contains("the reflectance has f_x = 0, 0.1, not 0.3 mm^-1"));
    let mut single = good();
    single.0.layers.truncate(1);
    assert!(message(single, lut(&F_X, r_d), &params).contains("two that differ are needed"));
    let mut twice = good();
    let extra = twice.0.layers[1].clone();
    twice.0.push(extra.info, extra.data);
    assert!(message(twice, lut(&F_X, r_d), &params).contains("2 orientations at f_x = 0.1"));
    let of_phantoms = |mu_a: f64| serde_json::json!({"mu_a": mu_a, "mu_s_prime": 1.0});
    let (mut relative, mut table) = (good(), lut(&F_X, r_d));
    relative.0.attributes.insert("reference".into(), of_phantoms(0.02));
    table.0.to_mut().attributes.insert("reference".into(), of_phantoms(0.03));
    assert!(
        message(relative, table, &params).contains("with mu_a = 0.02 mm^-1, the table's phantoms to one with 0.03")
    );
    let dark = lut(&F_X, |a, s, f| r_d(a, s, f) - 0.1);
    assert!(message(good(), dark, &params).contains("must be finite and > 0"));
    let mut short = lut(&F_X, r_d);
    short.0.to_mut().columns[0].cells = Cells::F64(vec![0.5; 7]);
    assert!(message(good(), short, &params).contains("7 rows for 2 f_x"));

    let mut problems = Problems::default();
    let wrong = Params { f_x: Some([-0.1, -0.2].map(PerLength).to_vec()), ..Params::default() };
    Invert::check(&wrong, &Known::default(), &mut problems);
    let paths: Vec<String> = problems.into_parts().0.into_iter().map(|p| p.path).collect();
    assert_eq!(paths, ["f_x.0", "f_x.1"]);
}
