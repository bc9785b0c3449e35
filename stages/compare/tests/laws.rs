//! The stage as the engine calls it: regions, masks, figures, refusals.

use std::collections::BTreeMap;

use turbid_compare::{Compare, Disk, In, Out, Params, Region};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Estimate, Expected, Maps, MaskReason, Truth};
use turbid_contract::{
    Cells, Ctx, Error, ImageStack, Known, LayerInfo, LayerKind, Length, MemoryHost, Problems, Stage, Table,
    serde_json::json,
};

const SIDE: usize = 40;

/// A disk of 10 mm (object 1) in a field of 20 x 20 mm; the top row is background.
fn truth() -> Truth {
    let mut stack = ImageStack::new(SIDE, SIDE);
    let inside = |r: usize, c: usize| (r as f64 - 19.5).hypot(c as f64 - 19.5) < 10.0;
    let plane = |f: &dyn Fn(usize, usize) -> f32| Array2::from_shape_fn((SIDE, SIDE), |(r, c)| f(r, c));
    stack.push(LayerInfo::value("mu_a", "mm^-1"), plane(&|r, c| if inside(r, c) { 0.12 } else { 0.06 }));
    stack.push(LayerInfo::value("mu_s_prime", "mm^-1"), plane(&|_, _| 0.8));
    stack.push(LayerInfo::value("object", "1"), plane(&|r, c| f32::from(u8::from(inside(r, c)))));
    let mask = plane(&|r, _| if r == 0 { MaskReason::Background.code() } else { 0.0 });
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    stack.attributes.insert("objects".into(), json!(["tissue", "polyp", "hidden"]));
    stack.attributes.insert("field".into(), json!([20.0, 20.0]));
    Truth(stack)
}

/// The truth times a factor, with standard errors of 1 % and one masked pixel in the middle.
fn estimate(factor: f32, sharing: f64) -> Maps {
    let Truth(truth) = truth();
    let mut stack = ImageStack::new(SIDE, SIDE);
    let mut mask = Array2::zeros((SIDE, SIDE));
    mask[(20, 20)] = MaskReason::LowSignal.code();
    for name in ["mu_a", "mu_s_prime"] {
        let mut data = &truth.find(name, None).unwrap().data * factor;
        data[(20, 20)] = 0.0;
        let se = &data * 0.01;
        let mut info = LayerInfo::value(name, "mm^-1");
        let variances: f64 = se.iter().map(|&s| f64::from(s).powi(2)).sum();
        info.mean_se = Some((variances * sharing).sqrt() / (SIDE * SIDE - 1) as f64);
        stack.push(info.clone(), data);
        stack.push(info.standard_error(), se);
    }
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    Maps(stack)
}

fn compare(estimate: Maps, truth: Truth, params: &Params) -> Result<(Out, MemoryHost), Error> {
    let host = MemoryHost { wanted: vec!["errors".into()], ..MemoryHost::default() };
    let (estimate, truth) = (Estimate::Maps(estimate), Some(Expected::Truth(truth)));
    let out = Compare::run(params, In { estimate, truth, source: std::marker::PhantomData }, Ctx::new(&host))?;
    Ok((out, host))
}

fn texts<'a>(table: &'a Table, name: &str) -> &'a [String] {
    match &table.columns.iter().find(|c| c.name == name).unwrap().cells {
        Cells::Text(v) => v,
        other => panic!("{name}: {other:?}"),
    }
}

fn cell(table: &Table, region: &str, quantity: &str, column: &str) -> f64 {
    let (regions, quantities) = (texts(table, "region"), texts(table, "quantity"));
    let row = (0..table.rows()).find(|&i| regions[i] == region && quantities[i] == quantity).unwrap();
    match &table.columns.iter().find(|c| c.name == column).unwrap().cells {
        Cells::MaybeF64(v) => v[row].unwrap_or_else(|| panic!("{region}, {quantity}: {column} is not known")),
        Cells::I64(v) => v[row] as f64,
        other => panic!("{column}: {other:?}"),
    }
}

