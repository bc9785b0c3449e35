//! Whole files, as a user writes them.

use crate::ids::{Id, StageId};
use std::path::PathBuf;

use serde_json::{Value, json};
use turbid_contract::Axes;

use super::*;

/// Files in a directory of their own.
struct Files(tempfile::TempDir);

impl Files {
    fn new(files: &[(&str, &str)]) -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory can be made");
        for (name, text) in files {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().expect("it lies in the directory")).expect("it can be made");
            std::fs::write(path, text).expect("it can be written");
        }
        Self(dir)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self, overrides: &[&str]) -> Result<Spec, Report> {
        load(&self.path("main.yaml"), &overrides.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>())
    }
}

fn spec(text: &str) -> Spec {
    Files::new(&[("main.yaml", text)]).load(&[]).unwrap_or_else(|report| panic!("{report}"))
}

fn mistakes(text: &str) -> String {
    Files::new(&[("main.yaml", text)]).load(&[]).expect_err("it holds mistakes").to_string()
}

fn rows(foreach: &str) -> (Vec<String>, Value) {
    let spec = spec(&format!("stages: {{s: {{use: x, foreach: {foreach}}}}}"));
    (spec.stages[StageId::new(0)].foreach.names.clone(), json!(spec.stages[StageId::new(0)].foreach.rows))
}

#[test]
fn the_whole_grammar_is_read() {
    let spec = spec(concat!(
        "pipeline: whole\nabout: All of it\nseed: 7\n",
        "vars: {f_x: 0.1, both: [0, \"${f_x}\"]}\n",
        "stages:\n",
        "  tissue: {use: scene}\n",
        "  frames:\n",
        "    use: render\n",
        "    in: {scene: tissue, pattern: {from: tissue.preview, where: {mu_a: 2.0}, over: [g]}, more: [a, b.c]}\n",
        "    with: {f_x: \"${both}\", samples: 1e3, label: \"f_x = ${f_x}\", cost: \"$${5}\"}\n",
        "    product: true\n    seed: 18446744073709551615\n",
        "studies:\n",
        "  s: {vary: {vars.f_x: {linspace: [0, 1, 3]}}, estimate: frames.mu_a, truth: frames.truth, error: rmse_percent}\n",
    ));
    assert_eq!((spec.pipeline.as_str(), spec.about.as_deref(), spec.seed), ("whole", Some("All of it"), 7));
    let frames = &spec.stages[StageId::new(1)];
    assert_eq!(
        (frames.use_name.as_str(), frames.product, frames.seed),
        ("render", true, Some(SeedSpec::PerInstance(u64::MAX)))
    );
    let source = |stage: &str, port: Option<&str>| SourceRef {
        stage: stage.to_owned(),
        port: port.map(str::to_owned),
        filter: BTreeMap::new(),
        over: None,
    };
    assert_eq!(frames.inputs[0].sources, [source("tissue", None)]);
    let filtered = SourceRef {
        filter: [("mu_a".to_owned(), json!(2))].into(),
        over: Some(vec!["g".to_owned()]),
        ..source("tissue", Some("preview"))
    };
    assert_eq!(frames.inputs[1].sources, [filtered]);
    assert_eq!(frames.inputs[2].sources, [source("a", None), source("b", Some("c"))]);
    let params = spec.params(StageId::new(1), &Axes::new()).expect("it needs no axes");
    assert_eq!(params, json!({"f_x": [0, 0.1], "samples": 1000, "label": "f_x = 0.1", "cost": "${5}"}));
    assert_eq!(spec.studies[0].vary, [("vars.f_x".to_owned(), vec![json!(0), json!(0.5), json!(1)])]);
}

