//! What a refusal means, in words: why, and the way out.

use super::answer::Complaint;

/// A refusal of a service.
pub(super) struct Refusal<'a> {
    pub status: u16,
    pub complaint: &'a Complaint,
    /// Of this program's settings.
    pub region: &'a str,
    pub bucket: &'a str,
    pub tries: u32,
}

impl Refusal<'_> {
    /// `403 AccessDenied: ..; ..`
    pub fn text(&self) -> String {
        let Complaint { code, message, .. } = self.complaint;
        let shown = if code.is_empty() { String::new() } else { format!(" {code}") };
        let words = self.words().unwrap_or_else(|| match message.as_str() {
            "" => "the service gives no reason; look into its log, or ask who runs it".to_owned(),
            message => format!("the service says: {message}"),
        });
        let tries = if self.tries > 1 { format!(" after {} tries", self.tries) } else { String::new() };
        format!("{}{shown}{tries}: {words}", self.status)
    }

    fn words(&self) -> Option<String> {
        let Self { status, complaint, region, bucket, .. } = self;
        let code = complaint.code.as_str();
        let elsewhere = [
            "PermanentRedirect",
            "TemporaryRedirect",
            "AuthorizationHeaderMalformed",
            "IllegalLocationConstraintException",
            "InvalidRegion",
        ];
        if elsewhere.contains(&code) || matches!(status, 301 | 302 | 307 | 308) {
            return Some(match complaint.region.as_deref().filter(|found| found != region) {
                Some(found) => {
                    format!("the bucket is in region {found}, and {region} was asked; set AWS_REGION={found}")
                }
                None => format!(
                    "the bucket is not where it was looked for (region {region}); set AWS_REGION, or the endpoint with AWS_ENDPOINT_URL_S3"
                ),
            });
        }
        let fixed = match code {
            "RequestTimeTooSkewed" | "RequestExpired" => {
                "the clock of this machine is wrong by more than a service allows (15 minutes); set it right"
            }
            "InvalidAccessKeyId" => {
                "the service does not know the access key; set AWS_ACCESS_KEY_ID (or AWS_PROFILE) to one of this service"
            }
            "SignatureDoesNotMatch" => {
                "the secret key does not belong to the access key; set AWS_SECRET_ACCESS_KEY anew"
            }
            "ExpiredToken" | "TokenRefreshRequired" => "the session has ended; get new keys and set them",
            "InvalidToken" | "InvalidSecurity" => {
                "the session token is wrong; set AWS_SESSION_TOKEN, or unset it where the keys have none"
            }
            "NoSuchBucket" => {
                return Some(format!("there is no bucket `{bucket}`; make it, or write another into --store"));
            }
            "InvalidBucketName" => {
                return Some(format!("`{bucket}` cannot be the name of a bucket; write another into --store"));
            }
            "QuotaExceeded"
            | "InsufficientStorage"
            | "InsufficientCapacity"
            | "StorageFull"
            | "XMinioStorageFull"
            | "XMinioAdminBucketQuotaExceeded"
            | "ServiceQuotaExceededException" => FULL,
            "EntityTooLarge" => "the service takes no objects of this length (32 MiB); raise its limit",
            "SlowDown" | "RequestLimitExceeded" | "ThrottlingException" => {
                "the service is asked too often; try again later, or with fewer processes"
            }
            "" | "AccessDenied" | "AllAccessDisabled" | "AccountProblem" | "InvalidObjectState" if *status == 403 => {
                return Some(format!(
                    "these keys may not do it; they need s3:ListBucket on {bucket}, and s3:GetObject and s3:PutObject on what is in it"
                ));
            }
            _ => match status {
                401 => "the service wants other keys; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE",
                404 | 405 | 501 if code.is_empty() || code == "MethodNotAllowed" || code == "NotImplemented" => {
                    "this does not look like S3; check the endpoint (AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL)"
                }
                429 => "the service is asked too often; try again later, or with fewer processes",
                507 => FULL,
                500 | 502 | 503 | 504 => "the service is not well; try again later",
                _ => return None,
            },
        };
        Some(fixed.to_owned())
    }
}

const FULL: &str = "the bucket is full, or its quota is used up; remove what is not needed, or ask for more room";

#[cfg(test)]
mod tests {
    use super::*;

    fn text(status: u16, code: &str, region: Option<&str>) -> String {
        let complaint = Complaint { code: code.into(), message: "because".into(), region: region.map(Into::into) };
        Refusal { status, complaint: &complaint, region: "us-east-1", bucket: "lab", tries: 1 }.text()
    }

    #[test]
    fn refusals_name_code_reason_and_way_out() {
        for (status, code, region, want) in [
            (301, "PermanentRedirect", Some("eu-west-1"), "301 PermanentRedirect: the bucket is in region eu-west-1"),
            (400, "AuthorizationHeaderMalformed", Some("eu-west-1"), "set AWS_REGION=eu-west-1"),
            (301, "", None, "set AWS_REGION"),
            (403, "AccessDenied", None, "s3:PutObject"),
            (403, "", None, "s3:ListBucket on lab"),
            (403, "RequestTimeTooSkewed", None, "the clock of this machine"),
            (403, "SignatureDoesNotMatch", None, "AWS_SECRET_ACCESS_KEY"),
            (404, "NoSuchBucket", None, "no bucket `lab`"),
            (404, "", None, "does not look like S3"),
            (403, "QuotaExceeded", None, "is full"),
            (507, "", None, "is full"),
            (503, "SlowDown", None, "503 SlowDown: the service is asked too often"),
            (500, "", None, "500: the service is not well"),
            (409, "OperationAborted", None, "409 OperationAborted: the service says: because"),
        ] {
            let text = text(status, code, region);
            assert!(text.contains(want), "{text}");
        }
    }
}
