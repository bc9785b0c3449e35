//! What noise of the reflectance and errors of the table do to maps, and what the maps say of it.

use super::*;

/// The mean over 40,000 noisy pixels is the truth up to 24 % of noise in mu_a, where left alone it is 1 to 3 % too high; the measure
/// says by how much. Tolerance: 4 standard errors of the mean, 1e-4 of the table, and a tenth of the second-order
/// term for the orders that are left out.
#[test]
fn noise_does_not_move_the_mean() {
    for medium in [[0.025, 0.85], [0.096, 0.74], [0.05, 0.6]] {
        for se in [[0.02, 0.03], [0.05, 0.07], [0.09, 0.12]] {
            let r = noisy(medium, se, 0.7, 40_000);
            let run = |noise_bias| {
                let params = Params { noise_bias, ..Params::default() };
                let (out, host) = invert(reflectance(&r, Some((se, 0.7))), lut(&F_X, r_d), &params, &[]).unwrap();
                let layers = [0, 1].map(|k| &out.maps.0.layers[k]);
                assert_eq!(layers[0].data.iter().filter(|&&v| v == 0.0).count(), 0, "no pixel is lost");
                let mean = |l: &Layer| l.data.iter().map(|&v| f64::from(v)).sum::<f64>() / 40_000.0;
                let bias = [0, 1].map(|k| mean(layers[k]) / medium[k] - 1.0);
                let mean_se = [0, 1].map(|k| layers[k].info.mean_se.unwrap() / medium[k]);
                (bias, mean_se, host.measures.lock().unwrap()["noise_bias_mu_a"] / 100.0)
            };
            let (kept, ..) = run(NoiseBias::Keep);
            let (bias, mean_se, measured) = run(NoiseBias::Correct);
            for k in 0..2 {
                let limit = 4.0 * mean_se[k] + 1e-4 + 0.1 * kept[k].abs();
                assert!(bias[k].abs() < limit, "{medium:?}, noise {se:?}: {bias:?}, kept {kept:?}");
            }
            assert!((kept[0] - measured).abs() < 4.0 * mean_se[0] + 1e-4 + 0.1 * kept[0], "{measured} for {kept:?}");
            assert!(se[0] < 0.09 || kept[0] > 0.01, "{medium:?}: there is something to correct, {kept:?}");
        }
    }
}

