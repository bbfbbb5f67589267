//! A page that shows readings as they arrive: a small server that only this machine can reach.
//!
//! It listens on the loopback address, and answers requests that contain its token, name it as their host and
//! come from no other origin; so another site that is open in the browser can neither read the skin nor guess
//! its address. A browser gets the newest frame at most 60 times a second; frames that it misses are counted.

use std::collections::hash_map::RandomState;
use std::fmt::Write as _;
use std::hash::{BuildHasher, Hasher};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Shortest time between two frames that a browser gets.
const FRAME: Duration = Duration::from_micros(16_667);

/// Largest request, in bytes, and how long it may take to arrive.
const MAX_REQUEST: u64 = 16_384;
const MAX_WAIT: Duration = Duration::from_secs(5);

/// Connections that are answered at once; a browser opens a few.
const MAX_CONNECTIONS: usize = 16;

/// How long the last frame can be fetched after the input has ended.
const LINGER: Duration = Duration::from_millis(500);

/// Serves a page and the frames that it shows.
#[derive(Debug)]
pub struct LiveServer {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    page: String,
    token: String,
    address: SocketAddr,
    latest: Mutex<Latest>,
    changed: Condvar,
    connections: AtomicUsize,
}

/// The newest frame.
#[derive(Debug, Default)]
struct Latest {
    count: u64,
    /// As JSON, without the braces.
    frame: Arc<str>,
    has_ended: bool,
}

impl LiveServer {
    /// Starts to serve a page on a free port of the loopback address.
    ///
    /// # Errors
    /// If the system gives no port.
    pub fn start(page: String) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let (latest, changed, connections) = Default::default();
        let shared = Arc::new(Shared { page, token: token(), address, latest, changed, connections });
        let served = Arc::clone(&shared);
        thread::spawn(move || {
            for connection in listener.incoming().flatten() {
                let shared = Arc::clone(&served);
                if shared.connections.fetch_add(1, Ordering::Relaxed) >= MAX_CONNECTIONS {
                    shared.connections.fetch_sub(1, Ordering::Relaxed);
                    continue;
                }
                thread::spawn(move || {
                    // A browser that closes the connection is not an error.
                    let _ = shared.answer(&connection);
                    shared.connections.fetch_sub(1, Ordering::Relaxed);
                });
            }
        });
        Ok(Self { shared })
    }

    /// The address of the page; whoever knows it can see the readings from this machine.
    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.shared.address, self.shared.token)
    }

    /// Shows a frame, as [`LiveFrames::next`](super::LiveFrames::next) gives it.
    pub fn show(&self, frame: String) {
        let mut latest = self.shared.latest();
        latest.count += 1;
        latest.frame = frame.into();
        self.shared.changed.notify_all();
    }

    /// Notifies the browsers that no frame follows.
    pub fn end(self) {
        self.shared.latest().has_ended = true;
        self.shared.changed.notify_all();
        thread::sleep(LINGER);
    }
}

/// 128 bits that cannot be guessed: from the keys of the standard library's hash maps, which come from the system.
fn token() -> String {
    let mut token = String::new();
    for _ in 0..2 {
        // Writing to a string cannot fail.
        let _ = write!(token, "{:016x}", RandomState::new().build_hasher().finish());
    }
    token
}

impl Shared {
    fn latest(&self) -> MutexGuard<'_, Latest> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, connection: &TcpStream) -> io::Result<()> {
        connection.set_read_timeout(Some(MAX_WAIT))?;
        connection.set_write_timeout(Some(MAX_WAIT))?;
        let Request { method, path, hosts, origin } = Request::read(connection)?;
        let port = self.address.port();
        let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let is_own_host = matches!(&hosts[..], [host] if own.contains(host));
        let is_own_origin =
            origin.is_none_or(|origin| own.iter().any(|host| origin == format!("http://{host}")));
        if !is_own_host || !is_own_origin {
            return respond(connection, "403 Forbidden", "text/plain", "another host or origin\n");
        }
        let Some(rest) = path.strip_prefix('/').and_then(|path| path.strip_prefix(&self.token)) else {
            return respond(connection, "404 Not Found", "text/plain", "nothing is here\n");
        };
        match (method.as_str(), rest) {
            ("GET", "/") => respond(connection, "200 OK", "text/html; charset=utf-8", &self.page),
            ("GET", "/frames") => self.stream(connection),
            _ => respond(connection, "404 Not Found", "text/plain", "nothing is here\n"),
        }
    }

    /// Sends frames until the input or the browser ends.
    fn stream(&self, mut connection: &TcpStream) -> io::Result<()> {
        write!(
            connection,
            "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n"
        )?;
        let (mut seen, mut dropped) = (self.latest().count.saturating_sub(1), 0);
        loop {
            let latest = self.latest();
            let wait = |latest: &mut Latest| latest.count <= seen && !latest.has_ended;
            let latest = self.changed.wait_while(latest, wait).unwrap_or_else(PoisonError::into_inner);
            let (count, frame) = (latest.count, Arc::clone(&latest.frame));
            drop(latest);
            if count <= seen {
                return write!(connection, "event: end\ndata: {{}}\n\n");
            }
            dropped += count - seen - 1;
            seen = count;
            let sent = Instant::now();
            write!(connection, "data: {{\"dropped\":{dropped},{frame}}}\n\n")?;
            connection.flush()?;
            thread::sleep(FRAME.saturating_sub(sent.elapsed()));
        }
    }
}

