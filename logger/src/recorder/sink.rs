//! Where blocks go.

use std::fmt;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

/// What takes a recording's blocks. It may wait as long as it likes: only the recorder's thread does.
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
    fn block(&mut self, block: &[u8]) -> io::Result<()>;
}

/// A file. A block that cannot be written whole (a full disk) is taken back, so that the file stays readable, and goes on when there is room again.
#[derive(Debug)]
pub struct FileSink {
    file: File,
    /// How long the file is with its last whole block.
    length: u64,
    is_broken: bool,
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
        })
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
        self.append(block)
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
