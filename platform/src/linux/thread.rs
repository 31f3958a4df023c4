//! Threads' attributes: set by the thread itself, then read back.

pub use super::alternate_stack::HandlerStack;
use super::deadline;
use crate::thread::{Attributes, EMERGENCY_PRIORITY, Obtained, Policy, Refusal, Why};
use nix::errno::Errno;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::sys::prctl;
use nix::sys::resource::{Resource, getrlimit};
use nix::sys::signal::{SigSet, SigmaskHow, Signal, pthread_sigmask};
use nix::unistd::{Pid, getpid, gettid};
use std::ffi::CString;
use std::sync::OnceLock;

/// The calling thread, for calls that take a thread id.
const MYSELF: Pid = Pid::from_raw(0);

/// The most bytes of a thread's name that the kernel keeps.
const KERNEL_NAME: usize = 15;

/// The mask of the main thread before anything was pinned here.
fn initial_mask() -> &'static CpuSet {
    static MASK: OnceLock<CpuSet> = OnceLock::new();
    MASK.get_or_init(|| {
        // The main thread's number is the process'. The call fails only on a machine with more
        // cores than the mask has bits.
        sched_getaffinity(getpid()).unwrap_or_else(|_| all_cores())
    })
}

fn all_cores() -> CpuSet {
    let mut all = CpuSet::new();
    for core in 0..CpuSet::count() {
        let _ = all.set(core);
    }
    all
}

/// Records the initial mask, which a later thread must not inherit. Call it before any thread is
/// pinned.
pub(crate) fn remember_process() {
    initial_mask();
}

/// The cores of unpinned threads.
pub fn available_cores() -> Vec<usize> {
    let mask = initial_mask();
    (0..CpuSet::count())
        .filter(|&core| mask.is_set(core).unwrap_or(false))
        .collect()
}

/// The core of this thread.
pub fn current_core() -> Option<usize> {
    nix::sched::sched_getcpu().ok()
}

/// The policy of this thread.
pub fn current_policy() -> Policy {
    // It cannot fail for the calling thread.
    let (policy, priority) = scheduler(0).unwrap_or((libc::SCHED_OTHER, 0));
    let priority = priority as u8;
    match policy & !libc::SCHED_RESET_ON_FORK {
        libc::SCHED_FIFO => Policy::Fifo(priority),
        libc::SCHED_RR => Policy::RoundRobin(priority),
        libc::SCHED_DEADLINE => deadline::get(),
        _ => Policy::Other,
    }
}

/// The bit of CAP_SYS_NICE: may take any policy and priority.
const CAP_SYS_NICE: u32 = 23;

/// Whether the calling thread has the capability of this bit in effect; `None` if the kernel does
/// not tell. One system call, which needs no file: a process that has too many open is no plain
/// user.
pub fn has_capability(capability: u32) -> Option<bool> {
    /// `struct __user_cap_header_struct`.
    #[repr(C)]
    struct Head {
        version: u32,
        process: i32,
    }
    /// `struct __user_cap_data_struct`: 32 capabilities.
    #[repr(C)]
    #[derive(Clone, Copy)]
    struct Half {
        effective: u32,
        permitted: u32,
        inheritable: u32,
    }
    // Version 3, of which there are two halves; process 0 is the calling thread.
    let mut head = Head {
        version: 0x2008_0522,
        process: 0,
    };
    let mut halves = [Half {
        effective: 0,
        permitted: 0,
        inheritable: 0,
    }; 2];
    // SAFETY: both live during the call, and have the layout and size of this version.
    let outcome = unsafe { libc::syscall(libc::SYS_capget, &raw mut head, halves.as_mut_ptr()) };
    let half = halves.get(capability as usize / 32)?;
    (outcome == 0).then_some(half.effective >> (capability % 32) & 1 == 1)
}

/// What the process may have by its capabilities and its limit.
pub fn highest_priority() -> u8 {
    if has_capability(CAP_SYS_NICE) == Some(true) {
        return EMERGENCY_PRIORITY;
    }
    let limit = getrlimit(Resource::RLIMIT_RTPRIO).map_or(0, |(soft, _)| soft);
    limit.min(u64::from(EMERGENCY_PRIORITY)) as u8
}

