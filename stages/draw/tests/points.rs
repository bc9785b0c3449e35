//! Laws of drawn points: equidistribution, distributions, what stays when something is added.

use serde_json::{Value, json};
use turbid_draw::{Distribution, Draw, Skipped, scrambled, sobol};

const SEED: u64 = 7;

/// The entries of a draw, in the order of the text `keys`.
fn entries(value: &Value, keys: &str) -> Vec<(String, Value)> {
    let named = keys.split_whitespace().map(|key| (key.to_owned(), value[key].clone()));
    let found: Vec<_> = named.filter(|(_, value)| !value.is_null()).collect();
    assert_eq!(found.len(), value.as_object().unwrap().len(), "every key is named");
    found
}

fn draw(value: Value, keys: &str) -> Draw {
    Draw::read(&entries(&value, keys), 1 << 32).unwrap_or_else(|mistakes| panic!("{mistakes:?}"))
}

/// SciPy 1.17, `qmc.Sobol(128, scramble=False, bits=32)`, which stands in the order of Gray codes.
#[test]
fn the_sequence_is_that_of_joe_and_kuo() {
    let gray = |i: u32| i ^ i >> 1;
    let dimensions = [0, 1, 2, 5, 31, 63, 127];
    let table: [(u32, [u32; 7]); 4] = [
        (3, [1073741824, 3221225472, 3221225472, 1073741824, 3221225472, 1073741824, 3221225472]),
        (7, [536870912, 2684354560, 1610612736, 1610612736, 3758096384, 1610612736, 1610612736]),
        (100, [1778384896, 1107296256, 3321888768, 3187671040, 1778384896, 2785017856, 1979711488]),
        (1023, [4194304, 3233808384, 2629828608, 1883242496, 2638217216, 171966464, 3007315968]),
    ];
    for (i, expected) in table {
        assert_eq!(dimensions.map(|dimension| sobol(gray(i), dimension)), expected, "point {i}");
    }
    let sum = |i: u32| (0..128).map(|d| u64::from(sobol(gray(i), d)) * (d as u64 + 1)).sum::<u64>();
    assert_eq!((sum(1023), sum(987_654)), (19054790180864, 17885922009088));
}

/// Every aligned stretch of 2^k points has one in each interval of length 2^-k, in each dimension, and one in each
/// elementary box of the first two: a (0, k, 2)-net. Scrambling keeps that.
#[test]
fn points_are_spread_evenly() {
    for k in [3_u32, 6, 10] {
        for start in [0_u32, 1 << k, 5 << k] {
            for dimension in 0..128 {
                let mut cells: Vec<u32> =
                    (0..1 << k).map(|i| scrambled(start + i, dimension, 99 * dimension as u32) >> (32 - k)).collect();
                cells.sort_unstable();
                assert!(cells.iter().copied().eq(0..1 << k), "dimension {dimension}, {k}");
            }
            for a in 0..=k {
                let b = k - a;
                let cell = |x: u32, bits: u32| x.checked_shr(32 - bits).unwrap_or(0);
                let mut cells: Vec<(u32, u32)> = (start..start + (1 << k))
                    .map(|i| (cell(scrambled(i, 0, 5), a), cell(scrambled(i, 1, 6), b)))
                    .collect();
                cells.sort_unstable();
                cells.dedup();
                assert_eq!(cells.len(), 1 << k, "boxes of 2^-{a} by 2^-{b}");
            }
        }
    }
}

/// Over the seeds each point is uniform: mean 1/2 and variance 1/12 within 5 standard errors, and the top bit of one
/// point says nothing about the second bit.
#[test]
fn scrambled_points_are_uniform_over_the_seeds() {
    let n = 4000;
    for (index, dimension) in [(0, 0), (1, 3), (77, 20), (1023, 127)] {
        let seed = |s: u32| s.wrapping_mul(0x9E37_79B9) ^ 0x5555;
        let drawn: Vec<u32> = (0..n).map(|s| scrambled(index, dimension, seed(s))).collect();
        let u: Vec<f64> = drawn.iter().map(|&x| f64::from(x) / 4_294_967_296.0).collect();
        let mean = u.iter().sum::<f64>() / f64::from(n);
        let variance = u.iter().map(|u| (u - 0.5).powi(2)).sum::<f64>() / f64::from(n);
        let case = format!("point {index}, dimension {dimension}");
        assert!((mean - 0.5).abs() < 5.0 * (1.0 / 12.0 / f64::from(n)).sqrt(), "{case}: mean {mean}");
        // Var((u - 1/2)^2) = 1/180.
        assert!((variance - 1.0 / 12.0).abs() < 5.0 * (1.0 / 180.0 / f64::from(n)).sqrt(), "{case}: {variance}");
        for bit in 1..8 {
            let same = drawn.iter().filter(|&&x| x >> 31 == x >> (31 - bit) & 1).count() as f64;
            let half = f64::from(n) / 2.0;
            assert!((same - half).abs() < 5.0 * (half / 2.0).sqrt(), "{case}: bit {bit} follows the first");
        }
    }
}

