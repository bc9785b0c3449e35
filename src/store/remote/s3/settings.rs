//! Keys, region and endpoint: from the environment and the profile files that all programs for S3 read.

use std::path::{Path, PathBuf};

use super::answer::is_region;
use super::profile::{Profile, profile};
use super::secret::{Keys, Secret};

/// How to reach the service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Settings {
    pub keys: Keys,
    pub region: String,
    /// Where it is not Amazon's.
    pub endpoint: Option<Endpoint>,
}

/// `http://host:port/path`; no keys stand in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Endpoint {
    pub is_tls: bool,
    /// Host, and port where it is given.
    pub authority: String,
    /// Without slashes at its ends.
    pub path: String,
}

/// Where settings come from.
pub(super) struct Sources<'a> {
    pub variable: &'a dyn Fn(&str) -> Option<String>,
    /// The text of a file, if it is there.
    pub file: &'a dyn Fn(&Path) -> Option<String>,
}

impl Settings {
    /// Error: what is missing or wrong, and how to set it. No value of a key is repeated.
    pub fn read(sources: &Sources<'_>) -> Result<Self, String> {
        let variable = |name: &str| (sources.variable)(name).filter(|value| !value.is_empty());
        let named = variable("AWS_PROFILE");
        let [credentials, config] = files(&variable);
        let text = |path: &Option<PathBuf>| path.as_ref().and_then(|path| (sources.file)(path)).unwrap_or_default();
        let name = named.clone().unwrap_or_else(|| "default".to_owned());
        let found = profile(&name, &text(&credentials), &text(&config));
        if found.is_none() && named.is_some() {
            let shown =
                |path: &Option<PathBuf>| path.as_ref().map_or("(none)".into(), |path| path.display().to_string());
            return Err(format!(
                "there is no profile `{name}`, which AWS_PROFILE names, in {} or {}",
                shown(&credentials),
                shown(&config)
            ));
        }
        let found = found.unwrap_or_default();
        let region = variable("AWS_REGION").or_else(|| variable("AWS_DEFAULT_REGION"));
        let region = region.or_else(|| found.get("region").cloned()).unwrap_or_else(|| "us-east-1".to_owned());
        if !is_region(&region) {
            return Err(format!("`{region}` is no region; set AWS_REGION to one like eu-central-1"));
        }
        let endpoint = variable("AWS_ENDPOINT_URL_S3").or_else(|| variable("AWS_ENDPOINT_URL"));
        let endpoint = endpoint.or_else(|| found.get("endpoint_url").cloned());
        Ok(Self {
            keys: keys(&variable, &found, &name)?,
            region,
            endpoint: endpoint.map(|url| Endpoint::parse(&url)).transpose()?,
        })
    }
}

/// The credentials file and the config file.
fn files(variable: &dyn Fn(&str) -> Option<String>) -> [Option<PathBuf>; 2] {
    let home = variable("HOME").or_else(|| variable("USERPROFILE")).map(PathBuf::from);
    [("AWS_SHARED_CREDENTIALS_FILE", "credentials"), ("AWS_CONFIG_FILE", "config")].map(|(name, file)| {
        let usual = || Some(home.as_ref()?.join(".aws").join(file));
        variable(name).map(PathBuf::from).or_else(usual)
    })
}

