//! Heights of surfaces whose shape is known: phases are computed from camera, projector and shape, the stage gives the shape back.

use std::f64::consts::TAU;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Camera, Distortion, MaskReason, Payload, Phase, Profile, Projection, Projector, Scene};
use turbid_contract::{
    AngleDeg, Ctx, Error, ImageStack, Known, LayerInfo, Length, MemoryHost, PerLength, Problems, Stage,
};
use turbid_optics::philox::{key, philox4x32, unit};
use turbid_profilometry::geometry::Rig;
use turbid_profilometry::{In, Method, Out, Params, Profilometry, ReferenceSurface, Tube, Unwrap};

fn scene(projector: [f64; 3], look_at: [f64; 3], distorted: bool) -> Scene {
    let distortion = distorted.then_some(Distortion { k1: -0.2, k2: 0.05, p1: 1e-3, p2: -2e-3, k3: 0.0 });
    Scene {
        wavelengths_nm: Vec::new(),
        media: Default::default(),
        objects: Default::default(),
        lights: Default::default(),
        detectors: Default::default(),
        camera: Some(Camera {
            position: [0.0, 0.0, 500.0],
            look_at: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            field: [64.0, 64.0],
            pixels: [48, 40],
            specular: None,
            projection: Projection::Pinhole,
            distortion,
            aperture: None,
        }),
        projector: Some(Projector {
            position: projector,
            look_at,
            up: [0.0, 1.0, 0.0],
            field: [128.0, 128.0],
            power: vec![5.0],
            profile: Profile::Flat,
            pixels: None,
            distortion,
        }),
    }
}

/// World point where the ray of each pixel meets the surface z = height(x, y): by secants along the ray.
fn hits(rig: &Rig, height: &dyn Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
    let meet = |pixel: usize| {
        let (origin, w) = rig.ray(pixel);
        let over = |t: f64| {
            let r = origin + t * w;
            r.z - height(r.x, r.y)
        };
        // The first crossing on a fine march, then bisection.
        let (mut low, mut t) = (0.0, 300.0);
        while over(t) > 0.0 {
            low = t;
            t += 0.25;
        }
        let mut high = t;
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if over(middle) > 0.0 { low = middle } else { high = middle }
        }
        (origin + high * w).to_array()
    };
    (0..rig.columns * rig.rows).map(meet).collect()
}

fn phase_of(rig: &Rig, points: &[[f64; 3]], f_x: &[f64], orientation: f64, sigma: f64, seed: u64) -> Phase {
    let mut stack = ImageStack::new(rig.rows, rig.columns);
    for (k, &f) in f_x.iter().enumerate() {
        let mut info = LayerInfo::value("phase", "rad").with_f_x(f);
        info.orientation_deg = Some(orientation);
        let value = |i: usize| {
            let [a, b, ..] = philox4x32([i as u32, k as u32, 0, 0], key(seed));
            let normal = (-2.0 * libm::log(unit(a))).sqrt() * libm::cos(TAU * unit(b));
            let phi = TAU * f * rig.coordinate(points[i].into()).unwrap() + sigma * normal;
            (phi - TAU * (phi / TAU).round()) as f32
        };
        let image = |value: &dyn Fn(usize) -> f32| {
            Array2::from_shape_fn((rig.rows, rig.columns), |(r, c)| value(r * rig.columns + c))
        };
        stack.push(info.clone(), image(&value));
        if sigma > 0.0 {
            stack.push(info.standard_error(), image(&|_| sigma as f32));
        }
    }
    Phase(stack)
}

fn run(params: &Params, scene: &Scene, sample: Phase, reference: Option<Phase>) -> Result<(Out, MemoryHost), Error> {
    let host = MemoryHost { wanted: vec!["normals".into()], ..MemoryHost::default() };
    let inputs = In { sample, reference, scene: scene.clone(), source: std::marker::PhantomData };
    Ok((Profilometry::run(params, inputs, Ctx::new(&host))?, host))
}