#[test]
fn foreach_makes_a_grid_whose_last_axis_varies_fastest() {
    let (names, values) = rows("{a: [1, 2.0], b: [x, y]}");
    assert_eq!(
        (names, values),
        (vec!["a".to_owned(), "b".to_owned()], json!([[1, "x"], [1, "y"], [2, "x"], [2, "y"]]))
    );
    assert_eq!(
        rows("{a: [1, 2], c: {range: [0, 2]}, b: [x, y], zip: [[a, b]]}"),
        (
            vec!["a".to_owned(), "b".to_owned(), "c".to_owned()],
            json!([[1, "x", 0], [1, "x", 1], [2, "y", 0], [2, "y", 1]])
        )
    );
    // Paired axes may repeat a value, as the columns of a table do; only the pairs must differ.
    assert_eq!(rows("{a: [1, 2, 0], b: [0, 0, 1], zip: [[a, b]]}").1, json!([[1, 0], [2, 0], [0, 1]]));
    assert_eq!(rows("{}").1, json!([[]]));
    assert_eq!(spec("stages: {s: {use: x}}").stages[StageId::new(0)].foreach.rows, [Vec::<Value>::new()]);
}

/// The axis `draw` counts points; what is drawn is known to `${}`, and another n or condition renames nothing.
#[test]
fn draws_are_one_axis_of_indices() {
    let foreach = |n: u64, only: &str| {
        format!("{{draw: {{n: {n}, mu_a: {{loguniform: [1e-4, 1e-2]}}, g: {{uniform: [0.5, 1]}}{only}}}, k: [1, 2]}}")
    };
    let of = |foreach: &str| {
        let spec = spec(&format!("seed: 3\nstages: {{s: {{use: x, foreach: {foreach}, with: {{g: \"${{g}}\"}}}}}}"));
        let stage = &spec.stages[StageId::new(0)].foreach;
        assert_eq!(stage.names, ["draw", "k"]);
        let draw = stage.draw.as_ref().expect("it draws");
        let values = |row: &Vec<Value>| {
            let mut axes: Axes = stage.names.iter().cloned().zip(row.iter().cloned()).collect();
            draw.put_into(&mut axes);
            assert_eq!(spec.params(StageId::new(0), &axes).expect("g is drawn")["g"], axes["g"]);
            axes
        };
        stage.rows.iter().map(values).collect::<Vec<_>>()
    };
    let (few, more) = (of(&foreach(8, "")), of(&foreach(16, "")));
    assert_eq!((few.len(), more.len()), (16, 32));
    assert_eq!(few, more[..16]);
    let some = of(&foreach(16, ", only: [[g, above, 0.75]]"));
    assert_eq!(some.len(), 16, "half of the points");
    assert!(some.iter().all(|axes| axes["g"].as_f64() > Some(0.75) && more.contains(axes)));
}

/// Entries with `when` are there where it is met, without the key itself.
#[test]
fn entries_may_depend_on_what_is_drawn() {
    let spec = spec(concat!(
        "vars: {deep: 2}\nstages:\n  s:\n    use: x\n    foreach: {shape: [ball, box], width: [1, 3]}\n",
        "    with:\n      objects:\n        ball: {when: {shape: ball, width: {above: \"${deep}\"}}, radius: \"${width}\"}\n",
        "        box: {when: {shape: {in: [box, none]}}, inner: {when: {width: 3}, size: 1}}\n        skin: {top: 0}\n",
    ));
    let params = |shape: &str, width: u64| {
        let axes = [("shape".to_owned(), json!(shape)), ("width".to_owned(), json!(width))].into();
        spec.params(StageId::new(0), &axes).expect("all names are known")["objects"].clone()
    };
    assert_eq!(params("ball", 3), json!({"ball": {"radius": 3}, "skin": {"top": 0}}));
    assert_eq!(params("ball", 1), json!({"skin": {"top": 0}}));
    assert_eq!(params("box", 3), json!({"box": {"inner": {"size": 1}}, "skin": {"top": 0}}));
    assert_eq!(params("box", 1), json!({"box": {}, "skin": {"top": 0}}));
}