/// Standard errors and covariance against the spread of 20,000 noisy pixels (correlated noise of 0.3 %). A sampled
/// deviation is off by 0.5 %; curvature adds gain^2 x noise, below 1 %: limit 3 %.
#[test]
fn standard_errors_are_the_spread() {
    let (count, se, rho) = (20_000, [0.003, 0.003], 0.7);
    let r = noisy([0.058, 0.75], se, rho, count);
    let (out, _) =
        invert(reflectance(&r, Some((se, rho))), lut(&F_X, r_d), &Params::default(), &["covariance"]).unwrap();
    let maps = &out.maps.0;
    let planes = ["mu_a", "mu_s_prime"].map(|name| layer(maps, name));
    let mean = |v: &[f64]| v.iter().sum::<f64>() / count as f64;
    let moment = |i: usize, j: usize| {
        let (a, b) = (mean(&planes[i]), mean(&planes[j]));
        planes[i].iter().zip(&planes[j]).map(|(x, y)| (x - a) * (y - b)).sum::<f64>() / count as f64
    };
    for (k, name) in ["mu_a_se", "mu_s_prime_se"].iter().enumerate() {
        let stated = mean(&layer(maps, name).iter().map(|s| s * s).collect::<Vec<_>>());
        assert!((moment(k, k) / stated - 1.0).abs() < 0.06, "{name}: {} for {stated}", moment(k, k));
        let mean_se = maps.layers[k].info.mean_se.unwrap();
        assert!((mean_se / (stated / count as f64).sqrt() - 1.0).abs() < 1e-6);
    }
    let covariance = &out.covariance.unwrap().0;
    let cross = covariance.layers.iter().find(|l| l.info.pair == Some([0, 1])).unwrap();
    let stated = mean(&cross.data.iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
    // A sampled covariance is off by s_a s_s / sqrt n for a weak correlation; 5 sigma.
    let limit = 5.0 * (moment(0, 0) * moment(1, 1) / count as f64).sqrt();
    assert!((moment(0, 1) - stated).abs() < limit, "{} for {stated} +- {limit}", moment(0, 1));
}

/// Reflectance at any f_x, with independent relative noise `se`.
fn reflectance_at(f_x: &[f64], r: &[Vec<f64>], se: f64) -> Reflectance {
    let mut stack = ImageStack::new(1, r.len());
    stack.attributes = reflectance(&[[0.5, 0.4]], None).0.attributes;
    for (k, f) in f_x.iter().enumerate() {
        let info = LayerInfo::value("r_d", "1").with_f_x(*f);
        let plane = |scale: f64| Array2::from_shape_fn((1, r.len()), |(_, c)| (scale * r[c][k]) as f32);
        stack.push(info.clone(), plane(1.0));
        stack.push(info.standard_error(), plane(se));
    }
    Reflectance(stack)
}

/// Least squares over five f_x: the spread of 4000 noisy pixels is what the standard errors say (a sampled deviation is off by
/// 1.1 %, curvature adds gain x noise = 1 %: limit 5 %), the mean is the truth (4 standard errors), and two f_x know less.
#[test]
fn least_squares_uses_all_frequencies() {
    let (f_x, medium, se, count) = ([0.0, 0.05, 0.1, 0.15, 0.2], [0.058, 0.75], 0.004, 4000);
    let mut state = 9_u64;
    let mut normal = || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    };
    let truth = f_x.map(|f| r_d(medium[0], medium[1], f));
    let r: Vec<Vec<f64>> = (0..count).map(|_| truth.iter().map(|t| t * (1.0 + se * normal())).collect()).collect();
    let run = |f_x_used: Option<Vec<PerLength>>| {
        let params = Params { method: Method::LeastSquares, f_x: f_x_used, ..Params::default() };
        let (out, _) = invert(reflectance_at(&f_x, &r, se), lut(&f_x, r_d), &params, &[]).unwrap();
        let maps = out.maps.0;
        ["mu_a", "mu_s_prime"].map(|name| {
            let (values, se) = (layer(&maps, name), layer(&maps, &format!("{name}_se")));
            let n = count as f64;
            let mean = values.iter().sum::<f64>() / n;
            let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
            (mean, sd, (se.iter().map(|s| s * s).sum::<f64>() / n).sqrt())
        })
    };
    let (all, two) = (run(None), run(Some(vec![PerLength(0.0), PerLength(0.1)])));
    for k in 0..2 {
        let (mean, sd, stated) = all[k];
        assert!((sd / stated - 1.0).abs() < 0.05, "{k}: {sd} for {stated}");
        assert!((mean - medium[k]).abs() < 4.0 * stated / (count as f64).sqrt() + 2e-4 * medium[k], "{k}: {mean}");
        assert!(stated < 0.95 * two[k].2, "{k}: {stated} against {} with two f_x", two[k].2);
    }
}

