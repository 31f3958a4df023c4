//! Passes blocks from a recorder's thread to the store, without delaying the recorder.

use crate::scope::{OnItsWay, Shared};
use crate::store::Recording;
use crate::together::Member;
use luna_logger::Sink;
use luna_logger::format::{ReadError, Reader};
use std::io::{self, Read};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

/// The limit of waiting blocks: 16 MiB with blocks of 64 KiB, two seconds with one block each 10
/// ms.
const WAITING: usize = 256;

struct Piece {
    bytes: Vec<u8>,
    /// It is the header of a recording.
    is_head: bool,
    _on_its_way: OnItsWay,
}

/// Takes a recording's blocks for the viewers of a [`Scope`](crate::Scope): a [`Sink`] for
/// [`Logging::to_sink`](luna_logger::Logging::to_sink).
///
/// It never waits, unless it is [patient](Self::patient). A block for which there is no room is
/// refused, so that the recorder counts its contents as lost and repeats all declarations.
pub struct ScopeSink {
    shared: Arc<Shared>,
    pieces: SyncSender<Piece>,
    is_patient: bool,
}

impl ScopeSink {
    pub(crate) fn new(shared: &Arc<Shared>) -> io::Result<Self> {
        let (pieces, waiting) = sync_channel(WAITING);
        std::thread::Builder::new()
            .name("luna-scope-feed".to_owned())
            .spawn({
                let shared = shared.clone();
                move || feed(&waiting, &shared)
            })?;
        Ok(Self {
            shared: shared.clone(),
            pieces,
            is_patient: false,
        })
    }

    /// Waits for room instead of refusing: for a receiver of recordings, which cannot request
    /// declarations again. Room comes as fast as the scope decodes, independently of its viewers.
    ///
    /// ```
    /// use luna_scope::{Scope, Settings};
    ///
    /// let scope = Scope::open(Settings::default().address(([127, 0, 0, 1], 0).into()))?;
    /// let sink = scope.sink()?.patient();
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn patient(mut self) -> Self {
        self.is_patient = true;
        self
    }

    fn hand_on(&self, bytes: &[u8], is_head: bool) -> io::Result<()> {
        let piece = Piece {
            bytes: bytes.to_vec(),
            is_head,
            _on_its_way: self.shared.on_its_way(),
        };
        let handed_on = if self.is_patient {
            self.pieces.send(piece).map_err(TrySendError::from)
        } else {
            self.pieces.try_send(piece)
        };
        handed_on.map_err(|error| match error {
            TrySendError::Full(_) => io::Error::other("the scope is too slow"),
            TrySendError::Disconnected(_) => io::Error::other("the scope is closed"),
        })
    }
}

impl Sink for ScopeSink {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.hand_on(head, true)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.hand_on(block, false)
    }
}

impl std::fmt::Debug for ScopeSink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ScopeSink").finish_non_exhaustive()
    }
}

/// The waiting blocks as a reader. It ends where another recording begins.
struct Waiting<'a> {
    pieces: &'a Receiver<Piece>,
    /// None when all of it is read.
    piece: Option<Piece>,
    at: usize,
    /// The header of the next recording.
    next: Option<Piece>,
}

impl Read for Waiting<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        loop {
            if let Some(piece) = &self.piece
                && self.at < piece.bytes.len()
            {
                let most = to.len().min(piece.bytes.len() - self.at);
                to[..most].copy_from_slice(&piece.bytes[self.at..self.at + most]);
                self.at += most;
                return Ok(most);
            }
            // The store has taken it: the reader asks for more.
            self.piece = None;
            match self.pieces.recv() {
                Ok(piece) if piece.is_head => {
                    self.next = Some(piece);
                    return Ok(0);
                }
                Ok(piece) => (self.piece, self.at) = (Some(piece), 0),
                Err(_) => return Ok(0),
            }
        }
    }
}

