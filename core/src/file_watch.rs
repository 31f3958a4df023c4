//! The files that the processes of one thread wait for: a reactor, and the waits of each file.
//!
//! A file is known to the reactor by the number of its descriptor, once for each thread, however
//! many wait for it. The waits are found from that number: they lie in 256 lists by it. Descriptors
//! are small and dense, so a list is short, and nothing has to grow. After a report the reactor
//! forgets what a file was watched for, but not the file: the next wait for it needs one system
//! call.

use crate::current::PendingWake;
use crate::executor::Shared;
use crate::files::FileError;
use crate::waiting::OpList;
use luna_platform::bell::{Bell, Hook, Watch};
use luna_platform::clock::Instant;
use luna_platform::futex::Waited;
use luna_platform::lock::PiLock;
use luna_platform::on_drop::OnDrop;
use luna_platform::reactor::{BorrowedFd, Interest, Reactor, ReactorError, Readiness};
use std::cell::{Cell, RefCell};
use std::os::fd::{AsRawFd, RawFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

/// A busy thread looks at its files once in this many rounds: a look costs half a microsecond.
const ROUNDS_PER_LOOK: u32 = 64;

/// Makes what this thread needs to wait for files, so that its first wait does not have to on the
/// real-time path: three descriptors and 4 KiB. Does nothing where a wait was made before.
///
/// # Errors
///
/// [`FileError`]: no process runs here, the platform cannot wait for files, or the program has no
/// descriptors left.
///
/// ```
/// use luna_core::{FileError, block_on, prepare_files};
///
/// assert_eq!(prepare_files(), Err(FileError::NoProcess));
/// let prepared = block_on(async { prepare_files() }).unwrap();
/// assert!(prepared.is_ok() || prepared.unwrap_err().is_unsupported());
/// ```
pub fn prepare_files() -> Result<(), FileError> {
    ThreadFiles::here().map(drop)
}

luna_platform::local! {
    /// The hook for this thread's files, and the files, while it runs processes.
    static HERE: RefCell<Option<Here>> = const { RefCell::new(None) };
    /// Whether this thread has files to look at. Its address stands for the thread.
    static HAS_FILES: Cell<bool> = const { Cell::new(false) };
}

/// This thread, among those that live.
fn this_thread() -> usize {
    HAS_FILES.with(|flag| std::ptr::from_ref(flag).addr())
}

/// Looks at this thread's files now and then, without sleeping: called in each round of a busy
/// thread.
#[inline]
pub(crate) fn glance(bell: &Bell) {
    if HAS_FILES.get() {
        bell.glance();
    }
}

/// Whether processes of this thread, which sleeps by `bell`, wait for files.
#[inline]
pub(crate) fn is_waiting(_: &Bell) -> bool {
    HAS_FILES.get()
        && HERE.with_borrow(|here| {
            let files = here.as_ref().and_then(|here| here.files.as_ref());
            files.is_some_and(|files| files.count.load(Ordering::Acquire) > 0)
        })
}

struct Here {
    hook: Hook,
    /// The executor that this thread is, if it looks at its files only when asked to.
    executor: Option<Arc<Shared>>,
    files: Option<Arc<ThreadFiles>>,
}

/// Lets the processes of this thread, which sleeps by `bell`, wait for files until the guard is
/// dropped. An `executor` is asked to look at them once there are any.
pub(crate) fn enter(bell: &Bell, executor: Option<Arc<Shared>>) -> OnDrop<impl FnMut() + use<>> {
    let here = Here {
        hook: bell.hook().clone(),
        executor,
        files: None,
    };
    HAS_FILES.set(false);
    // The former value: a process may be made by a builder that runs another one first.
    let mut before = HERE.replace(Some(here));
    OnDrop::new(move || {
        let before = before.take();
        HAS_FILES.set(before.as_ref().is_some_and(|here| here.files.is_some()));
        drop(HERE.replace(before));
    })
}

/// The files of one thread.
///
/// Its thread alone enlists, reports and sleeps. A wait that is dropped on another thread withdraws
/// itself from there, hence the lock; it is free in all other cases.
pub(crate) struct ThreadFiles {
    /// The thread, as the value of `this_thread`.
    thread: usize,
    reactor: Reactor,
    /// Held also while the reactor is updated, so that it never watches for less than what the
    /// lists want.
    pub(crate) waits: PiLock<Waits>,
    /// Number of waits. Read by the owner, to which a wait of its own is never hidden.
    count: AtomicUsize,
    /// Since the last look; the owner's alone.
    rounds: AtomicU32,
}

impl ThreadFiles {
    /// This thread's files, made if it has none yet.
    pub(crate) fn here() -> Result<Arc<ThreadFiles>, FileError> {
        HERE.with_borrow_mut(|here| {
            let here = here.as_mut().ok_or(FileError::NoProcess)?;
            if let Some(files) = &here.files {
                return Ok(files.clone());
            }
            let files = Arc::new(ThreadFiles {
                thread: this_thread(),
                reactor: Reactor::new().map_err(FileError::Refused)?,
                waits: PiLock::new(Waits::new()),
                count: AtomicUsize::new(0),
                rounds: AtomicU32::new(0),
            });
            // The thread is awake, since it polls: only then may a watch be added.
            // This thread alone sets it, once.
            let _ = here.hook.set(files.clone());
            HAS_FILES.set(true);
            if let Some(executor) = &here.executor {
                executor.inbound.ask_for_files();
            }
            here.files = Some(files.clone());
            Ok(files)
        })
    }

    /// Watches a file also for one more wait, which is about to be listed in `waits`.
    pub(crate) fn arm(
        &self,
        waits: &mut Waits,
        file: BorrowedFd<'_>,
        wait: FileWait,
    ) -> Result<(), FileError> {
        let FileWait { fd, interest } = wait;
        let interest = waits
            .interest(fd)
            .map_or(interest, |others| both(interest, others));
        // Mostly it was waited for before. If it was closed since, this is another file by the same
        // number, and the kernel treats it as another.
        match self.reactor.rearm(file, fd as u64, interest) {
            Err(ReactorError::NotRegistered { .. }) => {
                self.reactor.register(file, fd as u64, interest)
            }
            outcome => outcome,
        }
        .map_err(FileError::Refused)?;
        self.count.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    /// A wait for `file` has taken itself off `waits`, on any thread.
    pub(crate) fn disarm(&self, waits: &mut Waits, file: BorrowedFd<'_>) {
        let is_last = self.count.fetch_sub(1, Ordering::Release) == 1;
        // While others wait for the same file it stays watched for at least what they want; what
        // they do not want ends no wait.
        if waits.interest(file.as_raw_fd()).is_none() {
            // It fails if the file was closed behind our back; then the kernel has forgotten it.
            let _ = self.reactor.deregister(file);
        }
        if is_last && self.thread != this_thread() {
            // It may sleep in the belief that a file can wake it.
            self.reactor.wake();
        }
    }

    /// Readies all waits for what the file is ready for, the most urgent first.
    fn report(&self, fd: RawFd, readiness: Readiness) {
        self.ready(fd, |wait| wait.wants(readiness));
        let mut waits = self.waits.lock();
        let Some(interest) = waits.interest(fd) else {
            return;
        };
        // The report disarmed the file for the others too. SAFETY: a wait that is listed borrows
        // the file. If it was leaked and the file closed, the kernel refuses or watches another
        // file by that number: readiness is only a hint, and no code takes it for more.
        let file = unsafe { BorrowedFd::borrow_raw(fd) };
        let outcome = self.reactor.rearm(file, fd as u64, interest);
        drop(waits);
        if outcome.is_err() {
            // They try again, and get the error.
            self.ready(fd, |_| true);
        }
    }

    /// Readies the waits for `fd` that are `meant`.
    fn ready(&self, fd: RawFd, meant: impl Fn(FileWait) -> bool) {
        // One by one, so that no wake occurs under the lock. The waits may be gone when they are
        // woken: their wakes are not.
        loop {
            let ready = self.waits.lock().take(fd, &meant);
            let Some(ready) = ready else {
                return;
            };
            self.count.fetch_sub(1, Ordering::Relaxed);
            // The thread that looks at its files goes on for its other processes.
            ready.wake_contained();
        }
    }
}

impl Watch for ThreadFiles {
    fn sleep(&self, deadline: Instant) -> Waited {
        self.rounds.store(0, Ordering::Relaxed);
        match self.reactor.wait(deadline, &mut |token, readiness| {
            self.report(token as RawFd, readiness)
        }) {
            Ok(ended) if ended.timed_out => Waited::TimedOut,
            Ok(_) => Waited::Woken,
            // To continue would be to spin, possibly at the highest priority.
            Err(error) => panic!(
                "a thread's epoll failed; was a descriptor closed that belongs to another? {error}"
            ),
        }
    }

    fn ring(&self) {
        // A report that readies the thread's own process rings within its sleep, which is about to
        // end: a ring would end the next.
        if self.thread != this_thread() {
            self.reactor.wake();
        }
    }

    fn glance(&self) {
        let rounds = self.rounds.load(Ordering::Relaxed) + 1;
        if rounds < ROUNDS_PER_LOOK || self.count.load(Ordering::Relaxed) == 0 {
            self.rounds
                .store(rounds.min(ROUNDS_PER_LOOK), Ordering::Relaxed);
        } else {
            self.sleep(Instant::from_nanos(0));
        }
    }
}

luna_platform::debug_fields!(ThreadFiles, |files| waits: files.count);

/// Number of lists for the waits.
const LISTS: usize = 256;

/// What a wait is for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FileWait {
    pub(crate) fd: RawFd,
    pub(crate) interest: Interest,
}

impl FileWait {
    /// Whether `readiness` is what it waits for.
    fn wants(self, readiness: Readiness) -> bool {
        match self.interest {
            Interest::Readable => readiness.readable,
            Interest::Writable => readiness.writable,
            Interest::Both => readiness.readable || readiness.writable,
        }
    }
}

/// What both together want.
fn both(one: Interest, other: Interest) -> Interest {
    if one == other { one } else { Interest::Both }
}

/// All waits of one thread: in 256 lists by the number of the descriptor, most urgent first. It
/// belongs to a lock, which guards the nodes in it too.
pub(crate) struct Waits(Box<[OpList<FileWait>]>);

impl Waits {
    fn new() -> Self {
        Self((0..LISTS).map(|_| OpList::new()).collect())
    }

    /// The list of the waits for `fd`, and for others of the same number modulo 256.
    pub(crate) fn list(&mut self, fd: RawFd) -> &mut OpList<FileWait> {
        &mut self.0[fd as usize % LISTS]
    }

    /// Removes the most urgent of the waits for `fd` that are `meant`, and returns its wake.
    /// O(waits with descriptors equal modulo 256).
    fn take(&mut self, fd: RawFd, meant: impl Fn(FileWait) -> bool) -> Option<PendingWake> {
        self.list(fd).take(|wait| wait.fd == fd && meant(wait))
    }

    /// The union of the interests of all waits for `fd`. O(waits with descriptors equal modulo
    /// 256).
    fn interest(&mut self, fd: RawFd) -> Option<Interest> {
        let waits = self.list(fd).waiting().map(|(_, wait)| wait);
        let interests = waits.filter(|wait| wait.fd == fd).map(|wait| wait.interest);
        interests.reduce(both)
    }
}
