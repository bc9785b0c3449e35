//! Laws of patterns: closed forms at pixels, uniform fringes on surfaces, named mistakes.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::marker::PhantomData;

use turbid_contract::payload::{
    Camera, MaskReason, Medium, Object, Pattern, Profile, Projection, Projector, Scene, Shape, Surface,
    SurfaceFrequency,
};
use turbid_contract::{
    AngleDeg, Ctx, ImageStack, Known, Length, MemoryHost, Payload, PerLength, Problems, Ratio, Stage,
};
use turbid_pattern::speckle::Speckle;
use turbid_pattern::{
    Method, PatternIn, PatternParams, PatternStage, Predistort, PredistortIn, PredistortParams, Wave,
};

#[path = "laws/forms.rs"]
mod forms;
#[path = "laws/pictures.rs"]
mod pictures;

/// The tube of the paper, 250 mm long with a bore of 20 mm, and a projector 100 mm over its mouth.
fn tube(pixels: u32) -> Scene {
    let wall = Shape::Tube { inner_diameter: 20.0, outer_diameter: 80.0, top: 0.0, bottom: -250.0, center: [0.0; 2] };
    scene(wall, projector([0.0, 0.0, 100.0], [24.0, 24.0], pixels))
}

fn projector(position: [f64; 3], field: [f64; 2], pixels: u32) -> Projector {
    Projector {
        position,
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field,
        power: vec![5.0],
        profile: Profile::UniformIntensity,
        pixels: Some([pixels, pixels]),
        distortion: None,
    }
}

fn scene(shape: Shape, projector: Projector) -> Scene {
    let medium = Medium {
        mu_a: vec![0.1],
        mu_s: vec![5.0],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.8),
        n: 1.0,
    };
    let object = Object { shape, medium: Some("m".into()), priority: 0, surface: Surface::Smooth };
    Scene {
        detectors: Default::default(),
        wavelengths_nm: Vec::new(),
        media: BTreeMap::from([("m".into(), medium)]),
        objects: BTreeMap::from([("wall".into(), object)]),
        camera: None,
        projector: Some(projector),
        lights: BTreeMap::new(),
    }
}

fn along_wall(method: Method, f_x: &[f64]) -> PredistortParams {
    PredistortParams {
        surface: "wall".into(),
        f_x: f_x.iter().copied().map(PerLength).collect(),
        phases: 3,
        orientation_deg: AngleDeg(0.0),
        method,
        rays: 4,
        pixels_per_period: 4.0,
        flatten: None,
        lamps: 40,
        pixels: None,
    }
}

fn fringes(f_x: &[f64], orientation_deg: &[f64]) -> PatternParams {
    PatternParams {
        f_x: f_x.iter().copied().map(PerLength).collect(),
        phases: 3,
        orientation_deg: orientation_deg.iter().copied().map(AngleDeg).collect(),
        wave: Wave::Sinusoid,
        dither: turbid_pattern::dither::Dither::None,
        speckle: None,
        image: None,
        pixels: None,
        max_file_mb: Default::default(),
    }
}

fn host() -> MemoryHost {
    MemoryHost { seed: 3, wanted: vec!["surface_frequency".into()], ..MemoryHost::default() }
}

fn predistort(params: &PredistortParams, scene: &Scene) -> Result<(ImageStack, ImageStack), String> {
    let input = PredistortIn { scene: scene.clone(), source: PhantomData };
    let out = Predistort::run(params, input, Ctx::new(&host())).map_err(|e| e.to_string())?;
    let (Pattern(pattern), SurfaceFrequency(map)) = (out.pattern, out.surface_frequency.expect("wanted"));
    Ok((pattern, map))
}

fn pattern(params: &PatternParams, scene: &Scene) -> (ImageStack, ImageStack) {
    let input = PatternIn { scene: scene.clone(), source: PhantomData };
    let out = PatternStage::run(params, input, Ctx::new(&host())).expect("a pattern");
    (out.pattern.0, out.surface_frequency.expect("wanted").0)
}

