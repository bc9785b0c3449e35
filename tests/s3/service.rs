//! A service that speaks S3, on this machine, with objects in memory and faults on demand: PUT, GET with ranges, lists in pages.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;
use std::time::Duration;

use sha2::{Digest, Sha256};

/// The one bucket that there is.
pub const BUCKET: &str = "lab";
/// Objects in a page of a list, so that a few objects have several.
const PAGE: usize = 3;

/// What goes wrong with a request.
#[derive(Clone, Debug)]
pub enum Fault {
    /// A status with a code and a region.
    Refused(u16, &'static str, Option<&'static str>),
    /// The connection ends before an answer.
    Reset,
    /// It ends in the middle of one.
    Truncated,
    /// Nothing comes for so long.
    Stalled(Duration),
    /// An answer that repeats the headers of the request.
    Echo(u16),
    /// All is well, and nothing of it is kept.
    Lost,
}

/// A fault for requests of a method whose path contains a word, so many times.
struct Planned {
    method: &'static str,
    path: &'static str,
    times: usize,
    fault: Fault,
}

/// A request as it came.
#[derive(Clone, Debug)]
pub struct Seen {
    pub method: String,
    /// With its query.
    pub target: String,
    pub headers: BTreeMap<String, String>,
    pub body: usize,
    pub answered: usize,
}

#[derive(Default)]
struct State {
    /// Bytes, and when they were written.
    objects: BTreeMap<String, (Vec<u8>, usize)>,
    writes: usize,
    planned: Vec<Planned>,
    /// Of a thousand requests so many end in a fault that passes.
    per_mille: u64,
    random: u64,
    page: usize,
    seen: Vec<Seen>,
}

pub struct Service {
    state: Arc<Mutex<State>>,
    address: String,
    closing: Arc<AtomicBool>,
}

impl Service {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("this machine has a port left");
        let address = listener.local_addr().expect("it is bound").to_string();
        let state = Arc::new(Mutex::new(State { random: 1, page: PAGE, ..State::default() }));
        let closing = Arc::new(AtomicBool::new(false));
        let (shared, ends) = (state.clone(), closing.clone());
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if ends.load(Ordering::Relaxed) {
                    break;
                }
                let shared = shared.clone();
                thread::spawn(move || serve(stream, &shared));
            }
        });
        Self { state, address, closing }
    }

    pub fn endpoint(&self) -> String {
        format!("http://{}", self.address)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no thread of the service panics")
    }

    /// The next `times` requests of this kind fail.
    pub fn plan(&self, method: &'static str, path: &'static str, times: usize, fault: Fault) {
        self.state().planned.push(Planned { method, path, times, fault });
    }

    pub fn plan_nothing(&self) {
        let mut state = self.state();
        state.planned.clear();
        state.per_mille = 0;
    }

    /// From now on of a thousand requests so many fail for once, by chance.
    pub fn fail_by_chance(&self, per_mille: u64) {
        self.state().per_mille = per_mille;
    }

    /// Lists as those of Amazon.
    pub fn list_by_the_thousand(&self) {
        self.state().page = 1000;
    }

    pub fn names(&self) -> Vec<String> {
        self.state().objects.keys().cloned().collect()
    }

    pub fn content(&self, name: &str) -> Vec<u8> {
        self.state().objects[name].0.clone()
    }

    /// All objects as they are.
    pub fn objects(&self) -> BTreeMap<String, (Vec<u8>, usize)> {
        self.state().objects.clone()
    }

    /// These objects and no others.
    pub fn restore(&self, objects: &BTreeMap<String, (Vec<u8>, usize)>) {
        self.state().objects = objects.clone();
    }

    /// Puts other bytes under a name, or removes it.
    pub fn replace(&self, name: &str, bytes: Option<Vec<u8>>) {
        let mut state = self.state();
        match bytes {
            Some(bytes) => state.objects.get_mut(name).expect("it is there").0 = bytes,
            None => drop(state.objects.remove(name)),
        }
    }

    /// The requests since this was last asked.
    pub fn take_seen(&self) -> Vec<Seen> {
        std::mem::take(&mut self.state().seen)
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.closing.store(true, Ordering::Relaxed);
        let _ = TcpStream::connect(&self.address);
    }
}

