//! Shared by the tests: a watchdog, skipping, random numbers, and programs that run in a process of
//! their own.

#![allow(dead_code, unused_imports, reason = "each test file uses some of it")]

mod log;
#[path = "../shared/spawn.rs"]
mod spawn;
mod temp_file;

pub(crate) use crate::shared::{Random, Watchdog, is_long, sample, say, seed, skip, watchdog};
pub(crate) use log::Log;
use luna::error::SetupError;
use luna::inspect::Deadlock;
use luna::system::ProcessBuilder;
use luna::{End, Error, Policy, Report, System};
pub(crate) use spawn::SpawnOk;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::sync::{PoisonError, RwLock, RwLockReadGuard};
pub(crate) use temp_file::TempFile;

/// Whether the complete platform layer is below: policies, cores and signals.
pub(crate) const COMPLETE: bool = cfg!(all(target_os = "linux", not(luna_portable)));

/// Whether this program is given real-time policies.
pub(crate) fn has_real_time() -> bool {
    let mut probe = System::new("probe");
    probe
        .executor("probe")
        .policy(Policy::fifo(1))
        .build()
        .unwrap();
    probe.run().unwrap().threads[0].policy == Policy::fifo(1)
}

/// The core for a test of real-time policies; `None` where they are not given, which is reported.
pub(crate) fn real_time_core() -> Option<usize> {
    if !COMPLETE || !has_real_time() {
        skip("no real-time policies are given here");
        return None;
    }
    Some(luna_platform::thread::available_cores()[0])
}

/// Where a process can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Placement {
    Executor,
    Thread,
}

pub(crate) const PLACEMENTS: [Placement; 2] = [Placement::Executor, Placement::Thread];

impl Placement {
    /// A process called `name`, on an executor or thread of its own called `on`.
    pub(crate) fn process(self, system: &mut System, on: &str, name: &str) -> ProcessBuilder {
        match self {
            Placement::Executor => system.executor(on).build().unwrap().process(name),
            Placement::Thread => system.thread(on).process(name),
        }
    }
}

/// Runs a strict system to its deadlock.
#[track_caller]
pub(crate) fn deadlock_of(system: &System) -> Deadlock {
    match system.run() {
        Err(Error::Deadlock(deadlock)) => *deadlock,
        other => panic!("expected a deadlock, got {other:?}"),
    }
}

pub(crate) fn strict(name: &str) -> System {
    let mut system = System::new(name);
    system.strict();
    system
}

/// The error of a process with `source`.
pub(crate) fn in_process(name: &str, source: Error) -> Error {
    Error::Process {
        name: name.to_owned(),
        source: Box::new(source),
    }
}

pub(crate) fn panicked(process: &str, message: &str) -> Error {
    in_process(process, Error::Panicked(message.to_owned()))
}

/// Keeps the processor busy until `end`.
pub(crate) fn burn_until(end: luna::Instant) {
    while luna::now() < end {
        std::hint::spin_loop();
    }
}

/// The set-up error that it came to, after a look for parts of its message.
#[track_caller]
pub(crate) fn setup_error<T: std::fmt::Debug>(
    outcome: luna::Result<T>,
    parts: &[&str],
) -> SetupError {
    let error = match outcome.unwrap_err() {
        Error::Process { source, .. } => *source,
        error => error,
    };
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    match error {
        Error::Setup(error) => error,
        other => panic!("expected a set-up error, got {other:?}"),
    }
}

pub(crate) const PART: &str = "LUNA_TEST_PART";

/// The part that this program plays, if it is a child of a test. Call it in a test named `part`.
pub(crate) fn part() -> Option<String> {
    std::env::var(PART).ok()
}

/// The path of the test `part` in the caller's module, as the harness names it.
#[track_caller]
pub(crate) fn part_of_caller() -> String {
    let caller = std::path::Path::new(std::panic::Location::caller().file());
    // `tests/it/MODULE.rs` or `tests/it/MODULE/FILE.rs`.
    let mut components = caller.components().map(|part| part.as_os_str());
    components.find(|part| *part == "it" || *part == "own");
    let module = std::path::Path::new(components.next().unwrap()).with_extension("");
    format!("{}::part", module.display())
}

/// Held for reading by tests that look at the end of a pipe or socket, and for writing while a
/// program is started: until it runs, it has copies of all descriptors of this one, so that an end
/// that was closed here is open still.
static FORKS: RwLock<()> = RwLock::new(());