/// Phase (rad) of the fringe of layers first .. first + 3.
fn phases(stack: &ImageStack, first: usize) -> Vec<f64> {
    let layers: Vec<_> = stack.layers[first..first + 3].iter().map(|l| l.pixels()).collect();
    let pixel = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|k| f64::from(layers[k][i]));
        (3.0_f64.sqrt() * (c - b)).atan2(2.0 * a - b - c)
    };
    (0..stack.rows() * stack.columns()).map(pixel).collect()
}

/// (f_surface, mask) of every pixel.
fn reached(map: &ImageStack, f_x: f64) -> Vec<(f64, f32)> {
    let f = map.find("f_surface", Some(f_x)).expect("the map").pixels();
    let mask = map.find("mask", None).expect("a mask").pixels();
    f.iter().zip(mask.iter()).map(|(&f, &m)| (f64::from(f), m)).collect()
}

/// Largest relative deviation of the good pixels that `counts`, and how many there are.
fn worst(map: &ImageStack, f_x: f64, counts: impl Fn(usize) -> bool) -> (f64, usize) {
    let all = reached(map, f_x).into_iter().enumerate();
    let good = all.filter(|&(i, (_, mask))| mask == 0.0 && counts(i));
    good.fold((0.0, 0), |(worst, n), (_, (f, _))| (f64::max(worst, (f / f_x - 1.0).abs()), n + 1))
}

/// Rays and the formula are two ways to one pattern. The formula takes the phase as even over a pixel; its curvature there,
/// 2 pi (2 c - c) / rho at c cycles a pixel and the radius of rho pixels, moves the mean phase by 1/24 of it.
#[test]
fn rays_agree_with_the_formula() {
    let n = 200;
    for profile in [Profile::UniformIntensity, Profile::Flat] {
        let mut scene = tube(n);
        scene.projector.as_mut().unwrap().profile = profile;
        let traced = PredistortParams { rays: 8, ..along_wall(Method::Trace, &[0.05]) };
        let formula = PredistortParams { method: Method::Analytic, ..traced.clone() };
        let ((a, map), (b, _)) = (predistort(&traced, &scene).unwrap(), predistort(&formula, &scene).unwrap());
        let (pa, pb) = (phases(&a, 0), phases(&b, 0));
        let mut compared = 0;
        for (i, (_, mask)) in reached(&map, 0.05).into_iter().enumerate() {
            if mask != 0.0 {
                continue;
            }
            let at = |k: usize| k as f64 + 0.5 - 0.5 * f64::from(n);
            let rho = at(i % n as usize).hypot(at(i / n as usize));
            let cycles = 0.05 * 100.0 * 10.0 / (rho * rho * 24.0 / f64::from(n));
            let off = (pa[i] - pb[i] + PI).rem_euclid(TAU) - PI;
            // Twice for the next orders.
            assert!(off.abs() < 2.0 * TAU * 3.0 * cycles / rho / 24.0 + 1e-5, "{i}: {off} rad at rho {rho}, {cycles}");
            compared += 1;
        }
        assert!(compared > 5_000, "{compared}");
    }
}