fn unit_draw(method: &str, n: u64, dimensions: usize) -> Draw {
    let mut entries = vec![("n".to_owned(), json!(n)), ("method".to_owned(), json!(method))];
    entries.extend((0..dimensions).map(|d| (format!("x{d}"), json!({"uniform": [0, 1]}))));
    Draw::read(&entries, 1 << 32).unwrap()
}

/// The rms error over seeds of the mean of prod (1 + (x_d - 1/2) / d), whose integral over the cube is 1.
fn integration_error(method: &str, n: u64) -> f64 {
    let draw = unit_draw(method, n, 10);
    let seeds = 24;
    let squares = (0..seeds).map(|seed| {
        let f = |values: Vec<Value>| {
            let factors = values.iter().enumerate().map(|(d, x)| 1.0 + (x.as_f64().unwrap() - 0.5) / (d + 1) as f64);
            factors.product::<f64>()
        };
        let sum: f64 = (0..n).map(|i| f(draw.point(seed, i).unwrap())).sum();
        (sum / n as f64 - 1.0).powi(2)
    });
    (squares.sum::<f64>() / f64::from(seeds as u32)).sqrt()
}

/// Random points: rms error sigma / sqrt(n), with sigma^2 = prod (1 + 1 / (12 d^2)) - 1. Latin hypercubes leave the
/// interactions only; Sobol's points fall faster than either.
#[test]
fn sobol_integrates_better_than_hypercubes_and_these_better_than_chance() {
    let n = 1024;
    let [random, lhs, sobol] = ["random", "lhs", "sobol"].map(|method| integration_error(method, n));
    let sigma = ((1..=10).map(|d| 1.0 + 1.0 / (12.0 * f64::from(d * d))).product::<f64>() - 1.0).sqrt();
    let expected = sigma / (n as f64).sqrt();
    // The rms of 24 normal errors is off by a factor of 1 +- 1 / sqrt(48); five of these.
    assert!((random / expected - 1.0).abs() < 5.0 / 48_f64.sqrt(), "random {random}, expected {expected}");
    assert!(lhs < 0.5 * random && sobol < 0.3 * lhs, "random {random}, lhs {lhs}, sobol {sobol}");
    assert!(integration_error("sobol", 4 * n) < sobol / 3.0, "faster than 1 / sqrt(n), which gives 2");
}

/// Of n points one lies in each n-th.
#[test]
fn a_hypercube_has_one_point_in_each_stratum() {
    let n = 100;
    let draw = unit_draw("lhs", n, 3);
    for dimension in 0..3 {
        let point = |i| draw.point(SEED, i).unwrap()[dimension].as_f64().unwrap();
        let mut strata: Vec<u64> = (0..n).map(|i| (point(i) * n as f64) as u64).collect();
        strata.sort_unstable();
        assert!(strata.iter().copied().eq(0..n), "{strata:?}");
    }
}

/// More points, another condition, a quantity at the end: what was there keeps its values.
#[test]
fn points_keep_their_values() {
    for method in ["sobol", "random"] {
        let few =
            draw(json!({"n": 64, "method": method, "a": {"uniform": [0, 1]}, "b": {"normal": [0, 1]}}), "n method a b");
        let many = draw(
            json!({"n": 128, "method": method, "a": {"uniform": [0, 1]}, "b": {"normal": [0, 1]}, "c": {"uniform": [2, 3]},
                "only": [["a", "below", 0.5]]}),
            "n method a b c only",
        );
        let mut met = 0;
        for i in 0..64 {
            let values = few.point(SEED, i).unwrap();
            match many.point(SEED, i) {
                Ok(more) => {
                    assert_eq!(values, more[..2], "{method}: point {i}");
                    met += 1;
                }
                Err(skipped) => {
                    assert_eq!(skipped, Skipped::Condition(0));
                    assert!(values[0].as_f64().unwrap() >= 0.5);
                }
            }
        }
        assert!((20..=44).contains(&met), "{method}: {met} of 64 lie below the median");
        assert_ne!(few.point(SEED, 3), few.point(SEED + 1, 3), "the seed tells");
    }
}

