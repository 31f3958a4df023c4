//! From a recorder's thread to the store, without ever holding the recorder up.

use crate::scope::Shared;
use luna_logger::Sink;
use luna_logger::format::{ReadError, Reader};
use std::io::{self, Read};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

/// So many blocks may wait to be looked at: with 64 KiB each 16 MiB, with those of 10 ms two seconds.
const WAITING: usize = 256;

enum Piece {
    Head(Vec<u8>),
    Block(Vec<u8>),
}

/// Takes a recording's blocks for the viewers of a [`Scope`](crate::Scope): a [`Sink`] for [`Logging::to_sink`](luna_logger::Logging::to_sink).
///
/// It never waits, unless it is to be [patient](Self::patient). A block for which there is no room is refused, so that the recorder counts what is in it as lost, and repeats all
/// declarations.
pub struct ScopeSink {
    pieces: SyncSender<Piece>,
    is_patient: bool,
}

impl ScopeSink {
    pub(crate) fn new(shared: &Arc<Shared>) -> io::Result<Self> {
        let (pieces, waiting) = sync_channel(WAITING);
        let shared = shared.clone();
        std::thread::Builder::new()
            .name("luna-scope-feed".to_owned())
            .spawn(move || feed(&waiting, &shared))?;
        Ok(Self {
            pieces,
            is_patient: false,
        })
    }

    /// Waits for room instead of refusing: for who receives recordings and cannot ask for anything again. Room comes as fast as the scope reads, whoever looks at it.
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

    fn hand_on(&self, piece: Piece) -> io::Result<()> {
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
        self.hand_on(Piece::Head(head.to_vec()))
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.hand_on(Piece::Block(block.to_vec()))
    }
}

impl std::fmt::Debug for ScopeSink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ScopeSink").finish_non_exhaustive()
    }
}

/// What waits, as a reader wants it; it ends where another recording begins.
struct Waiting<'a> {
    pieces: &'a Receiver<Piece>,
    piece: Vec<u8>,
    at: usize,
    /// The head of the recording that has begun.
    next: Option<Vec<u8>>,
}

impl Read for Waiting<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        while self.at == self.piece.len() {
            match self.pieces.recv() {
                Ok(Piece::Block(block)) => (self.piece, self.at) = (block, 0),
                Ok(Piece::Head(head)) => {
                    self.next = Some(head);
                    return Ok(0);
                }
                Err(_) => return Ok(0),
            }
        }
        let most = to.len().min(self.piece.len() - self.at);
        to[..most].copy_from_slice(&self.piece[self.at..self.at + most]);
        self.at += most;
        Ok(most)
    }
}

/// Takes recordings until the sink is gone.
fn feed(pieces: &Receiver<Piece>, shared: &Shared) {
    let mut head = None;
    loop {
        let begins = match head.take() {
            Some(head) => head,
            None => match pieces.recv() {
                Ok(Piece::Head(head)) => head,
                // Of a recording that could not be read.
                Ok(Piece::Block(_)) => continue,
                Err(_) => return,
            },
        };
        let mut waiting = Waiting {
            pieces,
            piece: begins,
            at: 0,
            next: None,
        };
        if let Err(error) = recording(&mut waiting, shared) {
            shared.store().problem = Some(error.to_string());
        }
        head = waiting.next;
    }
}

fn recording(waiting: &mut Waiting<'_>, shared: &Shared) -> Result<(), ReadError> {
    let mut reader = Reader::new(waiting)?;
    shared.store().begin();
    while let Some(record) = reader.next()? {
        shared.store().take(&record);
        if shared.is_closed() {
            break;
        }
    }
    Ok(())
}
