//! Client of small services over plain HTTP: a cloud's metadata, metrics of nodes.

use std::fmt::Display;
use std::time::Duration;

use carom_protocol::limits::HTTP_ANSWER_BYTES_MAX;
use http_body_util::{BodyExt as _, Empty, Limited};
use hyper::body::Bytes;
use hyper::header::HOST;
use hyper::http::uri::Authority;
use hyper::{Method, Request, StatusCode, Uri};
use hyper_util::rt::TokioIo;
use tokio::net::TcpStream;

use crate::Error;
use crate::net::runtime;

/// The text at `http://host:port/path`.
///
/// # Errors
/// [`Error::Directory`] if there is no answer within `patience`, or its status is not 200.
pub fn http_get(url: &str, patience: Duration) -> Result<String, Error> {
    let mut answers = http_get_all(&[url.to_owned()], patience)?;
    answers.remove(0)
}

/// The texts of several URLs, requested concurrently, each with its own error.
///
/// # Errors
/// [`Error::Directory`] if the runtime cannot be created, for want of file descriptors.
pub fn http_get_all(
    urls: &[String],
    patience: Duration,
) -> Result<Vec<Result<String, Error>>, Error> {
    let runtime = runtime::waiting_thread().map_err(|why| Error::directory("http", why))?;
    let mut answers = Vec::new();
    runtime.block_on(async {
        for urls in urls.chunks(AT_ONCE_MAX) {
            let asked = urls.iter().cloned();
            let asked = asked.map(|url| tokio::spawn(async move { get(&url, patience).await }));
            let asked: Vec<_> = asked.collect();
            for (task, url) in asked.into_iter().zip(urls) {
                let answer = task.await;
                answers.push(answer.unwrap_or_else(|panic| Err(Error::directory(url, panic))));
            }
        }
    });
    Ok(answers)
}

async fn get(url: &str, patience: Duration) -> Result<String, Error> {
    let failed = |reason: String| Error::directory(url, reason);
    let service = HttpService::at(url).ok_or_else(|| failed("no http:// address".into()))?;
    let path = url.parse::<Uri>().map(|uri| uri.path().to_owned());
    let path = path.unwrap_or_default();
    let answer = service.ask(Method::GET, &path, None);
    match tokio::time::timeout(patience, answer).await {
        Ok(Ok((StatusCode::OK, text))) => Ok(text),
        Ok(Ok((status, _))) => Err(failed(format!("it answers {status}"))),
        Ok(Err(why)) => Err(failed(why)),
        Err(_) => Err(failed(format!("no answer within {} s", patience.as_secs()))),
    }
}

/// Maximum number of concurrent requests.
const AT_ONCE_MAX: usize = 128;

/// A service at a host and port.
#[derive(Debug)]
pub(super) struct HttpService {
    pub(super) authority: Authority,
}

impl HttpService {
    /// The service of a URL, which must begin with `http://`.
    pub(super) fn at(url: &str) -> Option<Self> {
        let parts = url.parse::<Uri>().ok()?.into_parts();
        let is_http = parts.scheme.as_ref().is_some_and(|it| it == "http");
        let authority = parts.authority.filter(|_| is_http)?;
        Some(Self { authority })
    }

    /// Sends a request over its own connection. An answer longer than [`HTTP_ANSWER_BYTES_MAX`] is an
    /// error.
    pub(super) async fn ask(
        &self,
        method: Method,
        path: &str,
        header: Option<(&str, &str)>,
    ) -> Result<(StatusCode, String), String> {
        let failed = |why: &dyn Display| why.to_string();
        let host = self.authority.host().trim_matches(['[', ']']);
        let address = (host, self.authority.port_u16().unwrap_or(80));
        let stream = TcpStream::connect(address).await;
        let stream = TokioIo::new(stream.map_err(|why| failed(&why))?);
        let handshake = hyper::client::conn::http1::handshake(stream).await;
        let (mut sender, connection) = handshake.map_err(|why| failed(&why))?;
        let mut request = Request::builder()
            .method(method)
            .uri(path)
            .header(HOST, self.authority.as_str());
        if let Some((name, value)) = header {
            request = request.header(name, value);
        }
        let request = request.body(Empty::<Bytes>::new());
        let request = request.map_err(|why| failed(&why))?;
        // Ends with the answer; its errors are reported by the request.
        tokio::spawn(connection);
        let response = sender.send_request(request).await;
        let response = response.map_err(|why| failed(&why))?;
        let status = response.status();
        let body = Limited::new(response.into_body(), HTTP_ANSWER_BYTES_MAX);
        let body = body.collect().await.map_err(|why| failed(&why))?;
        let text = String::from_utf8_lossy(&body.to_bytes()).into_owned();
        Ok((status, text))
    }
}
