//! Where blocks go.

use crate::format::Tally;
use luna_machine::new_file;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The destination of a recording's blocks. It is called on a thread of its own, and may block:
/// then the recorder waits for it, the rings fill, and what has no room there is lost and counted.
/// At the end of the recording it has [a limit](crate::Logging::end_within).
///
/// The blocks that it takes are the recording; the contents of blocks that it refuses are lost and
/// counted.
pub trait Sink: Send {
    /// Takes the bytes before the first block.
    ///
    /// # Errors
    ///
    /// The sink's own; the recording does not begin then.
    fn begin(&mut self, head: &[u8]) -> io::Result<()>;

    /// Takes a block completely, or refuses it and keeps nothing of it.
    ///
    /// # Errors
    ///
    /// An error of the sink's. The contents of the block are lost. The next block repeats all
    /// declarations.
    ///
    /// [`WouldBlock`](io::ErrorKind::WouldBlock): it cannot take the block yet. The block is
    /// offered again.
    fn block(&mut self, block: &[u8]) -> io::Result<()>;

    /// Where the recording goes, as the report and errors name it.
    fn place(&self) -> String {
        "a sink".to_owned()
    }

    /// The name of the recorded system. Called first.
    fn is_of(&mut self, _system: &str) {}

    /// At how many bytes a block is full, at most 64 KiB.
    fn block_size(&self) -> usize {
        64 << 10
    }

    /// Whether everything is to be declared again: the next block then begins with the session.
    /// Called after each block, and ten times a second.
    fn wants_declarations(&mut self) -> bool {
        false
    }

    /// The contents of blocks that it had taken and that are lost nevertheless, since the last
    /// call. Called after each block, and ten times a second.
    fn take_lost(&mut self) -> Tally {
        Tally::default()
    }

    /// The recording has ended, and there are no more blocks. Five seconds after `limit` its thread
    /// is detached. After a panic of the sink this is called with a limit of zero, so that
    /// [`take_lost`](Self::take_lost) reports its losses; it may then panic again.
    ///
    /// # Errors
    ///
    /// An error of the sink's, which goes into the report.
    fn end(&mut self, _limit: Duration) -> io::Result<()> {
        Ok(())
    }
}

/// A file. A block that cannot be written completely (a full disk) is truncated, so that the file
/// stays readable. Writing continues when there is room again.
#[derive(Debug)]
pub struct FileSink {
    path: PathBuf,
    file: File,
    /// How long the file is with its last whole block.
    length: u64,
    is_broken: bool,
    /// How often it is brought to the disk, and when it was.
    sync: Option<(Duration, Instant)>,
}

impl FileSink {
    /// A new file. Two programs do not write one file: it is locked.
    ///
    /// # Errors
    ///
    /// [`AlreadyExists`](io::ErrorKind::AlreadyExists) if there is something in it, or another
    /// program writes it. Else the system's own, or that of [`check_name`](Self::check_name).
    ///
    /// ```
    /// use luna_logger::FileSink;
    /// assert!(FileSink::create("/no/such/folder/run.luna".as_ref()).is_err());
    /// ```
    pub fn create(path: &Path) -> io::Result<FileSink> {
        Self::check_name(path)?;
        new_file::create(path).map(|file| Self::to(path.to_owned(), file))
    }

    /// As [`create`](Self::create). If that is taken, one with a number: `run.luna`, `run-2.luna`.
    /// [`place`](Sink::place) names it.
    ///
    /// # Errors
    ///
    /// The system's own, or that of [`check_name`](Self::check_name).
    pub fn create_numbered(path: &Path) -> io::Result<FileSink> {
        Self::check_name(path)?;
        new_file::create_numbered(path).map(|(path, file)| Self::to(path, file))
    }

    /// A file whose former content is lost.
    ///
    /// # Errors
    ///
    /// [`WouldBlock`](io::ErrorKind::WouldBlock) if another program writes it: nothing is lost
    /// then. Else the system's own, or that of [`check_name`](Self::check_name).
    pub fn replace(path: &Path) -> io::Result<FileSink> {
        Self::check_name(path)?;
        new_file::replace(path).map(|file| Self::to(path.to_owned(), file))
    }

    fn to(path: PathBuf, file: File) -> FileSink {
        FileSink {
            path,
            file,
            length: 0,
            is_broken: false,
            sync: None,
        }
    }

    /// Refuses a name that ends in `.replay`: that is a replay log, another kind of file.
    ///
    /// # Errors
    ///
    /// [`InvalidInput`](io::ErrorKind::InvalidInput).
    ///
    /// ```
    /// use luna_logger::FileSink;
    /// assert!(FileSink::check_name("run.luna".as_ref()).is_ok());
    /// assert!(FileSink::check_name("run.replay".as_ref()).is_err());
    /// ```
    pub fn check_name(path: &Path) -> io::Result<()> {
        match path.extension().is_some_and(|suffix| suffix == "replay") {
            true => Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "a recording of the logger is a .luna; a .replay is a replay log, which \
                 `System::record` or `luna demo --record` makes",
            )),
            false => Ok(()),
        }
    }

    /// Writes it to the disk (`fdatasync`) when this time has passed since the last time, and at
    /// the end.
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
    fn place(&self) -> String {
        self.path.display().to_string()
    }

    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.append(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.append(block)?;
        match &mut self.sync {
            Some((period, last)) if last.elapsed() >= *period => {
                *last = Instant::now();
                // The block is in the file. If the disk has failed, syncing fails again at the end
                // and is reported there.
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

/// Any output for bytes. It is not used after the first error, since a partly written block cannot
/// be removed.
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

luna_platform::debug_fields!(impl[W] WriterSink<W>, |sink| is_broken: sink.is_broken);