/// The first step of a new thread: leave the signals that end a program to the threads made
/// elsewhere, so that no handler runs on a real-time thread. The main thread is always among those.
pub(crate) fn begin() {
    let ending = SigSet::from_iter([
        Signal::SIGINT,
        Signal::SIGTERM,
        Signal::SIGHUP,
        Signal::SIGQUIT,
    ]);
    // It fails only for an unknown `how`.
    let _ = pthread_sigmask(SigmaskHow::SIG_BLOCK, Some(&ending), None);
}

/// The kernel's number of a real-time policy with a priority, for a thread whose children are
/// ordinary ones.
fn kind_of(policy: Policy) -> Option<libc::c_int> {
    match policy {
        Policy::Fifo(_) => Some(libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK),
        Policy::RoundRobin(_) => Some(libc::SCHED_RR | libc::SCHED_RESET_ON_FORK),
        Policy::Other | Policy::Deadline { .. } => None,
    }
}

/// Sets the policy of the thread `number`, 0 for the calling thread. Direct system call: musl's
/// function of this name only fails.
pub(super) fn set_scheduler(number: i32, kind: i32, priority: i32) -> Result<(), Errno> {
    let mut parameter = zeroed_parameter();
    parameter.sched_priority = priority;
    // SAFETY: the parameter is a valid structure for the length of the call.
    let outcome = unsafe {
        libc::syscall(
            libc::SYS_sched_setscheduler,
            number,
            kind,
            &raw const parameter,
        )
    };
    Errno::result(outcome).map(drop)
}

/// Gives the calling thread its attributes.
pub(crate) fn apply(attributes: &Attributes) -> Result<Obtained, Refusal> {
    set_name(&attributes.name);
    // Refused by no kernel since 2.6.28; without it, sleeps of ordinary threads end 50 µs later.
    let _ = prctl::set_timerslack(1);

    let mut obtained = Obtained::stack_of(attributes);
    match attributes.core.map(|core| (core, pin(core))) {
        Some((core, Ok(()))) => obtained.core = Some(core),
        Some((core, Err(why))) => {
            obtained.refused(attributes.mode, Refusal::Core { asked: core, why })?;
            unpin();
        }
        None => unpin(),
    }
    if let Some((lowest, size)) = stack() {
        obtained.stack_size = size;
        touch_stack(lowest, attributes.stack_size);
    }
    // Last, since the pages above are better fetched as an ordinary thread.
    if let Err(why) = set_policy(attributes.policy) {
        let asked = attributes.policy;
        obtained.refused(attributes.mode, Refusal::Policy { asked, why })?;
        // From what it had before to none is always allowed.
        let _ = set_policy(Policy::Other);
    }
    obtained.policy = current_policy();
    attributes.settle_spin(&mut obtained)?;
    Ok(obtained)
}

/// Sets the kernel's name of the thread, cut between characters to its maximum.
fn set_name(name: &str) {
    // The main thread's name is the program's in `ps` and `killall`: not ours to change.
    if gettid() == getpid() {
        return;
    }
    let kept = &name[..name.floor_char_boundary(KERNEL_NAME)];
    // A name with a zero byte was refused before.
    if let Ok(kept) = CString::new(kept) {
        let _ = prctl::set_name(&kept);
    }
}

fn pin(core: usize) -> Result<(), Why> {
    let mut mask = CpuSet::new();
    // A number beyond the mask is one that the kernel cannot know either.
    let set = mask
        .set(core)
        .and_then(|()| sched_setaffinity(MYSELF, &mask));
    match set {
        Ok(()) if sched_getaffinity(MYSELF) == Ok(mask) => Ok(()),
        Ok(()) => Err(Why::NotKept(current_policy())),
        Err(error) => Err(Why::Kernel(error as i32)),
    }
}

/// Lets this thread run on all cores of the process. Async-signal-safe once the initial mask is
/// known.
pub fn unpin() {
    if sched_setaffinity(MYSELF, initial_mask()).is_err() {
        // The control group has other cores by now. All of them, then: the kernel keeps those that
        // are allowed.
        let _ = sched_setaffinity(MYSELF, &all_cores());
    }
}

