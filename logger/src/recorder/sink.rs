//! Where blocks go.

use crate::format::Tally;
use std::fmt;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// What takes a recording's blocks. It is called on a thread of its own, and may wait as long as it likes: the recorder waits for it, the rings fill, and what has no room there is lost and
/// counted. At the end of the recording it has [a limit](crate::Logging::end_within).
///
/// What it takes is the recording; what it refuses is lost, and counted as such.
pub trait Sink: Send {
    /// Takes what stands before the first block.
    ///
    /// # Errors
    ///
    /// The sink's own; the recording does not begin then.
    fn begin(&mut self, head: &[u8]) -> io::Result<()>;

    /// Takes a block as a whole, or refuses it and keeps nothing of it.
    ///
    /// # Errors
    ///
    /// The sink's own. What is in the block is lost; the sink is asked again with the next one, which repeats all declarations.
    ///
    /// [`WouldBlock`](io::ErrorKind::WouldBlock) says that it cannot take the block yet: it is offered again.
    fn block(&mut self, block: &[u8]) -> io::Result<()>;

    /// The name of the system that is recorded: told before all else.
    fn is_of(&mut self, _system: &str) {}

    /// At how many bytes a block is full, at most 64 KiB.
    fn block_size(&self) -> usize {
        64 << 10
    }

    /// Whether all is to be declared again: the next block then begins with the session. Asked after each block, and ten times a second.
    fn wants_declarations(&mut self) -> bool {
        false
    }

    /// What was in blocks that it has taken, and that are lost after all: since this was asked last. Asked after each block, and ten times a second.
    fn take_lost(&mut self) -> Tally {
        Tally::default()
    }

    /// The recording has ended, and there are no more blocks. It is left alone five seconds after `limit` has passed. Called with no time at all after it has panicked, so that what it
    /// had taken and loses comes by [`take_lost`](Self::take_lost); it may then panic again.
    ///
    /// # Errors
    ///
    /// The sink's own, which is told in the report.
    fn end(&mut self, _limit: Duration) -> io::Result<()> {
        Ok(())
    }
}

/// A file. A block that cannot be written whole (a full disk) is taken back, so that the file stays readable, and goes on when there is room again.
#[derive(Debug)]
pub struct FileSink {
    file: File,
    /// How long the file is with its last whole block.
    length: u64,
    is_broken: bool,
    /// How often it is brought to the disk, and when it was.
    sync: Option<(Duration, Instant)>,
}

impl FileSink {
    /// A new file; one that is there is replaced.
    ///
    /// # Errors
    ///
    /// The system's own.
    ///
    /// ```
    /// use luna_logger::FileSink;
    /// assert!(FileSink::create("/no/such/folder/run.luna".as_ref()).is_err());
    /// ```
    pub fn create(path: &Path) -> io::Result<FileSink> {
        Ok(FileSink {
            file: File::create(path)?,
            length: 0,
            is_broken: false,
            sync: None,
        })
    }

    /// Brings it to the disk (`fdatasync`) when so much time has gone by since that was done last, and at the end.
    pub fn sync_every(mut self, period: Duration) -> FileSink {
        self.sync = Some((period, Instant::now()));
        self
    }

    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.is_broken {
            return Err(io::Error::other(
                "a block was written in part and could not be taken back",
            ));
        }
        if let Err(error) = self.file.write_all(bytes) {
            let back = self
                .file
                .set_len(self.length)
                .and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            self.is_broken = back.is_err();
            return Err(error);
        }
        self.length += bytes.len() as u64;
        Ok(())
    }
}

impl Sink for FileSink {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.append(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.append(block)?;
        match &mut self.sync {
            Some((period, last)) if last.elapsed() >= *period => {
                *last = Instant::now();
                // The block is in the file. That the disk has failed is told at the end, where it fails again.
                let _ = self.file.sync_data();
            }
            _ => {}
        }
        Ok(())
    }

    fn end(&mut self, _limit: Duration) -> io::Result<()> {
        match self.sync {
            Some(_) => self.file.sync_data(),
            None => Ok(()),
        }
    }
}

/// Anything that bytes can be written to. It is given up at the first error, since what it has taken of a block cannot be taken back.
pub struct WriterSink<W> {
    output: W,
    is_broken: bool,
}

impl<W: Write + Send> WriterSink<W> {
    /// A sink of `output`.
    pub fn new(output: W) -> Self {
        Self {
            output,
            is_broken: false,
        }
    }
}

impl<W: Write + Send> Sink for WriterSink<W> {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.block(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        if self.is_broken {
            return Err(io::Error::other("it has failed before"));
        }
        self.output
            .write_all(block)
            .and_then(|()| self.output.flush())
            .inspect_err(|_| self.is_broken = true)
    }
}

impl<W> fmt::Debug for WriterSink<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WriterSink")
            .field("is_broken", &self.is_broken)
            .finish_non_exhaustive()
    }
}