/// Uniform to 1 % wherever the projector resolves it, for surfaces of every kind; a flat sinusoid is not. At the pole from which meridians
/// start the pattern has a point, and differences across it say nothing: the first period is left out. Where light grazes, s goes like the root
/// of the distance x (pixels) from the limb, and the mean over a pixel is off by 1 / (32 x^2) of its slope: 0.4 % at 3 pixels.
#[test]
fn fringes_are_uniform_along_surfaces() {
    let turned =
        |shape: Shape| Shape::Turned { shape: Box::new(shape), about: [0.0; 3], rotation_deg: [25.0, -15.0, 40.0] };
    let far = |pixels| projector([30.0, -20.0, 300.0], [44.0, 44.0], pixels);
    let cases = [
        (tube(400), 0.05),
        (scene(Shape::Slab { top: 0.0, bottom: -50.0 }, far(200)), 0.2),
        (scene(turned(Shape::Box { size: [60.0, 60.0, 20.0], center: [0.0, 0.0, -10.0] }), far(200)), 0.2),
        (scene(Shape::Sphere { diameter: 40.0, center: [0.0, 0.0, -20.0] }, far(300)), 0.1),
        (scene(Shape::Spheroid { diameters: [40.0, 40.0, 80.0], center: [0.0, 0.0, -40.0] }, far(400)), 0.1),
        (
            scene(
                Shape::Cylinder { diameter: 30.0, length: 60.0, center: [0.0, 0.0, -15.0], axis: [1.0, 0.0, 0.0] },
                far(200),
            ),
            0.1,
        ),
    ];
    for (scene, f_x) in &cases {
        let (_, map) = predistort(&along_wall(Method::Trace, &[*f_x]), scene).unwrap();
        let s = map.find("coordinate", None).unwrap().pixels();
        let mask = map.find("mask", None).unwrap();
        // Three pixels from the limb of a ball light still comes in at 80 degrees.
        let inside = |i: usize| {
            let (row, column) = (i / map.columns(), i % map.columns());
            let near = |a: usize, b: usize| a.abs_diff(b) <= 3;
            let around = (row.saturating_sub(3)..map.rows()).take_while(|&r| near(r, row));
            around
                .flat_map(|r| {
                    (column.saturating_sub(3)..map.columns()).take_while(|&c| near(c, column)).map(move |c| (r, c))
                })
                .all(|place| mask.data[place] != MaskReason::Background.code())
        };
        let round = matches!(scene.objects["wall"].shape, Shape::Sphere { .. } | Shape::Spheroid { .. });
        let (off, n) = worst(&map, *f_x, |i| !round || (f64::from(s[i]) * f_x > 1.0 && inside(i)));
        assert!(off < 0.01 && n > 3000, "{:?}: {off} over {n} pixels", scene.objects["wall"].shape);
    }
    let (_, map) = predistort(&along_wall(Method::Analytic, &[0.05]), &tube(400)).unwrap();
    assert!(worst(&map, 0.05, |_| true).0 < 0.01);
    let (_, map) = pattern(&fringes(&[0.05], &[0.0]), &tube(400));
    let mut f: Vec<f64> = reached(&map, 0.05).into_iter().filter(|r| r.1 == 0.0).map(|r| r.0).collect();
    f.sort_by(f64::total_cmp);
    // f h / D sqrt(sin^2 + (R / D)^2 cos^2) at the depth D below the pinhole, h = 100 to the plane, by the azimuth from x.
    let (low, high) = (f[f.len() / 20], f[f.len() * 19 / 20]);
    assert!(high > 3.0 * low, "{low} to {high} mm^-1");
}

/// A flat sinusoid on a plane turned by theta about y, from far away: f cos(theta) along it where it lies across the fringes, and f
/// where it lies along them. The 1e5 mm leave perspective of 2 x 22 / 1e5.
#[test]
fn a_tilted_plane_stretches_fringes() {
    for (axis, expected) in [([0.0, 35.0, 0.0], 0.1 * f64::cos(35.0_f64.to_radians())), ([35.0, 0.0, 0.0], 0.1)] {
        let block = Shape::Box { size: [100.0, 100.0, 10.0], center: [0.0, 0.0, -5.0] };
        let shape = Shape::Turned { shape: Box::new(block), about: [0.0; 3], rotation_deg: axis };
        let (_, map) = pattern(&fringes(&[0.1], &[0.0]), &scene(shape, projector([0.0, 0.0, 1e5], [44.0, 44.0], 100)));
        for (f, mask) in reached(&map, 0.1) {
            assert!(mask == 0.0 && (f / expected - 1.0).abs() < 1e-3, "{axis:?}: {f} {expected}");
        }
    }
}

