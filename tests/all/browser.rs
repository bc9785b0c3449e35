//! The report in a browser: no message, no request, sorting by mouse and keys, both colour schemes, narrow and wide.
//!
//! Runs where Chromium is installed (`apt-get install --no-install-recommends chromium`); elsewhere it says so and the tests of the text stand alone
//! (`report.rs`). The browser is driven by its debugging protocol over two pipes; `TURBID_SCREENSHOTS=FOLDER` keeps what it showed.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::space::{SMALL, Space};

/// A browser with one page.
struct Browser {
    process: Child,
    to: File,
    from: BufReader<File>,
    session: Option<String>,
    count: u64,
    /// Everything that it told without being asked.
    events: Vec<Value>,
    _folder: tempfile::TempDir,
}

impl Browser {
    /// `None` where there is no Chromium.
    fn start() -> Option<Self> {
        let is_there = |name: &&&str| {
            let found = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
            found.is_ok_and(|status| status.success())
        };
        let program = ["chromium", "chromium-browser", "google-chrome"].iter().find(is_there)?;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [there, back] = ["there", "back"].map(|name| folder.path().join(name));
        let made = Command::new("mkfifo").args([&there, &back]).status();
        assert!(made.expect("mkfifo is there").success());
        // The protocol reads from descriptor 3 and writes to 4.
        let line = "exec \"$0\" --headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run --hide-scrollbars \
                    --user-data-dir=\"$1\" --remote-debugging-pipe 3<\"$2\" 4>\"$3\"";
        let mut command = Command::new("sh");
        command.args(["-c", line, program]).arg(folder.path().join("profile")).args([&there, &back]);
        let process = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("sh");
        let to = OpenOptions::new().write(true).open(&there).expect("the pipe is ours");
        let from = BufReader::new(File::open(&back).expect("the pipe is ours"));
        let mut browser = Self { process, to, from, session: None, count: 0, events: Vec::new(), _folder: folder };
        let target = browser.ask("Target.createTarget", &json!({"url": "about:blank"}))["targetId"].clone();
        let attached = browser.ask("Target.attachToTarget", &json!({"targetId": target, "flatten": true}));
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Runtime", "Log", "Network", "Page"] {
            browser.ask(&format!("{domain}.enable"), &json!({}));
        }
        Some(browser)
    }

    fn message(&mut self) -> Value {
        let mut bytes = Vec::new();
        loop {
            let mut byte = [0];
            self.from.read_exact(&mut byte).expect("the browser lives");
            if byte[0] == 0 {
                return serde_json::from_slice(&bytes).expect("the protocol is JSON");
            }
            bytes.push(byte[0]);
        }
    }

    fn ask(&mut self, method: &str, params: &Value) -> Value {
        self.count += 1;
        let mut message = json!({"id": self.count, "method": method, "params": params});
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("the browser lives");
        loop {
            let mut answer = self.message();
            if answer["id"] == self.count {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].take();
            }
            self.events.push(answer);
        }
    }

    fn open(&mut self, path: &Path) {
        let url = format!("file://{}", path.display());
        self.events.clear();
        self.ask("Page.navigate", &json!({"url": url}));
        while !self.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            let event = self.message();
            self.events.push(event);
        }
    }

    /// The value of an expression, as text.
    fn value(&mut self, expression: &str) -> String {
        let answer = self.ask("Runtime.evaluate", &json!({"expression": expression, "returnByValue": true}));
        assert!(answer.get("exceptionDetails").is_none(), "{expression}: {answer}");
        match &answer["result"]["value"] {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        }
    }

    /// Sets width and colours; whether the page is wider than the window.
    fn look(&mut self, width: u32, scheme: &str) {
        let metrics = json!({"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false});
        self.ask("Emulation.setDeviceMetricsOverride", &metrics);
        let features = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        self.ask("Emulation.setEmulatedMedia", &features);
    }

    fn picture(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("TURBID_SCREENSHOTS").map(PathBuf::from) else { return };
        let shot = self.ask("Page.captureScreenshot", &json!({"format": "png", "captureBeyondViewport": true}));
        let bytes = STANDARD.decode(shot["data"].as_str().expect("base64")).expect("base64");
        std::fs::create_dir_all(&folder).expect("the folder is ours");
        std::fs::write(folder.join(name), bytes).expect("the folder is ours");
    }

    /// What was said in the console, and what was asked for beside the page itself.
    fn complaints(&self, page: &Path) -> Vec<String> {
        let own = format!("file://{}", page.display());
        let event = |event: &Value| {
            let params = &event["params"];
            match event["method"].as_str()? {
                "Runtime.consoleAPICalled" | "Runtime.exceptionThrown" | "Log.entryAdded" => Some(params.to_string()),
                "Network.requestWillBeSent" => {
                    let url = params["request"]["url"].as_str().unwrap_or_default();
                    (url != own && !url.starts_with("data:")).then(|| format!("request: {url}"))
                }
                _ => None,
            }
        };
        self.events.iter().filter_map(event).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// First cells of a table, in the order that is shown.
const FIRST_CELLS: &str =
    "[...document.querySelector('#stages table').tBodies[0].rows].map(r => r.cells[0].textContent).join(' ')";

#[test]
fn the_report_is_read_in_a_browser() {
    let Some(mut browser) = Browser::start() else {
        eprintln!("there is no Chromium here: the page was not looked at");
        return;
    };
    let space = Space::with(&format!("# What does a browser say?\n{SMALL}"));
    space.turbid(&["run", "p.yaml"]).ok();
    space.turbid(&["report", "p.yaml"]).ok();
    let page = std::fs::canonicalize(space.outputs().join("latest/small/report.html")).expect("it was written");
    browser.open(&page);
    assert_eq!(browser.complaints(&page), Vec::<String>::new());
    // The policy lets style and script of the page through: the script has made buttons, the style has its colours.
    let before = browser.value(FIRST_CELLS);
    let click = |browser: &mut Browser| browser.value("document.querySelector('#stages th button').click()");
    click(&mut browser);
    let names: Vec<&str> = before.split(' ').collect();
    let mut sorted = names.clone();
    sorted.sort_unstable();
    assert_ne!(names, sorted, "sorting would not show");
    assert_eq!(browser.value(FIRST_CELLS), sorted.join(" "));
    assert_eq!(browser.value("document.querySelector('#stages th').getAttribute('aria-sort')"), "ascending");
    // And by keys: the button is focused, Enter presses it.
    browser.value("document.querySelector('#stages th button').focus()");
    for kind in ["keyDown", "keyUp"] {
        browser.ask(
            "Input.dispatchKeyEvent",
            &json!({"type": kind, "key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"}),
        );
    }
    sorted.reverse();
    assert_eq!(browser.value(FIRST_CELLS), sorted.join(" "));
    // Numbers sort as numbers: 10 stands behind 9.
    let column = "[...document.querySelector('#cost table').tBodies[0].rows].map(r => Number(r.cells[2].textContent))";
    browser.value("document.querySelectorAll('#cost th button')[2].click()");
    let rising = format!("(v => v.every((x, i) => i === 0 || v[i - 1] <= x))({column})");
    assert_eq!(browser.value(&rising), "true");
    let mut papers = Vec::new();
    for scheme in ["light", "dark"] {
        for width in [400, 1400] {
            browser.look(width, scheme);
            let wider = browser.value("document.documentElement.scrollWidth - window.innerWidth");
            assert!(wider.parse::<f64>().is_ok_and(|wider| wider <= 0.0), "{width} px: {wider} px too wide");
            browser.picture(&format!("report_{scheme}_{width}.png"));
        }
        papers.push(browser.value("getComputedStyle(document.body).backgroundColor"));
    }
    assert_ne!(papers[0], papers[1], "both schemes have one paper");
    // Every picture was taken: none is broken.
    let broken = "[...document.images].filter(i => !(i.complete && i.naturalWidth > 0)).length";
    assert_eq!(browser.value(broken), "0");
    assert_eq!(browser.complaints(&page), Vec::<String>::new());
    // Without the script the tables are read as they are.
    browser.ask("Emulation.setScriptExecutionDisabled", &json!({"value": true}));
    browser.open(&page);
    assert_eq!(browser.complaints(&page), Vec::<String>::new());
}

/// Pages that somebody names are looked at and kept as pictures: `TURBID_PAGES=a.html,b.html` with `TURBID_SCREENSHOTS`.
#[test]
fn named_pages_are_looked_at() {
    let pages = std::env::var("TURBID_PAGES").unwrap_or_default();
    for page in pages.split(',').filter(|page| !page.is_empty()) {
        let page = std::fs::canonicalize(page).expect("a page");
        let mut browser = Browser::start().expect("Chromium");
        browser.open(&page);
        let name = page.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for (scheme, width) in [("light", 1400), ("dark", 1400), ("light", 400), ("dark", 400)] {
            browser.look(width, scheme);
            browser.picture(&format!("{name}_{scheme}_{width}.png"));
        }
        assert_eq!(browser.complaints(&page), Vec::<String>::new());
    }
}