/// Takes recordings until the sink is gone.
fn feed(pieces: &Receiver<Piece>, shared: &Shared) {
    let mut head = None;
    let mut last = Recording::NONE;
    loop {
        let begins = match head.take() {
            Some(head) => head,
            None => match pieces.recv() {
                Ok(piece) if piece.is_head => piece,
                // Of a recording that could not be read.
                Ok(_) => continue,
                Err(_) => return,
            },
        };
        let mut waiting = Waiting {
            pieces,
            piece: Some(begins),
            at: 0,
            next: None,
        };
        if let Err(error) = recording(&mut waiting, shared, &mut last) {
            shared.store().fail(last, error.to_string());
        }
        head = waiting.next;
    }
}

/// Reads a recording to its end, also while another is shown, so that its sender need not wait.
/// Sets `begun` as soon as the recording has begun.
fn recording(
    waiting: &mut Waiting<'_>,
    shared: &Shared,
    begun: &mut Recording,
) -> Result<(), ReadError> {
    let mut reader = Reader::new(waiting)?;
    if let Some(together) = &shared.together {
        let mut member = Member::new(shared, together);
        while let Some(record) = reader.next()? {
            member.take(&record);
            *begun = member.recording();
            if shared.is_closed() {
                break;
            }
        }
        return Ok(());
    }
    *begun = shared.store().begin();
    while let Some(record) = reader.next()? {
        shared.store().take(*begun, &record);
        if shared.is_closed() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use luna_logger::format::{Encoder, Event, Record};
    use std::thread::JoinHandle;

    /// A recording of one loop, and the thread that takes it.
    struct Sender {
        sink: ScopeSink,
        encoder: Encoder,
        thread: JoinHandle<()>,
    }

    impl Sender {
        /// Returns when the store has begun with it.
        fn begin(shared: &Arc<Shared>) -> Sender {
            let before = shared.store().recording();
            let (pieces, waiting) = sync_channel(WAITING);
            let thread = std::thread::spawn({
                let shared = shared.clone();
                move || feed(&waiting, &shared)
            });
            let is_patient = true;
            let mut sink = ScopeSink {
                shared: shared.clone(),
                pieces,
                is_patient,
            };
            sink.begin(&Encoder::head()).unwrap();
            while shared.store().recording() == before {
                std::thread::yield_now();
            }
            let encoder = Encoder::new();
            Sender {
                sink,
                encoder,
                thread,
            }
        }

        fn slots(&mut self, count: u64) {
            for cycle in 0..count {
                self.encoder.put(&Record::Event(Event {
                    thread: 1,
                    time: cycle,
                    code: 10,
                    subject: 1,
                    arguments: [cycle, 0],
                }));
            }
            self.sink.block(self.encoder.block()).unwrap();
            self.encoder.next();
        }

        /// Returns when all of it has been taken.
        fn end(self) {
            drop(self.sink);
            self.thread.join().unwrap();
        }
    }

    fn cycles(shared: &Shared) -> serde_json::Value {
        shared.store().loops().json()["loops"][0]["count"].clone()
    }

    #[test]
    fn of_several_recordings_the_one_that_begins_last_is_shown_alone() {
        let shared = Arc::new(Shared::new(Settings::default()));
        let mut first = Sender::begin(&shared);
        let mut second = Sender::begin(&shared);
        second.slots(7);
        first.slots(100);
        // Damaged: it ends here, and that is no problem of the other.
        first
            .sink
            .block(b"no block, but long enough to be one")
            .unwrap();
        first.end();
        second.slots(2);
        second.end();
        assert_eq!(cycles(&shared), 9);
        assert!(shared.store().status()["problem"].is_null());

        let third = Sender::begin(&shared);
        let mut sink = third.sink;
        sink.block(b"no block, but long enough to be one").unwrap();
        drop(sink);
        third.thread.join().unwrap();
        assert!(cycles(&shared).is_null());
        assert!(shared.store().status()["problem"].is_string());
    }
}
