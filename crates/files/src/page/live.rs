//! A page that shows readings as they arrive: a small server that only this machine can reach.
//!
//! It listens on the loopback address, and answers requests that contain its token, name it as their host and
//! come from no other origin; so another site that is open in the browser can neither read the skin nor guess
//! its address. A browser gets the newest frame at most 60 times a second; frames that it misses are counted. It gets
//! every event that ends while it is connected, and a comment as a ping where no frame comes, so that a browser that
//! has left is noticed.
//!
//! The few lines of HTTP are here because `tiny_http`, the small server among the crates, has no deadline for a
//! request, no timeout of its sockets and no bound on its threads: a slow client or a browser that has left keeps one
//! as long as it likes.

use std::collections::VecDeque;
use std::collections::hash_map::RandomState;
use std::fmt::Write as _;
use std::hash::{BuildHasher, Hasher};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::page::LiveUpdate;

/// Shortest time between two frames that a browser gets.
const FRAME: Duration = Duration::from_micros(16_667);

/// Longest head of a request, in bytes, how long it may take to arrive, and how long a browser may not read.
const MAX_HEAD: usize = 16_384;
const MAX_WAIT: Duration = Duration::from_secs(5);

/// Time without a frame after which a browser is pinged. The second ping fails if it has left.
const PING: Duration = Duration::from_secs(1);

/// Time after which connections are accepted again if the system gave none, or no thread.
const RETRY: Duration = Duration::from_millis(100);

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
        thread::Builder::new().spawn(move || {
            for connection in listener.incoming() {
                if connection.and_then(|connection| Shared::accept(&served, connection)).is_err() {
                    thread::sleep(RETRY);
                }
            }
        })?;
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

    /// Answers a connection on a thread of its own, unless too many are open.
    fn accept(shared: &Arc<Self>, connection: TcpStream) -> io::Result<()> {
        let open = Open(Arc::clone(shared));
        if shared.connections.fetch_add(1, Ordering::Relaxed) < MAX_CONNECTIONS {
            // A browser that closes the connection is not an error.
            thread::Builder::new().spawn(move || _ = open.0.answer(&connection))?;
        }
        Ok(())
    }

    fn answer(&self, connection: &TcpStream) -> io::Result<()> {
        connection.set_write_timeout(Some(MAX_WAIT))?;
        let deadline = Instant::now() + MAX_WAIT;
        let Some(head) = read_head(connection, deadline)? else {
            let kind = "431 Request Header Fields Too Large";
            respond(connection, kind, "text/plain", &format!("more than {MAX_HEAD} bytes of headers\n"))?;
            return drain(connection, deadline);
        };
        let Some(Request { method, path, hosts, origins }) = Request::parse(&head) else {
            return respond(connection, "400 Bad Request", "text/plain", "not a request of HTTP in UTF-8\n");
        };
        let port = self.address.port();
        let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let is_own = |host: &str| own.iter().any(|own| own.eq_ignore_ascii_case(host));
        let is_own_host = matches!(hosts[..], [host] if is_own(host));
        let is_own_origin = |origin: &&str| origin.strip_prefix("http://").is_some_and(is_own);
        if !is_own_host || !origins.iter().all(is_own_origin) {
            return respond(connection, "403 Forbidden", "text/plain", "another host or origin\n");
        }
        let Some(rest) = path.strip_prefix('/').and_then(|path| path.strip_prefix(&self.token)) else {
            return respond(connection, "404 Not Found", "text/plain", "nothing is here\n");
        };
        match (method, rest) {
            ("GET", "/") => respond(connection, "200 OK", "text/html; charset=utf-8", &self.page),
            ("GET", "/frames") => self.stream(connection),
            _ => respond(connection, "404 Not Found", "text/plain", "nothing is here\n"),
        }
    }

    /// Sends frames until the input or the browser ends.
    fn stream(&self, mut connection: &TcpStream) -> io::Result<()> {
        write!(connection, "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{HEADERS}\r\n\r\n")?;
        let (mut seen, mut dropped) = (self.latest().count.saturating_sub(1), 0);
        loop {
            let latest = self.latest();
            let wait = |latest: &mut Latest| latest.count <= seen && !latest.has_ended;
            let waited = self.changed.wait_timeout_while(latest, PING, wait);
            let (latest, time) = waited.unwrap_or_else(PoisonError::into_inner);
            if time.timed_out() {
                drop(latest);
                write!(connection, ":\n\n")?;
                continue;
            }
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

/// A connection that is counted until it is dropped.
struct Open(Arc<Shared>);

impl Drop for Open {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The lines before the empty line of a request; `None` if they are too long.
fn read_head(connection: &TcpStream, deadline: Instant) -> io::Result<Option<Vec<u8>>> {
    let (mut head, mut part) = (Vec::new(), [0; 4096]);
    loop {
        if let Some(end) = head.windows(4).position(|bytes| bytes == b"\r\n\r\n") {
            head.truncate(end);
            return Ok(Some(head));
        }
        if head.len() > MAX_HEAD {
            return Ok(None);
        }
        match read_until(connection, deadline, &mut part)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            count => head.extend_from_slice(&part[..count]),
        }
    }
}

fn read_until(mut connection: &TcpStream, deadline: Instant, part: &mut [u8]) -> io::Result<usize> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(ErrorKind::TimedOut.into());
    }
    connection.set_read_timeout(Some(left))?;
    connection.read(part)
}