/// Shares below some values, against closed forms; 4096 Sobol points have at most a few in the wrong cell.
#[test]
fn quantities_have_their_distributions() {
    let n = 4096;
    let normal = |z: f64| 0.5 * libm::erfc(-z / 2_f64.sqrt());
    let cut = |z: f64| (normal(z) - normal(-1.0)) / (normal(3.0) - normal(-1.0));
    let cases: Vec<(Value, Vec<(f64, f64)>)> = vec![
        (json!({"uniform": [2, 6]}), vec![(2.0, 0.0), (3.0, 0.25), (6.0, 1.0)]),
        (json!({"uniform": [2, 6], "within": [4, 9]}), vec![(4.0, 0.0), (5.0, 0.5), (6.0, 1.0)]),
        (json!({"loguniform": [0.01, 100]}), vec![(0.1, 0.25), (1.0, 0.5), (10.0, 0.75)]),
        (json!({"normal": {"mean": 5, "sigma": 2}}), vec![(3.0, normal(-1.0)), (5.0, 0.5), (9.0, normal(2.0))]),
        (
            json!({"normal": {"mean": 5, "sigma": 2, "within": [3, 11]}}),
            vec![(3.0, 0.0), (5.0, cut(0.0)), (9.0, cut(2.0)), (11.0, 1.0)],
        ),
        (json!({"lognormal": {"median": 1.5, "sigma": 0.4}}), vec![(1.5, 0.5), (1.5 * 0.4_f64.exp(), normal(1.0))]),
        (
            json!({"lognormal": {"median": 1.5, "sigma": 0.4, "within": [1.5, 90]}}),
            vec![(1.5, 0.0), (1.5 * 0.4_f64.exp(), 2.0 * normal(1.0) - 1.0)],
        ),
        // 12 x (1 - x)^2 has 6 x^2 - 8 x^3 + 3 x^4 below x.
        (json!({"beta": {"alpha": 2, "beta": 3, "on": [10, 20]}}), vec![(15.0, 0.6875), (12.0, 0.1808)]),
        (
            json!({"beta": {"alpha": 2, "beta": 3}, "within": [0.5, 1]}),
            vec![(0.5, 0.0), (0.8, (0.9728 - 0.6875) / 0.3125)],
        ),
        (json!({"integer": [1, 4]}), vec![(1.5, 0.25), (3.5, 0.75), (4.0, 1.0)]),
        (json!({"choice": {"1": 3, "2": 1}}), vec![(1.5, 0.75)]),
    ];
    for (distribution, shares) in cases {
        let draw = draw(json!({"n": n, "x": distribution}), "n x");
        let values: Vec<f64> = (0..n).map(|i| draw.point(SEED, i).unwrap()[0].as_f64().unwrap()).collect();
        for (x, expected) in shares {
            let share = values.iter().filter(|&&v| v <= x).count() as f64 / n as f64;
            // An interval of the unit has n times its length of the points, give or take one at each end.
            assert!((share - expected).abs() <= 2.0 / n as f64, "{distribution} below {x}: {share}, not {expected}");
        }
    }
}

/// A quantity per group has one value in it; groups are about equally frequent (5 sigma of a binomial).
#[test]
fn groups_share_what_is_drawn_per_group() {
    let n = 10_000;
    let draw = draw(
        json!({"n": n, "patient": {"group": 20}, "mu_a": {"loguniform": [0.01, 1], "per": "patient"}, "twice":
            {"product": [2, "mu_a"]}, "lesion": {"uniform": ["mu_a", "twice"], "per": "patient"}, "depth": {"uniform": [0, 1]}}),
        "n patient mu_a twice lesion depth",
    );
    assert_eq!(draw.groups().collect::<Vec<_>>(), ["patient"]);
    let mut seen: Vec<Option<Vec<Value>>> = vec![None; 20];
    let mut counts = [0_f64; 20];
    for i in 0..n {
        let values = draw.point(SEED, i).unwrap();
        let group = values[0].as_u64().unwrap() as usize;
        counts[group] += 1.0;
        let of_group = seen[group].get_or_insert_with(|| values[1..4].to_vec());
        assert_eq!(*of_group, values[1..4], "group {group}");
        let [mu_a, twice, lesion] = [1, 2, 3].map(|i| values[i].as_f64().unwrap());
        assert!(twice == 2.0 * mu_a && mu_a < lesion && lesion < twice);
    }
    let mean = n as f64 / 20.0;
    assert!(counts.iter().all(|c| (c - mean).abs() < 5.0 * mean.sqrt()), "{counts:?}");
    let values: std::collections::BTreeSet<String> = seen.iter().map(|v| v.as_ref().unwrap()[0].to_string()).collect();
    assert_eq!(values.len(), 20, "groups differ");
}