/// A map that is 5 % too high is 5 % too high everywhere: bias = RMSE = 5 %; hidden objects have no row.
#[test]
fn a_constant_factor_is_its_own_bias() {
    let (out, host) = compare(estimate(1.05, 1.0), truth(), &Params::default()).unwrap();
    let table = &out.metrics.0;
    let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    let want = [
        "region",
        "quantity",
        "n",
        "mean",
        "mean_se",
        "truth",
        "bias_percent",
        "rmse_percent",
        "masked_percent",
        "bias",
        "rmse",
        "p95",
        "possible_shift_percent",
        "possible_shift",
        "n_unknown",
        "n_left_out",
        "unit",
    ];
    assert_eq!(names, want);
    assert_eq!(texts(table, "region"), ["all", "all", "tissue", "tissue", "polyp", "polyp"]);
    for region in ["all", "tissue", "polyp"] {
        for quantity in ["mu_a", "mu_s_prime"] {
            // Five roundings to f32.
            assert!((cell(table, region, quantity, "bias_percent") - 5.0).abs() < 1e-4);
            assert!((cell(table, region, quantity, "rmse_percent") - 5.0).abs() < 1e-4);
        }
    }
    let n = cell(table, "polyp", "mu_a", "n");
    assert_eq!(cell(table, "all", "mu_a", "n"), (SIDE * (SIDE - 1) - 1) as f64, "background and masked pixels are out");
    assert!((cell(table, "polyp", "mu_a", "masked_percent") - 100.0 / (n + 1.0)).abs() < 1e-9);
    assert!((cell(table, "polyp", "mu_a", "mean_se") / (0.01 * 0.126 / n.sqrt()) - 1.0).abs() < 1e-5);
    assert!((host.measures.lock().unwrap()["error: worst bias"] - 5.0).abs() < 1e-4);
}

/// What pixels share (a smoothed reference) does not average out in a region either.
#[test]
fn shared_noise_stays_in_the_mean() {
    let se = |sharing| {
        let (out, _) = compare(estimate(1.0, sharing), truth(), &Params::default()).unwrap();
        cell(&out.metrics.0, "tissue", "mu_a", "mean_se")
    };
    assert!((se(9.0) / se(1.0) - 3.0).abs() < 1e-6);
}

/// A region that is masked altogether says nothing: a warning names it and the worst bias is that of the others; none is told where nothing is known.
#[test]
fn masked_regions_have_no_bias() {
    let masked = |outside: bool| {
        let mut maps = estimate(1.05, 1.0);
        let polyp = truth().0.find("object", None).unwrap().data.mapv(|object| object == 1.0 || outside);
        let mask = maps.0.layers.iter_mut().find(|l| l.info.kind == LayerKind::Mask).unwrap();
        mask.data.zip_mut_with(&polyp, |m, &hidden| {
            if hidden {
                *m = MaskReason::LowSignal.code();
            }
        });
        compare(maps, truth(), &Params::default()).unwrap()
    };
    let (out, host) = masked(false);
    assert_eq!(cell(&out.metrics.0, "polyp", "mu_a", "n"), 0.0);
    let (table, row) = (&out.metrics.0, 4);
    assert_eq!((texts(table, "region")[row].as_str(), texts(table, "quantity")[row].as_str()), ("polyp", "mu_a"));
    for column in ["mean", "mean_se", "truth", "bias_percent", "rmse_percent", "bias", "rmse", "p95", "possible_shift"]
    {
        assert_eq!(table.maybe_f64s(column).unwrap()[row], None, "{column} of no pixel");
    }
    assert!((host.measures.lock().unwrap()["error: worst bias"] - 5.0).abs() < 1e-4);
    // Of mu_a and mu_s' of the polyp.
    const UNKNOWN: &str = "unknown: rows with every pixel masked";
    assert_eq!(host.measures.lock().unwrap()[UNKNOWN], 2.0);
    let warnings = host.warnings.lock().unwrap().clone();
    assert!(warnings.iter().any(|w| w.contains("`polyp`") && w.contains("mu_a")), "{warnings:?}");
    let (_, host) = masked(true);
    let measures = host.measures.lock().unwrap().clone();
    assert!(!measures.contains_key("error: worst bias") && measures[UNKNOWN] == 6.0, "{measures:?}");
    let (_, host) = compare(estimate(1.05, 1.0), truth(), &Params::default()).unwrap();
    assert!(!host.measures.lock().unwrap().contains_key(UNKNOWN), "everything is known");
}

