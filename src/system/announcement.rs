//! Announcements: a file for each system that wishes to be found by other programs, with what it is
//! made of.
//!
//! The file is locked as long as the system runs, by a lock that the kernel releases when the
//! program ends, however it does. So a file without that lock is left by a program that was killed,
//! and the program that finds it removes it. It is empty until it is locked: an empty one is left
//! alone.

use super::compose;
use super::plan::Plan;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::notice::notice;
use luna_machine::signals;
use std::fmt::Write as _;
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// How the names of the files begin.
const PREFIX: &str = "luna-system.";

/// The first line: the version.
const HEAD: &str = "luna 1";
/// The last line: so it is whole.
const LAST: &str = "end";

/// No announcement is longer, in bytes.
const LONGEST: u64 = 1 << 20;

/// The variable of the environment that asks for an announcement.
const VARIABLE: &str = "LUNA_ANNOUNCE";

/// Where the files are: the same for all programs of the computer, and gone with a restart of it.
fn folder() -> PathBuf {
    match cfg!(target_os = "linux") {
        true => PathBuf::from("/dev/shm"),
        false => std::env::temp_dir(),
    }
}

/// A system that runs and is [announced](crate::System::announce).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct AnnouncedSystem {
    /// Its name.
    pub name: String,
    /// Its program's process.
    pub pid: u32,
    /// The file name of its program.
    pub program: String,
    /// Its executors and OS threads, as they were at the start.
    pub threads: Vec<AnnouncedThread>,
    /// What it can be reached at: what that is, and the address.
    pub addresses: Vec<(String, String)>,
}

/// An executor or OS thread of an [`AnnouncedSystem`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct AnnouncedThread {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: ThreadKind,
    /// The policy that it has, as [`Policy`](crate::Policy) shows: `fifo:80`.
    pub policy: String,
    /// The core that it is pinned to.
    pub core: Option<usize>,
    /// How many processes it had.
    pub processes: usize,
}

/// What [`announced_systems`] has found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct AnnouncedSystems {
    /// By their processes' numbers.
    pub systems: Vec<AnnouncedSystem>,
    /// Announcements that cannot be read: of other users, or of another version.
    pub hidden: usize,
}

/// The systems of this computer that run, are announced, and belong to this user; for root, those
/// of all users. Removes what programs have left that were killed.
///
/// Not for the real-time path. It holds no lock that a system waits for.
///
/// # Errors
///
/// The folder of shared memory cannot be read.
///
/// ```
/// use luna::inspect::announced_systems;
/// use luna::prelude::*;
///
/// let mut system = System::new("found by others");
/// system.announce().announce_address("scope", "http://127.0.0.1:8620");
/// let main = system.executor("main").build()?;
/// main.process("looks").spawn(async {
///     let found = luna::blocking(announced_systems).await?;
///     let own = std::process::id();
///     let own = found.systems.iter().find(|system| system.pid == own).expect("it is announced");
///     assert_eq!((&*own.name, &*own.threads[0].name), ("found by others", "main"));
///     assert_eq!(own.addresses[0].1, "http://127.0.0.1:8620");
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn announced_systems() -> io::Result<AnnouncedSystems> {
    let mut found = AnnouncedSystems::default();
    for entry in fs::read_dir(folder())? {
        let Ok(entry) = entry else { continue };
        let is_one = entry
            .file_name()
            .to_str()
            .is_some_and(|name| name.starts_with(PREFIX));
        if !is_one {
            continue;
        }
        match read(&entry.path()) {
            Ok(system) => found.systems.extend(system),
            // Its system has just ended.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(_) => found.hidden += 1,
        }
    }
    found
        .systems
        .sort_by(|one, other| (one.pid, &one.name).cmp(&(other.pid, &other.name)));
    Ok(found)
}