/// Bounds that are drawn themselves may make no distribution at some points: these are skipped, with the reason.
#[test]
fn points_that_cannot_be_drawn_are_skipped() {
    let draw = draw(
        json!({"n": 1000, "width": {"uniform": [2, 10]}, "depth": {"uniform": [2, {"product": [0.5, "width"]}]}}),
        "n width depth",
    );
    let (mut there, mut skipped) = (0, 0);
    for i in 0..1000 {
        match draw.point(SEED, i) {
            Ok(values) => {
                let [width, depth] = [0, 1].map(|i| values[i].as_f64().unwrap());
                assert!(depth > 2.0 && depth < 0.5 * width, "{width} {depth}");
                there += 1;
            }
            Err(Skipped::Undrawn { quantity: 1, why }) => {
                assert!(why.contains("uniform takes [first, last] with first < last"), "{why}");
                skipped += 1;
            }
            Err(other) => panic!("{other:?}"),
        }
    }
    // Half the ends lie above 4 / 2.
    assert!((740..=760).contains(&there) && there + skipped == 1000, "{there}");
}

#[test]
fn conditions_compare_numbers_names_and_texts() {
    let draw = draw(
        json!({"n": 512, "shape": {"choice": {"ball": 1, "box": 1, "none": 2}}, "a": {"uniform": [0, 1]}, "b": {"uniform": [0, 1]},
            "only": [["a", "below", "b"], ["shape", "in", ["ball", "none"]], ["b", "above", 0.25]]}),
        "n shape a b only",
    );
    let points: Vec<Vec<Value>> = (0..512).filter_map(|i| draw.point(SEED, i).ok()).collect();
    for point in &points {
        let [a, b] = [1, 2].map(|i| point[i].as_f64().unwrap());
        assert!(a < b && b > 0.25 && point[0] != "box");
    }
    // P(a < b, b > 1/4) = (1 - 1/16) / 2, times 3/4: 180 of 512.
    assert!((165..=195).contains(&points.len()), "{}", points.len());
}