/// A table that is off at random by its stated errors moves the maps by theirs: z over 120 tables (rms known to 4.6 % for each quantity); a
/// mean over pixels of one medium is no better known than one of them.
#[test]
fn errors_of_the_table_are_in_the_maps() {
    let media = [[0.01, 0.8], [0.05, 1.2]];
    let (mut squares, mut n) = ([0.0; 2], 0.0);
    let mut random = 1_u64;
    let mut normal = move || {
        let mut unit = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| unit()).sum::<f64>() - 6.0
    };
    for k in 0..120 {
        // The inverse table takes a while to make: ten times is enough to see that its errors are the same.
        let method = if k < 10 { Method::Table } else { Method::LeastSquares };
        let medium = media[k % 2];
        let off = [normal(), normal()].map(|z| libm::exp(0.01 * z));
        let mut table = lut(&F_X, |a, s, f| r_d(a, s, f) * off[usize::from(f > 0.0)]);
        let se = table.0.f64s("r_d").unwrap().iter().map(|r| 0.01 * r).collect();
        table.0.to_mut().push("r_d_se", "1", Cells::F64(se));
        let r = [F_X.map(|f| r_d(medium[0], medium[1], f)); 4];
        let params = Params { method, ..Params::default() };
        let (out, _) = invert(reflectance(&r, Some(([1e-5, 1e-5], 0.0))), table, &params, &[]).unwrap();
        for (q, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
            let found = out.maps.0.find(name, None).unwrap();
            let se = layer(&out.maps.0, &format!("{name}_se"))[0];
            let z = libm::log(f64::from(found.data[(0, 0)]) / medium[q]) / (se / medium[q]);
            squares[q] += z * z;
            assert!((found.info.mean_se.unwrap() / se - 1.0).abs() < 1e-3);
        }
        n += 1.0;
    }
    for square in squares {
        let rms = f64::sqrt(square / n);
        // 4 standard errors of an rms over 120; mu_a is off by up to 10 %, where ln bends by a tenth of that.
        assert!((rms - 1.0).abs() < 4.0 / (2.0 * n).sqrt(), "rms z {rms}");
    }
}

/// The interval of one standard error holds the truth in 68.27 %, that of two in 95.45 % of 40,000 pixels. Tolerance: 4 standard errors of such a
/// share, and the square of the noise of mu, by which a bent p(R) bends the shares.
#[test]
fn intervals_cover_the_truth() {
    let count = 40_000;
    for medium in [[0.025, 0.85], [0.096, 0.74], [0.05, 3.0]] {
        for (se, rho) in [([0.002, 0.003], 0.7), ([0.01, 0.014], 0.7), ([0.01, 0.01], 0.0)] {
            let r = noisy(medium, se, rho, count);
            for method in [Method::Table, Method::Bicubic] {
                let params = Params { method, ..Params::default() };
                let (out, _) = invert(reflectance(&r, Some((se, rho))), lut(&F_X, r_d), &params, &[]).unwrap();
                for (k, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
                    let (mu, mu_se) = (layer(&out.maps.0, name), layer(&out.maps.0, &format!("{name}_se")));
                    let off: Vec<f64> = mu.iter().zip(&mu_se).map(|(mu, se)| (mu - medium[k]).abs() / se).collect();
                    let noise = mu_se.iter().sum::<f64>() / count as f64 / medium[k];
                    for (width, expected) in [(1.0, 0.6827), (2.0, 0.9545)] {
                        let share = off.iter().filter(|&&z| z < width).count() as f64 / count as f64;
                        let limit = 4.0 * (expected * (1.0 - expected) / count as f64).sqrt() + noise * noise;
                        println!("{medium:?} {name}, noise {noise:.3}, {method:?}: {share:.4} within {width} se");
                        assert!((share - expected).abs() < limit, "{medium:?} {name} {method:?}: {share} {expected}");
                    }
                }
            }
        }
    }
}

/// `count` x `count` pixels of one medium, of independent normal noise (relative) in both reflectances.
fn image(medium: [f64; 2], se: [f64; 2], rho: f64, side: usize, seed: u64) -> Reflectance {
    let flat = reflectance(&noisy_of(medium, se, rho, side * side, 1_000_003 * seed), Some((se, rho))).0;
    let truth = F_X.map(|f| r_d(medium[0], medium[1], f));
    let mut stack = ImageStack::new(side, side);
    stack.attributes = flat.attributes.clone();
    for layer in flat.layers {
        // A renderer knows the noise of the medium, not of what noise has made of the pixel.
        let noise = |k: usize| (se[k] * truth[k]) as f32;
        let data = match layer.info.kind {
            LayerKind::StandardError => {
                Array2::from_elem((side, side), noise(usize::from(layer.info.f_x_per_mm > Some(0.0))))
            }
            LayerKind::Covariance => Array2::from_elem((side, side), rho as f32 * noise(0) * noise(1)),
            _ => layer.data.into_shape_with_order((side, side)).expect("as many pixels"),
        };
        stack.push(layer.info, data);
    }
    Reflectance(stack)
}