/// The system of an announcement; `None` if it is being made, or its program was killed.
fn read(path: &Path) -> io::Result<Option<AnnouncedSystem>> {
    let file = open(path)?;
    let mut text = String::new();
    (&file).take(LONGEST).read_to_string(&mut text)?;
    if text.is_empty() {
        return Ok(None);
    }
    match file.try_lock_shared() {
        Ok(()) => {
            fs::remove_file(path)?;
            Ok(None)
        }
        Err(TryLockError::WouldBlock) if !text.ends_with(&format!("\n{LAST}\n")) => Ok(None),
        Err(TryLockError::WouldBlock) => match parse(&text) {
            Some(system) => Ok(Some(system)),
            None => Err(io::Error::other("it is of another version")),
        },
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Opens a file in a folder where every user may make some, if no other user can have put it there
/// for this one: a name says nothing of what is there.
fn open(path: &Path) -> io::Result<File> {
    let named = fs::symlink_metadata(path)?;
    // To write as well: so a FIFO in its place keeps nobody waiting.
    let file = OpenOptions::new().read(true).write(true).open(path)?;
    match is_announcement(&named, &file.metadata()?) {
        true => Ok(file),
        false => Err(io::Error::other(
            "it is no file that its owner alone can open",
        )),
    }
}

/// Whether a file that was opened is the one that the name stands for, a regular one with this name
/// alone, which its owner and root can open.
#[cfg(unix)]
fn is_announcement(named: &Metadata, opened: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    let is_same = (named.dev(), named.ino()) == (opened.dev(), opened.ino());
    is_same && opened.is_file() && opened.mode() & 0o077 == 0 && opened.nlink() <= 1
}

#[cfg(not(unix))]
fn is_announcement(named: &Metadata, opened: &Metadata) -> bool {
    named.is_file() && opened.is_file()
}

fn parse(text: &str) -> Option<AnnouncedSystem> {
    let rest = text.strip_prefix(HEAD)?.strip_prefix('\n')?;
    let mut system = AnnouncedSystem::default();
    for line in rest.lines() {
        let (what, value) = line.split_once(' ').unwrap_or((line, ""));
        match what {
            "system" => system.name = value.to_owned(),
            "process" => system.pid = value.parse().ok()?,
            "program" => system.program = value.to_owned(),
            "executor" => system.threads.push(thread(ThreadKind::Executor, value)?),
            "thread" => system.threads.push(thread(ThreadKind::OsThread, value)?),
            "address" => {
                let (what, address) = value.split_once(' ')?;
                system.addresses.push((what.to_owned(), address.to_owned()));
            }
            // The last one, and those of later versions.
            _ => {}
        }
    }
    (system.pid != 0).then_some(system)
}

fn thread(kind: ThreadKind, text: &str) -> Option<AnnouncedThread> {
    let mut words = text.splitn(4, ' ');
    let policy = words.next()?.to_owned();
    let core = words.next()?.parse().ok();
    let processes = words.next()?.parse().ok()?;
    let name = words.next()?.to_owned();
    Some(AnnouncedThread {
        name,
        kind,
        policy,
        core,
        processes,
    })
}

/// The announcement of a system that runs. It ends with this.
pub(super) struct Announcement {
    path: PathBuf,
    _locked: File,
}

impl Announcement {
    /// Announces the system, with the addresses that it asked for, or if its environment asks. If
    /// that fails the system goes on: nothing depends on being found.
    pub(super) fn of(plan: &Plan, asked: Option<Vec<(String, String)>>) -> Option<Self> {
        let by_variable = || {
            let value = std::env::var_os(VARIABLE)?;
            (!value.is_empty() && value != "0").then(Vec::new)
        };
        let addresses = asked.or_else(by_variable)?;
        let threads = compose::parts(&plan.members());
        let text = text(plan.name(), &threads, &addresses);
        match signals::without_write_signals(|| Self::make(&text)) {
            Ok(announcement) => Some(announcement),
            Err(error) => {
                let folder = folder();
                notice!(
                    "luna: system `{}` is not announced, so `luna list` does not show it: {}: {error}; {}",
                    plan.name(),
                    folder.display(),
                    remedy(&error)
                );
                None
            }
        }
    }

    fn make(text: &str) -> io::Result<Self> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let name = format!("{PREFIX}{}.{number}", std::process::id());
            let path = folder().join(name);
            let mut file = match options.open(&path) {
                Ok(file) => file,
                // Of a killed program that had the same number.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(error),
            };
            // Nobody locks it as long as it is empty: so it is not waited for.
            let locked = file.try_lock().map_err(io::Error::from);
            let written = locked.and_then(|()| file.write_all(text.as_bytes()));
            let announcement = Self {
                path,
                _locked: file,
            };
            return written.map(|()| announcement);
        }
    }
}

/// What to do about an error of the folder, or of a file in it.
fn remedy(error: &io::Error) -> &'static str {
    use io::ErrorKind::{
        FileTooLarge, NotFound, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
    };
    match error.kind() {
        StorageFull => {
            "make room there, or give it a larger file system (a container's --shm-size)"
        }
        QuotaExceeded => "raise this user's quota, or remove files of its own",
        FileTooLarge => "raise the limit on file sizes (`ulimit -f`, LimitFSIZE=)",
        NotFound => "mount a file system there (tmpfs)",
        ReadOnlyFilesystem => "mount it so that it can be written",
        PermissionDenied => "let this user write there (its mode is 1777 as a rule)",
        _ if is_without_descriptors(error) => {
            "raise the limit on open files (`ulimit -n`, LimitNOFILE=), or close some"
        }
        _ => "see whether files can be made there",
    }
}

/// Whether the process or the machine has as many open files as it may have.
fn is_without_descriptors(error: &io::Error) -> bool {
    #[cfg(unix)]
    {
        /// ENFILE and EMFILE, which all Unixes number so.
        const NUMBERS: [i32; 2] = [23, 24];
        error
            .raw_os_error()
            .is_some_and(|number| NUMBERS.contains(&number))
    }
    #[cfg(not(unix))]
    {
        let _ = error;
        false
    }
}