/// Named regions alone; erosion takes away the rim, so many mm or so many px of it.
#[test]
fn regions_are_what_they_say() {
    let polyp = Region { object: Some("polyp".into()), ..Region::default() };
    let regions = BTreeMap::from([
        ("whole".to_owned(), polyp.clone()),
        ("core".to_owned(), Region { erode_mm: Some(Length(2.0)), ..polyp.clone() }),
        ("core_px".to_owned(), Region { erode_px: Some(4.0), ..polyp.clone() }),
        (
            "spot".to_owned(),
            Region {
                disk: Some(Disk { center: [Length(0.0), Length(0.0)], diameter: Length(4.0) }),
                ..Region::default()
            },
        ),
    ]);
    let (out, _) = compare(estimate(1.0, 1.0), truth(), &Params { regions, ..Params::default() }).unwrap();
    let n = |region| cell(&out.metrics.0, region, "mu_a", "n") + 1.0;
    let disk = |radius_px: f64| std::f64::consts::PI * radius_px * radius_px;
    // The centres of foreign pixels begin half a px beyond the edge. A digital disk of radius r px is off by some sqrt(r) px.
    for (region, want) in [("whole", disk(10.0)), ("core", disk(6.5)), ("core_px", disk(6.5)), ("spot", disk(4.0))] {
        assert!((n(region) / want - 1.0).abs() < 0.1, "{region}: {} px for {want}", n(region));
    }
    assert_eq!(n("core"), n("core_px"));
    assert_eq!(texts(&out.metrics.0, "region").len(), 8);
}

/// The picture port: estimate, truth, percent, and zeros where a mask is.
#[test]
fn errors_are_shown_in_percent() {
    let (out, _) = compare(estimate(1.05, 1.0), truth(), &Params::default()).unwrap();
    let errors = out.errors.unwrap().0;
    let at = |name: &str, r: usize, c: usize| errors.find(name, None).unwrap().data[(r, c)];
    assert_eq!((at("mu_a_truth", 5, 5), at("mask", 5, 5)), (0.06, 0.0));
    assert!((at("mu_a_error", 5, 5) - 5.0).abs() < 1e-4);
    assert_eq!((at("mu_a_error", 20, 20), at("mask", 20, 20)), (0.0, MaskReason::LowSignal.code()));
    assert_eq!((at("mu_a_error", 0, 3), at("mask", 0, 3)), (0.0, MaskReason::Background.code()));
}

/// Where some truth is 0 there is no percentage, and a picture of 0 % would say that the pixel is right: the error is in the quantity's unit.
#[test]
fn errors_from_a_truth_of_0_are_in_their_unit() {
    let mut clear = truth();
    clear.0.layers[0].data[(5, 5)] = 0.0;
    let (out, _) = compare(estimate(1.05, 1.0), clear, &Params::default()).unwrap();
    let errors = out.errors.unwrap().0;
    let of = |name: &str| errors.find(name, None).unwrap();
    assert_eq!((of("mu_a_error").info.unit.as_str(), of("mu_s_prime_error").info.unit.as_str()), ("mm^-1", "%"));
    // 1.05 x 0.06 where there is nothing, 0.05 x 0.06 beside it, in f32.
    let at = |r: usize, c: usize| f64::from(of("mu_a_error").data[(r, c)]);
    assert!((at(5, 5) - 0.063).abs() < 1e-8 && (at(5, 6) - 0.003).abs() < 1e-8, "{} {}", at(5, 5), at(5, 6));
    assert_eq!(at(20, 20), 0.0, "masked");
}

