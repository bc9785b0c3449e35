//! The stage `tabulate`: rows by axes, what is subtracted and divided by, what is not there.

use turbid_compare::{Compare, Summarize, Tabulate};
use turbid_contract::kit::{Inputs, Trial};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, Maps, Metrics, Payload, Truth};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Axes, Cells, Ctx, Error, ImageStack, LayerInfo, LayerKind, MemoryHost, StageRow, Table};

/// Images on the ports, each with its axes.
type Images = Vec<(&'static str, Vec<(Axes, ImageStack)>)>;

fn inputs(images: Images) -> Inputs {
    let all = images.into_iter().flat_map(|(port, images)| images.into_iter().map(move |image| (port, image)));
    all.fold(Inputs::none(), |inputs, (port, (axes, stack))| inputs.with_at(port, axes, Frames(stack)))
}

/// A frame of one level with a standard error.
fn frame(level: f32, se: f32) -> ImageStack {
    let mut stack = ImageStack::new(2, 2);
    let info = LayerInfo::value("radiance", "W").with_f_x(0.1);
    stack.push(info.clone(), Array2::from_elem((2, 2), level));
    stack.push(info.standard_error(), Array2::from_elem((2, 2), se));
    stack
}

fn at(a: f64) -> Axes {
    [("A".to_owned(), json!(a)), ("kind".to_owned(), json!("wet"))].into()
}

fn run(params: &Value, images: Images) -> Result<Table, Error> {
    let host = MemoryHost::default();
    let made = StageRow::of::<Tabulate>().run(params, &inputs(images), Ctx::new(&host))?;
    Ok(Metrics::from_artifact(made.into_iter().next().expect("one port").1)?.0)
}

/// (8 - 2) / 4 x 255 and (6 - 3) / 4 x 255 at their own axes; four pixels halve the error of one: sqrt(0.3^2 + 0.4^2) / 2 / 4 x 255.
#[test]
fn rows_take_what_has_their_axes() {
    let images = vec![
        ("values", vec![(at(1.0), frame(8.0, 0.3)), (at(2.0), frame(6.0, 0.3))]),
        ("minus", vec![(at(2.0), frame(3.0, 0.4)), (at(1.0), frame(2.0, 0.4))]),
        ("relative_to", vec![(Axes::new(), frame(4.0, 0.0))]),
    ];
    let table = run(&json!({"scale": 255, "unit": "grey levels"}), images).unwrap();
    assert_eq!(table.maybe_f64s("mean"), Some(vec![Some(382.5), Some(191.25)]));
    assert_eq!(table.f64s("axis A"), Some(&[1.0, 2.0][..]));
    for se in table.maybe_f64s("mean_se").unwrap() {
        // Two roundings to f32.
        assert!((se.unwrap() / (0.5 / 2.0 / 4.0 * 255.0) - 1.0).abs() < 1e-6, "{se:?}");
    }
    let texts = |name: &str| match &table.columns.iter().find(|c| c.name == name).unwrap().cells {
        Cells::Text(texts) => texts.clone(),
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(texts("region"), ["A=1,kind=wet", "A=2,kind=wet"]);
    assert_eq!(texts("quantity"), ["radiance f_x=0.1"; 2]);
    assert_eq!(texts("unit"), ["grey levels"; 2]);
}

/// An image that is masked altogether has no mean, neither as what is tabulated nor as what is subtracted or divided by: null with a warning, not 0.
#[test]
fn what_is_masked_altogether_has_no_mean() {
    let masked = || {
        let mut stack = frame(8.0, 0.3);
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), Array2::ones((2, 2)));
        stack
    };
    let cases = [
        vec![("values", vec![(at(1.0), masked()), (at(2.0), frame(6.0, 0.3))])],
        vec![
            ("values", vec![(at(1.0), frame(8.0, 0.3)), (at(2.0), frame(8.0, 0.3))]),
            ("minus", vec![(at(1.0), masked()), (at(2.0), frame(2.0, 0.3))]),
        ],
        vec![
            ("values", vec![(at(1.0), frame(8.0, 0.3)), (at(2.0), frame(8.0, 0.3))]),
            ("relative_to", vec![(Axes::new(), masked())]),
        ],
    ];
    for (case, (images, second)) in cases.into_iter().zip([Some(6.0), Some(6.0), None]).enumerate() {
        let host = MemoryHost::default();
        let made = StageRow::of::<Tabulate>().run(&json!({}), &inputs(images), Ctx::new(&host)).expect("a table");
        let Metrics(table) = Metrics::from_artifact(made.into_iter().next().expect("one port").1).expect("a table");
        assert_eq!(table.maybe_f64s("mean"), Some(vec![None, second]), "case {case}");
        assert_eq!(table.maybe_f64s("mean_se").expect("a column")[0], None, "case {case}");
        assert_eq!(table.maybe_f64s("masked_percent").expect("a column")[0], Some(100.0), "case {case}");
        let warned = host.warnings.lock().expect("no holder panics")[0].clone();
        assert!(warned.contains("A=1,kind=wet: every pixel is masked, nothing is known of radiance"), "{warned}");
    }
}

