//! The guard itself: each breach of the rules is detected, with its process and its place; nothing
//! else is.

use super::places::watchdog;
use luna::prelude::*;
use luna_path_guard::{Coverage, Kind, Violation, check, collect, coverage, seen};
use std::future::{Future, poll_fn};
use std::hint::black_box;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Wake, Waker};
use std::time::Duration;

/// Where a careless process is.
const PLACES: [&str; 2] = ["an executor", "a thread"];

/// Runs a process called `careless`; returns the violations.
fn careless<F>(place: &str, body: F) -> Vec<Violation>
where
    F: Future<Output = luna::Result<()>> + Send + 'static,
{
    let (report, violations) = collect(|| run(place, body));
    report.unwrap();
    violations
}

fn run<F>(place: &str, body: F) -> luna::Result<luna::Report>
where
    F: Future<Output = luna::Result<()>> + Send + 'static,
{
    let mut system = System::new("control");
    let process = match place {
        "an executor" => system.executor("here").build().unwrap().process("careless"),
        _ => system.thread("here").process("careless"),
    };
    process.spawn(body).unwrap();
    system.run()
}

/// Whether system calls can be watched; if not, prints a message with the test's name.
fn sees_system_calls(test: &str) -> bool {
    let covered = coverage();
    if covered != Coverage::Complete {
        let _ = writeln!(std::io::stderr(), "skipped: {test}: {covered}");
    }
    covered == Coverage::Complete
}

#[track_caller]
fn is_by_the_process(violation: &Violation, function: &str) {
    assert_eq!(violation.process(), Some("careless"), "{violation}");
    assert_eq!(violation.thread(), "here", "{violation}");
    assert!(violation.backtrace().contains(function), "{violation}");
    assert!(violation.backtrace().contains("control.rs:"), "{violation}");
    assert!(
        !violation.backtrace().contains("luna_path_guard::"),
        "{violation}"
    );
}

fn is_call(kind: Kind, name: &str) -> bool {
    matches!(kind, Kind::SystemCall { name: called, .. } if called == name)
}

#[inline(never)]
fn allocates() -> Vec<u8> {
    black_box(Vec::with_capacity(1234))
}

#[test]
fn an_allocation_and_a_free_are_seen() {
    let _watch = watchdog();
    for place in PLACES {
        let violations = careless(place, async {
            drop(allocates());
            Ok(())
        });
        let kinds: Vec<Kind> = violations.iter().map(Violation::kind).collect();
        let bytes = 1234;
        assert_eq!(kinds, [Kind::Allocation { bytes }, Kind::Free { bytes }]);
        is_by_the_process(&violations[0], "allocates");
        is_by_the_process(&violations[1], "an_allocation_and_a_free_are_seen");
    }
}

#[test]
fn memory_that_grows_or_is_the_bodys_own_is_seen() {
    let _watch = watchdog();
    for place in PLACES {
        let mut grows: Vec<u8> = vec![0; 10];
        let violations = careless(place, async move {
            grows.reserve_exact(100);
            black_box(&mut grows);
            Ok(())
        });
        let kinds: Vec<Kind> = violations.iter().map(Violation::kind).collect();
        let grown = Kind::Reallocation { from: 10, to: 110 };
        // The body's end drops what it holds, on the path.
        assert_eq!(kinds, [grown, Kind::Free { bytes: 110 }]);
    }
}

#[test]
fn the_same_place_is_reported_once_and_counted() {
    let _watch = watchdog();
    let violations = careless("an executor", async {
        for _ in 0..1000 {
            drop(allocates());
        }
        assert_eq!(seen(), 2000);
        Ok(())
    });
    let times: Vec<u64> = violations.iter().map(Violation::times).collect();
    assert_eq!(times, [1000, 1000]);
    assert!(
        violations[0]
            .to_string()
            .contains("allocation of 1234 bytes, 1000 times")
    );
}

#[test]
fn a_test_fails_with_the_violation_its_process_and_its_place() {
    let _watch = watchdog();
    let failed = catch_unwind(|| {
        check(|| {
            run("an executor", async {
                drop(allocates());
                Ok(())
            })
        })
    });
    let payload = failed.unwrap_err();
    let report = payload.downcast_ref::<String>().unwrap();
    for part in [
        "broken in 2 ways",
        "1. process `careless` on `here`: allocation of 1234 bytes\n",
        "2. process `careless` on `here`: free of 1234 bytes\n",
        "path::control::allocates",
    ] {
        assert!(report.contains(part), "{part:?} is missing in: {report}");
    }
}