/// Where a period has fewer pixels than asked for, the light is flat and the map says why; what does not meet the wall is dark.
#[test]
fn what_is_too_fine_is_flat_and_masked() {
    let (stack, map) = predistort(&along_wall(Method::Trace, &[0.0, 0.2]), &tube(300)).unwrap();
    let (mut fine, mut dark, mut good) = (0, 0, 0);
    let s = map.find("coordinate", None).unwrap().pixels();
    for (i, (f, mask)) in reached(&map, 0.2).into_iter().enumerate() {
        let values: Vec<f32> = stack.layers.iter().map(|l| l.pixels()[i]).collect();
        if mask == MaskReason::Background.code() {
            dark += usize::from(values.iter().all(|&v| v == 0.0));
        } else if mask == MaskReason::BeyondProjector.code() && values[1..].iter().all(|&v| v == 0.5) {
            assert_eq!(f, 0.0);
            // ds/drho = (s + 100)^2 / (R h) times the pitch of 0.08 mm, along an axis at least 1 / sqrt 2 of it: a quarter of a cycle.
            let cycles = 0.2 * f64::from(s[i] + 100.0).powi(2) / 1000.0 * 0.08;
            assert!(cycles > 0.2 && s[i] > 0.0, "{cycles} at {} mm", s[i]);
            fine += 1;
        } else if mask == 0.0 {
            good += 1;
        }
    }
    assert!(fine > 1000 && dark > 10_000 && good > 10_000, "{fine} {dark} {good}");
}

/// After flattening, what the surface gets at pattern value 1/2 of the f_x = 0 layer is even: irradiance R / (R^2 + D^2)^(3/2) times the
/// value, over the bore, where the range allows it.
#[test]
fn flattening_evens_the_irradiance() {
    let params = PredistortParams { flatten: Some(Ratio(1000.0)), ..along_wall(Method::Trace, &[0.0]) };
    let scene = tube(400);
    let input = PredistortIn { scene: scene.clone(), source: PhantomData };
    let out = Predistort::run(&params, input, Ctx::new(&MemoryHost::default())).unwrap();
    assert!(out.surface_frequency.is_none(), "nobody wants it");
    let values = out.pattern.0.layers[0].pixels().into_owned();
    let mut light = Vec::new();
    for (i, &v) in values.iter().enumerate() {
        let at = |k: usize| (k as f64 + 0.5 - 200.0) * 24.0 / 400.0;
        let rho = at(i % 400).hypot(at(i / 400));
        // A pixel away from both ends of the bore.
        let drop = 1000.0 / rho;
        if (110.0..330.0).contains(&drop) {
            light.push(f64::from(v) * 10.0 / (100.0 + drop * drop).powf(1.5));
        }
    }
    let (low, high) = light.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), &v| (l.min(v), h.max(v)));
    // rho^3 over a pixel, at 48 of them: 3 / 4 / 48^2.
    assert!(light.len() > 10_000 && high / low - 1.0 < 1e-3, "{low} {high}");
    assert!(values.iter().all(|&v| v <= 0.5));
}

