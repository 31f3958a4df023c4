//! Device files: opening one, and the meaning of the system's refusal.

use crate::holder;
use luna_error::DeviceError;
use std::fs::{self, File, FileType, Metadata, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;

/// What a device file must be, for drivers: it opens one, and turns the system's refusal into an
/// error with a remedy.
///
/// ```
/// use luna::devices::{DeviceError, Node};
///
/// let chip = Node::new("GPIO chip").subsystem("gpio").group("gpio");
/// let error = chip.open("/dev/null".as_ref(), true).unwrap_err();
/// # #[cfg(target_os = "linux")]
/// assert!(matches!(error, DeviceError::WrongKind { expected: "GPIO chip", .. }), "{error}");
/// let error = chip.open("/dev/gpiochip99".as_ref(), true).unwrap_err();
/// assert!(matches!(error, DeviceError::Missing { .. }));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Node {
    kind: &'static str,
    subsystem: Option<&'static str>,
    group: &'static str,
}

impl Node {
    /// A character device that is a `kind`, in the words of an error: "GPIO chip".
    pub const fn new(kind: &'static str) -> Self {
        Self {
            kind,
            subsystem: None,
            group: "plugdev",
        }
    }

    /// The subsystem of the kernel that has the devices of this kind, as its folder of `/sys/class`
    /// is called: "gpio". Where the system does not show a device's subsystem, it is not compared.
    #[must_use]
    pub const fn subsystem(mut self, subsystem: &'static str) -> Self {
        self.subsystem = Some(subsystem);
        self
    }

    /// The group that a udev rule would give it by custom: "dialout"; "plugdev" if not stated.
    #[must_use]
    pub const fn group(mut self, group: &'static str) -> Self {
        self.group = group;
        self
    }

    /// What it is called in errors.
    pub fn kind(&self) -> &'static str {
        self.kind
    }

    /// Whether there is such a device, without opening it.
    ///
    /// # Errors
    ///
    /// [`DeviceError::Missing`] or [`DeviceError::WrongKind`], or what kept the system from
    /// looking.
    ///
    /// ```
    /// let node = luna::devices::Node::new("terminal");
    /// assert!(node.check("/dev/null".as_ref()).is_ok()); // a character device; more was not asked for
    /// assert!(node.check("/etc/passwd".as_ref()).is_err());
    /// ```
    pub fn check(&self, path: &Path) -> Result<(), DeviceError> {
        let about = fs::metadata(path).map_err(|error| self.explain(path, error))?;
        let wrong = |found| DeviceError::WrongKind {
            device: path.display().to_string(),
            expected: self.kind,
            found,
        };
        if !about.file_type().is_char_device() {
            return Err(wrong(what_it_is(about.file_type()).to_owned()));
        }
        match (self.subsystem, subsystem(&about)) {
            (Some(expected), Some(found)) if expected != found => {
                Err(wrong(format!("a device of the subsystem `{found}`")))
            }
            _ => Ok(()),
        }
    }

    /// Checks a device file and opens it to read and write; if `exclusive`, also locks it (`flock`)
    /// against other programs that do so. Neither waits: where the driver would (for a modem's
    /// carrier, say), open with `O_NONBLOCK` yourself, and use [`check`](Self::check),
    /// [`lock`](Self::lock) and [`explain`](Self::explain).
    ///
    /// # Errors
    ///
    /// A [`DeviceError`] with the reason.
    pub fn open(&self, path: &Path, exclusive: bool) -> Result<File, DeviceError> {
        self.check(path)?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map_err(|error| self.explain(path, error))?;
        if exclusive {
            self.lock(path, &file)?;
        }
        Ok(file)
    }

    /// Locks an open device file (`flock`) against other programs that do so too; until it is
    /// closed.
    ///
    /// # Errors
    ///
    /// [`DeviceError::Busy`], with the holder that the kernel names; or its refusal. A file system
    /// that knows no locks is no error.
    ///
    /// ```
    /// use luna::devices::{DeviceError, Holder, Node};
    ///
    /// let path = std::env::temp_dir().join(format!("luna-lock-{}", std::process::id()));
    /// let node = Node::new("sensor");
    /// let first = std::fs::File::create(&path)?;
    /// node.lock(&path, &first)?;
    /// let second = std::fs::File::open(&path)?;
    /// let busy = node.lock(&path, &second);
    /// assert!(matches!(busy, Err(DeviceError::Busy { .. })));
    /// # std::fs::remove_file(&path)?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn lock(&self, path: &Path, file: &File) -> Result<(), DeviceError> {
        match file.try_lock() {
            Ok(()) => Ok(()),
            Err(TryLockError::WouldBlock) => Err(DeviceError::Busy {
                device: path.display().to_string(),
                by: holder::of_lock(path),
            }),
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => Ok(()),
            Err(TryLockError::Error(error)) => Err(self.explain(path, error)),
        }
    }

    /// What it means that the system refused to open `path`, or to use it as this kind of device.
    ///
    /// ```
    /// use luna::devices::{DeviceError, Node};
    ///
    /// let refused = std::io::ErrorKind::PermissionDenied.into();
    /// let error = Node::new("I2C bus").group("i2c").explain("/dev/i2c-1".as_ref(), refused);
    /// assert!(matches!(&error, DeviceError::NoPermission { .. }));
    /// assert!(error.to_string().contains("GROUP=\"i2c\""));
    /// ```
    pub fn explain(&self, path: &Path, error: io::Error) -> DeviceError {
        let device = path.display().to_string();
        match (error.kind(), error.raw_os_error()) {
            (ErrorKind::NotFound, _) | (_, Some(ENXIO | ENODEV)) => DeviceError::Missing {
                device,
                kind: self.kind,
            },
            (ErrorKind::PermissionDenied, _) => DeviceError::NoPermission {
                remedy: self.remedy(path),
                device,
            },
            (ErrorKind::ResourceBusy, _) => DeviceError::Busy {
                by: holder::of_file(path),
                device,
            },
            (_, Some(ENOTTY)) => DeviceError::WrongKind {
                device,
                expected: self.kind,
                found: "a device that does not understand its requests".to_owned(),
            },
            _ => DeviceError::Refused {
                device,
                error: error.into(),
            },
        }
    }

    /// Which group or udev rule lets this user open `path`.
    fn remedy(&self, path: &Path) -> String {
        let about = fs::metadata(path).ok();
        // Read and write for the group, and a group that is for users.
        let group = about
            .as_ref()
            .filter(|about| about.mode() & 0o060 == 0o060 && about.gid() != 0)
            .and_then(|about| {
                group_name(
                    &fs::read_to_string("/etc/group").unwrap_or_default(),
                    about.gid(),
                )
            });
        if let Some(group) = group {
            return format!("its group may: `sudo usermod -aG {group} $USER`, and log in anew");
        }
        let name = path
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let subsystem = self
            .subsystem
            .map_or_else(String::new, |name| format!("SUBSYSTEM==\"{name}\", "));
        let group = self.group;
        format!(
            "add to /etc/udev/rules.d/60-luna.rules the line `{subsystem}KERNEL==\"{name}\", GROUP=\"{group}\", MODE=\"0660\"`, then \
             `sudo udevadm control --reload && sudo udevadm trigger`, `sudo usermod -aG {group} $USER`, and log in anew"
        )
    }
}