/// No program is started by another test meanwhile. The test itself starts none.
pub(crate) struct WithoutForks(
    #[expect(dead_code, reason = "it is held")] RwLockReadGuard<'static, ()>,
);

/// Waits until no program is being started, and lets none be.
pub(crate) fn without_forks() -> WithoutForks {
    WithoutForks(FORKS.read().unwrap_or_else(PoisonError::into_inner))
}

/// Starts a program, while no test looks at the end of a pipe.
pub(crate) fn spawn(command: &mut Command) -> Child {
    let _alone = FORKS.write().unwrap_or_else(PoisonError::into_inner);
    command.spawn().unwrap()
}

/// As [`spawn`], and waits for the end of the program. Gives what it said.
pub(crate) fn output(command: &mut Command) -> Output {
    command.stdout(Stdio::piped());
    spawn(command).wait_with_output().unwrap()
}

/// A child process that runs a part of this very test program.
pub(crate) struct Program {
    child: Child,
    output: BufReader<ChildStdout>,
}

/// How such a program ended, and what it said after what was read already.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    pub(crate) output: String,
    pub(crate) errors: String,
}

impl Program {
    /// Runs the test `part` of the caller's module, which finds `part` by [`part`].
    #[track_caller]
    pub(crate) fn start(part: &str) -> Self {
        let program = Command::new(std::env::current_exe().unwrap());
        Self::start_by(program, &part_of_caller(), part)
    }

    /// With `command`, to which what the test program needs is appended; it runs `test`.
    pub(crate) fn start_by(mut command: Command, test: &str, part: &str) -> Self {
        command
            .args([test, "--exact", "--nocapture", "--test-threads=1"])
            .env(PART, part)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = spawn(&mut command);
        let output = BufReader::new(child.stdout.take().unwrap());
        Self { child, output }
    }

    /// Reads until the program has said `line`; gives the lines before.
    pub(crate) fn wait_for(&mut self, line: &str) -> Vec<String> {
        let mut before = Vec::new();
        loop {
            let mut text = String::new();
            if self.output.read_line(&mut text).unwrap() == 0 {
                let mut errors = String::new();
                self.child
                    .stderr
                    .as_mut()
                    .unwrap()
                    .read_to_string(&mut errors)
                    .unwrap();
                panic!(
                    "the program ended without saying `{line}`, but: {before:?}, and on standard error: {errors}"
                );
            }
            // The harness writes the test's name before its first line.
            if text.trim_end().ends_with(line) {
                return before;
            }
            before.push(text.trim_end().to_owned());
        }
    }

    /// The next line that the program says on standard error; empty when it has ended.
    pub(crate) fn error_line(&mut self) -> String {
        // Byte by byte, so that nothing is read that `end` is to give.
        let mut line = Vec::new();
        let mut byte = [0];
        let errors = self.child.stderr.as_mut().unwrap();
        while errors.read(&mut byte).unwrap() == 1 {
            line.push(byte[0]);
            if byte[0] == b'\n' {
                break;
            }
        }
        String::from_utf8_lossy(&line).into_owned()
    }

    /// Closes its standard input.
    pub(crate) fn close_input(&mut self) {
        self.child.stdin.take();
    }

    /// Its number as a process.
    pub(crate) fn number(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal, by number.
    #[cfg(unix)]
    pub(crate) fn signal(&self, signal: i32) {
        use nix::sys::signal::{Signal, kill};
        kill(
            nix::unistd::Pid::from_raw(self.child.id() as i32),
            Signal::try_from(signal).unwrap(),
        )
        .unwrap();
    }

    /// Waits for its end. Its standard input stays open until then.
    pub(crate) fn end(mut self) -> Ended {
        let mut errors = self.child.stderr.take().unwrap();
        let errors = std::thread::spawn(move || {
            let mut text = String::new();
            errors.read_to_string(&mut text).map(|_| text)
        });
        let mut output = String::new();
        self.output.read_to_string(&mut output).unwrap();
        // `Child::wait` would close the input, which some programs are blocked on.
        let input = self.child.stdin.take();
        let status = self.child.wait().unwrap();
        drop(input);
        Ended {
            status,
            output,
            errors: errors.join().unwrap().unwrap(),
        }
    }
}

impl Ended {
    /// The lines among `lines`, in the order in which they were said.
    pub(crate) fn said(&self, lines: &[&str]) -> Vec<&str> {
        self.lines().filter(|line| lines.contains(line)).collect()
    }

