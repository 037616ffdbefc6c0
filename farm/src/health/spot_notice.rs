//! Notice of EC2 that it reclaims a spot machine, two minutes ahead, from its instance metadata service
//! (IMDSv2).

use std::time::Duration;

use hyper::{Method, StatusCode};

use super::http_client::HttpService;
use crate::Error;
use crate::net::{StopHandle, runtime};

/// Stops the node at the first notice; polls every five seconds, as AWS recommends, until the process ends.
///
/// The service is at the URL in the variable `AWS_EC2_METADATA_SERVICE_ENDPOINT`, as for AWS' own tools, or
/// at the address common to all machines of EC2.
///
/// # Errors
/// [`Error::Directory`] if the variable is no `http://` URL, [`Error::Socket`] if no thread can be started.
pub fn watch_spot_notice(stop: StopHandle) -> Result<(), Error> {
    let endpoint = std::env::var(ENDPOINT_VARIABLE).unwrap_or_else(|_| ENDPOINT.to_owned());
    let service = MetadataService::at(&endpoint)?;
    let failed = Error::socket(&endpoint);
    let runtime = runtime::waiting_thread().map_err(failed)?;
    std::thread::Builder::new()
        .name("carom-spot".into())
        .spawn(move || {
            let notice = runtime.block_on(service.wait());
            tracing::warn!("this machine is taken back: {notice}");
            stop.stop();
        })
        .map_err(failed)?;
    Ok(())
}

/// Client of an instance metadata service.
#[derive(Debug)]
struct MetadataService(HttpService);

impl MetadataService {
    fn at(endpoint: &str) -> Result<Self, Error> {
        let service = HttpService::at(endpoint).map(Self);
        service.ok_or_else(|| {
            let why = format!("`{}` is no http:// address", endpoint.escape_debug());
            Error::directory(ENDPOINT_VARIABLE, why)
        })
    }

    /// Waits for a notice and returns its text.
    async fn wait(&self) -> String {
        let mut reported = false;
        loop {
            match tokio::time::timeout(ANSWER_PATIENCE, self.notice()).await {
                Ok(Ok(Some(notice))) => return notice,
                Ok(Ok(None)) => reported = false,
                fault if !reported => {
                    let why = match fault {
                        Ok(Err(why)) => why,
                        _ => format!("no answer within {} s", ANSWER_PATIENCE.as_secs()),
                    };
                    tracing::warn!("no spot notices from {}: {why}", self.0.authority);
                    reported = true;
                }
                _ => {}
            }
            tokio::time::sleep(PERIOD).await;
        }
    }

    /// The notice, if there is one.
    async fn notice(&self) -> Result<Option<String>, String> {
        let lifetime = ("x-aws-ec2-metadata-token-ttl-seconds", "60");
        let (status, token) = self
            .0
            .ask(Method::PUT, "/latest/api/token", Some(lifetime))
            .await?;
        if status != StatusCode::OK {
            return Err(format!("it gives no token: {status}"));
        }
        let token = ("x-aws-ec2-metadata-token", token.as_str());
        let path = "/latest/meta-data/spot/instance-action";
        match self.0.ask(Method::GET, path, Some(token)).await? {
            (StatusCode::OK, notice) => Ok(Some(notice.escape_debug().to_string())),
            (StatusCode::NOT_FOUND, _) => Ok(None),
            (status, _) => Err(format!("{path}: {status}")),
        }
    }
}

const ENDPOINT_VARIABLE: &str = "AWS_EC2_METADATA_SERVICE_ENDPOINT";
/// The link-local address of the service on every machine of EC2.
const ENDPOINT: &str = "http://169.254.169.254";
/// Polling period, as AWS recommends for spot notices.
const PERIOD: Duration = Duration::from_secs(5);
/// Timeout of a request: the service is on the same host and answers within milliseconds.
const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::net::{SocketAddr, TcpListener};

    use super::*;

    /// A service that demands tokens and gives notice at the second request.
    fn stub() -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || {
            let mut questions = 0;
            for stream in listener.incoming() {
                let mut stream = stream.unwrap();
                let mut head = String::new();
                let mut reader = BufReader::new(stream.try_clone().unwrap());
                while !head.ends_with("\r\n\r\n") {
                    reader.read_line(&mut head).unwrap();
                }
                let head = head.to_ascii_lowercase();
                let (status, body) = if head.starts_with("put /latest/api/token ") {
                    assert!(head.contains("x-aws-ec2-metadata-token-ttl-seconds: 60\r\n"));
                    ("200 OK", "the-token")
                } else if !head.contains("x-aws-ec2-metadata-token: the-token\r\n") {
                    ("401 Unauthorized", "")
                } else {
                    questions += 1;
                    match questions {
                        1 => ("404 Not Found", ""),
                        _ => ("200 OK", r#"{"action":"terminate"}"#),
                    }
                };
                let length = body.len();
                write!(
                    stream,
                    "HTTP/1.1 {status}\r\nContent-Length: {length}\r\n\r\n{body}"
                )
                .unwrap();
            }
        });
        address
    }

    #[test]
    fn a_notice_is_found_by_a_token() {
        let service = MetadataService::at(&format!("http://{}", stub())).unwrap();
        let runtime = runtime::waiting_thread().unwrap();
        runtime.block_on(async {
            assert_eq!(service.notice().await, Ok(None));
            let notice = service.notice().await.unwrap().unwrap();
            assert!(notice.contains("terminate"), "{notice}");
        });
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for endpoint in ["", "169.254.169.254", "https://a", "ftp://b"] {
            let why = MetadataService::at(endpoint).unwrap_err().to_string();
            assert!(why.contains("is no http:// address"), "{why}");
        }
    }
}