/// The subsystem of a character device, where the system shows it.
fn subsystem(about: &Metadata) -> Option<String> {
    let number = about.rdev();
    let major = (number >> 8) & 0xfff | (number >> 32) & !0xfff;
    let minor = number & 0xff | (number >> 12) & !0xff;
    let link = fs::read_link(format!("/sys/dev/char/{major}:{}/subsystem", minor as u32)).ok()?;
    Some(link.file_name()?.to_string_lossy().into_owned())
}

fn what_it_is(kind: FileType) -> &'static str {
    if kind.is_file() {
        "a regular file"
    } else if kind.is_dir() {
        "a folder"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_fifo() {
        "a pipe"
    } else {
        "a block device"
    }
}

/// The name of a group in the text of `/etc/group`.
fn group_name(groups: &str, gid: u32) -> Option<String> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(gid)).then(|| name.to_owned())
    })
}

// The same on every Linux.
const ENXIO: i32 = 6;
const ENODEV: i32 = 19;
const ENOTTY: i32 = 25;

#[cfg(test)]
mod tests {
    use super::*;
    use luna_error::Holder;

    #[test]
    fn a_group_is_found_by_its_number() {
        let groups = "root:x:0:\ndialout:x:20:ann,bob\nbroken\n:x:\ngpio:x:997:\n";
        assert_eq!(group_name(groups, 20).as_deref(), Some("dialout"));
        assert_eq!(group_name(groups, 997).as_deref(), Some("gpio"));
        assert_eq!(group_name(groups, 7), None);
    }

    #[test]
    fn each_refusal_has_its_meaning() {
        let node = Node::new("GPIO chip").subsystem("gpio").group("gpio");
        let path = Path::new("/dev/gpiochip7");
        let explain = |error| node.explain(path, error);
        for number in [2, ENXIO, ENODEV] {
            let error = explain(io::Error::from_raw_os_error(number));
            assert!(matches!(
                error,
                DeviceError::Missing {
                    kind: "GPIO chip",
                    ..
                }
            ));
        }
        assert!(matches!(
            explain(io::Error::from_raw_os_error(16)),
            DeviceError::Busy {
                by: Holder::Unknown,
                ..
            }
        ));
        assert!(matches!(
            explain(io::Error::from_raw_os_error(ENOTTY)),
            DeviceError::WrongKind { .. }
        ));
        let DeviceError::NoPermission { remedy, .. } = explain(io::Error::from_raw_os_error(13))
        else {
            panic!("no permission");
        };
        assert!(
            remedy.contains(r#"SUBSYSTEM=="gpio", KERNEL=="gpiochip7", GROUP="gpio", MODE="0660""#),
            "{remedy}"
        );
        assert!(matches!(
            explain(io::Error::from_raw_os_error(5)),
            DeviceError::Refused { error, .. } if error.code() == Some(5)
        ));
    }

    #[test]
    fn what_is_no_device_is_named() {
        let node = Node::new("GPIO chip").subsystem("gpio");
        let found = |path: &str| match node.check(path.as_ref()) {
            Err(DeviceError::WrongKind { found, .. }) => found,
            other => panic!("{path}: {other:?}"),
        };
        assert_eq!(found("/etc/passwd"), "a regular file");
        assert_eq!(found("/tmp"), "a folder");
        #[cfg(target_os = "linux")]
        if Path::new("/sys/dev/char/1:3/subsystem").exists() {
            assert_eq!(found("/dev/null"), "a device of the subsystem `mem`");
        }
    }
}