/// Reads the rest of a request that is not looked at: what a closed socket has not read resets the connection,
/// and the answer is lost.
fn drain(connection: &TcpStream, deadline: Instant) -> io::Result<()> {
    connection.shutdown(Shutdown::Write)?;
    while read_until(connection, deadline, &mut [0; 4096])? > 0 {}
    Ok(())
}

/// The request line and the headers that are checked.
struct Request<'a> {
    method: &'a str,
    path: &'a str,
    hosts: Vec<&'a str>,
    origins: Vec<&'a str>,
}

impl<'a> Request<'a> {
    fn parse(head: &'a [u8]) -> Option<Self> {
        let mut lines = std::str::from_utf8(head).ok()?.split("\r\n");
        let mut words = lines.next()?.split(' ');
        let (method, path) = (words.next()?, words.next()?);
        let headers: Vec<_> = lines.filter_map(|line| line.split_once(':')).collect();
        let of = |wanted: &str| {
            let named = headers.iter().filter(|(name, _)| name.eq_ignore_ascii_case(wanted));
            named.map(|(_, value)| value.trim()).collect()
        };
        Some(Self { method, path, hosts: of("host"), origins: of("origin") })
    }
}

/// Headers of every answer.
const HEADERS: &str = "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
                       X-Frame-Options: DENY\r\nCross-Origin-Resource-Policy: same-origin\r\nConnection: close";

fn respond(mut connection: &TcpStream, status: &str, kind: &str, body: &str) -> io::Result<()> {
    let length = body.len();
    write!(
        connection,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{HEADERS}\r\n\r\n{body}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};

    /// The answer to a request of these lines.
    fn ask(server: &LiveServer, path: &str, headers: &[String]) -> String {
        let headers: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
        answer(server, format!("GET {path} HTTP/1.1\r\n{headers}\r\n").as_bytes())
    }

    fn answer(server: &LiveServer, request: &[u8]) -> String {
        let mut connection = TcpStream::connect(server.shared.address).unwrap();
        connection.write_all(request).unwrap();
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
        assert!(ask(&server, &path, &[host.clone(), foreign.clone()]).starts_with("HTTP/1.1 403"));
        let own = format!("Origin: http://{}", server.shared.address);
        assert!(ask(&server, &path, &[host, foreign, own]).starts_with("HTTP/1.1 403"), "any of two origins");
        let capitals = format!("HOST: LocalHost:{}", server.shared.address.port());
        assert!(ask(&server, &path, &[capitals]).starts_with("HTTP/1.1 200"), "hosts have no case");
        // Another site whose name resolves to this machine.
        assert!(ask(&server, &path, &["Host: example.com".into()]).starts_with("HTTP/1.1 403"));
        assert!(ask(&server, &path, &[]).starts_with("HTTP/1.1 403"));
    }

    #[test]
    fn long_and_foreign_and_slow_requests_end() {
        let server = LiveServer::start(String::new()).unwrap();
        let mut slow = TcpStream::connect(server.shared.address).unwrap();
        let begin = Instant::now();
        let cookies = [format!("Cookie: {}", "x".repeat(100_000))];
        assert!(ask(&server, "/", &cookies).starts_with("HTTP/1.1 431"));
        assert!(answer(&server, b"GET /\xff HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 400"));
        assert!(answer(&server, b"\r\n\r\n").starts_with("HTTP/1.1 400"));
        // A byte at a time does not put off the end.
        while slow.write_all(b"G").is_ok() && begin.elapsed() < 3 * MAX_WAIT {
            thread::sleep(Duration::from_millis(200));
        }
        assert!((MAX_WAIT..2 * MAX_WAIT).contains(&begin.elapsed()), "{:?}", begin.elapsed());
    }

    /// Browsers that have left are noticed while no frame comes.
    #[test]
    fn pages_that_were_closed_free_their_connections() {
        let server = LiveServer::start(String::new()).unwrap();
        server.show(update(0));
        let host = format!("Host: {}", server.shared.address);
        let request = format!("GET /{}/frames HTTP/1.1\r\n{host}\r\n\r\n", server.shared.token);
        for _ in 0..MAX_CONNECTIONS {
            let mut connection = TcpStream::connect(server.shared.address).unwrap();
            connection.write_all(request.as_bytes()).unwrap();
            let headers = BufReader::new(connection).lines().find(|line| line.as_ref().unwrap().is_empty());
            assert!(headers.is_some());
        }
        let (begin, path) = (Instant::now(), format!("/{}/", server.shared.token));
        let is_answered = || {
            let mut connection = TcpStream::connect(server.shared.address).unwrap();
            let sent = write!(connection, "GET {path} HTTP/1.1\r\n{host}\r\n\r\n");
            let mut answer = String::new();
            sent.is_ok()
                && connection.read_to_string(&mut answer).is_ok()
                && answer.starts_with("HTTP/1.1 200")
        };
        while !is_answered() {
            assert!(begin.elapsed() < 10 * PING, "no connection is free");
            thread::sleep(PING / 10);
        }
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
