//! HTTP and TLS, by ureq and rustls.

use std::io;
use std::path::Path;
use std::time::Duration;

use ureq::http::{Request, Response};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body, Error};

use super::retry::{TRIES, TRIES_UNHEARD};
use super::settings::Endpoint;
use crate::store::disk;

/// A connection must stand within this time.
const CONNECT: Duration = Duration::from_secs(10);
/// The first bytes of an answer must come within this time, and then more and more.
const PATIENCE_S: u64 = 60;

pub(super) struct Transport {
    agent: Agent,
}

/// An answer, whatever it says.
pub(super) struct Answer {
    pub status: u16,
    /// `x-amz-bucket-region`
    pub region: Option<String>,
    pub body: Vec<u8>,
}

/// Why there is no answer.
pub(super) struct Fault(Error);

impl Transport {
    /// `authorities`: a file of certificates to trust instead of those that come with the program. `patience`: seconds to wait for an answer.
    pub fn new(
        endpoint: Option<&Endpoint>,
        authorities: Option<&Path>,
        patience: Option<&str>,
    ) -> Result<Self, String> {
        let patience = match patience {
            None => PATIENCE_S,
            Some(text) => text.parse().ok().filter(|s| (1..=3600).contains(s)).ok_or_else(|| {
                format!("TURBID_STORE_TIMEOUT is `{text}`, and must be 1 to 3600: seconds to wait for an answer")
            })?,
        };
        let patience = Duration::from_secs(patience);
        let roots = match authorities {
            None => RootCerts::WebPki,
            Some(path) => certificates(path)?,
        };
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            // Without TLS only where an endpoint says so.
            .https_only(endpoint.is_none_or(|endpoint| endpoint.is_tls))
            .user_agent(concat!("turbid/", env!("CARGO_PKG_VERSION")))
            .timeout_connect(Some(CONNECT))
            .timeout_recv_response(Some(patience))
            .timeout_per_read(Some(patience))
            .timeout_per_write(Some(patience))
            .tls_config(TlsConfig::builder().root_certs(roots).build())
            .build();
        Ok(Self { agent: config.into() })
    }

    /// PUT of a body, or GET; of the answer no more than `longest` bytes are read.
    pub fn send(
        &self,
        url: &str,
        headers: &[(&'static str, String)],
        body: Option<&[u8]>,
        longest: u64,
    ) -> Result<Answer, Fault> {
        let mut request = Request::builder().method(if body.is_some() { "PUT" } else { "GET" }).uri(url);
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        let answer = match body {
            Some(body) => self.agent.run(request.body(body).map_err(Error::from).map_err(Fault)?),
            None => self.agent.run(request.body(()).map_err(Error::from).map_err(Fault)?),
        };
        read(answer.map_err(Fault)?, longest)
    }
}

fn read(mut answer: Response<Body>, longest: u64) -> Result<Answer, Fault> {
    let region = answer.headers().get("x-amz-bucket-region").and_then(|value| value.to_str().ok()).map(str::to_owned);
    let expected = answer.headers().get("content-length").and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    let status = answer.status().as_u16();
    let body = answer.body_mut().with_config().limit(longest.saturating_add(1)).read_to_vec().map_err(Fault)?;
    // A connection that ends early is no answer.
    if expected.is_some_and(|expected| expected != body.len() as u64) {
        return Err(Fault(Error::Io(io::ErrorKind::UnexpectedEof.into())));
    }
    Ok(Answer { status, region, body })
}

/// The certificates in a PEM file.
fn certificates(path: &Path) -> Result<RootCerts, String> {
    let wrong = |why: &str| format!("the certificates that AWS_CA_BUNDLE names ({}) {why}", path.display());
    let pem = disk::read_regular(path).map_err(|error| wrong(&format!("cannot be read: {error}")))?;
    let items = parse_pem(&pem).map(|item| item.map_err(|_| wrong("are not in PEM format")));
    let mut found = Vec::new();
    for item in items {
        if let PemItem::Certificate(certificate) = item? {
            found.push(certificate);
        }
    }
    if found.is_empty() { Err(wrong("are none")) } else { Ok(found.into_iter().into()) }
}

impl Fault {
    /// How often a request that ended so is worth making.
    pub fn tries(&self) -> u32 {
        match &self.0 {
            Error::HostNotFound | Error::ConnectionFailed => TRIES_UNHEARD,
            Error::Io(error) if error.kind() == io::ErrorKind::ConnectionRefused => TRIES_UNHEARD,
            Error::Tls(_) | Error::Rustls(_) | Error::Pem(_) | Error::BadUri(_) | Error::RequireHttpsOnly(_) => 1,
            Error::Http(_) | Error::BodyExceedsLimit(_) | Error::InvalidProxyUrl => 1,
            // rustls wraps what is wrong with a certificate.
            Error::Io(error) if error.kind() == io::ErrorKind::InvalidData => 1,
            _ => TRIES,
        }
    }

    /// Why, and the way out.
    pub fn text(&self, host: &str) -> String {
        let check = "check the endpoint (AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL), AWS_REGION and the network";
        match &self.0 {
            Error::HostNotFound => format!("no machine is named {host}; {check}"),
            Error::ConnectionFailed => format!("{host} cannot be reached; {check}"),
            Error::Io(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                format!("{host} refuses connections; {check}")
            }
            Error::Timeout(what) => format!("{host} took too long ({what}); {check}, or set TURBID_STORE_TIMEOUT"),
            Error::Rustls(error) => format!(
                "{host} does not prove who it is: {error}; name its certificate authority with AWS_CA_BUNDLE, or check the endpoint"
            ),
            Error::Io(error) if error.kind() == io::ErrorKind::InvalidData => format!(
                "{host} does not prove who it is: {error}; name its certificate authority with AWS_CA_BUNDLE, or check the endpoint"
            ),
            error => format!("{host}: {error}; {check}"),
        }
    }
}
