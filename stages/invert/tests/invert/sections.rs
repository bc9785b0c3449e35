//! Tables of sections, and the way in lanes of tables without.

use super::*;

/// Sections of the camera's pixels, as (own, other, share of the own); `None` is masked.
fn sections(pixels: &[Option<(usize, usize, f32)>], count: usize) -> Sections {
    let mut stack = ImageStack::new(1, pixels.len());
    let plane = |f: &dyn Fn(Option<(usize, usize, f32)>) -> f32| {
        Array2::from_shape_fn((1, pixels.len()), |(_, c)| f(pixels[c]))
    };
    stack.push(LayerInfo::value("section", "1"), plane(&|p| p.map_or(0.0, |p| p.0 as f32)));
    stack.push(LayerInfo::value("neighbour", "1"), plane(&|p| p.map_or(0.0, |p| p.1 as f32)));
    stack.push(LayerInfo::value("weight", "1"), plane(&|p| p.map_or(1.0, |p| p.2)));
    let masked = MaskReason::Background.code();
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), plane(&|p| if p.is_some() { 0.0 } else { masked }));
    let list: Vec<Section> =
        (0..count).map(|k| Section { from_mm: k as f64, to_mm: k as f64 + 1.0, pixels: 1, m_dc: 1.0 }).collect();
    stack.attributes.insert("sections".into(), serde_json::json!(list));
    Sections(stack)
}

/// A table whose sections reflect by these factors.
fn sectioned_lut(factors: &[f64]) -> Lut {
    let parts: Vec<Lut> = factors.iter().map(|&k| lut(&F_X, move |a, s, f| k * r_d(a, s, f))).collect();
    let all = parts.iter().flat_map(|part| part.0.f64s("r_d").unwrap().to_vec()).collect();
    let mut table = Table { columns: Vec::new(), attributes: parts[0].0.attributes.clone() };
    table.push("r_d", "1", Cells::F64(all));
    let list: Vec<serde_json::Value> = factors.iter().map(|_| serde_json::json!({})).collect();
    table.attributes.insert("sections".into(), list.into());
    table.into()
}

/// Each pixel is read in the table of its section; between two it is their blend in ln mu, and without one it is masked.
#[test]
fn sections_have_tables_of_their_own() {
    let medium = F_X.map(|f| r_d(0.05, 1.2, f));
    let dim = medium.map(|r| 0.7 * r);
    let run = |r: [f64; 2], pixel, method| {
        let flat = inputs(reflectance(&[r], Some(([0.01, 0.01], 0.2))), sectioned_lut(&[1.0, 0.7]));
        let inputs = In { sections: Some(sections(&[pixel], 2)), ..flat };
        let params = Params { method, noise_bias: NoiseBias::Keep, ..Params::default() };
        let out = Invert::run(&params, inputs, Ctx::new(&MemoryHost::default())).unwrap().maps.0;
        ["mu_a", "mu_s_prime", "mu_a_se", "mask"].map(|name| layer(&out, name)[0])
    };
    for method in [Method::Table, Method::Bicubic, Method::LeastSquares] {
        for (r, section) in [(medium, 0), (dim, 1)] {
            let [mu_a, mu_s_prime, _, mask] = run(r, Some((section, section, 1.0)), method);
            assert!((mu_a / 0.05 - 1.0).abs() < 1e-3 && (mu_s_prime / 1.2 - 1.0).abs() < 1e-3 && mask == 0.0);
        }
        let [own, other] = [0, 1].map(|k| run(medium, Some((k, k, 1.0)), method));
        let blended = run(medium, Some((0, 1, 0.75)), method);
        for k in 0..2 {
            let want = libm::exp(0.75 * libm::log(own[k]) + 0.25 * libm::log(other[k]));
            assert!((blended[k] / want - 1.0).abs() < 1e-6, "{method:?}: {} {want}", blended[k]);
        }
        assert!(blended[2] > 0.0);
        assert_eq!(run(medium, None, method), [0.0, 0.0, 0.0, f64::from(MaskReason::Background.code())]);
    }
    let fails = |lut: Lut, sections: Option<Sections>| {
        let inputs = In { sections, ..inputs(reflectance(&[medium], None), lut) };
        Invert::run(&Params::default(), inputs, Ctx::new(&MemoryHost::default())).map(|_| ()).unwrap_err().to_string()
    };
    assert!(fails(sectioned_lut(&[1.0, 0.7]), None).contains("the table has 2 sections, and which pixel"));
    let one = [Some((0, 0, 1.0))];
    assert!(
        fails(lut(&F_X, r_d), Some(sections(&one, 2))).contains("there are 2 sections, and the table has no sections")
    );
    assert!(fails(sectioned_lut(&[1.0, 0.7]), Some(sections(&one, 3))).contains("there are 3 sections"));
    assert!(fails(sectioned_lut(&[1.0, 0.7]), Some(sections(&[one[0]; 4], 2))).contains("another size"));
}

/// Tables without sections are read in lanes, those with sections pixel by pixel: bit for bit the same, with or without noise, errors of the table and
/// values outside, by whatever vector instructions.
#[test]
fn lanes_say_what_pixels_say() {
    // 300 pixels are chunks of lanes and a rest; some are masked, some lie outside, some are no numbers at all.
    let mut r: Vec<[f64; 2]> = scattered(300).map(|m| F_X.map(|f| r_d(m[0], m[1], f))).collect();
    (r[7], r[70], r[71], r[130]) = ([0.999, 0.5], [1e-5, 1e-6], [f64::NAN, 0.1], [0.3, 0.31]);
    let own = vec![Some((0, 0, 1.0)); r.len()];
    for noise in [None, Some(([0.02, 0.03], 0.5))] {
        for table_se in [0.0, 0.01] {
            for outside in [Outside::Mask, Outside::Nearest] {
                let run = |simd: &str, sectioned: bool| {
                    let mut input = reflectance(&r, noise);
                    let mut mask = Array2::zeros((1, r.len()));
                    mask[(0, 9)] = MaskReason::LowSignal.code();
                    input.0.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
                    let mut lut = if sectioned { sectioned_lut(&[1.0]) } else { lut(&F_X, r_d) };
                    let se = lut.0.f64s("r_d").unwrap().iter().map(|r| table_se * r).collect();
                    lut.0.to_mut().push("r_d_se", "1", Cells::F64(se));
                    let inputs = In { sections: sectioned.then(|| sections(&own, 1)), ..inputs(input, lut) };
                    let host = MemoryHost { simd: simd.to_owned(), ..MemoryHost::new(0, &["covariance"], 1) };
                    let params = Params { outside, ..Params::default() };
                    let out = Invert::run(&params, inputs, Ctx::new(&host)).unwrap();
                    let stacks = [Some(out.maps.0), out.covariance.map(|c| c.0)];
                    let layers = stacks.into_iter().flatten().flat_map(|stack| stack.layers);
                    layers.map(|l| (l.info, l.data.mapv(f32::to_bits))).collect::<Vec<_>>()
                };
                let alone = run("baseline", true);
                for simd in ["baseline", "v3", "v4"] {
                    assert_eq!(run(simd, false), alone, "{simd}, noise {noise:?}, table {table_se}, {outside:?}");
                }
            }
        }
    }
}