/// The painted tube seen from the projector's place: over the depths that it resolves the captured fringes are as many as were painted,
/// f times the length, to a tenth of one (light between the walls makes them no pure sinusoids, which ripples the phase).
#[test]
fn captured_fringes_are_as_many_as_were_painted() {
    let n = 240;
    let mut scene = tube(n);
    scene.camera = Some(Camera {
        position: [0.0, 0.0, 100.0],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [24.0, 24.0],
        pixels: [n, n],
        specular: None,
        projection: Projection::Pinhole,
        distortion: None,
        aperture: None,
    });
    let (stack, _) = predistort(&along_wall(Method::Capture, &[0.05]), &scene).unwrap();
    let phase = phases(&stack, 0);
    // Outwards along the row below the middle: from 125 mm of depth to 5 mm.
    let row = n as usize / 2;
    let rho = |column: usize| ((column as f64 + 0.5 - 120.0).powi(2) + 0.25).sqrt() * 0.1;
    let columns: Vec<usize> = (120..240).filter(|&c| (5.0..125.0).contains(&(1000.0 / rho(c) - 100.0))).collect();
    let mut turns = 0.0;
    for pair in columns.windows(2) {
        let step = phase[row * 240 + pair[1]] - phase[row * 240 + pair[0]];
        turns += (step + PI).rem_euclid(TAU) - PI;
    }
    let (first, last) = (columns[0], columns[columns.len() - 1]);
    let expected = 0.05 * (1000.0 / rho(last) - 1000.0 / rho(first));
    assert!((turns / TAU - expected).abs() < 0.1, "{} {expected}", turns / TAU);
    let all = stack.layers.iter().flat_map(|l| l.pixels().into_owned());
    let (low, high) = all.fold((1.0_f32, 0.0_f32), |(l, h), v| (l.min(v), h.max(v)));
    assert_eq!((low, high), (0.0, 1.0), "stretched to the full range");
}

/// (1 + cos(2 pi f (x cos o + y sin o) + phase)) / 2 at pixel centres; rows run from +y down. Square waves are their own mean of 1/2
/// and, where pixel edges lie on the jumps, 0 and 1 alone.
#[test]
fn fringes_are_their_formula() {
    let board = scene(Shape::Slab { top: 0.0, bottom: -5.0 }, projector([3.0, 4.0, 100.0], [20.0, 20.0], 40));
    let (stack, _) = pattern(&fringes(&[0.0, 0.07], &[0.0, 30.0]), &board);
    assert_eq!(stack.layers.len(), 7);
    assert!(stack.layers[0].pixels().iter().all(|&v| v == 0.5));
    for layer in &stack.layers[1..] {
        let (o, phase) = (layer.info.orientation_deg.unwrap().to_radians(), layer.info.phase_rad.unwrap());
        for ((row, column), &v) in layer.data.indexed_iter() {
            let (x, y) = (0.5 * (column as f64 + 0.5) - 10.0, 10.0 - 0.5 * (row as f64 + 0.5));
            let expected = 0.5 + 0.5 * (TAU * 0.07 * (x * o.cos() + y * o.sin()) + phase).cos();
            assert!((f64::from(v) - expected).abs() < 1e-7, "{row} {column}: {v} {expected}");
        }
    }
    let square = PatternParams { wave: Wave::Square, phases: 4, ..fringes(&[0.25], &[0.0]) };
    let (stack, _) = pattern(&square, &board);
    for layer in &stack.layers {
        assert!(layer.pixels().iter().all(|&v| v == 0.0 || v == 1.0), "{:?}", layer.info);
        assert_eq!(layer.data.mean(), Some(0.5));
    }
}

/// The same seed gives the same speckle, another seed another one.
#[test]
fn speckle_is_seeded() {
    let board = scene(Shape::Slab { top: 0.0, bottom: -5.0 }, projector([0.0, 0.0, 100.0], [20.0, 20.0], 40));
    let speckle = Speckle { correlation_length: Length(2.0), contrast: Ratio(0.5), count: 2 };
    let params = PatternParams { speckle: Some(speckle), ..fringes(&[], &[0.0]) };
    let of = |seed: u64| {
        let host = MemoryHost { seed, ..MemoryHost::default() };
        let input = PatternIn { scene: board.clone(), source: PhantomData };
        PatternStage::run(&params, input, Ctx::new(&host)).unwrap().pattern.0
    };
    let (a, b, c) = (of(1), of(1), of(2));
    assert_eq!(a, b);
    assert!(a != c && a.layers.len() == 2 && a.layers[0].data != a.layers[1].data);
    assert!(PatternStage::draws(&params) && !PatternStage::draws(&fringes(&[0.1], &[0.0])));
}