#[test]
fn csv_columns_are_axes_that_go_together() {
    let files = Files::new(&[
        ("main.yaml", "stages: {s: {use: x, foreach: {csv: data/m.csv, k: [1, 2]}}}"),
        ("data/m.csv", "mu_a,g\n0.1,0.8\n0.2,0.9\n"),
    ]);
    let foreach = &files.load(&[]).expect("it is right").stages[StageId::new(0)].foreach;
    assert_eq!(foreach.names, ["mu_a", "g", "k"]);
    assert_eq!(json!(foreach.rows), json!([[0.1, 0.8, 1], [0.1, 0.8, 2], [0.2, 0.9, 1], [0.2, 0.9, 2]]));
}

/// Params of an instance made afresh and by refilling those of another are equal.
#[test]
fn refilled_params_are_those_made_afresh() {
    let spec = spec(concat!(
        "vars: {k: 3}\nstages:\n  s:\n    use: x\n    foreach: {a: [1, 2, 0.5], b: [u, v]}\n",
        "    with: {list: [0, \"${a}\", {deep: \"${b}-${k}\"}], k: \"${k}\", fixed: {x: 1}}\n",
    ));
    let foreach = &spec.stages[StageId::new(0)].foreach;
    for row in &foreach.rows {
        let axes: Axes = foreach.names.iter().cloned().zip(row.iter().cloned()).collect();
        let fresh = spec.params(StageId::new(0), &axes).expect("all axes are there");
        let expected = json!({
            "list": [0, axes["a"], {"deep": format!("{}-3", axes["b"].as_str().unwrap())}], "k": 3, "fixed": {"x": 1}
        });
        assert_eq!(fresh, expected);
    }
    let lost = spec.params(StageId::new(0), &[("a".to_owned(), json!(1))].into()).expect_err("b is not there");
    assert!(lost[0].to_string().contains("`${b}` is an axis that this stage does not carry"), "{}", lost[0]);
}

/// The including file wins key by key, a later include over an earlier one; each path is relative to its own file.
#[test]
fn includes_merge_and_paths_stay_with_their_files() {
    let files = Files::new(&[
        ("main.yaml", "include: [lib/base.yaml, lib/more.yaml]\nvars: {a: 1}\nstages: {s: {with: {y: 5, own: o.obj}}}"),
        (
            "lib/base.yaml",
            "vars: {a: 0, b: 0, file: v.obj}\nstages: {s: {use: x, with: {x: 1, y: 1, mesh: {file: m.obj}, v: \"${file}\"}}}",
        ),
        ("lib/more.yaml", "vars: {b: 2}\nstages: {t: {use: z}}"),
    ]);
    let spec = files.load(&["stages.s.with.given=g.obj"]).expect("it is right");
    assert_eq!((&spec.vars["a"], &spec.vars["b"]), (&json!(1), &json!(2)));
    let params = spec.params(StageId::new(0), &Axes::new()).expect("it needs no axes");
    assert_eq!((&params["x"], &params["y"]), (&json!(1), &json!(5)));
    assert_eq!(spec.stages.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["s", "t"]);
    assert_eq!(spec.input_file_base(StageId::new(0), "mesh.file"), files.path("lib"));
    assert_eq!(spec.input_file_base(StageId::new(0), "v"), files.path("lib"));
    assert_eq!(spec.input_file_base(StageId::new(0), "own"), files.path(""));
    assert_eq!(spec.input_file_base(StageId::new(0), "given"), PathBuf::new());
}

#[test]
fn overrides_are_typed_and_recorded() {
    let text = "vars: {x: 1}\nstages: {s: {use: x, with: {list: [1, 2], t: \"${x}\"}}}";
    let files = Files::new(&[("main.yaml", text)]);
    let given = ["vars.x=0.5", "stages.s.with.list.1=[3, a]", "stages.s.with.new.deep='7'", "seed=9", "vars.x=0.25"];
    let spec = files.load(&given).expect("they are right");
    assert_eq!(
        spec.params(StageId::new(0), &Axes::new()).unwrap(),
        json!({"list": [1, [3, "a"]], "t": 0.25, "new": {"deep": "7"}})
    );
    assert_eq!((spec.seed, spec.overrides.as_slice()), (9, given.map(str::to_owned).as_slice()));
}