/// Each mistake at its place, with what is wrong.
#[test]
fn mistakes_have_places() {
    let cases = [
        (json!({"a": {"uniform": [0, 1]}}), "a", "", "`draw` needs `n`"),
        (json!({"n": 0, "a": {"uniform": [0, 1]}}), "n a", "n", "n must lie in 1..1000"),
        (json!({"n": 9, "method": "halton", "a": {"uniform": [0, 1]}}), "n method a", "method", "sobol, lhs, random"),
        (json!({"n": 9}), "n", "", "nothing to draw"),
        (json!({"n": 9, "a": {"uniform": [1, 0]}}), "n a", "a.uniform", "first < last"),
        (json!({"n": 9, "a": {"loguniform": [0, 1]}}), "n a", "a.loguniform", "above 0"),
        (json!({"n": 9, "a": {"loguniform": [-1, 1]}}), "n a", "a.loguniform", "above 0"),
        (json!({"n": 9, "a": {"lognormal": {"median": 0, "sigma": 1}}}), "n a", "a.lognormal", "median"),
        (json!({"n": 9, "a": {"normal": {"mean": 0, "sigma": 0}}}), "n a", "a.normal", "sigma"),
        (json!({"n": 9, "a": {"normal": {"mean": 0, "sd": 1}}}), "n a", "a.normal.sd", "no key `sd`"),
        (json!({"n": 9, "a": {"normal": {"mean": 0, "sigma": 1, "within": [50, 60]}}}), "n a", "a.normal", "share"),
        (json!({"n": 9, "a": {"gauss": [0, 1]}}), "n a", "a.gauss", "no key `gauss`"),
        (json!({"n": 9, "a": {"beta": {"alpha": 0, "beta": 1}}}), "n a", "a.beta", "0.001"),
        (json!({"n": 9, "a": {"integer": [1.2, 1.8]}}), "n a", "a.integer", "no whole number"),
        (json!({"n": 9, "a": {"choice": []}}), "n a", "a.choice", "nothing to choose"),
        (json!({"n": 9, "a": {"choice": ["x", "x"]}}), "n a", "a.choice", "twice"),
        (json!({"n": 9, "a": {"choice": {"x": -1}}}), "n a", "a.choice.x", "weight"),
        (json!({"n": 9, "a": {"uniform": [0, "width"]}}), "n a", "a", "`width` is not drawn"),
        (json!({"n": 9, "a": {"sum": ["b", 1]}, "b": {"sum": ["a", 1]}}), "n a b", "a", "circle"),
        (json!({"n": 9, "a": {"uniform": [0, 1], "per": "patient"}}), "n a", "a.per", "no group"),
        (json!({"n": 9, "s": {"choice": ["x", "y"]}, "a": {"sum": ["s", 1]}}), "n s a", "a", "`s` is no number"),
        (
            json!({"n": 9, "p": {"group": 3}, "b": {"uniform": [0, 1]}, "a": {"uniform": ["b", 2], "per": "p"}}),
            "n p b a",
            "a",
            "`b` changes within a p",
        ),
        (json!({"n": 9, "p": {"group": 0}}), "n p", "p.group", "1 or more"),
        (json!({"n": 9, "a": {"uniform": [0, 1]}, "only": [["b", "below", 1]]}), "n a only", "only.0.0", "not drawn"),
        (
            json!({"n": 9, "a": {"uniform": [0, 1]}, "only": [["a", "under", 1]]}),
            "n a only",
            "only.0.1",
            "above, below",
        ),
        (json!({"n": 9, "a": {"choice": ["x", "y"]}, "only": [["a", "below", 1]]}), "n a only", "only.0", "no number"),
    ];
    for (value, keys, path, words) in cases {
        let mistakes = Draw::read(&entries(&value, keys), 1000).expect_err(&value.to_string());
        let found = mistakes.iter().any(|m| m.path.join(".") == path && m.message.contains(words));
        assert!(found, "{value}: {mistakes:?}");
        assert_eq!(mistakes.len(), 1, "{value}: no more than one: {mistakes:?}");
    }
}

/// The distribution of a scene's own random bodies is read by the same words.
#[test]
fn distributions_stand_alone() {
    let distribution = Distribution::read(&json!({"uniform": [1, 4]})).unwrap();
    assert_eq!(distribution.quantile(0.5, &|_| 0.0), Ok(json!(2.5)));
    assert!(Distribution::read(&json!({"uniform": [4, 1]})).is_err());
    assert!(Distribution::read(&json!(3)).is_err());
}

/// Ends of the unit interval and extreme shapes: never a value outside, never one that is not finite.
#[test]
fn extreme_numbers_stay_inside() {
    let cases = [
        (json!({"loguniform": [1e-300, 1e300]}), [1e-300, 1e300]),
        (json!({"uniform": [-1e-9, 1e-9]}), [-1e-9, 1e-9]),
        (json!({"beta": {"alpha": 0.001, "beta": 0.001}}), [0.0, 1.0]),
        (json!({"beta": {"alpha": 1e5, "beta": 1e5}}), [0.0, 1.0]),
        (json!({"normal": {"mean": 0, "sigma": 1, "within": [6.5, 7]}}), [6.5, 7.0]),
        (
            json!({"normal": {"mean": 1e6, "sigma": 1e-6, "within": [999999.9999999, 1000000.1]}}),
            [999999.9999999, 1000000.1],
        ),
        (json!({"lognormal": {"median": 1e-12, "sigma": 3, "within": [1e-15, 1e-9]}}), [1e-15, 1e-9]),
    ];
    for (value, [first, last]) in cases {
        let distribution = Distribution::read(&value).unwrap_or_else(|mistakes| panic!("{value}: {mistakes:?}"));
        let mut before = first;
        for u in [1.2e-10, 1e-6, 0.01, 0.3, 0.5, 0.9, 0.999_999, 1.0 - 1.2e-10] {
            let x = distribution.quantile(u, &|_| 0.0).unwrap_or_else(|why| panic!("{value}: {why}")).as_f64().unwrap();
            assert!(x >= before && x <= last, "{value} at {u}: {x} after {before}");
            before = x;
        }
    }
}
