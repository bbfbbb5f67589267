//! Rows of a recording or a live stream, one after the other: all of them, or the latest ones.

use std::{
    sync::{Arc, Condvar, Mutex, PoisonError},
    thread,
};

use dermatome::io::{IoError, ReadingsReader};

/// Rows of readings, one after the other.
pub(super) trait Rows {
    /// The next row; false after the last.
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError>;

    /// Number of rows that were dropped.
    fn dropped(&self) -> usize {
        0
    }
}

/// Every row there is.
pub(super) struct Every(pub(super) ReadingsReader);

impl Rows for Every {
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        self.0.read(values, time)
    }
}

/// The latest row, read by a thread of its own: rows that come while a frame is drawn replace each
/// other.
pub(super) struct Latest {
    shared: Arc<(Mutex<Slot>, Condvar)>,
}

#[derive(Default)]
struct Slot {
    row: Option<(Vec<f64>, f64)>,
    ended: Option<Result<(), IoError>>,
    dropped: usize,
}

impl Latest {
    pub(super) fn new(mut reader: ReadingsReader) -> Self {
        let shared = Arc::new((Mutex::new(Slot::default()), Condvar::new()));
        let theirs = Arc::clone(&shared);
        thread::spawn(move || {
            let (slot, changed) = &*theirs;
            let (mut values, mut time) = (Vec::new(), f64::NAN);
            loop {
                let read = reader.read(&mut values, &mut time);
                let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
                let ended = match read {
                    Ok(true) => {
                        let row = slot.row.replace((std::mem::take(&mut values), time));
                        slot.dropped += usize::from(row.is_some());
                        // The buffer of a dropped row is used again.
                        values = row.map_or_else(Vec::new, |(values, _)| values);
                        false
                    }
                    Ok(false) => {
                        slot.ended = Some(Ok(()));
                        true
                    }
                    Err(e) => {
                        slot.ended = Some(Err(e));
                        true
                    }
                };
                changed.notify_one();
                if ended {
                    return;
                }
            }
        });
        Self { shared }
    }
}

impl Rows for Latest {
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        let (slot, changed) = &*self.shared;
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some((row, at)) = slot.row.take() {
                (*values, *time) = (row, at);
                return Ok(true);
            }
            if let Some(ended) = slot.ended.take() {
                return ended.map(|()| false);
            }
            slot = changed.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn dropped(&self) -> usize {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner).dropped
    }
}
