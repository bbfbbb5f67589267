//! A page that shows readings as they arrive: a small server that only this machine can reach.
//!
//! It listens on the loopback address, and answers requests that contain its token, name it as their host and
//! come from no other origin; so another site that is open in the browser can neither read the skin nor guess
//! its address. A browser gets the newest frame at most 60 times a second; frames that it misses are counted. It gets
//! every event that ends while it is connected.

use std::collections::VecDeque;
use std::collections::hash_map::RandomState;
use std::fmt::Write as _;
use std::hash::{BuildHasher, Hasher};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::page::LiveUpdate;

/// Shortest time between two frames that a browser gets.
const FRAME: Duration = Duration::from_micros(16_667);

/// Largest request, in bytes, and how long it may take to arrive.
const MAX_REQUEST: u64 = 16_384;
const MAX_WAIT: Duration = Duration::from_secs(5);

/// Connections that are answered at once; a browser opens a few.
const MAX_CONNECTIONS: usize = 16;

/// How long the last frame can be fetched after the input has ended.
const LINGER: Duration = Duration::from_millis(500);

/// Events that are kept for browsers that are slow.
const MAX_EVENTS: usize = 1000;

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
    /// The latest events, each with the number of the frame with which it was known; that after the last frame for those
    /// that end with the input.
    events: VecDeque<(u64, String)>,
    has_ended: bool,
}

impl Latest {
    fn keep(&mut self, frame: u64, events: Vec<String>) {
        self.events.extend(events.into_iter().map(|event| (frame, event)));
        self.events.drain(..self.events.len().saturating_sub(MAX_EVENTS));
    }

    /// The events since a frame, as a list in JSON.
    fn events_since(&self, seen: u64) -> String {
        let since = self.events.iter().skip_while(|(frame, _)| *frame <= seen);
        let events: Vec<&str> = since.map(|(_, event)| event.as_str()).collect();
        format!("[{}]", events.join(","))
    }
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
    pub fn show(&self, update: LiveUpdate) {
        let mut latest = self.shared.latest();
        latest.count += 1;
        latest.frame = update.frame.into();
        let count = latest.count;
        latest.keep(count, update.events);
        self.shared.changed.notify_all();
    }

    /// Notifies the browsers that no frame follows, and of the events that have ended with the last one, as
    /// [`LiveFrames::finish`](super::LiveFrames::finish) gives them.
    pub fn end(self, events: Vec<String>) {
        let mut latest = self.shared.latest();
        let after = latest.count + 1;
        latest.keep(after, events);
        latest.has_ended = true;
        drop(latest);
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
            let (count, frame, events) = (latest.count, Arc::clone(&latest.frame), latest.events_since(seen));
            drop(latest);
            if count <= seen {
                return write!(connection, "event: end\ndata: {{\"events\":{events}}}\n\n");
            }
            dropped += count - seen - 1;
            seen = count;
            let sent = Instant::now();
            write!(connection, "data: {{\"dropped\":{dropped},\"events\":{events},{frame}}}\n\n")?;
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

    /// A frame `{"k":K}`, and its number as an event.
    fn update(k: u64) -> LiveUpdate {
        LiveUpdate { frame: format!("\"k\":{k}"), events: vec![k.to_string()] }
    }

    #[test]
    fn a_browser_gets_the_newest_frame_the_number_of_missed_ones_and_all_events() {
        let server = LiveServer::start(String::new()).unwrap();
        (0..3).for_each(|k| server.show(update(k)));
        let mut connection = TcpStream::connect(server.shared.address).unwrap();
        write!(
            connection,
            "GET /{}/frames HTTP/1.1\r\nHost: {}\r\n\r\n",
            server.shared.token, server.shared.address
        )
        .unwrap();
        let mut lines = BufReader::new(connection).lines().map(Result::unwrap);
        let mut next = || -> serde_json::Value {
            let line = lines.find(|line| line.starts_with("data:")).unwrap();
            serde_json::from_str(line.strip_prefix("data:").unwrap()).unwrap()
        };
        assert_eq!(next(), serde_json::json!({"dropped": 0, "events": [2], "k": 2}));
        // Several more frames arrive before the browser reads again.
        (3..7).for_each(|k| server.show(update(k)));
        let mut events = Vec::new();
        loop {
            let data = next();
            events.extend(data["events"].as_array().unwrap().clone());
            if data["k"] == 6 {
                break;
            }
        }
        assert_eq!(events, [3, 4, 5, 6], "each once");
        // More events than are kept leave the latest.
        server.end((0..2 * MAX_EVENTS).map(|k| k.to_string()).collect());
        let last = next()["events"].as_array().unwrap().clone();
        assert_eq!((last.len(), last[0].as_u64()), (MAX_EVENTS, Some(MAX_EVENTS as u64)));
    }
}