#[test]
fn mistakes_of_a_stage_are_placed_at_what_stands_in_the_file() {
    let spec = spec("stages:\n  s:\n    use: scene\n    with:\n      media: {m: {g: 2}}\n      size: 1_000\n");
    let place = |section, path: &[&str]| {
        let d = spec.diagnostic(StageId::new(0), section, path, "wrong", None);
        (d.line, d.column, d.path)
    };
    assert_eq!(place(Section::With, &["media", "m", "g"]), (5, 22, "stages.s.with.media.m.g".to_owned()));
    assert_eq!(place(Section::With, &["media", "m", "n"]), (5, 15, "stages.s.with.media.m.n".to_owned()));
    assert_eq!(place(Section::With, &[]), (4, 5, "stages.s.with".to_owned()));
    assert_eq!(place(Section::In, &["frames"]), (2, 3, "stages.s.in.frames".to_owned()));
    assert_eq!(place(Section::Use, &[]), (3, 10, "stages.s.use".to_owned()));
    // What is unknown is the key, whatever the words.
    assert_eq!(place(Section::With, &["size"]), (6, 13, "stages.s.with.size".to_owned()));
    let unknown =
        spec.diagnostic(StageId::new(0), Section::With, &["size"], Mistake::new(Kind::UnknownKey, "wrong"), None);
    assert_eq!((unknown.line, unknown.column, unknown.kind), (6, 7, Kind::UnknownKey));
}

/// A value that comes from a var is marked there, one that comes from an axis where it is used; the other place is shown too.
#[test]
fn vars_and_axes_are_shown_with_their_other_place() {
    let text =
        "vars:\n  n: 4\n  m: \"${n}\"\nstages:\n  s: {use: x, foreach: {k: [1]}, with: {a: \"${m}\", b: \"${k}\"}}\n";
    let spec = spec(text);
    let shown = |name: &str| spec.diagnostic(StageId::new(0), Section::With, &[name], "wrong", None).to_string();
    let (of_var, of_axis) = (shown("a"), shown("b"));
    assert!(of_var.contains("main.yaml:2:6: error: stages.s.with.a: wrong"), "{of_var}");
    assert!(of_var.contains("main.yaml:5:44\n") && of_var.contains("------ used here"), "{of_var}");
    assert!(of_axis.contains("main.yaml:5:55: error: stages.s.with.b: wrong"), "{of_axis}");
    assert!(of_axis.contains("main.yaml:5:25\n") && of_axis.contains("- the axis"), "{of_axis}");
}

/// What follows from a reported mistake is not reported: a misspelt section, a name that is not known, a `.nan`.
#[test]
fn nothing_is_reported_twice_under_two_names() {
    let files = Files::new(&[(
        "main.yaml",
        "stages: {s: {use: x, wiht: {a: 1}}, t: {use: x, with: {a: \"${nix}\", b: .nan, c: 1}, in: {p: [}]}}}",
    )]);
    assert!(files.load(&[]).is_err());
    let text = "stages: {s: {use: x, wiht: {a: 1}}, t: {use: x, with: {a: \"${nix}\", b: .nan, c: 1}, in: {p: []}}}";
    let files = Files::new(&[("main.yaml", text)]);
    let (spec, mut report) = read(&files.path("main.yaml"), &[]);
    let spec = spec.expect("much of it can be read");
    let before = report.errors();
    assert_eq!(before, 4, "{report}");
    report.push(spec.diagnostic(StageId::new(0), Section::With, &["a"], "`a` is missing", None));
    report.push(spec.diagnostic(StageId::new(1), Section::With, &["a"], "`a` is empty", None));
    report.push(spec.diagnostic(StageId::new(1), Section::With, &["b"], "`b` is empty", None));
    report.push(spec.diagnostic(StageId::new(1), Section::In, &[] as &[&str], "needs the input `p`", None));
    assert_eq!(report.errors(), before, "{report}");
    report.push(spec.diagnostic(StageId::new(1), Section::With, &["c"], "`c` is wrong", None));
    assert_eq!(report.errors(), before + 1);
}

