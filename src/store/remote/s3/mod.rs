//! Objects in a bucket of S3 or of a service that speaks like it: PUT, GET with ranges, LIST.

mod answer;
mod date;
mod profile;
mod retry;
mod secret;
mod settings;
mod sign;
mod told;
mod transport;

use std::env;
use std::ops::Range;
use std::path::Path;
use std::thread;
use std::time::{SystemTime, UNIX_EPOCH};

use super::objects::{Counter, Listed, Objects, RemoteError, Traffic};
use crate::store::disk;
use answer::{Complaint, complaint, page};
use retry::TRIES;
use settings::{Endpoint, Settings, Sources};
use sign::{Request, encoded, headers, query_text};
use told::Refusal;
use transport::{Answer, Fault, Transport};

/// No file with keys is longer.
const LONGEST_FILE: u64 = 1 << 20;
/// No page of a list, and nothing that is read of a refusal, is longer.
const LONGEST_PAGE: u64 = 16 << 20;

/// A prefix of a bucket.
pub(super) struct S3 {
    transport: Transport,
    settings: Settings,
    bucket: String,
    prefix: String,
    /// `http` or `https`, and host with port.
    scheme: &'static str,
    host: String,
    /// Encoded, what stands before the name of an object: `/bucket/prefix/` or `/prefix/`.
    base: String,
    /// The path of the bucket.
    root: String,
    counter: Counter,
}

impl S3 {
    /// With keys, region and endpoint of the environment and the profile files.
    ///
    /// Error: they are missing or wrong.
    pub fn of_environment(bucket: &str, prefix: &str) -> Result<Self, RemoteError> {
        let sources = Sources { variable: &|name| env::var(name).ok(), file: &read };
        let settings = Settings::read(&sources).map_err(RemoteError::new)?;
        let authorities = env::var_os("AWS_CA_BUNDLE").filter(|path| !path.is_empty());
        let patience = env::var("TURBID_STORE_TIMEOUT").ok();
        let transport =
            Transport::new(settings.endpoint.as_ref(), authorities.as_deref().map(Path::new), patience.as_deref());
        Ok(Self::new(transport.map_err(RemoteError::new)?, settings, bucket, prefix))
    }

    fn new(transport: Transport, settings: Settings, bucket: &str, prefix: &str) -> Self {
        let (scheme, host, root) = place(settings.endpoint.as_ref(), &settings.region, bucket);
        let base = if prefix.is_empty() { root.clone() } else { format!("{root}{}/", encoded(prefix, true)) };
        let (bucket, prefix) = (bucket.to_owned(), prefix.to_owned());
        Self { transport, settings, bucket, prefix, scheme, host, base, root, counter: Counter::default() }
    }

    /// What becomes of a request, in as many tries as are worth it.
    fn ask(&self, asked: &Asked<'_>) -> Result<Answer, RemoteError> {
        let mut tries = 1;
        loop {
            let fault = match self.once(asked) {
                Ok(answer) if (200..300).contains(&answer.status) => return Ok(answer),
                Ok(answer) if asked.accepts(&answer) => return Ok(answer),
                Ok(answer) => {
                    let complaint = self.complaint(&answer);
                    if !retry::may_pass(answer.status, &complaint.code) || tries >= TRIES {
                        let refusal = Refusal {
                            status: answer.status,
                            complaint: &complaint,
                            region: &self.settings.region,
                            bucket: &self.bucket,
                            tries,
                        };
                        return Err(self.failed(asked, &refusal.text()));
                    }
                    None
                }
                Err(fault) => Some(fault),
            };
            if let Some(fault) = fault
                && tries >= fault.tries()
            {
                let times = if tries > 1 { format!(" after {tries} tries") } else { String::new() };
                let text = self.settings.keys.taken_out_of(&fault.text(&self.host));
                return Err(self.failed(asked, &format!("no answer{times}: {text}")));
            }
            thread::sleep(retry::wait(tries));
            tries += 1;
        }
    }

    fn once(&self, asked: &Asked<'_>) -> Result<Answer, Fault> {
        let path = match asked.name {
            Some(name) => format!("{}{}", self.base, encoded(name, true)),
            None => self.root.clone(),
        };
        let request = Request {
            method: if asked.body.is_some() { "PUT" } else { "GET" },
            host: &self.host,
            path: &path,
            query: &asked.query,
            range: asked.range.as_deref(),
            payload: asked.body.unwrap_or_default(),
        };
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let signed = headers(&request, &self.settings.keys, &self.settings.region, now);
        let query = if asked.query.is_empty() { String::new() } else { format!("?{}", query_text(&asked.query)) };
        let url = format!("{}://{}{path}{query}", self.scheme, self.host);
        let answer = self.transport.send(&url, &signed, asked.body, asked.longest);
        let sent = asked.body.map_or(0, <[u8]>::len);
        self.counter.add(sent, answer.as_ref().map_or(0, |answer| answer.body.len()));
        answer
    }

    fn complaint(&self, answer: &Answer) -> Complaint {
        let mut complaint = complaint(&answer.body);
        complaint.message = self.settings.keys.taken_out_of(&complaint.message);
        complaint.region =
            complaint.region.or_else(|| answer.region.clone().filter(|region| answer::is_region(region)));
        complaint
    }

