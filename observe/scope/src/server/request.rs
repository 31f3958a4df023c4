//! Requests, and the checks of their origin.

use std::net::IpAddr;

/// The limit of a request's headers. Browsers send about fifteen.
const MAX_HEADERS: usize = 64;

/// Why a request is refused. Its `Display` is the answer's text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    #[error("The scope does not understand this request.")]
    Malformed,
    #[error("The request is too long.")]
    TooLong,
    #[error("The scope takes no content.")]
    HasBody,
    #[error("The scope only answers GET requests.")]
    Method,
    #[error("The scope does not answer under this name; it can be started with --host NAME.")]
    Host,
    #[error("A page of another origin has no access to the scope.")]
    Origin,
    #[error("There is no such page.")]
    NoSuchPath,
    #[error("This path needs a WebSocket, version 13.")]
    NoWebSocket,
    #[error("The scope has reached its limit of viewers.")]
    TooMany,
}

impl Refusal {
    pub(super) fn status(self) -> &'static str {
        match self {
            Refusal::Malformed => "400 Bad Request",
            Refusal::TooLong => "431 Request Header Fields Too Large",
            Refusal::HasBody => "413 Content Too Large",
            Refusal::Method => "405 Method Not Allowed",
            Refusal::Host => "421 Misdirected Request",
            Refusal::Origin => "403 Forbidden",
            Refusal::NoSuchPath => "404 Not Found",
            Refusal::NoWebSocket => "426 Upgrade Required",
            Refusal::TooMany => "503 Service Unavailable",
        }
    }
}

/// A request that is well-formed.
#[derive(Debug, PartialEq)]
pub(super) struct Request {
    pub(super) path: String,
    pub(super) wants_body: bool,
    /// The WebSocket key of a client that wants to become a viewer.
    pub(super) web_socket: Option<String>,
    host: String,
    origin: Option<String>,
}

impl Request {
    /// Understands a request's line and headers.
    pub(super) fn parse(bytes: &[u8]) -> Result<Request, Refusal> {
        let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        match parsed.parse(bytes) {
            Ok(httparse::Status::Complete(_)) => {}
            Err(httparse::Error::TooManyHeaders) => return Err(Refusal::TooLong),
            _ => return Err(Refusal::Malformed),
        }
        let header = |name: &str| one(parsed.headers, name);
        let wants_body = match parsed.method {
            Some("GET") => true,
            Some("HEAD") => false,
            _ => return Err(Refusal::Method),
        };
        let has_content = header("content-length")?.is_some_and(|length| length != "0");
        if has_content || header("transfer-encoding")?.is_some() {
            return Err(Refusal::HasBody);
        }
        let target = parsed.path.ok_or(Refusal::Malformed)?;
        let path = target.split('?').next().unwrap_or_default();
        let web_socket = match path {
            "/live" => {
                let is_upgrade = wants_body
                    && header("upgrade")?.is_some_and(|to| to.eq_ignore_ascii_case("websocket"))
                    && header("sec-websocket-version")? == Some("13");
                let key = header("sec-websocket-key")?.filter(|key| is_upgrade && key.len() == 24);
                Some(key.ok_or(Refusal::NoWebSocket)?.to_owned())
            }
            _ => None,
        };
        Ok(Request {
            path: path.to_owned(),
            wants_body,
            web_socket,
            host: header("host")?
                .ok_or(Refusal::Malformed)?
                .to_ascii_lowercase(),
            origin: header("origin")?.map(str::to_ascii_lowercase),
        })
    }

    /// Checks that the request was meant for this scope, and comes from its own page. A program
    /// that is not a browser may omit the origin.
    pub(super) fn check(&self, reached: IpAddr, others: &[String]) -> Result<(), Refusal> {
        let (name, port) = split_port(&self.host).ok_or(Refusal::Host)?;
        let address = name.trim_start_matches('[').trim_end_matches(']').parse();
        let is_ours = name == "localhost"
            || address.is_ok_and(|address: IpAddr| {
                address == reached.to_canonical()
                    || (address.is_loopback() && reached.to_canonical().is_loopback())
            })
            || others.iter().any(|other| other == name);
        let is_port = port.is_none_or(|port| port.parse::<u16>().is_ok());
        if !is_ours || !is_port {
            return Err(Refusal::Host);
        }
        match &self.origin {
            Some(origin) if origin.strip_prefix("http://") != Some(&self.host) => {
                Err(Refusal::Origin)
            }
            _ => Ok(()),
        }
    }
}

/// The value of a header that may occur only once.
fn one<'a>(headers: &[httparse::Header<'a>], name: &str) -> Result<Option<&'a str>, Refusal> {
    let mut found = headers
        .iter()
        .filter(|header| header.name.eq_ignore_ascii_case(name));
    let value = found.next().map(|header| header.value);
    if found.next().is_some() {
        return Err(Refusal::Malformed);
    }
    value
        .map(|value| std::str::from_utf8(value).map_err(|_| Refusal::Malformed))
        .transpose()
}