#[test]
fn a_sleep_is_seen() {
    let _watch = watchdog();
    if !sees_system_calls("a_sleep_is_seen") {
        return;
    }
    for place in PLACES {
        let violations = careless(place, async {
            std::thread::sleep(Duration::from_micros(1));
            Ok(())
        });
        assert_eq!(violations.len(), 1, "{violations:?}");
        assert!(is_call(violations[0].kind(), "clock_nanosleep"));
        is_by_the_process(&violations[0], "a_sleep_is_seen");
    }
}

#[test]
fn output_is_seen() {
    let _watch = watchdog();
    if !sees_system_calls("output_is_seen") {
        return;
    }
    // Its buffer is there before.
    let _ = writeln!(std::io::stdout(), "a process prints:");
    for place in PLACES {
        let violations = careless(place, async {
            let _ = writeln!(std::io::stdout(), "it prints");
            Ok(())
        });
        assert_eq!(violations.len(), 1, "{violations:?}");
        assert!(is_call(violations[0].kind(), "write"));
        is_by_the_process(&violations[0], "output_is_seen");
    }
}

#[test]
fn a_contended_lock_of_the_standard_library_is_seen() {
    let _watch = watchdog();
    if !sees_system_calls("a_contended_lock_of_the_standard_library_is_seen") {
        return;
    }
    for place in PLACES {
        let lock = Arc::new(Mutex::new(()));
        let (of_body, of_holder) = (lock.clone(), lock);
        let (holds, held) = std::sync::mpsc::channel();
        let (report, violations) = collect(|| {
            let holder = std::thread::spawn(move || {
                let held = of_holder.lock();
                holds.send(()).unwrap();
                // Until the process was seen to wait.
                while seen() == 0 {
                    std::thread::yield_now();
                }
                drop(held);
            });
            held.recv().unwrap();
            let report = run(place, async move {
                drop(of_body.lock());
                luna::realtime::off_path(|| drop(of_body));
                Ok(())
            });
            holder.join().unwrap();
            report
        });
        report.unwrap();
        let operation = "FUTEX_WAIT_BITSET";
        assert_eq!(violations[0].kind(), Kind::Lock { operation });
        is_by_the_process(
            &violations[0],
            "a_contended_lock_of_the_standard_library_is_seen",
        );
    }
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn any_codes_system_call_is_detected_and_has_its_effect() {
    let _watch = watchdog();
    if !sees_system_calls("any_codes_system_call_is_detected_and_has_its_effect") {
        return;
    }
    for place in PLACES {
        let violations = careless(place, async {
            let parent: i64;
            // SAFETY: getppid takes no arguments and changes only its result and two registers.
            unsafe {
                std::arch::asm!(
                    "syscall",
                    inlateout("rax") libc::SYS_getppid => parent,
                    lateout("rcx") _,
                    lateout("r11") _,
                );
            }
            let really = luna::realtime::off_path(std::os::unix::process::parent_id);
            assert_eq!(parent, i64::from(really));
            // All six arguments, a result in memory, and an error.
            let mut pipe = [0; 2];
            // SAFETY: the array has room for two descriptors, which only this test uses; the
            // buffers are live.
            unsafe {
                assert_eq!(libc::pipe(pipe.as_mut_ptr()), 0);
                assert_eq!(libc::write(pipe[1], b"abc".as_ptr().cast(), 3), 3);
                let mut read = [0_u8; 8];
                assert_eq!(libc::read(pipe[0], read.as_mut_ptr().cast(), 8), 3);
                assert_eq!(&read[..3], b"abc");
                assert_eq!(libc::close(pipe[0]) + libc::close(pipe[1]), 0);
                assert_eq!(libc::close(pipe[0]), -1);
                let (anywhere, private) =
                    (libc::MAP_ANONYMOUS | libc::MAP_PRIVATE, libc::PROT_READ);
                let page = libc::mmap(std::ptr::null_mut(), 4096, private, anywhere, -1, 0);
                assert_ne!(page, libc::MAP_FAILED);
                assert_eq!(libc::munmap(page, 4096), 0);
            }
            assert_eq!(
                std::io::Error::last_os_error().raw_os_error(),
                Some(libc::EBADF)
            );
            Ok(())
        });
        let mut names = Vec::new();
        for violation in &violations {
            is_by_the_process(violation, "any_codes_system_call");
            let Kind::SystemCall { name, .. } = violation.kind() else {
                panic!("{violation}");
            };
            names.push(name);
        }
        let made = [
            "getppid", "pipe2", "write", "read", "close", "close", "close", "mmap", "munmap",
        ];
        // glibc makes a pipe by a system call that has no name here.
        names
            .iter_mut()
            .filter(|name| name.is_empty())
            .for_each(|name| *name = "pipe2");
        assert_eq!(names, made);
    }
}

/// These cannot be made by the guard in the thread's name.
#[test]
fn threads_and_signals_work_on_the_path() {
    let _watch = watchdog();
    if !sees_system_calls("threads_and_signals_work_on_the_path") {
        return;
    }
    extern "C" fn ignore(_: libc::c_int) {}
    // SAFETY: the handler does nothing, and the signal has no other use here.
    unsafe { libc::signal(libc::SIGUSR2, ignore as *const () as usize) };
    for place in PLACES {
        let violations = careless(place, async {
            // SAFETY: the signal has a handler.
            assert_eq!(unsafe { libc::raise(libc::SIGUSR2) }, 0);
            luna::yield_now().await;
            assert_eq!(std::thread::spawn(|| 7).join().unwrap(), 7);
            luna::after(Duration::from_micros(10)).await;
            // The executor has gone on, and is watched as before.
            std::thread::sleep(Duration::from_micros(1));
            Ok(())
        });
        let made = |name| {
            violations
                .iter()
                .any(|violation| is_call(violation.kind(), name))
        };
        assert!(made("tgkill"), "{violations:?}");
        assert!(
            made("rt_sigprocmask") || made("clone3") || made("clone"),
            "{violations:?}"
        );
    }
}

#[test]
fn what_an_executor_does_between_polls_is_seen() {
    let _watch = watchdog();
    /// A foreign waker that allocates.
    struct Careless(Waker);
    impl Wake for Careless {
        fn wake(self: Arc<Self>) {
            self.0.wake_by_ref();
            luna_core::path::off_path(|| drop(self));
            drop(allocates());
        }
    }
    let violations = careless("an executor", async {
        // Not over before the first poll, however busy the machine is.
        let mut delay = pin!(luna::after(Duration::from_millis(100)));
        poll_fn(|cx| {
            let waker =
                luna::realtime::off_path(|| Waker::from(Arc::new(Careless(cx.waker().clone()))));
            let polled = delay.as_mut().poll(&mut Context::from_waker(&waker));
            luna::realtime::off_path(|| drop(waker));
            polled
        })
        .await;
        Ok(())
    });
    assert_eq!(violations.len(), 2, "{violations:?}");
    assert_eq!(violations[0].process(), None);
    let text = violations[0].to_string();
    assert!(
        text.starts_with("thread `here`, between two polls: allocation of 1234 bytes"),
        "{text}"
    );
    assert!(text.contains("timer_queue"), "{text}");
}

#[test]
fn what_is_off_the_path_is_not_seen() {
    let _watch = watchdog();
    for place in PLACES {
        let violations = careless(place, async {
            luna::realtime::off_path(|| {
                drop(allocates());
                std::thread::sleep(Duration::from_micros(1));
            });
            Ok(())
        });
        assert_eq!(violations, []);
    }
    // A plain thread is not on the path.
    check(|| drop(allocates()));
}

#[test]
fn a_panic_is_reported_only_as_such() {
    let _watch = watchdog();
    for place in PLACES {
        let (report, violations) = collect(|| run(place, async { panic!("on purpose") }));
        assert!(report.unwrap_err().to_string().contains("on purpose"));
        assert_eq!(violations, []);
    }
    // One that comes by does not leave the guard on, or shut.
    let outcome = catch_unwind(AssertUnwindSafe(|| check(|| panic!("on purpose"))));
    assert!(outcome.is_err());
    check(|| ());
}

#[test]
fn a_check_within_a_check_is_refused() {
    let outcome = catch_unwind(|| check(|| check(|| ())));
    let payload = outcome.unwrap_err();
    let message = payload.downcast_ref::<&str>().unwrap();
    assert!(
        message.contains("one `check` or `collect` within another"),
        "{message}"
    );
}