fn set_policy(asked: Policy) -> Result<(), Why> {
    let kind = match asked {
        // A batch or idle thread stays so: it has no real-time policy, and its policy was set on
        // purpose.
        Policy::Other if !current_policy().is_real_time() => return Ok(()),
        // Taking the flag back would need a privilege, which must not keep a thread from giving up
        // its policy.
        Policy::Other => {
            let flags = scheduler(0).map_or(0, |(policy, _)| policy);
            libc::SCHED_OTHER | flags & libc::SCHED_RESET_ON_FORK
        }
        Policy::Deadline { .. } => return deadline::set(asked),
        Policy::Fifo(_) | Policy::RoundRobin(_) => kind_of(asked).unwrap_or(libc::SCHED_OTHER),
    };
    kept(asked, set_scheduler(0, kind, asked.priority().into()))
}

/// Whether the calling thread has what was `set`.
pub(super) fn kept(asked: Policy, set: Result<(), Errno>) -> Result<(), Why> {
    set.map_err(|error| Why::Kernel(error as i32))?;
    match current_policy() {
        obtained if obtained == asked => Ok(()),
        obtained => Err(Why::NotKept(obtained)),
    }
}

/// A thread's policy, with its flags, and its priority; 0 is the calling thread. Nothing if there
/// is no such thread. Two system calls.
pub(super) fn scheduler(thread: i32) -> Option<(i32, i32)> {
    let mut parameter = zeroed_parameter();
    // Direct system calls: musl's functions of these names only fail. SAFETY: the parameter is a
    // valid structure to write to.
    let (policy, asked) = unsafe {
        (
            libc::syscall(libc::SYS_sched_getscheduler, thread),
            libc::syscall(libc::SYS_sched_getparam, thread, &raw mut parameter),
        )
    };
    (policy >= 0 && asked == 0).then_some((policy as i32, parameter.sched_priority))
}

fn zeroed_parameter() -> libc::sched_param {
    // SAFETY: a structure of numbers (one with glibc, more with musl), for which all zeros is a
    // value.
    unsafe { std::mem::zeroed() }
}

/// The calling thread's stack: the lowest address above its guard, and its size.
fn stack() -> Option<(usize, usize)> {
    // SAFETY: the attributes are written by the first call, read by the second only if it
    // succeeded, and then released.
    unsafe {
        let mut attributes = std::mem::MaybeUninit::<libc::pthread_attr_t>::uninit();
        if libc::pthread_getattr_np(libc::pthread_self(), attributes.as_mut_ptr()) != 0 {
            return None;
        }
        let mut lowest = std::ptr::null_mut();
        let mut size = 0;
        let outcome = libc::pthread_attr_getstack(attributes.as_ptr(), &mut lowest, &mut size);
        libc::pthread_attr_destroy(attributes.as_mut_ptr());
        (outcome == 0).then_some((lowest as usize, size))
    }
}

/// Writes to each page of the stack below this function, `most` bytes or down to `lowest`, so that
/// none has to be faulted in later.
#[inline(never)]
fn touch_stack(lowest: usize, most: usize) {
    let page = page_size();
    let here = 0_u8;
    let here = (&raw const here).addr() & !(page - 1);
    let lowest = lowest.max(here.saturating_sub(most));
    // The lowest byte of the page below this one: at least a page away from the frames in use,
    // which are much smaller.
    let mut at = here - page;
    while at >= lowest {
        // SAFETY: the byte lies in this thread's stack, above its guard and below every frame in
        // use, so no live value is changed. A signal handler may use it too, but only while this
        // loop does not run.
        unsafe { std::ptr::with_exposed_provenance_mut::<u8>(at).write_volatile(0) };
        match at.checked_sub(page) {
            Some(next) => at = next,
            None => return,
        }
    }
}

pub(super) fn page_size() -> usize {
    let size = nix::unistd::sysconf(nix::unistd::SysconfVar::PAGE_SIZE);
    size.ok()
        .flatten()
        .and_then(|size| usize::try_from(size).ok())
        .unwrap_or(4096)
}