#[test]
fn many_mistakes_come_in_the_order_of_the_file() {
    let report = mistakes(concat!(
        "pipeline: a b\nseed: 1e99\nvars: {a: \"${b}\", b: \"${a}\"}\nstages:\n",
        "  s: {use: 5, seed: -1, product: yes, foreach: {x: [], y: {linspace: [0, 1]}}}\n  t: scene\n",
    ));
    let places: Vec<&str> =
        report.lines().filter(|l| l.contains("error:")).map(|l| l.split("error: ").nth(1).unwrap()).collect();
    let paths: Vec<&str> = places.iter().map(|p| p.split(':').next().unwrap()).collect();
    assert_eq!(
        paths,
        [
            "pipeline",
            "seed",
            "vars.a",
            "stages.s.use",
            "stages.s.seed",
            "stages.s.product",
            "stages.s.foreach.x",
            "stages.s.foreach.y.linspace",
            "stages.t"
        ],
        "{report}"
    );
}

/// Values multiply through vars and grids; what would fill the memory is refused before it is made.
#[test]
fn what_multiplies_is_bounded() {
    let lists = (1..60).fold("vars:\n  a0: [x, y]\n".to_owned(), |t, i| {
        t + &format!("  a{i}: [\"${{a{j}}}\", \"${{a{j}}}\"]\n", j = i - 1)
    });
    assert!(mistakes(&lists).contains("makes more than"));
    let texts = (1..60)
        .fold("vars:\n  a0: xxxxxxxx\n".to_owned(), |t, i| t + &format!("  a{i}: \"${{a{j}}}${{a{j}}}\"\n", j = i - 1));
    assert!(mistakes(&texts).contains("grows beyond"));
    let chain = (0..200).fold("vars:\n".to_owned(), |t, i| t + &format!("  a{i}: \"${{a{}}}\"\n", i + 1));
    assert!(mistakes(&chain).contains("chain of more than 64"));
    let grid = "stages: {s: {use: x, foreach: {a: {range: [0, 1001]}, b: {range: [0, 1000]}}}}";
    assert!(mistakes(grid).contains("1001000 instances (1001 a x 1000 b) are more than 1000000"));
    // Names that are unknown are looked up among those that are known: not each of thousands among thousands.
    let vars: Vec<String> = (0..5000).map(|i| format!("var{i}: 1")).collect();
    let names: Vec<String> = (0..20_000).map(|i| format!("\"${{vax{i}}}\"")).collect();
    let began = std::time::Instant::now();
    let unknown =
        format!("vars: {{{}}}\nstages: {{s: {{use: x, with: {{a: [{}]}}}}}}", vars.join(", "), names.join(", "));
    assert!(mistakes(&unknown).contains("`${vax0}` is not a var"));
    assert!(began.elapsed().as_secs() < 20, "{:?}", began.elapsed());
    let ring = Files::new(&[("main.yaml", "include: other.yaml"), ("other.yaml", "include: main.yaml")]);
    assert!(ring.load(&[]).unwrap_err().to_string().contains("`main.yaml` includes itself"));
}

/// An override is named by the stages that it can change: through their own parts, through vars of vars, or as the seed.
#[test]
fn overrides_belong_to_the_stages_that_use_them() {
    let text = concat!(
        "vars: {samples: 1, twice: [\"${samples}\", 2], other: 3}\n",
        "stages:\n  a: {use: x, with: {n: \"${twice}\"}}\n  b: {use: x, foreach: {k: [\"${other}\"]}}\n  c: {use: x}\n",
    );
    let given = ["vars.samples=4", "vars.other=5", "stages.c.with.g=0.8", "seed=9", "about=more", "vars.samples=6"];
    let spec = Files::new(&[("main.yaml", text)]).load(&given).unwrap_or_else(|report| panic!("{report}"));
    let of = |stage: usize| spec.overrides_of(StageId::new(stage)).into_iter().collect::<Vec<_>>();
    assert_eq!([of(0), of(1), of(2)], [vec![0, 3, 5], vec![1, 3], vec![2, 3]]);
    assert!(self::spec(text).overrides_of(StageId::new(0)).is_empty());
}

