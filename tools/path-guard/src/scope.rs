//! Scopes in which the rules are enforced.

use crate::{Coverage, Violation};

/// Calls `run`, and fails if code in it broke the path's rules, on its threads and those that it
/// starts, from when they enter the path.
///
/// Systems belong completely inside. One call runs at a time in a program, the others wait for it;
/// a nested call fails. If not all of the rules can be watched, a message on standard error names
/// the test.
///
/// # Panics
///
/// With all [`Violation`]s, their processes and their backtraces. If violations cannot be detected:
/// see [`coverage`](crate::coverage).
///
/// The crate's page has an example.
#[track_caller]
pub fn check<R>(run: impl FnOnce() -> R) -> R {
    let covered = crate::coverage();
    if covered != Coverage::Complete {
        use std::io::Write;
        let thread = std::thread::current();
        // Not by a macro: a test harness captures its output.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: {}: {covered}",
            thread.name().unwrap_or("?")
        );
    }
    let (outcome, violations) = collect(run);
    if !violations.is_empty() {
        panic!("{}", report(&violations));
    }
    outcome
}

/// As [`check`], but returns the violations instead of failing: for tests of the guard, and for
/// programs that have to break a rule.
///
/// It returns at most 64 violations in different places for one call, and 1024 in a program.
///
/// # Panics
///
/// As for [`coverage`](crate::coverage).
///
/// ```
/// # #[global_allocator]
/// # static ALLOCATOR: luna_path_guard::Allocator = luna_path_guard::Allocator::new();
/// use luna::prelude::*;
///
/// let (report, violations) = luna_path_guard::collect(|| {
///     let mut system = System::new("careless");
///     let main = system.executor("main").build().unwrap();
///     main.process("hoarder").spawn(async { Ok(drop(vec![1; 100])) }).unwrap();
///     system.run()
/// });
/// assert!(report.is_ok());
/// if luna_path_guard::coverage() != luna_path_guard::Coverage::Nothing {
///     assert_eq!(violations.len(), 2); // the allocation, and the free
///     assert_eq!(violations[0].process(), Some("hoarder"));
///     println!("{}", violations[0]); // with a backtrace
/// }
/// ```
#[track_caller]
pub fn collect<R>(run: impl FnOnce() -> R) -> (R, Vec<Violation>) {
    #[cfg(luna_path_guard)]
    return guarded::collect(run);
    #[cfg(not(luna_path_guard))]
    (run(), Vec::new())
}

/// The number of violations since the present [`check`] or [`collect`] has begun, including
/// repeated ones: to wait for one. From any thread.
///
/// ```
/// # #[global_allocator]
/// # static ALLOCATOR: luna_path_guard::Allocator = luna_path_guard::Allocator::new();
/// luna_path_guard::check(|| assert_eq!(luna_path_guard::seen(), 0));
/// ```
pub fn seen() -> usize {
    #[cfg(luna_path_guard)]
    return crate::room::seen();
    #[cfg(not(luna_path_guard))]
    0
}

fn report(violations: &[Violation]) -> String {
    let mut report = format!(
        "the rules of the real-time path were broken in {} ways:\n",
        violations.len()
    );
    for (index, violation) in violations.iter().enumerate() {
        report.push_str(&format!("\n{}. {violation}", index + 1));
    }
    report
}

#[cfg(luna_path_guard)]
pub(crate) use guarded::probed;

#[cfg(luna_path_guard)]
mod guarded {
    use super::report;
    use crate::{Coverage, Kind, Violation, room, symbols, system_calls, watch};
    use luna_core::current;
    use std::cell::Cell;
    use std::hint::black_box;
    use std::sync::{Mutex, OnceLock, PoisonError};

    /// One scope at a time.
    static SCOPE: Mutex<()> = Mutex::new(());

    thread_local! {
        static IS_INSIDE: Cell<bool> = const { Cell::new(false) };
    }

    /// Ends the scope; during a panic, prints the violations, which may be its cause.
    struct Open;

    impl Drop for Open {
        fn drop(&mut self) {
            IS_INSIDE.set(false);
            if std::thread::panicking() {
                let violations = in_words(room::close());
                if !violations.is_empty() {
                    eprintln!("{}", report(&violations));
                }
            }
        }
    }

    #[track_caller]
    pub(super) fn collect<R>(run: impl FnOnce() -> R) -> (R, Vec<Violation>) {
        probed();
        assert!(!IS_INSIDE.get(), "one `check` or `collect` within another");
        let _alone = SCOPE.lock().unwrap_or_else(PoisonError::into_inner);
        IS_INSIDE.set(true);
        let _open = Open;
        room::open();
        let outcome = run();
        (outcome, in_words(room::close()))
    }

    fn in_words(noted: Vec<(room::Raw, u64)>) -> Vec<Violation> {
        noted
            .iter()
            .map(|(raw, times)| symbols::violation(raw, *times))
            .collect()
    }

    /// The guard's findings for a deliberate allocation, free and system call.
    #[track_caller]
    pub(crate) fn probed() -> Coverage {
        static PROBED: OnceLock<Coverage> = OnceLock::new();
        let coverage = PROBED.get_or_init(|| {
            let _alone = SCOPE.lock().unwrap_or_else(PoisonError::into_inner);
            watch::begin();
            room::open();
            let before = current::set_on_path(true);
            drop(black_box(Box::new(7_u64)));
            system_calls::probe();
            current::set_on_path(before);
            let seen: Vec<Kind> = room::close().iter().map(|(raw, _)| raw.kind).collect();
            assert!(
                seen.contains(&Kind::Allocation { bytes: 8 })
                    && seen.contains(&Kind::Free { bytes: 8 }),
                "allocations are not seen: make `luna_path_guard::Allocator` the test program's `#[global_allocator]`"
            );
            match system_calls::availability() {
                Ok(()) => {
                    let call = |kind: &&Kind| matches!(kind, Kind::SystemCall { .. });
                    assert!(
                        seen.iter().any(|kind| call(&kind)),
                        "the kernel dispatches system calls, but one was not seen"
                    );
                    Coverage::Complete
                }
                Err(why) => Coverage::MemoryAlone { why },
            }
        });
        coverage.clone()
    }
}