/// Values of axes that are neither numbers nor texts stand in their column as they are written.
#[test]
fn switches_are_axes_too() {
    let axes: Axes = [("dark".to_owned(), json!(true))].into();
    let table = run(&json!({}), vec![("values", vec![(axes, frame(8.0, 0.3))])]).unwrap();
    let cells = &table.columns.iter().find(|c| c.name == "axis dark").expect("a column").cells;
    assert_eq!(cells, &Cells::Text(vec!["true".to_owned()]));
}

/// Nothing at a point, nothing to divide by, no such quantity: named, never a number.
#[test]
fn what_is_missing_is_named() {
    let values = || ("values", vec![(at(1.0), frame(8.0, 0.3))]);
    let fails = |more: (&'static str, Vec<(Axes, ImageStack)>)| {
        run(&json!({}), vec![values(), more]).expect_err("it is not there").to_string()
    };
    let message = fails(("minus", vec![(at(3.0), frame(1.0, 0.0))]));
    assert!(message.contains("minus: there is nothing at A=1"), "{message}");
    let message = fails(("relative_to", vec![(Axes::new(), frame(0.0, 0.0))]));
    assert!(message.contains("the mean of radiance f_x=0.1 is 0"), "{message}");
    let mut other = ImageStack::new(2, 2);
    other.push(LayerInfo::value("radiance", "W"), Array2::zeros((2, 2)));
    let message = fails(("relative_to", vec![(Axes::new(), other)]));
    assert!(message.contains("the images have no radiance f_x=0.1; they have radiance"), "{message}");
}

/// Images in two units are neither subtracted nor divided by each other: found before the run by the rule of the run, with both producers and units.
#[test]
fn images_in_two_units_are_refused() {
    let mut counts = frame(3.0, 0.4);
    counts.layers.iter_mut().for_each(|layer| layer.info.unit = "counts".into());
    for port in ["minus", "relative_to"] {
        let trial = |other: &ImageStack| {
            let trial = Trial::of::<Tabulate>(json!({})).input("values", Frames(frame(8.0, 0.3)));
            trial.input(port, Frames(other.clone()))
        };
        trial(&frame(3.0, 0.4)).passes();
        let told = "`made.values`: radiance f_x=0.1 is in counts here, and in W on the port `values`";
        trial(&counts).refuses(&format!("in.{port}"), told);
        let error = trial(&counts).run_alone(&MemoryHost::default()).expect_err("it is refused");
        assert!(error.to_string().contains("is in counts here"), "{error}");
    }
}

/// Rows, columns and units are said before the run, whatever is subtracted, divided by or named.
#[test]
fn what_is_said_is_made() {
    for params in [json!({}), json!({"scale": 255, "unit": "grey levels"})] {
        for port in [None, Some("minus"), Some("relative_to")] {
            let mut trial = Trial::of::<Tabulate>(params.clone());
            for a in [1.0, 2.0] {
                trial = trial.input_at("values", at(a), Frames(frame(8.0, 0.3)));
            }
            let trial = port.into_iter().fold(trial, |trial, port| trial.input(port, Frames(frame(3.0, 0.4))));
            let form = &trial.describe()["metrics"];
            assert!(form.rows == Some(2) && form.columns.is_some(), "{form:?}");
            trial.run().expect("it is as it was described");
        }
    }
}

/// A summary needs the metrics of `compare`: tables of means, and other summaries, are refused before the run; a summary is as it was described.
#[test]
fn summaries_are_of_comparisons() {
    let metrics = |trial: &Trial| trial.run().expect("it is sound").get::<Metrics>("metrics");
    let means = metrics(&Trial::of::<Tabulate>(json!({})).input("values", Frames(frame(8.0, 0.3))));
    let summary = |of: Metrics| Trial::of::<Summarize>(json!({})).input("metrics", of);
    summary(means).refuses(
        "in.metrics",
        "`made.metrics`: the metrics have no column `truth` (connect the metrics of a `compare` stage)",
    );
    let image = |name: &str| {
        let mut stack = ImageStack::new(2, 2);
        let info = LayerInfo::value(name, "mm^-1");
        stack.push(info.clone(), Array2::from_elem((2, 2), 0.1));
        stack.push(info.standard_error(), Array2::from_elem((2, 2), 0.01));
        stack
    };
    let compared =
        Trial::of::<Compare>(json!({})).input("estimate", Maps(image("mu_a"))).input("truth", Truth(image("mu_a")));
    let trial = summary(metrics(&compared));
    assert!(trial.describe()["metrics"].columns.is_some());
    summary(metrics(&trial)).refuses("in.metrics", "the metrics have no column `mean`");
}
