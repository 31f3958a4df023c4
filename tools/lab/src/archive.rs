//! Archives in the form that the kernel unpacks at its start: cpio, "newc", not compressed.

use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

const DIRECTORY: u32 = 0o040_000;
const FILE: u32 = 0o100_000;
const LINK: u32 = 0o120_000;

/// An archive that is being written. Its entries are root's and have no times, so that the same
/// files make the same archive.
#[derive(Debug)]
pub(crate) struct Archive<W> {
    out: W,
    entries: u32,
}

impl<W: Write> Archive<W> {
    pub(crate) fn new(out: W) -> Archive<W> {
        Archive { out, entries: 0 }
    }

    /// A folder; those above it have to be there already.
    pub(crate) fn folder(&mut self, name: &str) -> io::Result<()> {
        self.head(name, DIRECTORY | 0o755, 0)
    }

    /// A file with these bytes.
    pub(crate) fn bytes(&mut self, name: &str, mode: u32, bytes: &[u8]) -> io::Result<()> {
        self.file(name, mode, bytes.len() as u64, bytes)
    }

    /// A file of the host, which may be run if it may be run there.
    ///
    /// # Errors
    ///
    /// It is no file, cannot be read, or is 4 GiB or larger.
    pub(crate) fn copy(&mut self, name: &str, from: &Path) -> io::Result<()> {
        let file = fs::File::open(from)?;
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "it is no plain file",
            ));
        }
        let mode = metadata.permissions().mode() & 0o777;
        self.file(name, mode, metadata.len(), file)
    }

    /// All that is below a folder of the host: folders, files and symbolic links, by their names.
    pub(crate) fn tree(&mut self, below: &str, from: &Path) -> io::Result<()> {
        let mut entries = fs::read_dir(from)?.collect::<io::Result<Vec<_>>>()?;
        entries.sort_by_key(|entry| entry.file_name());
        for entry in entries {
            let own = entry.file_name();
            let Some(own) = own.to_str() else {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    format!("{}: its name is no UTF-8", entry.path().display()),
                ));
            };
            let name = if below.is_empty() {
                own.to_owned()
            } else {
                format!("{below}/{own}")
            };
            let kind = entry.file_type()?;
            if kind.is_dir() {
                self.folder(&name)?;
                self.tree(&name, &entry.path())?;
            } else if kind.is_symlink() {
                let target = fs::read_link(entry.path())?;
                let target = target.as_os_str().as_bytes();
                self.head(&name, LINK | 0o777, target.len() as u64)?;
                self.body(target.len() as u64, target)?;
            } else {
                self.copy(&name, &entry.path())?;
            }
        }
        Ok(())
    }

    /// Writes what ends an archive, and gives its output back.
    pub(crate) fn finish(mut self) -> io::Result<W> {
        self.head("TRAILER!!!", 0, 0)?;
        self.out.flush()?;
        Ok(self.out)
    }

    fn file(&mut self, name: &str, mode: u32, size: u64, content: impl Read) -> io::Result<()> {
        self.head(name, FILE | mode, size)?;
        self.body(size, content)
    }

    fn head(&mut self, name: &str, mode: u32, size: u64) -> io::Result<()> {
        let size = u32::try_from(size)
            .map_err(|_| io::Error::new(io::ErrorKind::FileTooLarge, "it has 4 GiB or more"))?;
        self.entries += 1;
        // Inode, mode, user, group, links, time, size, device and special device, length of the
        // name with its zero, checksum (none).
        let length = name.len() as u32 + 1;
        let fields = [self.entries, mode, 0, 0, 1, 0, size, 0, 0, 0, 0, length, 0];
        let mut head = "070701".to_owned();
        for field in fields {
            head.push_str(&format!("{field:08X}"));
        }
        head.push_str(name);
        self.out.write_all(head.as_bytes())?;
        // The head has 110 bytes. Name and body each end at a multiple of four.
        self.out
            .write_all(&[0; 4][..1 + padding(head.len() as u64 + 1)])
    }

    fn body(&mut self, size: u64, content: impl Read) -> io::Result<()> {
        let copied = io::copy(&mut content.take(size), &mut self.out)?;
        if copied != size {
            return Err(io::Error::new(
                io::ErrorKind::UnexpectedEof,
                "it became shorter while it was read",
            ));
        }
        self.out.write_all(&[0; 3][..padding(size)])
    }
}

fn padding(length: u64) -> usize {
    (length.wrapping_neg() % 4) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// Reads an archive: names, modes and bodies.
    fn entries(mut bytes: &[u8]) -> Vec<(String, u32, Vec<u8>)> {
        let mut all = Vec::new();
        loop {
            let field = |index: usize| {
                let digits = &bytes[6 + 8 * index..14 + 8 * index];
                u32::from_str_radix(std::str::from_utf8(digits).unwrap(), 16).unwrap()
            };
            assert_eq!(&bytes[..6], b"070701");
            let (mode, size, name) = (field(1), field(6) as usize, field(11) as usize);
            let text = std::str::from_utf8(&bytes[110..110 + name - 1]).unwrap();
            assert_eq!(bytes[110 + name - 1], 0);
            let begin = (110 + name).next_multiple_of(4);
            if text == "TRAILER!!!" {
                return all;
            }
            all.push((text.to_owned(), mode, bytes[begin..begin + size].to_owned()));
            bytes = &bytes[(begin + size).next_multiple_of(4)..];
        }
    }

    #[test]
    fn an_archive_has_what_was_put_in_it() {
        let host = tempfile::tempdir().unwrap();
        fs::create_dir(host.path().join("lib")).unwrap();
        fs::write(host.path().join("lib/one.so"), "five!").unwrap();
        fs::set_permissions(
            host.path().join("lib/one.so"),
            PermissionsExt::from_mode(0o750),
        )
        .unwrap();
        symlink("one.so", host.path().join("lib/a")).unwrap();
        let mut archive = Archive::new(Vec::new());
        archive.tree("", host.path()).unwrap();
        archive.bytes("init", 0o755, b"#!").unwrap();
        archive.bytes("empty", 0o644, b"").unwrap();
        let bytes = archive.finish().unwrap();
        let expected: [(&str, u32, &[u8]); 5] = [
            ("lib", 0o040_755, b""),
            ("lib/a", 0o120_777, b"one.so"),
            ("lib/one.so", 0o100_750, b"five!"),
            ("init", 0o100_755, b"#!"),
            ("empty", 0o100_644, b""),
        ];
        let found = entries(&bytes);
        let found: Vec<_> = found
            .iter()
            .map(|(name, mode, body)| (&**name, *mode, &**body))
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_same_files_make_the_same_archive() {
        let once = || {
            let host = tempfile::tempdir().unwrap();
            for name in ["c", "a", "b"] {
                fs::write(host.path().join(name), name).unwrap();
            }
            let mut archive = Archive::new(Vec::new());
            archive.tree("", host.path()).unwrap();
            archive.finish().unwrap()
        };
        assert_eq!(once(), once());
    }

    #[test]
    fn a_file_that_cannot_be_put_in_is_refused() {
        let mut archive = Archive::new(Vec::new());
        assert!(archive.copy("folder", Path::new("/")).is_err());
        assert!(archive.copy("none", Path::new("/none/such")).is_err());
        let sizes = archive.head("large", FILE, 1 << 32).unwrap_err();
        assert_eq!(sizes.kind(), io::ErrorKind::FileTooLarge);
    }
}