/// Where the estimate is but the end of a table, and how large pixels are, goes with the picture.
#[test]
fn errors_say_what_the_maps_say() {
    let (mut maps, mut truth) = (estimate(1.05, 1.0), truth());
    let outside = Array2::from_shape_fn((SIDE, SIDE), |(r, _)| if r < 5 { MaskReason::AboveTable.code() } else { 0.0 });
    maps.0.push(LayerInfo::value("outside", "1"), outside.clone());
    truth.0.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 0.5]));
    let (out, _) = compare(maps, truth, &Params::default()).unwrap();
    let errors = out.errors.unwrap().0;
    assert_eq!(errors.find("outside", None).unwrap().data, outside);
    assert_eq!(errors.pixel_pitch_mm(), Some([0.5, 0.5]));
}

/// A medium without absorption has no relative error: its pixels are left out, with a word.
#[test]
fn nothing_is_relative_to_zero() {
    let mut dark = truth();
    dark.0.layers[0].data.mapv_inplace(|v| if v > 0.1 { 0.0 } else { v });
    let (out, host) = compare(estimate(1.0, 1.0), dark, &Params::default()).unwrap();
    assert!(cell(&out.metrics.0, "all", "mu_a", "bias_percent").abs() < 1e-4);
    assert_eq!(texts(&out.metrics.0, "region"), ["all", "all", "tissue", "tissue", "polyp"]);
    assert!(host.warnings.lock().unwrap().iter().any(|w| w.contains("region `polyp`") && w.contains("without mu_a")));
    let numbers = out.metrics.0.columns.iter().filter_map(|c| match &c.cells {
        Cells::MaybeF64(v) => Some(v),
        _ => None,
    });
    assert!(numbers.flatten().flatten().all(|v| v.is_finite()));
}

/// What does not fit is named, with the field path where there is one.
#[test]
fn mistakes_are_named() {
    let message = |e, t, region: Option<Region>| {
        let regions = region.map(|r| ("r".to_owned(), r)).into_iter().collect();
        compare(e, t, &Params { regions, ..Params::default() }).map(|_| ()).unwrap_err().to_string()
    };
    let one = || estimate(1.0, 1.0);
    assert!(message(Maps(ImageStack::new(1, 1)), truth(), None).contains("1 x 1 pixels, the truth 40 x 40"));
    assert!(message(Maps(ImageStack::new(SIDE, SIDE)), truth(), None).contains("share no quantity"));
    let unknown = Region { object: Some("polip".into()), ..Region::default() };
    let text = message(one(), truth(), Some(unknown));
    assert!(text.starts_with("regions.r.object") && text.contains("tissue, polyp, hidden"), "{text}");
    let hidden = Region { object: Some("hidden".into()), ..Region::default() };
    assert!(message(one(), truth(), Some(hidden)).contains("holds no pixel"));
    let mut fieldless = truth();
    fieldless.0.attributes.remove("field");
    let eroded = Region { erode_mm: Some(Length(1.0)), ..Region::default() };
    assert!(message(one(), fieldless, Some(eroded)).contains("how many mm"));

    let mut problems = Problems::default();
    let wrong = Region {
        erode_mm: Some(Length(-1.0)),
        erode_px: Some(f64::INFINITY),
        disk: Some(Disk { center: [Length(0.0); 2], diameter: Length(0.0) }),
        ..Region::default()
    };
    let regions = BTreeMap::from([("a".to_owned(), Region::default()), ("b".to_owned(), wrong)]);
    let known = Known { connected: vec!["truth".to_owned()], ..Known::default() };
    Compare::check(&Params { regions, ..Params::default() }, &known, &mut problems);
    let paths: Vec<String> = problems.into_parts().0.into_iter().map(|p| p.path).collect();
    assert_eq!(
        paths,
        ["regions.a", "regions.b.erode_px", "regions.b.erode_mm", "regions.b.erode_px", "regions.b.disk.diameter"]
    );
}

