//! The report: one file that asks nobody for anything, the same for the same results, whatever names and outputs hold.

use crate::space::{SMALL, Space};

/// The page beside the pictures.
fn page(space: &Space, pipeline: &str) -> String {
    let path = space.outputs().join("latest").join(pipeline).join("report.html");
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Without what differs between two runs of the same work.
fn unmarked(page: &str) -> String {
    let mut out = String::new();
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("<span class=\"run\">") {
        out.push_str(before);
        let (_, after) = after.split_once("</span>").expect("a marked timing ends");
        rest = after;
    }
    out + rest
}

/// All values of an attribute.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let begin = format!(" {name}=\"");
    page.split(&begin).skip(1).map(|rest| rest.split('"').next().unwrap_or_default()).collect()
}

/// What a browser would fetch or run of a page: nothing but what is in it and named by the policy.
fn assert_self_contained(page: &str) {
    let policy = attributes(page, "content").into_iter().find(|c| c.contains("default-src")).expect("a policy");
    assert!(policy.contains("default-src &#39;none&#39;") || policy.contains("default-src 'none'"), "{policy}");
    assert!(policy.contains("img-src data:;") && !policy.contains("unsafe"), "{policy}");
    for source in attributes(page, "src") {
        assert!(source.starts_with("data:image/"), "{source:.80}");
    }
    for link in attributes(page, "href") {
        assert!(link.starts_with('#') || !link.contains(':'), "{link}");
    }
    for (one, count) in [("<style", 1), ("<script", 1), ("<link", 0), ("<iframe", 0), ("@import", 0)] {
        assert_eq!(page.matches(one).count(), count, "{one}");
    }
    assert!(attributes(page, "style").is_empty(), "a style attribute, which the policy forbids");
    assert!(!page.contains(" onerror=") && !page.contains(" onclick="), "a handler in the text");
    // Every picture says what it is.
    assert_eq!(page.matches("<img ").count(), page.matches("<img alt=\"").count());
    assert_eq!(page.matches("<svg ").count(), page.matches("role=\"img\"").count());
}

/// A whole page of a small pipeline: what it asks, its figures, stages, costs, params and where it all comes from; no output is in the way.
#[test]
fn a_page_holds_all_of_a_pipeline() {
    let text = format!("# What is left of M_AC?\n#\n# Expected:\n#   half\n{SMALL}");
    let space = Space::with(&text);
    space.turbid(&["run", "p.yaml", "--set", "vars.samples=8"]).ok();
    let said = space.turbid(&["report", "p.yaml", "--set", "vars.samples=8"]).ok();
    assert!(said.contains("report.html (") && said.contains(" ms)"), "{said}");
    let page = page(&space, "small");
    assert_self_contained(&page);
    for part in [
        "<h1>small</h1>",
        "All 7 instances are up to date",
        "What is left of M_AC?",
        "<pre>  half</pre>",
        "reflectance.reflectance",
        "demodulate 9",
        "m_ac per pixel",
        "turbid run p.yaml --set vars.samples=8",
        "low_signal",
        "CPU s",
        "data:image/png;base64,",
        "What was left out",
        "up to date",
    ] {
        assert!(page.contains(part), "`{part}` is missing");
    }
    // Where params come from.
    let row = |param: &str, from: &str| {
        let found = page
            .split("<tr>")
            .any(|row| row.contains(&format!(">{param}</td>")) && row.contains(&format!(">{from}</td>")));
        assert!(found, "{param} is not from {from}");
    };
    row("low_signal", "file");
    row("noise_bias", "default");
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
}

/// The same results give the same bytes but for what is marked as of the run, wherever and whenever they were computed.
#[test]
fn the_same_results_give_the_same_page() {
    let pages = ["1", "2"].map(|jobs| {
        let space = Space::with(SMALL);
        space.turbid(&["run", "p.yaml", "-j", jobs]).ok();
        space.turbid(&["report", "p.yaml"]).ok();
        page(&space, "small")
    });
    assert!(pages[0].contains("<span class=\"run\">"), "nothing is marked");
    assert_eq!(unmarked(&pages[0]), unmarked(&pages[1]));
}

/// Names, comments and texts are text, also where they are markup.
#[test]
fn texts_are_no_markup() {
    let evil = "<script>alert(1)</script><img src=x onerror=alert(1)>\"'&";
    let text = SMALL
        .replace("pipeline: small\n", &format!("pipeline: small\nabout: '{}'\n", evil.replace('\'', "''")))
        .replace("{m: {A_rho", "{\"<b>m</b>\": {A_rho")
        .replacen("medium: m}", "medium: \"<b>m</b>\"}", 1);
    let space = Space::with(&format!("# {evil}\n{text}"));
    let ran = space.turbid(&["run", "p.yaml"]);
    // A medium's name may be refused; the rest is as it was.
    if ran.code != Some(0) {
        space.write("p.yaml", &format!("# {evil}\n{}", text.replace("<b>m</b>", "m")));
        space.turbid(&["run", "p.yaml"]).ok();
    }
    space.turbid(&["report", "p.yaml"]).ok();
    let page = page(&space, "small");
    let shown = page.matches("&lt;script&gt;alert(1)&lt;/script&gt;").count();
    assert!(shown >= 2, "{shown} times of comment and about");
    assert!(
        !page.contains("<script>alert") && !page.contains("<img src=x") && !page.contains("<b>m"),
        "markup came through"
    );
}

