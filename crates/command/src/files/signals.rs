//! What ^C, `kill` and a closed terminal do: a live stream ends, and its run completes what it has;
//! any other run, and a stream at the second signal, removes its temporary files.

use std::io::{self, Read, stdin};
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::{fs, process, thread};

use dermatome::io::Outputs;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;

/// Exit code of a stopped run, less the number of the signal; as shells have it.
const STOPPED: i32 = 128;

/// Bytes that are read from a stream at once, and how many such pieces wait for the run.
const PIECE: usize = 1 << 16;
const WAITING: usize = 4;

type Piece = io::Result<Vec<u8>>;

/// The live stream, which a signal ends.
static STREAM: Mutex<Option<SyncSender<Piece>>> = Mutex::new(None);

/// The signal that ended it, or 0.
static SIGNAL: AtomicI32 = AtomicI32::new(0);

/// From now on a signal ends the live stream, or this run.
pub(crate) fn catch_signals(outputs: &Outputs) {
    // Without a handler a stopped run only leaves its files, so go on.
    // A file beyond the limit of its size is then an error of its writer.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    let Ok(mut signals) = Signals::new(signals()) else { return };
    let outputs = outputs.clone();
    let _ = thread::Builder::new().spawn(move || {
        for signal in signals.forever() {
            let Some(stream) = STREAM.lock().unwrap_or_else(PoisonError::into_inner).take() else {
                outputs.discard(|| process::exit(STOPPED + signal));
                return;
            };
            SIGNAL.store(signal, Ordering::SeqCst);
            // Wakes a run that waits. Where pieces wait for the run, it looks at the signal itself.
            let _ = stream.try_send(Ok(Vec::new()));
        }
    });
}

/// The exit code of a run whose live stream was ended by a signal.
pub(crate) fn stopped() -> Option<u8> {
    let signal = SIGNAL.load(Ordering::SeqCst);
    u8::try_from(STOPPED + signal).ok().filter(|_| signal != 0)
}

/// Standard input as a live stream: a signal is an error of reading it.
pub(crate) fn live_input() -> io::Result<impl Read + Send + 'static> {
    let (sender, pieces) = sync_channel(WAITING);
    *STREAM.lock().unwrap_or_else(PoisonError::into_inner) = Some(sender.clone());
    thread::Builder::new().spawn(move || {
        loop {
            let mut piece = vec![0; PIECE];
            let read = stdin().read(&mut piece);
            let is_last = !matches!(read, Ok(1..));
            let piece = read.map(|count| {
                piece.truncate(count);
                piece
            });
            if sender.send(piece).is_err() || is_last {
                return;
            }
        }
    })?;
    Ok(LiveInput { pieces: Some(pieces), piece: Vec::new(), used: 0 })
}

struct LiveInput {
    /// Until the end of the stream, or its error: no piece follows these, but a sender stays for signals.
    pieces: Option<Receiver<Piece>>,
    piece: Vec<u8>,
    used: usize,
}

impl Read for LiveInput {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.used == self.piece.len() {
            let next = self.pieces.take().and_then(|pieces| Some((pieces.recv().ok()?, pieces)));
            (self.piece, self.used) = (Vec::new(), 0);
            if let Some((piece, pieces)) = next {
                self.piece = piece?;
                self.pieces = Some(pieces).filter(|_| !self.piece.is_empty());
            }
        }
        if stopped().is_some() {
            return Err(io::Error::other("the run was stopped"));
        }
        let count = (&self.piece[self.used..]).read(buffer)?;
        self.used += count;
        Ok(count)
    }
}

/// The signals that stop a run. A hangup that the caller ignores stays ignored: `nohup` says so, and
/// a handler would undo it.
fn signals() -> Vec<i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0).collect()
}