/// A host's name and port; the name of an IPv6 address keeps its brackets.
fn split_port(host: &str) -> Option<(&str, Option<&str>)> {
    let end = match host.starts_with('[') {
        true => host.find(']')? + 1,
        false => host.find(':').unwrap_or(host.len()),
    };
    let (name, rest) = host.split_at(end);
    match rest {
        "" => Some((name, None)),
        _ => Some((name, Some(rest.strip_prefix(':')?))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(lines: &str) -> Result<Request, Refusal> {
        let text = lines.replace('\n', "\r\n") + "\r\n\r\n";
        Request::parse(text.as_bytes())
    }

    fn check(host: &str, origin: &str, reached: &str, others: &[&str]) -> Result<(), Refusal> {
        let origin = match origin {
            "" => String::new(),
            origin => format!("\nOrigin: {origin}"),
        };
        let others: Vec<_> = others.iter().map(|&other| other.to_owned()).collect();
        parse(&format!("GET / HTTP/1.1\nHost: {host}{origin}"))?
            .check(reached.parse().unwrap(), &others)
    }

    #[test]
    fn hosts_that_are_this_machine_are_answered() {
        for host in [
            "localhost",
            "localhost:8620",
            "LocalHost:1",
            "127.0.0.1:8620",
            "[::1]:8620",
        ] {
            assert_eq!(check(host, "", "127.0.0.1", &[]), Ok(()), "{host}");
        }
        assert_eq!(check("192.168.0.7:8620", "", "192.168.0.7", &[]), Ok(()));
        assert_eq!(check("192.168.0.7", "", "::ffff:192.168.0.7", &[]), Ok(()));
        assert_eq!(
            check("robot.local:8620", "", "10.0.0.1", &["robot.local"]),
            Ok(())
        );
    }

    #[test]
    fn other_hosts_are_refused() {
        for host in [
            "evil.example",
            "evil.example:8620",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "10.0.0.1",
            "localhost:x",
            "localhost:8620:1",
            "[::1",
            "[::1]8620",
            "",
            "user@localhost",
        ] {
            assert_eq!(
                check(host, "", "127.0.0.1", &["robot"]),
                Err(Refusal::Host),
                "{host}"
            );
        }
        // Loopback under the name of the loopback alone.
        assert_eq!(check("127.0.0.1", "", "10.0.0.1", &[]), Err(Refusal::Host));
        assert_eq!(parse("GET / HTTP/1.1"), Err(Refusal::Malformed));
        let twice = "GET / HTTP/1.1\nHost: localhost\nHost: evil.example";
        assert_eq!(parse(twice), Err(Refusal::Malformed));
    }

    #[test]
    fn its_own_origin_alone_may_look() {
        let own = |origin| check("localhost:8620", origin, "127.0.0.1", &[]);
        assert_eq!(own("http://localhost:8620"), Ok(()));
        for origin in [
            "http://evil.example",
            "http://localhost",
            "http://localhost:8621",
            "https://localhost:8620",
            "null",
            "http://localhost:8620.evil.example",
            "http://127.0.0.1:8620",
        ] {
            assert_eq!(own(origin), Err(Refusal::Origin), "{origin}");
        }
    }

    #[test]
    fn it_takes_no_content_and_no_other_method() {
        let lines = |line: &str, more: &str| format!("{line} HTTP/1.1\nHost: localhost{more}");
        assert_eq!(parse(&lines("POST /", "")), Err(Refusal::Method));
        assert_eq!(
            parse(&lines("GET /", "\nContent-Length: 5")),
            Err(Refusal::HasBody)
        );
        assert_eq!(
            parse(&lines("GET /", "\nTransfer-Encoding: chunked")),
            Err(Refusal::HasBody)
        );
        assert!(parse(&lines("GET /", "\nContent-Length: 0")).is_ok());
        assert!(!parse(&lines("HEAD /", "")).unwrap().wants_body);
        assert_eq!(parse("nonsense"), Err(Refusal::Malformed));
        let many = "\nX: y".repeat(MAX_HEADERS);
        assert_eq!(parse(&lines("GET /", &many)), Err(Refusal::TooLong));
    }

    #[test]
    fn a_viewer_speaks_web_socket_13() {
        let live = |more: &str| parse(&format!("GET /live HTTP/1.1\nHost: localhost{more}"));
        let good = "\nUpgrade: websocket\nConnection: Upgrade\nSec-WebSocket-Version: 13\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==";
        let key = Some("dGhlIHNhbXBsZSBub25jZQ==".to_owned());
        assert_eq!(live(good).unwrap().web_socket, key);
        for bad in [
            "",
            &good.replace("13", "8"),
            &good.replace("websocket", "h2c"),
            &good.replace("==", ""),
        ] {
            assert_eq!(live(bad), Err(Refusal::NoWebSocket), "{bad}");
        }
    }
}