fn problems<S: Stage>(params: &S::Params, scene: &Scene) -> Vec<String> {
    let mut known = Known::default();
    known.insert("scene", scene.clone().into_artifact());
    known.connected.push("scene".into());
    let mut problems = Problems::default();
    S::check(params, &known, &mut problems);
    problems.into_parts().0.iter().map(ToString::to_string).collect()
}

/// Mistakes are found before anything runs, each with its field and the figure that matters.
#[test]
fn mistakes_are_named() {
    let told = |found: Vec<String>, field: &str, words: &str| {
        assert!(found.iter().any(|p| p.starts_with(field) && p.contains(words)), "{field}, {words}: {found:?}");
    };
    let flat = |params: PatternParams, scene: &Scene| problems::<PatternStage>(&params, scene);
    let wall = |params: PredistortParams, scene: &Scene| problems::<Predistort>(&params, scene);
    let scene_of_tube = tube(300);
    assert_eq!(flat(fringes(&[0.0, 0.05], &[0.0]), &scene_of_tube), Vec::<String>::new());
    assert_eq!(wall(along_wall(Method::Analytic, &[0.0, 0.05]), &scene_of_tube), Vec::<String>::new());
    // 24 mm over 300 pixels: half a cycle of 0.08 mm is 6.25 mm^-1.
    told(flat(fringes(&[0.1, 7.0], &[0.0]), &scene_of_tube), "f_x.1", "6.2500 mm^-1");
    told(flat(fringes(&[], &[0.0]), &scene_of_tube), "f_x", "nothing would be shown");
    let speckle = Speckle { correlation_length: Length(0.1), contrast: Ratio(1.5), count: 1 };
    let params = PatternParams { speckle: Some(speckle), ..fringes(&[], &[0.0]) };
    told(flat(params.clone(), &scene_of_tube), "speckle.correlation_length", "two of the projector's pixels");
    told(flat(params, &scene_of_tube), "speckle.contrast", "1.5");
    let mut without = tube(300);
    without.projector.as_mut().unwrap().pixels = None;
    told(flat(fringes(&[0.05], &[0.0]), &without), "pixels", "how many pixels");
    without.projector = None;
    told(flat(fringes(&[0.05], &[0.0]), &without), "in.scene: ", "no projector");

    let other = PredistortParams { surface: "lumen".into(), ..along_wall(Method::Trace, &[0.05]) };
    told(wall(other, &scene_of_tube), "surface", "no object `lumen`");
    let triaxial = scene(
        Shape::Spheroid { diameters: [10.0, 20.0, 30.0], center: [0.0; 3] },
        projector([0.0, 0.0, 100.0], [24.0, 24.0], 99),
    );
    told(wall(along_wall(Method::Trace, &[0.05]), &triaxial), "surface", "no coordinate");
    let turned = PredistortParams { orientation_deg: AngleDeg(30.0), ..along_wall(Method::Trace, &[0.05]) };
    told(wall(turned, &scene_of_tube), "surface", "flat faces only");
    let mut beside = tube(300);
    beside.projector.as_mut().unwrap().position = [0.5, 0.0, 100.0];
    told(wall(along_wall(Method::Analytic, &[0.05]), &beside), "method", "0.5 mm off");
    told(wall(along_wall(Method::Capture, &[0.05]), &beside), "method", "no camera");
    told(wall(along_wall(Method::Trace, &[]), &scene_of_tube), "f_x", "empty");
    let coarse = PredistortParams { pixels_per_period: 1.0, ..along_wall(Method::Trace, &[0.05]) };
    told(wall(coarse, &scene_of_tube), "pixels_per_period", "be >= 2");
    // A projector that looks elsewhere is found when the rays are traced.
    let mut away = tube(50);
    away.projector.as_mut().unwrap().look_at = [500.0, 0.0, 0.0];
    let error = predistort(&along_wall(Method::Trace, &[0.05]), &away).unwrap_err();
    assert!(error.contains("no light of the projector meets `wall`"), "{error}");
}
