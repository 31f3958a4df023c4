//! `getrusage` of the thread, its clock, and its line of `/proc`.

use crate::usage::ThreadUsage;
use luna_platform::clock::processor_time;
use luna_platform::path::{self, Call};
use nix::libc;
use nix::sys::resource::{UsageWho, getrusage};
use std::cell::OnceCell;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::Duration;

thread_local! {
    /// Open from the first reading on, as long as the thread lives: opening it costs more than
    /// reading it.
    static SCHEDULING: OnceCell<Option<File>> = const { OnceCell::new() };
}

pub(crate) fn prepare_thread() {
    // The first touch registers the destructor, which may allocate.
    SCHEDULING.with(|_| {});
}

pub(crate) fn of_current_thread() -> Option<ThreadUsage> {
    path::expected(Call::Account, counted)
}

fn counted() -> Option<ThreadUsage> {
    let usage = getrusage(UsageWho::RUSAGE_THREAD).ok()?;
    // The times of `getrusage` are as old as the last tick; the clock's is exact.
    let cpu_time = processor_time()?;
    // They are counters, and never negative.
    let count = |number: libc::c_long| u64::try_from(number).unwrap_or_default();
    Some(ThreadUsage {
        minor_faults: count(usage.minor_page_faults()),
        major_faults: count(usage.major_page_faults()),
        voluntary_switches: count(usage.voluntary_context_switches()),
        involuntary_switches: count(usage.involuntary_context_switches()),
        cpu_time,
        run_delay: run_delay(),
    })
}

fn run_delay() -> Option<Duration> {
    SCHEDULING
        .try_with(|file| {
            let open = || File::open("/proc/thread-self/schedstat").ok();
            let mut text = [0; 96];
            let length = file
                .get_or_init(open)
                .as_ref()?
                .read_at(&mut text, 0)
                .ok()?;
            parse(&text[..length])
        })
        .ok()?
}

/// Time on a core, time in a queue for one, and turns: of the file of a thread.
fn parse(text: &[u8]) -> Option<Duration> {
    let mut words = std::str::from_utf8(text).ok()?.split_ascii_whitespace();
    words.nth(1)?.parse().ok().map(Duration::from_nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_number_is_the_delay() {
        assert_eq!(
            parse(b"67155991 632764 46\n"),
            Some(Duration::from_nanos(632_764))
        );
        // A kernel without the accounting writes nothing, or less.
        assert_eq!(parse(b""), None);
        assert_eq!(parse(b"67155991\n"), None);
    }
}