/// The request line and the headers that are checked.
struct Request {
    method: String,
    path: String,
    hosts: Vec<String>,
    origin: Option<String>,
}

impl Request {
    fn read(connection: &TcpStream) -> io::Result<Self> {
        let mut lines = BufReader::new(connection.take(MAX_REQUEST)).lines();
        let end = || io::Error::from(ErrorKind::UnexpectedEof);
        let first = lines.next().ok_or_else(end)??;
        let mut words = first.split(' ').map(str::to_owned);
        let (method, path) = words.next().zip(words.next()).ok_or_else(end)?;
        let mut request = Self { method, path, hosts: Vec::new(), origin: None };
        for line in lines {
            let line = line?;
            if line.is_empty() {
                return Ok(request);
            }
            let Some((name, value)) = line.split_once(':') else { continue };
            if name.eq_ignore_ascii_case("host") {
                request.hosts.push(value.trim().to_owned());
            } else if name.eq_ignore_ascii_case("origin") {
                request.origin = Some(value.trim().to_owned());
            }
        }
        Err(end())
    }
}

fn respond(mut connection: &TcpStream, status: &str, kind: &str, body: &str) -> io::Result<()> {
    write!(
        connection,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nX-Frame-Options: DENY\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer to a request of these lines.
    fn ask(server: &LiveServer, path: &str, headers: &[String]) -> String {
        let mut connection = TcpStream::connect(server.shared.address).unwrap();
        let headers: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
        write!(connection, "GET {path} HTTP/1.1\r\n{headers}\r\n").unwrap();
        let mut answer = String::new();
        connection.read_to_string(&mut answer).unwrap();
        answer
    }

    #[test]
    fn requests_need_the_token_and_this_host_and_origin() {
        let server = LiveServer::start("<p>skin</p>".into()).unwrap();
        let (path, host) = (format!("/{}/", server.shared.token), format!("Host: {}", server.shared.address));
        assert!(ask(&server, &path, std::slice::from_ref(&host)).ends_with("<p>skin</p>"));
        let own = format!("Origin: http://{}", server.shared.address);
        assert!(ask(&server, &path, &[host.clone(), own]).starts_with("HTTP/1.1 200"));
        assert!(ask(&server, "/", std::slice::from_ref(&host)).starts_with("HTTP/1.1 404"));
        let wrong = format!("/{}/", "0".repeat(32));
        assert!(ask(&server, &wrong, std::slice::from_ref(&host)).starts_with("HTTP/1.1 404"));
        let foreign = "Origin: https://example.com".to_owned();
        assert!(ask(&server, &path, &[host, foreign]).starts_with("HTTP/1.1 403"));
        // Another site whose name resolves to this machine.
        assert!(ask(&server, &path, &["Host: example.com".into()]).starts_with("HTTP/1.1 403"));
        assert!(ask(&server, &path, &[]).starts_with("HTTP/1.1 403"));
    }

    #[test]
    fn a_browser_gets_the_newest_frame_and_the_number_of_missed_ones() {
        let server = LiveServer::start(String::new()).unwrap();
        for k in 0..3 {
            server.show(format!("\"k\":{k}"));
        }
        let mut connection = TcpStream::connect(server.shared.address).unwrap();
        write!(
            connection,
            "GET /{}/frames HTTP/1.1\r\nHost: {}\r\n\r\n",
            server.shared.token, server.shared.address
        )
        .unwrap();
        let mut lines = BufReader::new(connection).lines().map(Result::unwrap);
        let mut next = || lines.find(|line| line.starts_with("data:")).unwrap();
        assert_eq!(next(), "data: {\"dropped\":0,\"k\":2}");
        // Several more frames arrive before the browser reads again.
        for k in 3..7 {
            server.show(format!("\"k\":{k}"));
        }
        let last = loop {
            let line = next();
            if line.contains("\"k\":6") {
                break line;
            }
        };
        assert!(last.contains("\"dropped\":"), "{last}");
        server.end();
        assert_eq!(next(), "data: {}");
    }
}
