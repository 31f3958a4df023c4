//! The guardian: a small program beside this one that brings the machine to safety when this one is
//! gone, whatever killed it.
//!
//! It is a process of its own because nothing within this one survives `kill -9`, the kernel's
//! killer of programs that take too much memory, or a fault of the emergency functions' own memory.
//! It is started by `exec`, not by a bare `fork`: a copy of a program with threads may only do what
//! a handler of signals may, holds copies of all its descriptors, so that devices stay open and
//! other pipes never end, and shares its pages until each is written, when memory may be short. And
//! it learns of the death from the end of a pipe, not from a signal that the kernel sends at the
//! parent's death: that one is sent at the end of the *thread* that made the child, can be lost
//! between the start and the set-up, and is reset by a program with other privileges. A child of a
//! bare `fork` has a copy of the pipe's end: so [`guard`] also waits for a descriptor of the
//! program itself.

use super::emergency::Emergency;
use super::state::{Cause, Degree};
use crate::error::{Error, Result, SetupError};
use crate::notice::notice;
use luna_machine::parent::{ParentWatch, Watched, outlive_requests};
use luna_machine::{memory, signals};
use luna_platform::thread::{
    self, Attributes, EMERGENCY_PRIORITY, MINIMUM_STACK_SIZE, Policy, Thread, apply_to_current,
};
use std::convert::Infallible;
use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long a guardian may take until it is ready.
const READY_WITHIN: Duration = Duration::from_secs(10);

/// How long the end of a system waits for its guardian's.
const ENDS_WITHIN: Duration = Duration::from_secs(2);

/// The line that it gets at the orderly end: nothing is to be done.
const FAREWELL: &[u8] = b"safe\n";

/// A program with this environment variable knows that it is a guardian.
const VARIABLE: &str = "LUNA_GUARDIAN";

/// A program to be started with a system, that brings the machine to safety if the system's program
/// is killed: for [`System::guardian`](crate::System::guardian).
///
/// Its standard input is a pipe that ends with the system's program, whatever killed it, kill -9
/// too. Within ten seconds of its start it writes a line to its standard output: it is ready. Then
/// it reads to the end of the input. If the last line is `safe`, the system has ended in order,
/// emergency functions and all, and nothing is to be done. If the input ends without, the guardian
/// brings the machine to safety, as far as it can beside the hardware's own watchdog. It keeps the
/// device open, or opens it then.
///
/// If it ends while the system runs, that is a warning
/// ([`Cause::GuardianLost`](super::Cause::GuardianLost)), and an emergency of a
/// [`strict`](crate::System::strict) system.
///
/// [`Guardian::this_program`] starts this program once more, which calls
/// [`guard`](super::guard()) first thing in `main`; [`Guardian::command`] another one, a
/// shell's line at its simplest:
///
/// ```
/// use luna::prelude::*;
/// use luna::safety::Guardian;
///
/// let mut system = System::new("arm");
/// let script = "echo ready; while read line; do last=$line; done; [ \"$last\" = safe ] || echo 0 > /dev/null";
/// system.guardian(Guardian::command("sh").arg("-c").arg(script));
/// let main = system.executor("main").build()?;
/// main.process("servo").spawn(async { Ok(()) })?;
/// # if !std::path::Path::new("/bin/sh").exists() { return Ok(()); }
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Guardian {
    program: OsString,
    arguments: Vec<OsString>,
    is_this: bool,
}

impl Guardian {
    /// Another program, by its path or name.
    pub fn command(program: impl AsRef<OsStr>) -> Guardian {
        Guardian {
            program: program.as_ref().to_owned(),
            arguments: Vec::new(),
            is_this: false,
        }
    }

    /// This program once more, with a `main` that begins with [`guard`](crate::safety::guard()):
    /// for a function in Rust, that knows the same devices.
    ///
    /// On Linux it is started from the very file that runs, also if that was replaced meanwhile.
    pub fn this_program() -> Guardian {
        let itself = if cfg!(target_os = "linux") {
            Ok("/proc/self/exe".into())
        } else {
            std::env::current_exe()
        };
        Guardian {
            is_this: true,
            // If the path is unknown, the start fails with that error.
            ..Self::command(itself.unwrap_or_default())
        }
    }

    /// One more argument for it.
    pub fn arg(mut self, argument: impl AsRef<OsStr>) -> Guardian {
        self.arguments.push(argument.as_ref().to_owned());
        self
    }
}