/// The mean over a region does not depend on which pixels noise pushes out of the table: over six images it is the truth to 2 standard errors (and
/// 0.2 %, the largest that second order leaves below the noise from which the tangent is taken), up to 25 % of noise in R and a third of the pixels outside. Without those
/// pixels, as a mask would have it, it is off by 1 to 50 %. They are flagged, and nothing else is; the stated errors of the others are their scatter.
#[test]
fn pixels_outside_the_table_stay_in_the_mean() {
    let cases = [
        ([0.096, 0.74], [0.16, 0.2], 0.0),
        ([0.096, 0.74], [0.2, 0.25], 0.7),
        ([0.05, 3.0], [0.05, 0.07], 0.0),
        ([0.05, 3.0], [0.09, 0.12], 0.7),
        ([0.004, 1.0], [0.16, 0.2], 0.7),
    ];
    for (medium, se, rho) in cases {
        let mut sums = [[0.0; 4]; 2];
        let (mut count, mut outside, mut masked) = (0.0, 0.0, 0.0);
        for seed in 0..6 {
            let (out, host) =
                invert(image(medium, se, rho, 48, seed), lut(&F_X, r_d), &Params::default(), &["covariance"]).unwrap();
            let maps = &out.maps.0;
            let (mask, flags) = (layer(maps, "mask"), layer(maps, "mu_a_se_unknown"));
            assert_eq!(flags, layer(maps, "mu_s_prime_se_unknown"));
            let good = mask.iter().filter(|m| **m == 0.0).count() as f64;
            let flagged = flags.iter().sum::<f64>();
            let told = host.measures.lock().unwrap()["kept_outside_table"];
            assert!((told - 100.0 * flagged / mask.len() as f64).abs() < 1e-9, "{told}");
            (count, outside, masked) = (count + good, outside + flagged, masked + mask.len() as f64 - good);
            for (k, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
                let info = &maps.find(name, None).unwrap().info;
                let (values, own) = (layer(maps, name), layer(maps, &format!("{name}_se")));
                sums[k][2] += (info.mean_se.unwrap() * good).powi(2);
                for i in (0..mask.len()).filter(|&i| mask[i] == 0.0) {
                    sums[k][0] += values[i];
                    sums[k][1] += if flags[i] == 0.0 { values[i] } else { 0.0 };
                    sums[k][3] += own[i] * own[i];
                }
            }
            let shared = out.covariance.unwrap().0;
            let variance = &shared.layers.iter().find(|l| l.info.pair == Some([0, 0])).unwrap().data;
            let stated = layer(maps, "mu_a_se");
            assert!(variance.iter().zip(&stated).all(|(v, se)| (f64::from(v.sqrt()) - se).abs() <= 1e-5 * se));
        }
        for (k, sums) in sums.into_iter().enumerate() {
            let off = |sum: f64, n: f64| sum / n / medium[k] - 1.0;
            let (bias, without) = (off(sums[0], count), off(sums[1], count - outside));
            let mean_se = sums[2].sqrt() / count / medium[k];
            println!(
                "{medium:?} {se:?} {rho}: {:.1} % outside, bias {:+.2} ({:.2}) %, without them {:+.2} %",
                100.0 * outside / count,
                100.0 * bias,
                100.0 * mean_se,
                100.0 * without
            );
            assert!(bias.abs() < 2.0 * mean_se + 0.002, "{medium:?} {se:?} {rho}: {bias} +- {mean_se}");
            assert!((sums[2] / sums[3] - 1.0).abs() < 1e-4, "the error of the mean is that of the pixels");
        }
        assert!(masked < 0.002 * count, "{masked} of {count}");
    }
}