/// Before anything ran the page says what to do; a stage that failed says why; damaged outputs are named and nothing else is lost.
#[test]
fn what_is_missing_or_damaged_is_said() {
    let space = Space::with(SMALL);
    space.turbid(&["report", "p.yaml", "--to", "fresh.html"]).ok();
    assert!(!space.outputs().exists(), "to look is to change nothing");
    let fresh = std::fs::read_to_string(space.path().join("fresh.html")).expect("it was written");
    assert_self_contained(&fresh);
    for part in ["Nothing has run yet", "turbid run p.yaml", "to run", "waits"] {
        assert!(fresh.contains(part), "`{part}` is missing");
    }
    space.turbid(&["run", "p.yaml", "frames"]).ok();
    space.turbid(&["report", "p.yaml"]).ok();
    let part = page(&space, "small");
    assert!(part.contains("2 of 7 instances are up to date") || part.contains(" of 7 instances are up to date"));
    space.turbid(&["run", "p.yaml"]).ok();
    // Every blob is damaged: what cannot be read is named.
    for file in space.files("outputs/store") {
        let name = file.to_string_lossy().into_owned();
        if name.contains("pack") {
            let mut bytes = std::fs::read(&file).expect("it is there");
            let at = bytes.len() / 2;
            bytes.iter_mut().skip(at).take(64).for_each(|b| *b ^= 0xff);
            std::fs::write(&file, bytes).expect("it is ours");
        }
    }
    let done = space.turbid(&["report", "p.yaml", "--to", "damaged.html"]);
    assert!(matches!(done.code, Some(0 | 1)) && !done.err.contains("panicked"), "{}", done.err);
}

#[test]
fn a_wrong_place_is_refused() {
    let space = Space::with(SMALL);
    let refused = space.turbid(&["report", "p.yaml", "--to", "no/such/folder.html"]).fails(2);
    assert!(refused.contains("there is no folder no/such"), "{refused}");
    let refused = space.turbid(&["report", "p.yaml", "--to", "."]).fails(2);
    assert!(refused.contains("a folder"), "{refused}");
    let refused = space.turbid(&["report", "none.yaml"]).fails(2);
    assert!(refused.contains("none.yaml"), "{refused}");
}

/// Thousands of instances: the page counts them and stays small.
#[test]
fn many_instances_stay_a_page() {
    let space = Space::with(
        "pipeline: many\nstages:\n  table:\n    use: build_lut\n    foreach: {n: {linspace: [1.0, 1.5, 3000]}}\n    with: {model: diffusion, f_x: [0, 0.1], mu_a: [0.01, 0.1], mu_s_prime: [0.5, 2], g: 0.8, n: \"${n}\"}\n",
    );
    space.turbid(&["report", "p.yaml"]).ok();
    let page = page(&space, "many");
    assert!(page.contains("and 2500 more") && page.len() < 150_000, "{} bytes", page.len());
    assert!(page.contains("values)"), "the param that differs shows its range");
}

/// The list of runs, and two of them beside each other: params, measures, metrics with z, a page with pictures.
#[test]
fn runs_are_listed_and_compared() {
    let space = Space::with(SMALL);
    assert!(space.turbid(&["runs"]).ok().contains("nothing has run yet"));
    space.turbid(&["run", "p.yaml"]).ok();
    space.turbid(&["run", "p.yaml", "--set", "vars.samples=8"]).ok();
    space.turbid(&["run", "p.yaml"]).ok();
    let listed = space.turbid(&["runs"]).ok();
    assert!(listed.lines().count() == 4 && listed.contains("vars.samples=8") && listed.contains("p.yaml"), "{listed}");
    assert_eq!(space.turbid(&["runs", "-n", "1"]).ok().lines().count(), 2);
    let one: serde_json::Value = space
        .turbid(&["runs", "-n", "2", "--json"])
        .ok()
        .lines()
        .next()
        .map(|l| serde_json::from_str(l).expect("JSON"))
        .expect("a line");
    assert!(one["ran"] == 5 && one["hits"] == 2 && one["seconds"].as_f64().is_some(), "{one}");
    let differ = space.turbid(&["diff", "last~1", "last", "--to", "diff.html"]).ok();
    for part in ["with.samples  16", "8", "2 with the same key, 5 that differ", "rms of z", "same random numbers"] {
        assert!(differ.contains(part), "`{part}` is missing:\n{differ}");
    }
    let page = std::fs::read_to_string(space.path().join("diff.html")).expect("it was written");
    assert_self_contained(&page);
    assert!(page.matches("<img ").count() >= 9, "three pictures for each output");
    // A pipeline with overrides against a run: the same results.
    let same = space.turbid(&["diff", "p.yaml", "last", "--set-a", "vars.samples=8"]).ok();
    assert!(same.contains("7 with the same key, 0 that differ"), "{same}");
    let single = space.turbid(&["diff", "p.yaml:frames", "p.yaml:phantom_frames"]).ok();
    assert!(single.contains("frames and phantom_frames") && single.contains("rms of z"), "{single}");
    for (wrong, why) in [("last~9", "there are 2 runs"), ("nosuch", "neither a file nor a run"), ("2", "runs begin so")]
    {
        let refused = space.turbid(&["diff", wrong, "last"]).fails(2);
        assert!(refused.contains(why), "{refused}");
    }
}