fn layer<'a>(stack: &'a ImageStack, name: &str) -> &'a Array2<f32> {
    &stack.find(name, None).unwrap_or_else(|| panic!("layer {name}")).data
}

/// The surfaces: flat, tilted planes, a step, and the polyp of 40 mm.
type Surface = (&'static str, fn(f64, f64) -> f64);
const SURFACES: [Surface; 5] = [
    ("flat", |_, _| 0.0),
    ("tilted", |x, y| 0.2 * x - 0.1 * y + 3.0),
    ("steep", |x, _| 0.9 * x),
    ("step", |x, _| if x > 1.0 { 8.0 } else { 0.0 }),
    ("polyp", |x, y| (400.0 - x * x - y * y).max(0.0).sqrt()),
];

/// Heights to what f32 phases allow: 2e-7 rad x 23 mm/rad, and f32 heights; where all that the methods assume is true, and with
/// a tilted projector, unequal pupils and lenses that distort for those that allow for it. Normals of planes too.
#[test]
fn known_shapes_come_back() {
    let level = scene([35.0, 0.0, 500.0], [35.0, 0.0, 0.0], false);
    let tilted = scene([35.0, 5.0, 430.0], [0.0; 3], false);
    let distorted = scene([35.0, 0.0, 500.0], [0.0; 3], true);
    let cases = [
        (Method::Triangulation, &level, 1.0),
        (Method::Triangulation, &tilted, 1.0),
        (Method::Triangulation, &distorted, 1.0),
        (Method::Formula, &level, 1.0),
        // Interpolates the measured reference between pixels 1.3 mm apart, exactly where it is linear.
        (Method::ReferenceMap, &level, 1.0),
        (Method::ReferenceMap, &tilted, 1.0),
    ];
    for (method, scene, factor) in cases {
        let rig = Rig::new(scene, 0.0).unwrap();
        for (name, height) in SURFACES {
            let points = hits(&rig, &height);
            let params = Params { method, heights: Some([Length(-30.0), Length(45.0)]), ..Params::default() };
            let (out, _) = run(&params, scene, phase_of(&rig, &points, &[0.1], 0.0, 0.0, 1), None).unwrap();
            let stack = &out.height.0;
            let mut good = 0;
            for (i, point) in points.iter().enumerate() {
                let at = (i / rig.columns, i % rig.columns);
                if layer(stack, "mask")[at] == 0.0 {
                    good += 1;
                    let got = f64::from(layer(stack, "height")[at]);
                    assert!(
                        (got - point[2]).abs() < 2e-5 * factor,
                        "{method:?}, {name}: {got} for {} at {at:?}",
                        point[2]
                    );
                }
            }
            // The reference map ends with the image: up to s = d h / (l_0 - h) = 3.1 mm of 64 mm, at one side.
            let least = if method == Method::ReferenceMap { 0.9 } else { 1.0 };
            assert!(good as f64 >= least * points.len() as f64, "{method:?}, {name}: {good} good pixels");
            if name == "tilted" && method == Method::Triangulation {
                let want = glam::DVec3::new(-0.2, 0.1, 1.0).normalize();
                let normals = &out.normals.unwrap().0;
                for (k, axis) in ["normal_x", "normal_y", "normal_z"].into_iter().enumerate() {
                    assert!(layer(normals, axis).iter().all(|&v| (f64::from(v) - want[k]).abs() < 1e-4));
                }
            }
        }
    }
}

/// The formula on a projector tilted by 4 degrees: no more than what is known for it, -1.2 to +0.8 % of (l_0 - h) in s, is right
/// only near the middle; triangulation is exact.
#[test]
fn a_warning_says_where_the_formula_fails() {
    let uneven = scene([35.0, 0.0, 400.0], [0.0; 3], false);
    let mut known = Known::default();
    known.insert("scene", Payload::into_artifact(uneven));
    let mut problems = Problems::default();
    Profilometry::check(&Params { method: Method::Formula, ..Params::default() }, &known, &mut problems);
    let (found, warnings) = problems.into_parts();
    assert!(found.is_empty(), "{found:?}");
    assert!(warnings[0].to_string().contains("500 and 400 mm over the plane"), "{warnings:?}");
}

/// More than a turn: quality-guided and temporal unwrapping give the polyp at f_x = 0.5, where |dphi| reaches 9.6 rad; `none` does not.
#[test]
fn whole_turns_are_found() {
    let scene = scene([35.0, 0.0, 500.0], [0.0; 3], false);
    let rig = Rig::new(&scene, 0.0).unwrap();
    let hill = |x: f64, y: f64| 20.0 * libm::exp(-(x * x + y * y) / 300.0);
    let points = hits(&rig, &hill);
    let phase = phase_of(&rig, &points, &[0.05, 0.2, 0.5], 0.0, 0.02, 3);
    for (unwrap, right) in
        [(Unwrap::Auto, true), (Unwrap::Quality, true), (Unwrap::Temporal, true), (Unwrap::None, false)]
    {
        let (out, _) = run(&Params { unwrap, ..Params::default() }, &scene, phase.clone(), None).unwrap();
        let z = layer(&out.height.0, "height");
        let worst = points.iter().zip(z).map(|(p, &z)| (f64::from(z) - p[2]).abs()).fold(0.0, f64::max);
        // 5 sigma of 0.02 rad at 4.6 mm/rad is 0.5 mm; a lost turn is 29 mm.
        assert_eq!(worst < 0.5, right, "{unwrap:?}: {worst} mm");
    }
}

/// With noise the errors are normal with the standard errors given: 68.3 and 95.4 % lie within 1 and 2, to 4 sigma of the count.
#[test]
fn standard_errors_cover() {
    let scene = scene([35.0, 0.0, 500.0], [0.0; 3], false);
    let rig = Rig::new(&scene, 0.0).unwrap();
    let (flat, polyp) = (hits(&rig, &SURFACES[0].1), hits(&rig, &SURFACES[4].1));
    for method in [Method::Triangulation, Method::Formula, Method::ReferenceMap] {
        let (mut n, mut within) = (0.0, [0.0; 2]);
        for seed in 0..5 {
            let sample = phase_of(&rig, &polyp, &[0.1], 0.0, 0.01, 2 * seed);
            // A reference map is a ruler: its own noise would have to be smoothed.
            let sigma = if method == Method::ReferenceMap { 0.0 } else { 0.01 };
            let reference = phase_of(&rig, &flat, &[0.1], 0.0, sigma, 2 * seed + 1);
            let params = Params { method, unwrap: Unwrap::None, ..Params::default() };
            let (out, _) = run(&params, &scene, sample, Some(reference)).unwrap();
            let stack = &out.height.0;
            for (i, point) in polyp.iter().enumerate() {
                let at = (i / rig.columns, i % rig.columns);
                if layer(stack, "mask")[at] == 0.0 {
                    // The projector looks at the origin from 35 mm aside on a plane parallel image: the formula is exact too.
                    let z =
                        (f64::from(layer(stack, "height")[at]) - point[2]) / f64::from(layer(stack, "height_se")[at]);
                    n += 1.0;
                    within[0] += f64::from(u8::from(z.abs() < 1.0));
                    within[1] += f64::from(u8::from(z.abs() < 2.0));
                }
            }
        }
        for (within, want) in within.into_iter().zip([0.6827, 0.9545]) {
            let sigma = (want * (1.0_f64 - want) / n).sqrt();
            assert!((within / n - want).abs() < 4.0 * sigma, "{method:?}: {} for {want} +- {sigma}", within / n);
        }
    }
}

/// The inside of a tube against a straight reference tube: where the wall bulges, triangulation gives its points; pixels that see past the mouth or through
/// the other end of the reference are masked, and only they; the flat formula is refused, and a tube that nothing sees.
#[test]
fn lumens_are_read_against_a_straight_tube() {
    let mut scene = scene([6.0, 0.0, 100.0], [0.0, 0.0, 0.0], false);
    if let Some(camera) = &mut scene.camera {
        (camera.position, camera.field) = ([0.0, 0.0, 100.0], [40.0, 40.0]);
    }
    let rig = Rig::new(&scene, 0.0).unwrap();
    let (length, top) = (Length(400.0), Length(55.0));
    let tube = |x: f64| {
        ReferenceSurface::Tube(Tube { inner_diameter: Length(20.0), length, top, center: [Length(x), Length(0.0)] })
    };
    let wall = |radius: f64| -> Vec<[f64; 3]> {
        let meet = |i: usize| {
            let (o, w) = rig.ray(i);
            let t = radius / (w.x * w.x + w.y * w.y).sqrt();
            (o + t * w).to_array()
        };
        (0..rig.rows * rig.columns).map(meet).collect()
    };
    let (narrow, straight) = (wall(9.6), wall(10.0));
    let params = Params { reference_surface: Some(tube(0.0)), unwrap: Unwrap::None, ..Params::default() };
    let phase = |points: &[[f64; 3]]| phase_of(&rig, points, &[0.1], 0.0, 0.0, 0);
    let (out, _) = run(&params, &scene, phase(&narrow), Some(phase(&straight))).unwrap();
    let (z, mask) = (layer(&out.height.0, "height"), layer(&out.height.0, "mask"));
    let good: Vec<usize> = (0..narrow.len()).filter(|&i| mask[(i / rig.columns, i % rig.columns)] == 0.0).collect();
    assert!(good.len() > narrow.len() / 2, "{}", good.len());
    let mut outside = [0, 0];
    for (i, point) in straight.iter().enumerate() {
        let (beside, beyond) = (point[2] > top.0, point[2] < top.0 - length.0);
        outside = [outside[0] + usize::from(beside), outside[1] + usize::from(beyond)];
        let masked = mask[(i / rig.columns, i % rig.columns)] == MaskReason::OutsideReference.code();
        assert_eq!(masked, beside || beyond, "pixel {i}, on the endless tube at {point:?}");
    }
    assert!(outside.iter().all(|&n| n > 10), "{outside:?} pixels past the mouth and through the end");
    for i in good {
        let (got, want) = (f64::from(z[(i / rig.columns, i % rig.columns)]), narrow[i][2]);
        // f32 phases (2e-7 rad) at up to (distance / baseline across)^2 mm per rad.
        assert!((got - want).abs() < 0.02, "pixel {i}: {got} for {want}");
    }
    let mut problems = Problems::default();
    Profilometry::check(&Params { method: Method::Formula, ..params.clone() }, &Known::default(), &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("only triangulation"));
    let mut problems = Problems::default();
    let aside = Params { reference_surface: Some(tube(300.0)), ..params };
    let known = Known::with("scene", scene.into_artifact());
    Profilometry::check(&aside, &known, &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("no pixel of the camera sees the reference tube"));
}

/// What cannot give a height says so: fringes along the baseline's normal, poles, other sizes, missing layers, wrong params.
#[test]
fn what_gives_no_height_is_named() {
    let scene = scene([35.0, 0.0, 500.0], [0.0; 3], false);
    let rig = Rig::new(&scene, 0.0).unwrap();
    let points = hits(&rig, &SURFACES[0].1);
    let phase = phase_of(&rig, &points, &[0.1], 0.0, 0.0, 0);
    let message =
        |params: &Params, sample: Phase| run(params, &scene, sample, None).map(|_| ()).unwrap_err().to_string();
    let across = Rig::new(&scene, 90.0).unwrap();
    let parallel = phase_of(&across, &points, &[0.1], 90.0, 0.0, 0);
    assert!(message(&Params::default(), parallel).contains("show no height"), "fringes parallel to the baseline");
    assert!(message(&Params::default(), Phase(ImageStack::new(40, 48))).contains("no phase"));
    assert!(message(&Params::default(), Phase(ImageStack::new(1, 1))).contains("no phase"));
    assert!(message(&Params { f_x: Some(PerLength(0.3)), ..Params::default() }, phase.clone()).contains("f_x = 0.3"));
    let mut small = ImageStack::new(2, 2);
    small.push(LayerInfo::value("phase", "rad").with_f_x(0.1), Array2::zeros((2, 2)));
    assert!(message(&Params::default(), Phase(small)).contains("2 x 2 pixels"));

    // Near the pole dphi = 2 pi f_0 d = 22 rad heights are masked, not large.
    let mut high = phase.clone();
    high.0.layers[0].data.fill(0.0);
    let reference = phase_of(&rig, &points, &[0.1], 0.0, 0.0, 0);
    let mut far = scene.clone();
    if let Some(p) = &mut far.projector {
        p.position = [4.0, 0.0, 500.0];
    }
    let params = Params { method: Method::Formula, unwrap: Unwrap::None, ..Params::default() };
    let (out, _) = run(&params, &far, high, Some(reference)).unwrap();
    let mask = layer(&out.height.0, "mask");
    assert!(mask.iter().any(|&m| m == MaskReason::NoHeight.code()) && mask.iter().any(|&m| m == 0.0));
    assert!(layer(&out.height.0, "height").iter().zip(mask).all(|(&h, &m)| m == 0.0 || h == 0.0));

    let mut problems = Problems::default();
    let mut known = Known::default();
    known.insert("scene", Payload::into_artifact(scene.clone()));
    let params = Params {
        orientation_deg: Some(AngleDeg(90.0)),
        heights: Some([Length(5.0), Length(-5.0)]),
        f_x: Some(PerLength(0.0)),
        ..Params::default()
    };
    Profilometry::check(&params, &known, &mut problems);
    let found: Vec<String> = problems.into_parts().0.iter().map(ToString::to_string).collect();
    for part in [
        "heights.1: heights = -5 mm must be above",
        "f_x = 0 mm^-1 must be > 0",
        "orientation_deg: fringes of 90 deg show no height",
    ] {
        assert!(found.iter().any(|f| f.contains(part)), "{part}: {found:?}");
    }
    let mut above = scene.clone();
    if let Some(p) = &mut above.projector {
        p.position = [0.0, 0.1, 510.0];
    }
    known.insert("scene", Payload::into_artifact(above));
    let mut problems = Problems::default();
    Profilometry::check(&Params::default(), &known, &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("one above the other"));
    let mut blind = scene.clone();
    blind.projector = None;
    known.insert("scene", Payload::into_artifact(blind));
    let mut problems = Problems::default();
    Profilometry::check(&Params::default(), &known, &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("no projector"));
}

/// A phase that does not know its standard error gives a height that does not know its own, of the sample as of the reference; the value stays.
#[test]
fn unknown_errors_are_passed_on() {
    let scene = scene([35.0, 0.0, 500.0], [0.0; 3], false);
    let rig = Rig::new(&scene, 0.0).unwrap();
    let flat = hits(&rig, &SURFACES[0].1);
    let phase = |flagged: Option<(usize, usize)>, seed: u64| {
        let mut phase = phase_of(&rig, &flat, &[0.1], 0.0, 0.01, seed);
        if let Some(at) = flagged {
            let mut flags = Array2::zeros((rig.rows, rig.columns));
            flags[at] = 1.0;
            let info = phase.0.layers[0].info.se_unknown();
            phase.0.push(info, flags);
        }
        phase
    };
    let params = Params { unwrap: Unwrap::None, ..Params::default() };
    let plain = run(&params, &scene, phase(None, 1), Some(phase(None, 2))).unwrap().0.height.0;
    assert!(plain.find("height_se_unknown", None).is_none() && plain.layers[0].info.mean_se.is_some());
    let (sample, reference) = (phase(Some((3, 4)), 1), phase(Some((5, 6)), 2));
    let found = run(&params, &scene, sample, Some(reference)).unwrap().0.height.0;
    let flags = found.se_unknown(&found.layers[0].info).expect("two pixels are flagged");
    assert!(flags.data[(3, 4)] == 1.0 && flags.data[(5, 6)] == 1.0 && flags.data.sum() == 2.0);
    assert_eq!((layer(&found, "height"), found.layers[0].info.mean_se), (layer(&plain, "height"), None));
}