/// What lies outside the table for its medium is masked with its side, whatever noise does there: a dark block beside a medium that the table holds, and
/// a single dark pixel in it. `keep` reads no pixel along the tangent that the table holds.
#[test]
fn structure_outside_the_table_is_masked() {
    let (side, se) = (24, [0.02, 0.02]);
    let mut bright = image([0.096, 0.74], se, 0.0, side, 3);
    let dark = image([3.0, 0.74], se, 0.0, side, 4);
    let outside = |r: usize, c: usize| c >= 12 || (r, c) == (6, 4);
    for (layer, dark) in bright.0.layers.iter_mut().zip(&dark.0.layers) {
        for (r, c) in (0..side).flat_map(|r| (0..side).map(move |c| (r, c))).filter(|&(r, c)| outside(r, c)) {
            layer.data[(r, c)] = dark.data[(r, c)];
        }
    }
    let (out, _) = invert(bright.clone(), lut(&F_X, r_d), &Params::default(), &[]).unwrap();
    let maps = &out.maps.0;
    let mask = &maps.find("mask", None).unwrap().data;
    for ((r, c), &code) in mask.indexed_iter() {
        assert_eq!(code != 0.0, outside(r, c), "row {r}, column {c}: {code}");
    }
    assert!(maps.find("mu_a_se_unknown", None).is_none());
    let noisy = image([0.025, 0.85], [0.09, 0.12], 0.0, side, 5);
    let params = Params { noise_bias: NoiseBias::Keep, ..Params::default() };
    let (out, host) = invert(noisy.clone(), lut(&F_X, r_d), &params, &[]).unwrap();
    assert!(host.measures.lock().unwrap().get("read_along_tangent").is_none());
    let plain = Params { method: Method::Bicubic, ..params };
    let (exact, _) = invert(noisy, lut(&F_X, r_d), &plain, &[]).unwrap();
    let pairs = out.maps.0.layers[0].data.iter().zip(&exact.maps.0.layers[0].data);
    assert!(pairs.into_iter().all(|(a, b)| (a / b - 1.0).abs() < 2e-3), "each pixel by itself");
}

/// A reflectance that does not know its error at a pixel leaves both maps without one there; the values stay.
#[test]
fn unknown_errors_are_passed_on() {
    let quiet = || image([0.025, 0.85], [0.01, 0.012], 0.5, 8, 1);
    let plain = invert(quiet(), lut(&F_X, r_d), &Params::default(), &[]).unwrap().0.maps.0;
    let mut flagged = quiet();
    let mut flags = Array2::zeros((8, 8));
    flags[(2, 5)] = 1.0;
    let info = flagged.0.layers[1].info.clone();
    flagged.0.push(info.se_unknown(), flags.clone());
    let found = invert(flagged, lut(&F_X, r_d), &Params::default(), &[]).unwrap().0.maps.0;
    for k in 0..2 {
        assert_eq!(found.se_unknown(&found.layers[k].info).map(|l| &l.data), Some(&flags));
        assert_eq!(found.layers[k].data, plain.layers[k].data);
        assert_eq!((found.layers[k].info.mean_se, plain.layers[k].info.mean_se.is_some()), (None, true));
    }
}

/// A table that does not know its errors leaves the maps those of the reflectance, and says so; one that knows them says nothing.
#[test]
fn unknown_errors_of_the_table_are_told() {
    let of = |known: bool| {
        let mut table = lut(&F_X, r_d);
        let se = table.0.f64s("r_d").unwrap().iter().map(|r| known.then_some(0.01 * r)).collect();
        table.0.to_mut().push("r_d_se", "1", Cells::MaybeF64(se));
        let r = [F_X.map(|f| r_d(0.05, 1.2, f)); 4];
        let reflectance = reflectance(&r, Some(([1e-3, 1e-3], 0.0)));
        let (out, host) = invert(reflectance, table, &Params::default(), &[]).unwrap();
        let told = host.warnings.lock().unwrap().iter().any(|w| w.contains("does not know its standard errors"));
        (layer(&out.maps.0, "mu_a_se")[0], told)
    };
    let ((with, quiet), (without, told)) = (of(true), of(false));
    assert!(!quiet && told && without > 0.0 && without < 0.5 * with, "{with} {without}");
}
