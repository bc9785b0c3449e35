//! The files `~/.aws/credentials` and `~/.aws/config`: sections in brackets, with `name = value` below.

use std::collections::BTreeMap;

/// The settings of one profile, by name.
pub(super) type Profile = BTreeMap<String, String>;

/// The profile in the texts of both files; what `credentials` says goes first. `None` where neither has it.
pub(super) fn profile(name: &str, credentials: &str, config: &str) -> Option<Profile> {
    let in_config = if name == "default" { section("default", config) } else { None };
    let in_config = in_config.or_else(|| section(&format!("profile {name}"), config));
    let mut all = match (section(name, credentials), in_config) {
        (None, None) => return None,
        (credentials, config) => {
            let mut all = config.unwrap_or_default();
            all.extend(credentials.unwrap_or_default());
            all
        }
    };
    all.retain(|_, value| !value.is_empty());
    Some(all)
}

/// What stands below `[NAME]`, up to the next section; nested settings are left out.
fn section(name: &str, text: &str) -> Option<Profile> {
    let mut found: Option<Profile> = None;
    let mut inside = false;
    for line in text.lines() {
        let bare = line.trim();
        if bare.starts_with(['#', ';']) {
            continue;
        }
        if let Some(head) = bare.strip_prefix('[').and_then(|rest| rest.split_once(']')).map(|(head, _)| head) {
            inside = head.split_whitespace().collect::<Vec<_>>().join(" ") == name;
            if inside {
                found.get_or_insert_default();
            }
        } else if inside
            && !line.starts_with([' ', '\t'])
            && let (Some((key, value)), Some(found)) = (bare.split_once('='), &mut found)
        {
            found.insert(key.trim().to_ascii_lowercase(), value.trim().to_owned());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_are_read_from_both_files() {
        let credentials =
            "# mine\n[default]\naws_access_key_id = A\naws_secret_access_key=B=\n\n[lab]\naws_access_key_id=C\n";
        let config = "[default]\nregion = eu-west-1\n[profile lab]\nregion=us-west-2\nAWS_ACCESS_KEY_ID=ignored\ns3 =\n  endpoint_url = nested\n; x\n[profile other]\nregion=x";
        let get = |name: &str| profile(name, credentials, config);
        let pairs = |name: &str| {
            get(name).map(|p| p.into_iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" "))
        };
        assert_eq!(pairs("default").as_deref(), Some("aws_access_key_id=A aws_secret_access_key=B= region=eu-west-1"));
        assert_eq!(pairs("lab").as_deref(), Some("aws_access_key_id=C region=us-west-2"));
        assert_eq!(pairs("other").as_deref(), Some("region=x"));
        assert_eq!(get("absent"), None);
        assert_eq!(profile("default", "", ""), None);
    }
}