/// Makes this program a guardian if it was started as one by [`Guardian::this_program`]: it does
/// not return then. If not, it returns at once. To be called first thing in `main`.
///
/// `prepare` makes what is needed, such as a device that is opened; what it gives is handed to
/// `neutral` when the system's program was killed. In between the guardian sleeps: in a session of
/// its own, deaf to SIGINT, SIGTERM and SIGHUP, with its memory locked and at the priority of the
/// emergency functions, as far as it is allowed to. A child of the system's program that holds a
/// copy of its descriptors does not keep the guardian waiting (Linux 5.3 or later).
///
/// ```no_run
/// # fn build() -> luna::System { luna::System::new("arm") }
/// fn main() -> luna::Result<()> {
///     luna::safety::guard(
///         || Ok(std::fs::OpenOptions::new().write(true).open("/dev/motor")?),
///         |mut motor| drop(std::io::Write::write_all(&mut motor, b"0\n")),
///     );
///     let mut system = build();
///     system.guardian(luna::safety::Guardian::this_program());
///     println!("{}", system.run()?);
///     Ok(())
/// }
/// ```
pub fn guard<T>(prepare: impl FnOnce() -> std::io::Result<T>, neutral: impl FnOnce(T)) {
    if std::env::var_os(VARIABLE).is_none() {
        return;
    }
    outlive_requests();
    let parent = Parent::watch();
    let prepared = match prepare() {
        Ok(prepared) => prepared,
        Err(error) => {
            notice!("luna: the guardian is not ready: {error}");
            std::process::exit(1);
        }
    };
    let mut input = std::io::stdin().lock();
    let mut last = [0; FAREWELL.len()];
    let policy = Policy::fifo(EMERGENCY_PRIORITY);
    // Best effort, both: the system itself has already reported a refusal.
    let _memory = memory::lock_memory().ok();
    let _ = apply_to_current(&Attributes::framework("luna-guardian", policy));
    if writeln!(std::io::stdout(), "ready").is_err() {
        // The system's program has ended, or has closed the pipe.
        std::process::exit(1);
    }
    while parent.has_input() {
        // All that its buffer takes: what is left there would not be waited for.
        match input.fill_buf() {
            Ok([]) => break,
            Ok(bytes) => {
                for byte in bytes {
                    last.rotate_left(1);
                    last[FAREWELL.len() - 1] = *byte;
                }
                let length = bytes.len();
                input.consume(length);
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(_) => break,
        }
    }
    if last != FAREWELL {
        neutral(prepared);
    }
    std::process::exit(0);
}

/// The system's program, as its guardian sees it: a copy of it that holds the other end of the pipe
/// open is not it.
struct Parent(Option<ParentWatch>);

impl Parent {
    /// Watches it, where the system can; the pipe's end remains otherwise.
    fn watch() -> Self {
        Self(ParentWatch::new().ok())
    }

    /// Waits for input. Returns false if the program has ended and left none.
    fn has_input(&self) -> bool {
        #[cfg(unix)]
        if let Some(watch) = &self.0 {
            use std::os::fd::AsFd;
            return watch.wait_for_input(std::io::stdin().as_fd());
        }
        true
    }
}

/// A running guardian. Dropping this notifies it if all is safe, and waits for its end.
pub(crate) struct GuardianWatch {
    /// Whether it need not do anything when this is dropped: only if that was confirmed.
    is_safe: bool,
    child: Child,
    input: Option<ChildStdin>,
    is_to_end: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    ended: mpsc::Receiver<()>,
}

impl GuardianWatch {
    /// Starts it, and waits until it is ready.
    pub(crate) fn start(
        guardian: &Guardian,
        emergency: Arc<Emergency>,
        is_strict: bool,
    ) -> Result<Self> {
        let failed = |message: String| {
            Error::from(SetupError::Guardian {
                command: guardian.program.to_string_lossy().into_owned(),
                message,
            })
        };
        let mut command = Command::new(&guardian.program);
        command.args(&guardian.arguments);
        if guardian.is_this {
            command.env(VARIABLE, "1");
        } else {
            command.env_remove(VARIABLE);
        }
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| failed(error.to_string()))?;
        let input = child.stdin.take();
        let output = child.stdout.take().map(BufReader::new);
        let is_to_end = Arc::new(AtomicBool::new(false));
        let (ready, is_ready) = mpsc::sync_channel(1);
        let (ends, ended) = mpsc::channel();
        let own = is_to_end.clone();
        let reader = std::thread::Builder::new()
            .name("luna-guardian".to_owned())
            .spawn(move || {
                let _ends = ends;
                if let Some(output) = output
                    && hear(output, &ready)
                    && !own.load(Ordering::Acquire)
                {
                    lost(&emergency, is_strict);
                }
            });
        let mut watch = Self {
            is_safe: false,
            child,
            input,
            is_to_end,
            reader: None,
            ended,
        };
        watch.reader = Some(reader.map_err(|error| failed(error.to_string()))?);
        match is_ready.recv_timeout(READY_WITHIN) {
            Ok(()) => Ok(watch),
            Err(why) => {
                let message = match why {
                    mpsc::RecvTimeoutError::Timeout => {
                        "it did not say within ten seconds that it is ready"
                    }
                    mpsc::RecvTimeoutError::Disconnected => "it has ended",
                };
                // Nothing moves yet.
                watch.is_safe = true;
                let _ = watch.child.kill();
                Err(failed(message.to_owned()))
            }
        }
    }
}

