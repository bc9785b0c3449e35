//! What a service says in XML: lists of objects, and errors.

use super::super::objects::Listed;

/// One page of a list.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Page {
    pub objects: Vec<Listed>,
    /// What to ask for the next page with.
    pub next: Option<String>,
}

/// A page of `ListObjectsV2`; `None` where this is none. Names are those behind the last slash.
pub(super) fn page(xml: &str) -> Option<Page> {
    if !xml.contains("<ListBucketResult") || !xml.contains("</ListBucketResult>") {
        return None;
    }
    let mut objects = Vec::new();
    for part in xml.split("<Contents>").skip(1) {
        let part = part.split("</Contents>").next()?;
        let key = text(part, "Key")?;
        let name = key.rsplit('/').next().unwrap_or_default().to_owned();
        objects.push(Listed { name, bytes: text(part, "Size")?.parse().ok()?, modified: text(part, "LastModified")? });
    }
    let more = text(xml, "IsTruncated").is_some_and(|more| more == "true");
    let next = if more { Some(text(xml, "NextContinuationToken")?) } else { None };
    Some(Page { objects, next })
}

/// What an error says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Complaint {
    /// A word such as `AccessDenied`; empty where there is none.
    pub code: String,
    pub message: String,
    /// Where the bucket is, if the service says so.
    pub region: Option<String>,
}

/// Of the body of an answer, whatever it is.
pub(super) fn complaint(body: &[u8]) -> Complaint {
    let xml = String::from_utf8_lossy(body);
    let code = text(&xml, "Code").filter(|code| code.len() <= 64 && code.bytes().all(|b| b.is_ascii_alphanumeric()));
    let message = text(&xml, "Message").unwrap_or_default();
    Complaint {
        code: code.unwrap_or_default(),
        message: message.chars().filter(|c| !c.is_control()).take(200).collect(),
        region: text(&xml, "Region").filter(|region| is_region(region)),
    }
}

/// `eu-central-1` and the like.
pub(super) fn is_region(text: &str) -> bool {
    (1..=64).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

/// The text of the first element of this name.
fn text(xml: &str, name: &str) -> Option<String> {
    let (_, rest) = xml.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once(&format!("</{name}>"))?;
    let plain = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&#39;", "'"), ("&amp;", "&")];
    Some(plain.into_iter().fold(text.to_owned(), |text, (escaped, plain)| text.replace(escaped, plain)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_read() {
        let xml = "<?xml version=\"1.0\"?>\n<ListBucketResult xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\"><Name>b</Name>\
            <IsTruncated>true</IsTruncated><NextContinuationToken>a&amp;b=</NextContinuationToken>\
            <Contents><Key>p/packs/one</Key><LastModified>2026-01-02T03:04:05.000Z</LastModified><Size>12</Size></Contents>\
            <Contents><Key>p/packs/two</Key><LastModified>2026-01-03T03:04:05.000Z</LastModified><ETag>&quot;x&quot;</ETag><Size>0</Size></Contents>\
            </ListBucketResult>";
        let found = page(xml).expect("it is a list");
        assert_eq!(found.next.as_deref(), Some("a&b="));
        let names: Vec<_> = found.objects.iter().map(|o| (o.name.as_str(), o.bytes)).collect();
        assert_eq!(names, [("one", 12), ("two", 0)]);
        assert!(found.objects[0].modified < found.objects[1].modified);
        assert_eq!(
            page("<ListBucketResult><IsTruncated>false</IsTruncated></ListBucketResult>"),
            Some(Page::default())
        );
        for wrong in ["", "<html>", &xml[..xml.len() - 5], &xml.replace("<Size>12", "<Size>many")] {
            assert_eq!(page(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn complaints_are_read_from_anything() {
        let xml = b"<Error><Code>AuthorizationHeaderMalformed</Code><Message>the region 'a' is wrong</Message><Region>eu-west-1</Region></Error>";
        let read = complaint(xml);
        assert_eq!((read.code.as_str(), read.region.as_deref()), ("AuthorizationHeaderMalformed", Some("eu-west-1")));
        assert_eq!(complaint(b""), Complaint::default());
        assert_eq!(complaint(b"<Code>\x1b[31m</Code><Region>x y</Region>"), Complaint::default());
        assert_eq!(complaint(&[0xff; 1000]), Complaint::default());
        assert_eq!(
            complaint(&[b"<Message>".to_vec(), vec![b'm'; 5000], b"</Message>".to_vec()].concat()).message.len(),
            200
        );
    }
}