/// Any bytes of a pipeline file or of a table of axes changed: a spec, or mistakes with a place; never a panic or a hang.
/// `MUTATIONS=4000` tries so many in place of the few that every test run tries.
#[test]
fn changed_texts_are_read_or_refused() {
    const TEXT: &str = concat!(
        "pipeline: whole\nseed: 7\nvars: {f_x: 0.1, both: [0, \"${f_x}\"], t: &t [a, \"b\", 'c']}\nstages:\n",
        "  tissue: {use: scene, foreach: {a: {logspace: [1e-3, 1, 4]}, b: {range: [0, 4]}, zip: [[a, b]]}, with: {x: *t}}\n",
        "  frames:\n    use: render\n    in: {scene: {from: tissue, where: {a: 1}, over: [b]}}\n    product: true\n",
        "    foreach: {c: {linspace: [0, 1, 11]}, draw: {n: 9, m: {uniform: [0, 1]}}}\n",
        "    with:\n      <<: {f_x: \"${both}\"}\n      text: |\n        f_x = ${f_x} ${c}\n      samples: 1e3\n",
        "studies:\n  s: {vary: {vars.f_x: [1, 2]}, estimate: frames.m, truth: frames.t, error: rmse_percent}\n",
    );
    const TABLE: &str = "# of today\nmu_a, label,n\r\n0.01,\"a, \"\"b\"\"\",1.0\n\n1e-3,\"2\",1.4\n5,x,.5\n";
    const PIECES: [&str; 22] = [
        "{", "}", "[", "]", ": ", "- ", "\"", "'", "${", "${f_x}", "*t", "&t ", "<<: *t", "\n", "\t", ",", "#", "|",
        "!!", "1e999", "\u{feff}", "---\n",
    ];
    let count: usize = std::env::var("MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(300);
    let mut state = 15_u64;
    let mut below = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    let (mut read, mut refused) = (0, 0);
    for round in 0..2 * count {
        let mut bytes = if round % 2 == 0 { TEXT } else { TABLE }.as_bytes().to_vec();
        for _ in 0..=below(4) {
            let at = below(bytes.len());
            let end = (at + 1 + below(40)).min(bytes.len());
            match below(5) {
                0 => bytes[at] ^= 1 << below(8),
                1 => drop(bytes.drain(at..end)),
                2 => drop(bytes.splice(at..at, PIECES[below(PIECES.len())].bytes())),
                3 => {
                    let again = bytes[at..end].repeat(1 + below(3));
                    drop(bytes.splice(at..at, again));
                }
                _ => bytes.truncate(end),
            }
            if bytes.is_empty() {
                break;
            }
        }
        let began = std::time::Instant::now();
        let sound = if round % 2 == 0 {
            let (spec, report) = read_bytes(Path::new("f.yaml"), &bytes, &[]);
            if let Some(spec) = spec.filter(|_| !report.has_errors()) {
                for (i, stage) in spec.stages.iter_ids() {
                    let first: Axes = stage.foreach.names.iter().cloned().zip(stage.foreach.rows[0].clone()).collect();
                    let _ = spec.params(i, &first);
                }
            }
            assert!(report.has_errors() || !report.to_string().contains("error:"));
            !report.has_errors()
        } else {
            std::str::from_utf8(&bytes).is_ok_and(|text| csv::parse(text).is_ok())
        };
        *(if sound { &mut read } else { &mut refused }) += 1;
        assert!(began.elapsed().as_secs() < 20, "{}", String::from_utf8_lossy(&bytes));
    }
    println!("{read} read, {refused} refused");
    assert!(read > count / 10 && refused > count / 10, "{read} {refused}");
}