    /// The lines of its output, without what the harness writes before the first.
    pub(crate) fn lines(&self) -> impl Iterator<Item = &str> {
        self.output.lines().map(|line| {
            line.split_once("::part ... ")
                .map_or(line, |(_test, line)| line)
        })
    }
}

/// A command that runs a program as a user without privileges.
#[cfg(unix)]
fn as_nobody(program: &std::path::Path) -> Command {
    let mut command = Command::new("setpriv");
    command
        .args(["--reuid=65534", "--regid=65534", "--clear-groups", "--"])
        .arg(program)
        .current_dir("/");
    command
}

/// As [`as_nobody`], with real-time priorities up to 98: all that a user may have, below the
/// emergency's.
#[cfg(unix)]
fn as_limited(program: &std::path::Path) -> Command {
    let as_nobody = as_nobody(program);
    let mut command = Command::new("prlimit");
    command
        .arg("--rtprio=98:98")
        .arg(as_nobody.get_program())
        .args(as_nobody.get_args())
        .current_dir("/");
    command
}

/// Runs a part as a user without privileges, if that can be; this program may run as one already.
#[cfg(unix)]
#[track_caller]
pub(crate) fn as_plain_user(part: &str) -> Option<Ended> {
    if !has_real_time() {
        return Some(Program::start(part).end());
    }
    as_other_user(as_nobody, part)
}

/// Runs a part as a user with real-time priorities up to 98, if the machine allows it.
#[cfg(unix)]
#[track_caller]
pub(crate) fn as_limited_user(part: &str) -> Option<Ended> {
    as_other_user(as_limited, part)
}

#[cfg(unix)]
#[track_caller]
fn as_other_user(by: fn(&std::path::Path) -> Command, part: &str) -> Option<Ended> {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;
    if !nix::unistd::geteuid().is_root() {
        skip("this user is not root, and cannot run a program as another one");
        return None;
    }
    // One at a time: a program that another thread makes meanwhile would for a moment keep the copy
    // open for writing, and the copy could not be run.
    static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _alone = ALONE.lock().unwrap();
    // Where that user can read it.
    let folder = std::env::temp_dir().join(format!(
        "luna-{}-{}",
        std::process::id(),
        part.replace(' ', "-")
    ));
    let copy = folder.join("program");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(std::env::current_exe().unwrap(), &copy).unwrap();
    for path in [&folder, &copy] {
        std::fs::set_permissions(path, Permissions::from_mode(0o755)).unwrap();
    }
    let test = part_of_caller();
    let can = {
        let _alone = FORKS.write().unwrap_or_else(PoisonError::into_inner);
        by(&copy)
            .arg("--list")
            .output()
            .is_ok_and(|output| output.status.success())
    };
    let ended = can.then(|| Program::start_by(by(&copy), &test, part).end());
    std::fs::remove_dir_all(folder).unwrap();
    if !can {
        skip("no program can be run as that user, with setpriv and its limits");
    }
    ended
}

/// Runs a part until it is ready, sends it a signal, and waits for its end.
#[cfg(unix)]
#[track_caller]
pub(crate) fn end_by(part: &str, signal: i32) -> Ended {
    let mut program = Program::start(part);
    program.wait_for("ready");
    program.signal(signal);
    program.end()
}

/// Ends a child program with its report: with 70 and the number of the signal that ended it.
pub(crate) fn exit_by(report: &Report) -> ! {
    println!("{report}");
    std::process::exit(match report.end {
        End::Signal(number) => 70 + number,
        _ => 1,
    })
}

/// A watchdog for a test that waits for files; none where the platform cannot, which is reported.
pub(crate) fn with_files() -> Option<Watchdog> {
    watchdog_if_complete("the portable layer cannot wait for files")
}

/// As [`with_files`], for a test that looks at the end of a pipe or socket.
pub(crate) fn with_ends() -> Option<(Watchdog, WithoutForks)> {
    with_files().map(|watchdog| (watchdog, without_forks()))
}

/// A watchdog for a test of signals; none where there are none, which is reported.
pub(crate) fn with_signals() -> Option<Watchdog> {
    watchdog_if_complete("the portable layer has no signals")
}

fn watchdog_if_complete(why_not: &str) -> Option<Watchdog> {
    if !COMPLETE {
        skip(why_not);
    }
    COMPLETE.then(watchdog)
}