/// A height is a position: off by 0.5 mm everywhere, it is so where the truth is 0 as well, and nothing is in percent.
#[test]
fn positions_are_scored_in_their_unit() {
    let image = |value: f32| Array2::from_shape_fn((SIDE, SIDE), |(r, _)| if r < 20 { value } else { 3.0 + value });
    let (mut shape, mut surface) = (ImageStack::new(SIDE, SIDE), ImageStack::new(SIDE, SIDE));
    shape.push(LayerInfo::value("height", "mm"), image(0.5));
    surface.push(LayerInfo::value("height", "mm"), image(0.0));
    let (out, host) = compare(Maps(shape), Truth(surface), &Params::default()).unwrap();
    let table = &out.metrics.0;
    assert_eq!(texts(table, "unit"), ["mm"]);
    assert_eq!(table.columns.iter().find(|c| c.name == "bias").unwrap().unit, "mm");
    for (name, want) in [("bias", 0.5), ("rmse", 0.5), ("p95", 0.5), ("mean", 2.0)] {
        assert!((cell(table, "all", "height", name) - want).abs() < 1e-12, "{name}");
    }
    for percent in ["bias_percent", "rmse_percent"] {
        assert_eq!(table.maybe_f64s(percent).unwrap(), [None], "nothing of a position is in percent");
    }
    let measures = host.measures.lock().unwrap().clone();
    assert!(
        !measures.contains_key("error: worst bias"),
        "a bias of 0 % would say that the heights are right: {measures:?}"
    );
    assert!((measures["error: worst RMSE"] - 0.5).abs() < 1e-12 && (measures["worst_bias_mm"] - 0.5).abs() < 1e-12);
    let errors = out.errors.unwrap().0;
    let error = errors.find("height_error", None).unwrap();
    assert!(error.info.unit == "mm" && error.data.iter().all(|&e| e == 0.5));
    assert!(host.warnings.lock().unwrap().is_empty());
}

/// Pixels that are masked for what was measured there are counted, and what the mean may owe to their absence is told; those that geometry
/// leaves out select nothing. Flags of unknown errors are counted too.
#[test]
fn what_was_left_out_is_told() {
    let masked = |reason: MaskReason| {
        let mut maps = estimate(1.05, 1.0);
        let flags = truth().0.find("object", None).unwrap().data.clone();
        let mask = maps.0.layers.iter_mut().find(|l| l.info.kind == LayerKind::Mask).unwrap();
        (0..SIDE).for_each(|c| mask.data[(5, c)] = reason.code());
        let info = maps.0.layers[0].info.clone();
        maps.0.push(info.se_unknown(), flags);
        compare(maps, truth(), &Params::default()).unwrap()
    };
    let (out, host) = masked(MaskReason::BelowTable);
    let table = &out.metrics.0;
    assert_eq!(cell(table, "tissue", "mu_a", "n_left_out"), SIDE as f64, "the pixel in the middle is of the polyp");
    let n = cell(table, "tissue", "mu_s_prime", "n");
    // Every pixel is off by 5 % of 0.8, so nothing but the standard errors of 1 % scatters.
    let want = 0.01 * 1.05 * 100.0 * (SIDE as f64 / n).sqrt();
    let shift = cell(table, "tissue", "mu_s_prime", "possible_shift_percent");
    assert!((shift / want - 1.0).abs() < 1e-5, "{shift} for {want}");
    let warnings = host.warnings.lock().unwrap().join("\n");
    assert!(
        warnings.contains("`tissue`: 40 of ") && warnings.contains("the mean of mu_a may be off by up to"),
        "{warnings}"
    );
    assert_eq!(cell(table, "polyp", "mu_a", "n_unknown"), cell(table, "polyp", "mu_a", "n"));
    assert_eq!(cell(table, "tissue", "mu_a", "n_unknown"), 0.0);
    let row = 4;
    assert_eq!(table.maybe_f64s("mean_se").unwrap()[row], None, "no error of the polyp's mu_a is known");
    assert!(table.maybe_f64s("mean").unwrap()[row].is_some(), "the values stay in the mean");
    let (out, host) = masked(MaskReason::TooSteep);
    assert_eq!(cell(&out.metrics.0, "tissue", "mu_a", "n_left_out"), 0.0);
    assert_eq!(cell(&out.metrics.0, "tissue", "mu_a", "possible_shift"), 0.0);
    assert!(host.warnings.lock().unwrap().is_empty());
}