    /// `cannot write packs/ab.. to s3://bucket/prefix: ..`
    fn failed(&self, asked: &Asked<'_>, why: &str) -> RemoteError {
        let slash = if self.prefix.is_empty() { "" } else { "/" };
        let store = format!("s3://{}{slash}{}", self.bucket, self.prefix);
        RemoteError::new(match (asked.name, asked.body) {
            (Some(name), Some(_)) => format!("cannot write {name} to {store}: {why}"),
            (Some(name), None) => format!("cannot read {name} of {store}: {why}"),
            (None, _) => format!("cannot list {store}: {why}"),
        })
    }
}

/// A request before it is signed.
struct Asked<'a> {
    /// Of an object; a list otherwise.
    name: Option<&'a str>,
    query: Vec<(&'a str, &'a str)>,
    range: Option<String>,
    body: Option<&'a [u8]>,
    /// More bytes of the answer are not read.
    longest: u64,
}

impl Asked<'_> {
    /// What is no error where an object is read: that there is none, or none of its bytes.
    fn accepts(&self, answer: &Answer) -> bool {
        let reads = self.name.is_some() && self.body.is_none();
        let absent =
            answer.status == 404 && matches!(complaint(&answer.body).code.as_str(), "NoSuchKey" | "NoSuchVersion");
        reads && (absent || answer.status == 416)
    }
}

impl Objects for S3 {
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        let asked =
            Asked { name: Some(name), query: Vec::new(), range: None, body: Some(bytes), longest: LONGEST_PAGE };
        self.ask(&asked).map(drop)
    }

    fn get(&self, name: &str, range: Range<u64>) -> Result<Option<Vec<u8>>, RemoteError> {
        let Some(last) = range.end.checked_sub(1).filter(|last| *last >= range.start) else {
            return Ok(Some(Vec::new()));
        };
        let length = range.end - range.start;
        let bytes = Some(format!("bytes={}-{last}", range.start));
        let longest = range.end.max(LONGEST_PAGE);
        let asked = Asked { name: Some(name), query: Vec::new(), range: bytes, body: None, longest };
        let answer = self.ask(&asked)?;
        Ok(match answer.status {
            404 => None,
            416 => Some(Vec::new()),
            206 => Some(answer.body),
            // The object as a whole: the service takes no ranges.
            _ => {
                let at = |n: u64| usize::try_from(n).unwrap_or(usize::MAX).min(answer.body.len());
                Some(answer.body[at(range.start)..at(range.end)].to_vec())
            }
        }
        .map(|mut bytes| {
            bytes.truncate(usize::try_from(length).unwrap_or(usize::MAX));
            bytes
        }))
    }

    fn list(&self, folder: &str) -> Result<Vec<Listed>, RemoteError> {
        let prefix = if self.prefix.is_empty() { format!("{folder}/") } else { format!("{}/{folder}/", self.prefix) };
        let (mut objects, mut next) = (Vec::new(), None::<String>);
        loop {
            let mut query = vec![("list-type", "2"), ("max-keys", "1000"), ("prefix", prefix.as_str())];
            query.extend(next.as_deref().map(|next| ("continuation-token", next)));
            let asked = Asked { name: None, query, range: None, body: None, longest: LONGEST_PAGE };
            let answer = self.ask(&asked)?;
            let Some(page) = page(&String::from_utf8_lossy(&answer.body)) else {
                return Err(self.failed(
                    &asked,
                    "the answer is no list of objects; check the endpoint (AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL)",
                ));
            };
            if page.next.is_some() && page.next == next {
                return Err(self.failed(&asked, "the service gives the same page again and again; ask who runs it"));
            }
            objects.extend(page.objects);
            match page.next {
                Some(token) => next = Some(token),
                None => return Ok(objects),
            }
        }
    }

    fn traffic(&self) -> Traffic {
        self.counter.traffic()
    }
}

/// Scheme, host and path of a bucket: its own host at Amazon, and the path of an endpoint otherwise (and where dots in the name fit no certificate).
fn place(endpoint: Option<&Endpoint>, region: &str, bucket: &str) -> (&'static str, String, String) {
    match endpoint {
        Some(Endpoint { is_tls, authority, path }) => {
            let path = if path.is_empty() { String::new() } else { format!("/{path}") };
            (if *is_tls { "https" } else { "http" }, authority.clone(), format!("{path}/{bucket}/"))
        }
        None => {
            let domain = if region.starts_with("cn-") { "amazonaws.com.cn" } else { "amazonaws.com" };
            if bucket.contains('.') {
                ("https", format!("s3.{region}.{domain}"), format!("/{bucket}/"))
            } else {
                ("https", format!("{bucket}.s3.{region}.{domain}"), "/".to_owned())
            }
        }
    }
}

/// The text of a file with settings.
fn read(path: &Path) -> Option<String> {
    let file = disk::open_regular(path).ok()?;
    let length = file.metadata().ok()?.len().min(LONGEST_FILE);
    Some(String::from_utf8_lossy(&disk::read_at(&file, 0, length as usize).ok()?).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_have_their_places() {
        let at = |endpoint: Option<&Endpoint>, bucket| place(endpoint, "eu-west-1", bucket);
        assert_eq!(at(None, "lab"), ("https", "lab.s3.eu-west-1.amazonaws.com".into(), "/".into()));
        assert_eq!(at(None, "lab.x"), ("https", "s3.eu-west-1.amazonaws.com".into(), "/lab.x/".into()));
        assert_eq!(place(None, "cn-north-1", "lab").1, "lab.s3.cn-north-1.amazonaws.com.cn");
        let own = Endpoint { is_tls: false, authority: "h:9000".into(), path: "s3".into() };
        assert_eq!(at(Some(&own), "lab"), ("http", "h:9000".into(), "/s3/lab/".into()));
    }
}
