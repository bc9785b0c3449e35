//! Places, aliases, repeated keys, and texts that are meant to hurt.

use super::*;

fn read(text: &str) -> (Option<Node>, String) {
    let sources = [SourceFile::new("f", "", text)];
    let mut report = Report::default();
    let node = parse(&sources, 0, &mut report);
    (node, report.to_string())
}

fn good(text: &str) -> Node {
    let (node, report) = read(text);
    assert_eq!(report, "", "{text}");
    node.expect("a file without mistakes has a tree")
}

#[test]
fn every_key_and_value_has_its_place() {
    let root = good("µ: {a: [1, 'zwei'], b: }\nlist:\n  - x: 1.5\n");
    let place = |s: Span| (s.line, s.column, s.len);
    let inner = root.get("µ").unwrap();
    assert_eq!(place(root.entry("µ").unwrap().at), (1, 1, 1));
    assert_eq!(place(inner.span), (1, 4, 21));
    assert_eq!(place(inner.entry("a").unwrap().at), (1, 5, 1));
    assert_eq!(place(inner.get("a").unwrap().step("1").unwrap().1.span), (1, 12, 6));
    let x = root.get("list").unwrap().step("0").unwrap().1;
    assert_eq!(place(x.get("x").unwrap().span), (3, 8, 3));
    assert_eq!(root.to_json(), serde_json::json!({"µ": {"a": [1, "zwei"], "b": null}, "list": [{"x": 1.5}]}));
}

#[test]
fn merge_keys_and_aliases_copy_and_written_keys_win() {
    let root = good("base: &b {x: 1, y: 2}\nmore: &m {y: 3, z: 4}\nall: {<<: [*b, *m], x: 0}\nsame: *b\n");
    assert_eq!(root.get("all").unwrap().to_json(), serde_json::json!({"x": 0, "y": 2, "z": 4}));
    assert_eq!(root.get("same").unwrap().to_json(), serde_json::json!({"x": 1, "y": 2}));
}

#[test]
fn carriage_returns_change_nothing() {
    let root = good("a: 1\r\nb: text\r\n");
    assert_eq!(root.to_json(), serde_json::json!({"a": 1, "b": "text"}));
}

#[test]
fn all_repeated_keys_and_infinite_numbers_are_found_at_once() {
    let (_, report) = read("a: {x: 1, x: 2}\nb: .nan\na: 3\nc: [1e999]\n");
    for place in ["f:1:11: error: a.x:", "f:2:4: error: b:", "f:3:1: error: a:", "f:4:5: error: c.0:"] {
        assert!(report.contains(place), "{place} in\n{report}");
    }
}

/// A comma within a number is found where YAML would take half of it; lists of numbers stay lists.
#[test]
fn decimal_commas_are_no_second_entry() {
    for (text, place, meant) in [
        ("vars: {mu: 0,05, n: 1}", "f:1:12: error: vars.mu: `0,05` is no number", "write `0.05`"),
        ("f_x: [0, 0,05, 0,1]", "f:1:10: error: f_x.1: `0,05` is no number", "write `0.05`"),
        ("a: {thickness: 1,5 mm}", "f:1:16: error: a.thickness: `1,5 mm` is no number", "write `1.5 mm`"),
    ] {
        let (node, report) = read(text);
        assert!(report.contains(place) && report.contains(meant), "{report}");
        assert_eq!(report.matches("error:").count(), 1, "{report}");
        assert!(node.is_some_and(|node| node.holds_broken()));
    }
    assert_eq!(good("a: [0,1,10]").get("a").unwrap().to_json(), serde_json::json!([0, 1, 10]));
    assert_eq!(good("a: {b: 1,c: 2}").get("a").unwrap().to_json(), serde_json::json!({"b": 1, "c": 2}));
    assert_eq!(good("a: {b: 1, 2: 3}").get("a").unwrap().to_json(), serde_json::json!({"b": 1, "2": 3}));
}

#[test]
fn hostile_texts_get_one_message() {
    let deep_flow = "[".repeat(100_000);
    let deep_block: String = (0..2000).map(|i| format!("{}a:\n", " ".repeat(i))).collect();
    let bomb = (1..12).fold("a0: &a0 [x, x]\n".to_owned(), |t, i| {
        let j = i - 1;
        t + &format!("a{i}: &a{i} [{}]\n", vec![format!("*a{j}"); 9].join(", "))
    });
    let long = format!("a: &a {}\nb: [{}]\n", "x".repeat(1 << 20), vec!["*a"; 1000].join(", "));
    let chain = (1..200).fold("a0: &a0 [x]\n".to_owned(), |t, i| t + &format!("a{i}: &a{i} [*a{}]\n", i - 1));
    for (text, says) in [
        (deep_flow.as_str(), "64 deep"),
        (&deep_block, "64 deep"),
        (&bomb, "500000 values"),
        (&chain, "64 deep"),
        (&long, "500000 values"),
        ("a: &x [*x]", "inside the value that it names"),
        ("a: *nowhere", "not YAML"),
        ("a: 1\n---\nb: 2\n", "second YAML document"),
        ("a: !python/object {}\n", "tag `!python/object`"),
        ("a:\n\tb: 1\n", "no tabs"),
        ("a: b: c\n", "not YAML"),
        ("a: [1, 2\nb: 3\n", "not YAML"),
        ("a: \"open\n", "not YAML"),
        ("? [a, b]\n: 1\n", "not a list or a map"),
        (": 1\n", "a key is missing"),
        ("<<: 3\n", "merges a map"),
    ] {
        let (node, report) = read(text);
        assert!(node.is_none(), "{says}");
        assert!(report.contains(says), "{says}: {report}");
        assert_eq!(report.matches("error:").count(), 1, "{report}");
    }
}

#[test]
fn megabytes_of_repeated_keys_end_early() {
    let (node, report) = read(&"a: 1\n".repeat(200_000));
    assert!(node.is_none() && report.contains("too many mistakes"));
}
