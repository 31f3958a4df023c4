//! Syscall User Dispatch on x86-64: the handler, and the arming of threads. See
//! `Documentation/admin-guide/syscall-user-dispatch.rst` of Linux.

use super::Selector;
use super::rules::Made;
use crate::watch;
use libc::{c_int, c_void, siginfo_t, ucontext_t};
use luna_core::path;
use std::arch::asm;
use std::io;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::OnceLock;

// From linux/prctl.h and asm-generic/siginfo.h; libc has them not.
const PR_SET_SYSCALL_USER_DISPATCH: c_int = 59;
const PR_SYS_DISPATCH_ON: u64 = 1;
const SYS_USER_DISPATCH: c_int = 2;

/// `mov $15, %rax; syscall`: how glibc and musl return from a signal's handler.
const RESTORER_LENGTH: u64 = 16;
/// `syscall`.
const INSTRUCTION_LENGTH: i64 = 2;

/// Why a thread could not be armed: the first one's reason.
static REFUSED: OnceLock<String> = OnceLock::new();

/// Whether threads can be armed, once one was to be.
pub(crate) fn availability() -> Result<(), String> {
    REFUSED.get().cloned().map_or(Ok(()), Err)
}

/// A system call that does nothing.
pub(crate) fn probe() {
    // SAFETY: it has no argument and does nothing.
    unsafe { libc::syscall(libc::SYS_getppid) };
}

/// Stops this thread's system calls while `selector` is set, from now to its end.
///
/// # Safety
///
/// The selector belongs to this thread, and lives as long: the kernel reads it on each system call.
pub(crate) unsafe fn arm(selector: &Selector) {
    let outcome = installed().clone().and_then(|restorer| {
        // The return from the handler is never stopped: the handler sets the selector for the code
        // after it. SAFETY: the caller promises that the selector is this thread's, and lives as
        // long as it. The range is code that only returns from handlers.
        let outcome = unsafe {
            libc::prctl(
                PR_SET_SYSCALL_USER_DISPATCH,
                PR_SYS_DISPATCH_ON,
                restorer,
                RESTORER_LENGTH,
                ptr::from_ref(selector),
            )
        };
        if outcome == 0 {
            return Ok(());
        }
        let error = io::Error::last_os_error();
        Err(format!(
            "the kernel refuses Syscall User Dispatch, which came with Linux 5.11: {error}"
        ))
    });
    if let Err(why) = outcome {
        // The first one's reason is as good as any.
        let _ = REFUSED.set(why);
    }
}

/// Installs the handler, once; returns the address of the code that returns from it.
fn installed() -> &'static Result<u64, String> {
    static INSTALLED: OnceLock<Result<u64, String>> = OnceLock::new();
    INSTALLED.get_or_init(|| {
        // SAFETY: a zeroed action is a valid one, with an empty mask.
        let mut action: libc::sigaction = unsafe { MaybeUninit::zeroed().assume_init() };
        action.sa_sigaction = on_stopped as *const () as usize;
        // A handler of another signal that interrupts this one may be stopped too.
        action.sa_flags = libc::SA_SIGINFO | libc::SA_NODEFER;
        // SAFETY: the handler has the signature that SA_SIGINFO requires, and is async-signal-safe.
        let outcome = unsafe { libc::sigaction(libc::SIGSYS, &action, ptr::null_mut()) };
        if outcome != 0 {
            return Err(format!(
                "SIGSYS has no handler: {}",
                io::Error::last_os_error()
            ));
        }
        restorer()
    })
}

/// The address of the C library's code that returns from handlers, as the kernel has it.
fn restorer() -> Result<u64, String> {
    #[repr(C)]
    #[derive(Default)]
    struct KernelAction {
        handler: u64,
        flags: u64,
        restorer: u64,
        mask: u64,
    }
    let mut action = KernelAction::default();
    // SAFETY: the structure is the kernel's on this architecture, and its mask has the stated 8
    // bytes.
    let outcome = unsafe {
        libc::syscall(
            libc::SYS_rt_sigaction,
            libc::SIGSYS,
            ptr::null::<KernelAction>(),
            &raw mut action,
            8,
        )
    };
    if outcome == 0 && action.restorer != 0 {
        Ok(action.restorer)
    } else {
        Err("the C library does not say how it returns from handlers".to_owned())
    }
}

/// Calls that the handler cannot make in place of the thread: they replace the thread's stack, its
/// signal mask or the program, or return from a handler.
fn must_be_made_in_place(number: i64) -> bool {
    matches!(
        number,
        libc::SYS_rt_sigreturn
            | libc::SYS_rt_sigprocmask
            | libc::SYS_sigaltstack
            | libc::SYS_clone
            | libc::SYS_clone3
            | libc::SYS_fork
            | libc::SYS_vfork
            | libc::SYS_execve
            | libc::SYS_execveat
            | libc::SYS_exit
            | libc::SYS_exit_group
    )
}

/// A system call of this thread was stopped.
extern "C" fn on_stopped(_: c_int, information: *mut siginfo_t, context: *mut c_void) {
    // SAFETY: with SA_SIGINFO the kernel passes both, valid for the handler's time, and there are
    // no other references to them.
    let (information, registers) = unsafe {
        let context = &mut *context.cast::<ucontext_t>();
        (&*information, &mut context.uc_mcontext.gregs)
    };
    if information.si_code != SYS_USER_DISPATCH {
        // A seccomp filter's, or a `kill`: behave as without a handler.
        // SAFETY: both are async-signal-safe.
        unsafe {
            libc::signal(libc::SIGSYS, libc::SIG_DFL);
            libc::raise(libc::SIGSYS);
        }
        return;
    }
    let argument = |register: c_int| registers[register as usize] as u64;
    let made = Made {
        number: registers[libc::REG_RAX as usize],
        arguments: [
            argument(libc::REG_RDI),
            argument(libc::REG_RSI),
            argument(libc::REG_RDX),
            argument(libc::REG_R10),
            argument(libc::REG_R8),
            argument(libc::REG_R9),
        ],
    };
    // Not a violation in itself: the end of another signal's handler that interrupted the path.
    let is_return = made.number == libc::SYS_rt_sigreturn;
    let selector = watch::stopped(|| {
        if is_return {
            return None;
        }
        made.breach(path::expected_call())
    });
    if must_be_made_in_place(made.number) {
        // Back to the instruction, which passes now, as do later ones until the thread enters the
        // path again.
        registers[libc::REG_RIP as usize] -= INSTRUCTION_LENGTH;
        return;
    }
    // SAFETY: it is the call that the thread was about to make, with its arguments, so it is as
    // sound as there; the result goes where the kernel would have put it. Other registers changed
    // by the instruction are changed by the kernel as well.
    registers[libc::REG_RAX as usize] = unsafe { make(&made) };
    // SAFETY: the selector is this thread's own.
    unsafe { &*selector }.stop();
}

/// # Safety
///
/// The system call is sound with these arguments, on this thread and now.
unsafe fn make(made: &Made) -> i64 {
    let [a, b, c, d, e, f] = made.arguments;
    let result;
    // SAFETY: the caller promises that this system call is sound here with these arguments. The
    // kernel changes rcx and r11 besides the result, and does not use this stack.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") made.number => result,
            in("rdi") a,
            in("rsi") b,
            in("rdx") c,
            in("r10") d,
            in("r8") e,
            in("r9") f,
            lateout("rcx") _,
            lateout("r11") _,
            options(nostack),
        );
    }
    result
}