impl Drop for Announcement {
    fn drop(&mut self) {
        // What cannot be removed has no lock from now on, and is removed by the program that finds
        // it.
        let _ = fs::remove_file(&self.path);
    }
}

fn text(system: &str, threads: &[ThreadPart], addresses: &[(String, String)]) -> String {
    // A name is in one line.
    let line = |text: &str| text.replace(char::is_control, " ");
    let program = std::env::current_exe().unwrap_or_default();
    let program = program.file_name().unwrap_or_default().to_string_lossy();
    let mut text = format!(
        "{HEAD}\nsystem {}\nprocess {}\nprogram {}\n",
        line(system),
        std::process::id(),
        line(&program)
    );
    for thread in threads {
        let kind = match thread.kind {
            ThreadKind::Executor => "executor",
            ThreadKind::OsThread => "thread",
        };
        let core = thread.core.map_or("-".to_owned(), |core| core.to_string());
        let (policy, processes) = (thread.policy, thread.processes.len());
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{kind} {policy} {core} {processes} {}",
            line(&thread.name)
        );
    }
    for (what, address) in addresses {
        let what = line(what).replace(' ', "-");
        let _ = writeln!(text, "address {what} {}", line(address));
    }
    text + LAST + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_platform::thread::Policy;

    fn of(system: &str) -> String {
        let threads = [ThreadPart {
            name: "control and more".to_owned(),
            kind: ThreadKind::Executor,
            policy: Policy::fifo(80),
            core: Some(3),
            processes: Vec::new(),
        }];
        let addresses = [(
            "live scope".to_owned(),
            "http://127.0.0.1:1/?a=b c".to_owned(),
        )];
        text(system, &threads, &addresses)
    }

    #[cfg(unix)]
    #[test]
    fn a_remedy_is_that_of_the_error() {
        let [enospc, emfile, efbig, eacces] = [28, 24, 27, 13];
        for (number, part) in [
            (enospc, "make room"),
            (emfile, "ulimit -n"),
            (efbig, "ulimit -f"),
            (eacces, "let this user write"),
        ] {
            let remedy = remedy(&io::Error::from_raw_os_error(number));
            assert!(remedy.contains(part), "{number}: {remedy}");
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let written = of("feeder\nprocess 1");
        let system = parse(&written).unwrap();
        assert_eq!(
            (&*system.name, system.pid),
            ("feeder process 1", std::process::id())
        );
        let thread = &system.threads[0];
        assert_eq!(thread.name, "control and more");
        assert_eq!((&*thread.policy, thread.core), ("fifo:80", Some(3)));
        let address = (
            "live-scope".to_owned(),
            "http://127.0.0.1:1/?a=b c".to_owned(),
        );
        assert_eq!(system.addresses, [address]);
        assert!(parse(&written.replace("luna 1", "luna 2")).is_none());
        assert!(parse("luna 1\nexecutor fifo:80\n").is_none());
    }

    /// A file as a killed program leaves it, one that is being made, and one of a system that runs.
    #[test]
    fn what_a_killed_program_has_left_is_removed() {
        let left = Announcement::make(&of("killed")).unwrap();
        assert_eq!(read(&left.path).unwrap().unwrap().name, "killed");
        let path = left.path.clone();
        left._locked.unlock().unwrap();
        match read(&path) {
            Ok(found) => assert_eq!(found, None),
            // By a user that looks at all of this computer.
            Err(error) => assert_eq!(error.kind(), io::ErrorKind::NotFound),
        }
        assert!(!path.exists());
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        options.open(&path).unwrap();
        assert_eq!(read(&path).unwrap(), None);
        assert!(path.exists(), "it may be that of a system that starts");
        fs::remove_file(&path).unwrap();
    }

    /// As another user may put there: files that everybody can write, links, and a FIFO, which
    /// would keep waiting a program that opens it to read.
    #[cfg(unix)]
    #[test]
    fn what_another_user_may_have_put_there_is_not_read() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let true_one = Announcement::make(&of("true")).unwrap();
        let path = true_one.path.with_extension("false");
        let is_refused = |what: &str| {
            let error = read(&path).unwrap_err();
            assert!(
                error.to_string().contains("its owner alone"),
                "{what}: {error}"
            );
            fs::remove_file(&path).unwrap();
        };
        symlink(&true_one.path, &path).unwrap();
        is_refused("a symbolic link");
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
        is_refused("a FIFO");
        fs::copy(&true_one.path, &path).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o666)).unwrap();
        is_refused("a file that others can write");
        fs::hard_link(&true_one.path, &path).unwrap();
        is_refused("a second name");
        assert_eq!(read(&true_one.path).unwrap().unwrap().name, "true");
    }
}
