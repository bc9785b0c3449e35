//! Stacks of layers: against one slab, conservation, reciprocity, and counting photons.

use turbid_iad::{Incidence, Layer, Layered, Plan, Response, Slab, Slide, Stack};

fn layer(mu_a: f64, mu_s_prime: f64, g: f64, thickness_mm: f64) -> Layer {
    Layer { mu_a_per_mm: mu_a, mu_s_prime_per_mm: mu_s_prime, g, thickness_mm }
}

fn four(r: &Response) -> [f64; 4] {
    [r.ur1, r.ut1, r.uru, r.utu]
}

fn apart(a: &Response, b: &Response) -> f64 {
    four(a).iter().zip(four(b)).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

fn sides() -> [(f64, Slide, Slide); 4] {
    let glass = Slide::clear(1.5);
    [
        (1.0, Slide::NONE, Slide::NONE),
        (1.4, Slide::NONE, Slide::NONE),
        (1.4, glass, glass),
        (1.33, Slide { n: 1.6, tau: 0.1 }, Slide::NONE),
    ]
}

/// A slab is what its pieces make together, in 1, 2 and 7 pieces: 1e-11, a few roundings over the gap of what is trapped.
#[test]
fn pieces_make_the_slab() {
    for (n, top, bottom) in sides() {
        for (light, g) in [
            (Incidence::Normal, 0.8),
            (Incidence::Normal, -0.5),
            (Incidence::Diffuse, 0.0),
            (Incidence::Cone(0.5), 0.99),
        ] {
            for (mu_a, mu_s_prime, d) in [
                (0.1, 1.0, 1.0),
                (0.0, 2.0, 3.0),
                (5.0, 0.01, 0.2),
                (1e-3, 20.0, 2.0),
                (0.1, 1.0, 1e-5),
                (1.0, 3.0, 1e-11),
            ] {
                let whole = Slab { top, bottom, ..Slab::bare(n, g, d) };
                let whole =
                    Plan::<16>::lit(&whole, light).expect("a slab").forward(mu_a, mu_s_prime).expect("within range");
                let stack = Stack::<16>::new(n, top, bottom, light).expect("a stack");
                for pieces in [1, 2, 7] {
                    let cut = vec![layer(mu_a, mu_s_prime, g, d / pieces as f64); pieces];
                    let found = stack.forward(&cut).expect("layers that can be");
                    let case = format!("n {n} {light:?} g {g} {mu_a} {mu_s_prime} {d}, {pieces} pieces");
                    assert!(apart(&found.response, &whole) < 1e-11, "{case}: {:?} {whole:?}", found.response);
                    let absorbed = found.response.absorbed / whole.absorbed;
                    // Light that the surfaces hold in a thin slab follows from 1 - R B, the depth: N roundings in each piece.
                    let depth = (mu_a + mu_s_prime) * d;
                    // Below 1e-7 a stack is a straight line, off by that depth over the flattest cosine, 0.01.
                    let line = if n > 1.0 && depth < 1e-7 { 1e-5 } else { 1e-9 };
                    let within = line + (16 * pieces) as f64 * f64::EPSILON / depth.max(1e-7);
                    assert!(mu_a == 0.0 || (absorbed - 1.0).abs() < within, "{case}: {absorbed}");
                    assert!((found.response.ut1_unscattered - whole.ut1_unscattered).abs() < 1e-14, "{case}");
                }
            }
        }
    }
}

/// Reflected, transmitted and what each layer (and no slide) absorbs is all the light; without absorption nothing is lost.
#[test]
fn stacks_conserve() {
    for (n, top, bottom) in &sides()[..3] {
        let stack = Stack::<16>::new(*n, *top, *bottom, Incidence::Oblique(0.6)).expect("a stack");
        for absorption in [0.0, 1e-8, 1.0] {
            let layers = [
                layer(0.2 * absorption, 2.0, 0.9, 0.5),
                layer(0.01 * absorption, 1.0, 0.0, 1.0),
                layer(3.0 * absorption, 0.0, 0.5, 0.1),
                layer(0.02 * absorption, 30.0, -0.6, 5.0),
            ];
            let Layered { response: r, absorbed, absorbed_diffuse } = stack.forward(&layers).expect("layers");
            let sum = |parts: &[f64]| parts.iter().fold(0.0, |sum, x| sum + x);
            assert!((r.ur1 + r.ut1 + sum(&absorbed) - 1.0).abs() < 1e-10, "n = {n}: {r:?}");
            assert!((r.uru + r.utu + sum(&absorbed_diffuse) - 1.0).abs() < 1e-11, "n = {n}: {r:?}");
            assert!(absorbed.iter().all(|x| (*x > 0.0) == (absorption > 0.0)), "n = {n}: {absorbed:?}");
        }
    }
}

/// Diffuse transmittance does not care which side is lit; of clear layers only the sum of the depths counts.
#[test]
fn order_where_it_does_not_matter() {
    let layers = [layer(0.2, 2.0, 0.9, 0.5), layer(1.0, 0.3, 0.0, 0.3), layer(0.01, 5.0, 0.7, 1.0)];
    let turned = [layers[2], layers[1], layers[0]];
    for (n, top, bottom) in sides() {
        let forth =
            Stack::<16>::new(n, top, bottom, Incidence::Normal).expect("a stack").forward(&layers).expect("layers");
        let back =
            Stack::<16>::new(n, bottom, top, Incidence::Normal).expect("a stack").forward(&turned).expect("layers");
        assert!((forth.response.utu - back.response.utu).abs() < 1e-13, "n = {n}");
    }
    let clear = Stack::<16>::new(1.0, Slide::NONE, Slide::NONE, Incidence::Normal).expect("a stack");
    let t = clear.forward(&[layer(0.3, 0.0, 0.0, 1.0), layer(2.0, 0.0, 0.5, 0.5)]).expect("layers").response.ut1;
    assert!((t - libm::exp(-1.3)).abs() < 1e-14, "{t}");
    // Nothing lies under a half-space; an empty stack is its surfaces.
    let deep = [layers[0], layer(0.1, 1.0, 0.8, f64::INFINITY), layers[2]];
    let (with, without) = (clear.forward(&deep).expect("layers"), clear.forward(&deep[..2]).expect("layers"));
    assert_eq!((with.response.ur1, with.absorbed[2]), (without.response.ur1, 0.0));
    let empty = clear.forward(&[]).expect("no layers").response;
    assert!((empty.ut1 - 1.0).abs() < 1e-15 && empty.ur1 == 0.0, "{empty:?}");
}

#[test]
fn layers_that_cannot_be_are_refused() {
    let stack = Stack::<8>::new(1.4, Slide::NONE, Slide::NONE, Incidence::Normal).expect("a stack");
    for bad in [
        layer(-1.0, 1.0, 0.0, 1.0),
        layer(0.1, f64::NAN, 0.0, 1.0),
        layer(0.1, 1.0, 1.0, 1.0),
        layer(0.1, 1.0, 0.0, 0.0),
    ] {
        assert!(stack.forward(&[layer(0.1, 1.0, 0.0, 1.0), bad]).is_err(), "{bad:?}");
    }
    assert!(Stack::<8>::new(0.9, Slide::NONE, Slide::NONE, Incidence::Normal).is_err());
}

/// Photons counted one by one through two layers of one index, Fresnel surfaces and all: fractions within 4.5 standard
/// errors, and over all cases as scattered as they should be. The quadrature's own error at N = 32 is below 1e-4.
#[test]
fn photons_through_two_layers() {
    let mut worst = (0.0f64, String::new());
    let mut squares = Vec::new();
    for (case, n) in [1.0, 1.4].into_iter().enumerate() {
        for (order, cos) in [1.0, 0.5].into_iter().enumerate() {
            let layers = [layer(0.4, 3.0, 0.8, 0.4), layer(0.02, 1.0, 0.3, 1.5)];
            let light = if cos == 1.0 { Incidence::Normal } else { Incidence::Oblique(libm::acos(cos)) };
            let stack = Stack::<32>::new(n, Slide::NONE, Slide::NONE, light).expect("a stack");
            let found = stack.forward(&layers).expect("layers");
            const PHOTONS: usize = 100_000;
            let counts = count(n, cos, &layers, PHOTONS, 7 + 10 * case as u64 + order as u64);
            let model = [found.response.ur1, found.response.ut1, found.absorbed[0], found.absorbed[1]];
            for (i, (count, p)) in counts.iter().zip(model).enumerate() {
                let share = *count as f64 / PHOTONS as f64;
                let z = (share - p) / (p * (1.0 - p) / PHOTONS as f64).sqrt();
                squares.push(z * z);
                if z.abs() > worst.0.abs() {
                    worst = (z, format!("n {n} cos {cos} part {i}: {share} {p}"));
                }
            }
        }
    }
    let rms = (squares.iter().fold(0.0, |sum, x| sum + x) / squares.len() as f64).sqrt();
    println!("z: rms {rms:.2} of {}, worst {:.2} ({})", squares.len(), worst.0, worst.1);
    assert!(worst.0.abs() < 4.5, "{worst:?}");
    // 16 fractions of which 12 are independent: the root mean square has the standard deviation 0.2.
    assert!(rms < 1.0 + 4.5 * 0.2, "{rms}");
}

/// Reflected, transmitted, absorbed above and below: analogue photons, one interaction at a time.
fn count(n: f64, cos_air: f64, layers: &[Layer; 2], photons: usize, seed: u64) -> [usize; 4] {
    let mut state = seed;
    let mut next = move || {
        // SplitMix64.
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let depth = layers[0].thickness_mm + layers[1].thickness_mm;
    let fresnel = |cos: f64, n: f64| {
        // From the side of index n relative to the other.
        let sin2 = n * n * (1.0 - cos * cos);
        if sin2 >= 1.0 {
            return 1.0;
        }
        let out = (1.0 - sin2).sqrt();
        let (s, p) = ((n * cos - out) / (n * cos + out), (n * out - cos) / (n * out + cos));
        0.5 * (s * s + p * p)
    };
    let mut counts = [0; 4];
    for _ in 0..photons {
        if next() < fresnel(cos_air, 1.0 / n) {
            counts[0] += 1;
            continue;
        }
        let mut z = 0.0;
        let mut cos = (1.0 - (1.0 - cos_air * cos_air) / (n * n)).sqrt();
        let mut left = -libm::log(1.0 - next());
        let end = loop {
            let i = if z < layers[0].thickness_mm || z == layers[0].thickness_mm && cos < 0.0 { 0 } else { 1 };
            let Layer { mu_a_per_mm, mu_s_prime_per_mm, g, .. } = layers[i];
            let mu_s = mu_s_prime_per_mm / (1.0 - g);
            let mu_t = mu_a_per_mm + mu_s;
            let wall = match (i, cos > 0.0) {
                (0, false) => 0.0,
                (1, true) => depth,
                _ => layers[0].thickness_mm,
            };
            let to_wall = (wall - z) / cos;
            if left >= to_wall * mu_t {
                left -= to_wall * mu_t;
                z = wall;
                if wall == layers[0].thickness_mm {
                    continue;
                }
                if next() < fresnel(cos.abs(), n) {
                    cos = -cos;
                    continue;
                }
                break usize::from(cos > 0.0);
            }
            z += left * cos / mu_t;
            if next() * mu_t < mu_a_per_mm {
                break 2 + i;
            }
            let u = 2.0 * next() - 1.0;
            let bend = if g == 0.0 { u } else { (1.0 + g * g - ((1.0 - g * g) / (1.0 + g * u)).powi(2)) / (2.0 * g) };
            let turn = libm::cos(std::f64::consts::TAU * next());
            cos = (cos * bend + ((1.0 - cos * cos) * (1.0 - bend * bend)).max(0.0).sqrt() * turn).clamp(-1.0, 1.0);
            left = -libm::log(1.0 - next());
        };
        counts[end] += 1;
    }
    counts
}