impl GuardianWatch {
    /// Ends it. What the emergency functions did not bring to safety, because one panicked or hung,
    /// is left to it.
    pub(crate) fn end(mut self, is_safe: bool) {
        self.is_safe = is_safe;
    }
}

/// Reads the guardian's output: that it is ready, and then until its end. Returns whether it was
/// ready.
fn hear(mut output: BufReader<ChildStdout>, ready: &mpsc::SyncSender<()>) -> bool {
    let mut line = Vec::new();
    if !matches!(output.read_until(b'\n', &mut line), Ok(length) if length > 0) {
        return false;
    }
    if ready.send(()).is_err() {
        return false;
    }
    // Its further output is not used, and must not fill the pipe.
    let _ = std::io::copy(&mut output, &mut std::io::sink());
    true
}

fn lost(emergency: &Emergency, is_strict: bool) {
    if is_strict {
        emergency.trigger(Cause::GuardianLost);
    } else {
        emergency
            .journal
            .note(Degree::Warning, Cause::GuardianLost, || true);
        notice!(
            "luna: the guardian has ended: nobody would bring the machine to safety if this program were killed"
        );
    }
}

impl Drop for GuardianWatch {
    fn drop(&mut self) {
        self.is_to_end.store(true, Ordering::Release);
        if let Some(mut input) = self.input.take()
            && self.is_safe
        {
            // A guardian that has ended reads nothing.
            let _ = signals::without_write_signals(|| input.write_all(FAREWELL));
        }
        // Its end is noticed by the end of its output: the reader then drops its end of `ended`.
        if self.ended.recv_timeout(ENDS_WITHIN) == Err(mpsc::RecvTimeoutError::Timeout) {
            notice!("luna: the guardian did not end within {ENDS_WITHIN:?} and is left to itself");
            return;
        }
        let _ = self.child.wait();
        if let Some(reader) = self.reader.take() {
            // It holds no user data.
            let _ = reader.join();
        }
    }
}

/// The thread that waits for the parent's death. Dropping it ends it.
pub(crate) struct ParentThread {
    watch: Arc<ParentWatch>,
    thread: Option<Thread<()>>,
}

impl ParentThread {
    /// Starts it. A machine that does not support it is an error if that `is_strict`, else a
    /// notice.
    pub(crate) fn start(
        emergency: Arc<Emergency>,
        policy: Policy,
        is_strict: bool,
    ) -> Result<Option<Self>> {
        let watch = match ParentWatch::new() {
            Ok(watch) => Arc::new(watch),
            Err(error) => {
                let error = Error::from(SetupError::system(format!(
                    "the parent process cannot be watched: {error}; Linux 5.3 or later can (pidfd_open(2))"
                )));
                if is_strict {
                    return Err(error);
                }
                notice!("luna: {error}");
                return Ok(None);
            }
        };
        let own = watch.clone();
        let thread = thread::spawn(
            Attributes::framework("luna-parent", policy).stack_size(MINIMUM_STACK_SIZE),
            |_| Ok::<_, Infallible>(()),
            move |()| {
                if own.wait() == Watched::HasEnded {
                    emergency.trigger(Cause::ParentDied);
                }
            },
        )
        .map_err(|error| Error::not_started("the watch of the parent process", error))?;
        Ok(Some(Self {
            watch,
            thread: Some(thread),
        }))
    }
}

impl Drop for ParentThread {
    fn drop(&mut self) {
        self.watch.stop();
        if let Some(thread) = self.thread.take() {
            // It holds no user data.
            let _ = thread.join();
        }
    }
}
