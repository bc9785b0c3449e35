//! Signing of requests: AWS Signature Version 4, as its reference for Amazon S3 describes it, in the header `authorization`. Nothing of it is in an URL.

use sha2::{Digest as _, Sha256};

use super::date::amz_date;
use super::secret::Keys;

/// Bytes that SHA-256 takes at a time.
const BLOCK: usize = 64;

/// What is signed of a request.
pub(super) struct Request<'a> {
    pub method: &'a str,
    /// With its port, as the header says it.
    pub host: &'a str,
    /// Percent-encoded, from the first slash on.
    pub path: &'a str,
    /// Not encoded.
    pub query: &'a [(&'a str, &'a str)],
    /// `bytes=0-9`
    pub range: Option<&'a str>,
    pub payload: &'a [u8],
}

/// The query of an URL: encoded and sorted.
pub(super) fn query_text(query: &[(&str, &str)]) -> String {
    let mut pairs: Vec<String> =
        query.iter().map(|(name, value)| format!("{}={}", encoded(name, false), encoded(value, false))).collect();
    pairs.sort();
    pairs.join("&")
}

/// Percent-encoded but for letters, digits and `-._~` (and slashes).
pub(super) fn encoded(text: &str, slashes: bool) -> String {
    let mut out = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => out.push(char::from(byte)),
            b'/' if slashes => out.push('/'),
            _ => out.push_str(&format!("%{byte:02X}")),
        }
    }
    out
}

/// The headers that sign a request at a Unix time in s, sorted by name; `host` is not among them.
pub(super) fn headers(request: &Request<'_>, keys: &Keys, region: &str, unix_s: u64) -> Vec<(&'static str, String)> {
    let time = amz_date(unix_s);
    let payload = hex(&Sha256::digest(request.payload));
    let mut headers = vec![("host", request.host.to_owned())];
    headers.extend(request.range.map(|range| ("range", range.to_owned())));
    headers.push(("x-amz-content-sha256", payload.clone()));
    headers.push(("x-amz-date", time.clone()));
    headers.extend(keys.token.as_ref().map(|token| ("x-amz-security-token", token.reveal().to_owned())));
    let names = headers.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(";");
    let lines: String = headers.iter().map(|(name, value)| format!("{name}:{}\n", value.trim())).collect();
    let canonical =
        format!("{}\n{}\n{}\n{lines}\n{names}\n{payload}", request.method, request.path, query_text(request.query));
    let scope = format!("{}/{region}/s3/aws4_request", &time[..8]);
    let text = format!("AWS4-HMAC-SHA256\n{time}\n{scope}\n{}", hex(&Sha256::digest(canonical)));
    let mut key = hmac(format!("AWS4{}", keys.secret.reveal()).as_bytes(), &time.as_bytes()[..8]);
    for part in [region, "s3", "aws4_request"] {
        key = hmac(&key, part.as_bytes());
    }
    let signature = hex(&hmac(&key, text.as_bytes()));
    let id = keys.id.reveal();
    headers.remove(0);
    headers.insert(
        0,
        (
            "authorization",
            format!("AWS4-HMAC-SHA256 Credential={id}/{scope}, SignedHeaders={names}, Signature={signature}"),
        ),
    );
    headers
}

/// HMAC with SHA-256 (RFC 2104).
fn hmac(key: &[u8], text: &[u8]) -> [u8; 32] {
    let mut block = [0; BLOCK];
    if key.len() > BLOCK {
        block[..32].copy_from_slice(&Sha256::digest(key));
    } else {
        block[..key.len()].copy_from_slice(key);
    }
    let padded =
        |pad: u8, rest: &[u8]| Sha256::new().chain_update(block.map(|b| b ^ pad)).chain_update(rest).finalize();
    padded(0x5c, &padded(0x36, text)).into()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::super::secret::Secret;
    use super::*;

    fn keys() -> Keys {
        let (id, secret) = ("AKIAIOSFODNN7EXAMPLE", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY");
        Keys { id: Secret::new(id), secret: Secret::new(secret), token: None }
    }

    fn signature(request: &Request<'_>) -> String {
        let headers = headers(request, &keys(), "us-east-1", 1_369_353_600);
        headers[0].1.rsplit_once("Signature=").expect("it ends so").1.to_owned()
    }

    /// RFC 4231, cases 1, 2 and 6.
    #[test]
    fn hmac_is_that_of_the_rfc() {
        for (key, text, want) in [
            (&[0x0b; 20][..], &b"Hi There"[..], "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7"),
            (
                b"Jefe",
                b"what do ya want for nothing?",
                "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843",
            ),
            (
                &[0xaa; 131],
                b"Test Using Larger Than Block-Size Key - Hash Key First",
                "60e431591ee0b67f0d8a26aacbf5b77f8e0bc6213728c5140546040f0ee37f54",
            ),
        ] {
            assert_eq!(hex(&hmac(key, text)), want);
        }
    }

    /// The examples of "Authenticating Requests: Using the Authorization Header" of Amazon S3: a range of an object, a list.
    #[test]
    fn signatures_are_those_of_the_reference() {
        let (method, host) = ("GET", "examplebucket.s3.amazonaws.com");
        let range = Request { method, host, path: "/test.txt", query: &[], range: Some("bytes=0-9"), payload: b"" };
        assert_eq!(signature(&range), "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41");
        let query: &[_] = &[("prefix", "J"), ("max-keys", "2")];
        let list = Request { method, host, path: "/", query, range: None, payload: b"" };
        assert_eq!(signature(&list), "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7");
    }

    #[test]
    fn a_session_token_is_sent_and_signed() {
        let keys = Keys { token: Some(Secret::new("session")), ..keys() };
        let put = Request { method: "PUT", host: "h", path: "/a", query: &[], range: None, payload: b"x" };
        let headers = headers(&put, &keys, "eu-west-1", 0);
        assert!(headers.contains(&("x-amz-security-token", "session".to_owned())));
        assert!(headers[0].1.contains("SignedHeaders=host;x-amz-content-sha256;x-amz-date;x-amz-security-token"));
        assert!(headers[0].1.contains("/19700101/eu-west-1/s3/aws4_request"));
    }

    #[test]
    fn names_are_encoded() {
        assert_eq!(encoded("a/b c+ü~", true), "a/b%20c%2B%C3%BC~");
        assert_eq!(encoded("a/b", false), "a%2Fb");
        assert_eq!(query_text(&[("b", "1"), ("a", "x/y")]), "a=x%2Fy&b=1");
    }
}