/// The requests of one connection.
fn serve(stream: TcpStream, state: &Mutex<State>) {
    let Ok(mut to) = stream.try_clone() else { return };
    let mut from = BufReader::new(stream);
    while let Some((seen, body)) = request(&mut from) {
        let fault = state.lock().expect("no panic").fault(&seen);
        let (status, head, mut answer) = match &fault {
            Some(Fault::Reset) => break,
            Some(Fault::Stalled(time)) => {
                thread::sleep(*time);
                break;
            }
            Some(Fault::Refused(status, code, region)) => refusal(*status, code, *region),
            Some(Fault::Echo(status)) => {
                let headers: String = seen.headers.iter().map(|(name, value)| format!("{name}: {value} ")).collect();
                refusal(*status, &format!("Odd</Code><Message>{headers}</Message><Code>Odd"), None)
            }
            Some(Fault::Lost) => (200, String::new(), Vec::new()),
            Some(Fault::Truncated) | None => state.lock().expect("no panic").answer(&seen, body),
        };
        let length = answer.len();
        if matches!(fault, Some(Fault::Truncated)) {
            answer.truncate(length / 2);
        }
        state.lock().expect("no panic").seen.push(Seen { answered: answer.len(), ..seen });
        let cut = if matches!(fault, Some(Fault::Truncated)) { length.max(1) } else { length };
        let head = format!("HTTP/1.1 {status} Told\r\ncontent-length: {cut}\r\n{head}\r\n");
        if to.write_all(&[head.as_bytes(), &answer].concat()).is_err() || cut != answer.len() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
}

fn request(from: &mut impl BufRead) -> Option<(Seen, Vec<u8>)> {
    let mut line = String::new();
    from.read_line(&mut line).ok().filter(|n| *n > 0)?;
    let mut words = line.split_whitespace();
    let (method, target) = (words.next()?.to_owned(), words.next()?.to_owned());
    let mut headers = BTreeMap::new();
    loop {
        let mut line = String::new();
        from.read_line(&mut line).ok().filter(|n| *n > 0)?;
        let Some((name, value)) = line.trim_end().split_once(':') else { break };
        headers.insert(name.to_ascii_lowercase(), value.trim().to_owned());
    }
    let length = headers.get("content-length").and_then(|n| n.parse().ok()).unwrap_or(0);
    let mut body = vec![0; length];
    from.read_exact(&mut body).ok()?;
    Some((Seen { method, target, headers, body: length, answered: 0 }, body))
}

/// Status, further headers, body.
type Answer = (u16, String, Vec<u8>);

fn refusal(status: u16, code: &str, region: Option<&str>) -> Answer {
    let header = region.map(|region| format!("x-amz-bucket-region: {region}\r\n")).unwrap_or_default();
    (status, header, format!("<?xml version=\"1.0\"?><Error><Code>{code}</Code></Error>").into_bytes())
}

impl State {
    fn fault(&mut self, seen: &Seen) -> Option<Fault> {
        // Knuth's MMIX generator.
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let fits = |p: &&mut Planned| p.times > 0 && seen.method == p.method && seen.target.contains(p.path);
        if let Some(planned) = self.planned.iter_mut().find(fits) {
            planned.times -= 1;
            return Some(planned.fault.clone());
        }
        let by_chance = [
            Fault::Reset,
            Fault::Truncated,
            Fault::Refused(500, "InternalError", None),
            Fault::Refused(503, "SlowDown", None),
        ];
        let chance = self.random >> 33;
        (chance % 1000 < self.per_mille).then(|| by_chance[(chance / 1000 % 4) as usize].clone())
    }

    fn answer(&mut self, seen: &Seen, body: Vec<u8>) -> Answer {
        let (path, query) = seen.target.split_once('?').unwrap_or((&seen.target, ""));
        if !is_signed(seen, &body) {
            return refusal(403, "SignatureDoesNotMatch", None);
        }
        let Some(key) = path.strip_prefix('/').and_then(|path| path.strip_prefix(BUCKET)?.strip_prefix('/')) else {
            return refusal(404, "NoSuchBucket", None);
        };
        match (seen.method.as_str(), key) {
            ("GET", "") => (200, String::new(), self.list(query).into_bytes()),
            ("GET", key) => match self.objects.get(key) {
                Some((bytes, _)) => part(bytes, seen.headers.get("range").map(String::as_str)),
                None => refusal(404, "NoSuchKey", None),
            },
            ("PUT", key) => {
                self.writes += 1;
                self.objects.insert(key.to_owned(), (body, self.writes));
                (200, String::new(), Vec::new())
            }
            _ => refusal(405, "MethodNotAllowed", None),
        }
    }

    fn list(&self, query: &str) -> String {
        let of = |name: &str| {
            let value = query.split('&').find_map(|pair| pair.strip_prefix(name)?.strip_prefix('='));
            value.map(|value| value.replace("%2F", "/"))
        };
        let (prefix, after) = (of("prefix").unwrap_or_default(), of("continuation-token"));
        let all = self.objects.iter().filter(|(name, _)| name.starts_with(&prefix));
        let mut left = all.filter(|(name, _)| after.as_ref().is_none_or(|after| *name > after)).peekable();
        let mut xml = "<ListBucketResult>".to_owned();
        let mut last = None;
        for (name, (bytes, time)) in left.by_ref().take(self.page) {
            let (seconds, length) =
                (format!("2026-01-01T{:02}:{:02}:{:02}.000Z", time / 3600, time / 60 % 60, time % 60), bytes.len());
            xml.push_str(&format!(
                "<Contents><Key>{name}</Key><LastModified>{seconds}</LastModified><Size>{length}</Size></Contents>"
            ));
            last = Some(name);
        }
        if let (Some(_), Some(last)) = (left.peek(), last) {
            xml.push_str(&format!(
                "<IsTruncated>true</IsTruncated><NextContinuationToken>{last}</NextContinuationToken>"
            ));
        }
        xml.push_str("</ListBucketResult>");
        xml
    }
}

/// Whether a request has the headers of a signature, and a payload that is what it says.
fn is_signed(seen: &Seen, body: &[u8]) -> bool {
    let header = |name: &str| seen.headers.get(name).map_or("", String::as_str);
    let payload: String = Sha256::digest(body).iter().map(|byte| format!("{byte:02x}")).collect();
    let authorization = header("authorization");
    authorization.starts_with("AWS4-HMAC-SHA256 Credential=")
        && authorization.contains("Signature=")
        && header("x-amz-content-sha256") == payload
        && header("x-amz-date").len() == 16
        && !seen.target.contains("X-Amz-")
}

/// The bytes that a range asks for.
fn part(bytes: &[u8], range: Option<&str>) -> Answer {
    let Some(range) = range.and_then(|range| range.strip_prefix("bytes=")) else {
        return (200, String::new(), bytes.to_vec());
    };
    let (first, last) = range.split_once('-').expect("a range has two ends");
    let (first, last): (usize, usize) = (first.parse().expect("a number"), last.parse().expect("a number"));
    if first >= bytes.len() {
        return refusal(416, "InvalidRange", None);
    }
    (206, String::new(), bytes[first..(last + 1).min(bytes.len())].to_vec())
}