fn keys(variable: &dyn Fn(&str) -> Option<String>, found: &Profile, name: &str) -> Result<Keys, String> {
    let half = |what: &str, there: &str, missing: &str| Err(format!("{what} has {there} and no {missing}; set both"));
    match (variable("AWS_ACCESS_KEY_ID"), variable("AWS_SECRET_ACCESS_KEY")) {
        (Some(id), Some(secret)) => {
            let token = variable("AWS_SESSION_TOKEN").map(Secret::new);
            return sendable(Keys { id: Secret::new(id), secret: Secret::new(secret), token }, "the environment");
        }
        (Some(_), None) => return half("the environment", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"),
        (None, Some(_)) => return half("the environment", "AWS_SECRET_ACCESS_KEY", "AWS_ACCESS_KEY_ID"),
        (None, None) => {}
    }
    let of = |key: &str| found.get(key).map(Secret::new);
    let what = format!("the profile `{name}`");
    match (of("aws_access_key_id"), of("aws_secret_access_key")) {
        (Some(id), Some(secret)) => sendable(Keys { id, secret, token: of("aws_session_token") }, &what),
        (Some(_), None) => half(&what, "aws_access_key_id", "aws_secret_access_key"),
        (None, Some(_)) => half(&what, "aws_secret_access_key", "aws_access_key_id"),
        (None, None) => {
            let elsewhere =
                ["sso_session", "sso_start_url", "role_arn", "credential_process", "web_identity_token_file"];
            Err(match elsewhere.into_iter().find(|setting| found.contains_key(*setting)) {
                Some(setting) => format!(
                    "{what} has its keys from `{setting}`, which turbid does not ask; let the AWS command line do it: \
                     `eval \"$(aws configure export-credentials --profile {name} --format env)\"`"
                ),
                None => "no keys for S3: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or name a profile of \
                         ~/.aws/credentials with AWS_PROFILE"
                    .to_owned(),
            })
        }
    }
}

/// Keys that a header can hold.
fn sendable(keys: Keys, of: &str) -> Result<Keys, String> {
    let all = [Some(&keys.id), Some(&keys.secret), keys.token.as_ref()];
    let good = all.into_iter().flatten().all(|key| key.reveal().bytes().all(|byte| byte.is_ascii_graphic()));
    if good { Ok(keys) } else { Err(format!("a key of {of} has blanks or characters that no key has; set it anew")) }
}

impl Endpoint {
    fn parse(url: &str) -> Result<Self, String> {
        let rule = "an endpoint is https://HOST or http://HOST:PORT (AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL or endpoint_url of the profile)";
        let rest = |scheme: &str| url.strip_prefix(scheme);
        let (is_tls, rest) = match (rest("https://"), rest("http://")) {
            (Some(rest), _) => (true, rest),
            (_, Some(rest)) => (false, rest),
            _ => return Err(format!("the endpoint of S3 has no https:// or http:// before it: {rule}")),
        };
        let (authority, path) = rest.split_once('/').unwrap_or((rest, ""));
        // What stands before an @ may be a password, slashes included: it is not repeated.
        if rest.contains('@') {
            return Err(format!("the endpoint of S3 holds a name or a password, which would be shown: {rule}"));
        }
        let host = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
        let good = |c: char| c.is_ascii_graphic() && !"?#%\\".contains(c);
        if authority.is_empty() || !authority.chars().all(host) || !path.chars().all(good) {
            return Err(format!("the endpoint `{url}` is none: {rule}"));
        }
        Ok(Self { is_tls, authority: authority.to_owned(), path: path.trim_matches('/').to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [(&str, &str); 2] = [("AWS_ACCESS_KEY_ID", "AKIA"), ("AWS_SECRET_ACCESS_KEY", "hidden")];

    fn read(variables: &[(&str, &str)], files: &[(&str, &str)]) -> Result<Settings, String> {
        let variable = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned());
        let file = |path: &Path| files.iter().find(|(n, _)| path == Path::new(n)).map(|(_, text)| (*text).to_owned());
        Settings::read(&Sources { variable: &variable, file: &file })
    }

    #[test]
    fn the_environment_goes_first() {
        let files = [
            ("/h/.aws/credentials", "[default]\naws_access_key_id=F\naws_secret_access_key=G\naws_session_token=T\n"),
            ("/h/.aws/config", "[default]\nregion=eu-west-1\nendpoint_url=http://host:9000/\n"),
        ];
        let home = [("HOME", "/h")];
        let of_files = read(&home, &files).unwrap();
        assert_eq!((of_files.keys.id.reveal(), of_files.keys.token.as_ref().map(Secret::reveal)), ("F", Some("T")));
        assert_eq!(of_files.region, "eu-west-1");
        let endpoint = Endpoint { is_tls: false, authority: "host:9000".into(), path: String::new() };
        assert_eq!(of_files.endpoint, Some(endpoint));
        let all = [&home[..], &BOTH, &[("AWS_DEFAULT_REGION", "us-west-2"), ("AWS_ENDPOINT_URL", "https://s3.lab/x")]]
            .concat();
        let of_environment = read(&all, &files).unwrap();
        assert_eq!((of_environment.keys.id.reveal(), &of_environment.keys.token), ("AKIA", &None));
        assert_eq!(of_environment.region, "us-west-2");
        assert_eq!(
            of_environment.endpoint.map(|e| (e.is_tls, e.authority, e.path)),
            Some((true, "s3.lab".into(), "x".into()))
        );
        let other = [("AWS_SHARED_CREDENTIALS_FILE", "/c"), ("AWS_PROFILE", "lab")];
        let lab = read(&other, &[("/c", "[lab]\naws_access_key_id=L\naws_secret_access_key=M\n")]).unwrap();
        assert_eq!((lab.keys.id.reveal(), lab.region.as_str(), lab.endpoint), ("L", "us-east-1", None));
    }

    /// What is missing or wrong is named, with the way out, and without a value that is secret.
    #[test]
    fn what_is_missing_is_named() {
        for (variables, files, want) in [
            (&[][..], &[][..], "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"),
            (&BOTH[..1], &[], "no AWS_SECRET_ACCESS_KEY"),
            (&BOTH[1..], &[], "no AWS_ACCESS_KEY_ID"),
            (&[("AWS_PROFILE", "lab"), ("HOME", "/h")], &[], "no profile `lab`"),
            (
                &[("HOME", "/h")],
                &[("/h/.aws/credentials", "[default]\naws_secret_access_key=hidden")],
                "no aws_access_key_id",
            ),
            (
                &[("HOME", "/h")],
                &[("/h/.aws/config", "[default]\nsso_session=x")],
                "export-credentials --profile default",
            ),
        ] {
            let error = read(variables, files).unwrap_err();
            assert!(error.contains(want) && !error.contains("hidden"), "{error}");
        }
        for (name, value, want) in [
            ("AWS_REGION", "eu west", "is no region"),
            ("AWS_ENDPOINT_URL", "host:9000", "no https:// or http://"),
            ("AWS_ENDPOINT_URL", "http://user:hidden@host", "a name or a password"),
            ("AWS_ENDPOINT_URL", "http://user:hid/hidden@host", "a name or a password"),
            ("AWS_ENDPOINT_URL", "http://", "is none"),
            ("AWS_ENDPOINT_URL_S3", "http://host/?x", "is none"),
            ("AWS_SESSION_TOKEN", "hidden token", "set it anew"),
        ] {
            let error = read(&[&BOTH[..], &[(name, value)]].concat(), &[]).unwrap_err();
            assert!(error.contains(want) && !error.contains("hidden"), "{error}");
        }
    }
}
