//! Signals become events; a second one ends the program; handlers of before come back.

#![cfg(not(loom))]

use luna_machine::signals::{Signal, SignalWatch, received};

#[cfg(not(all(target_os = "linux", not(luna_portable))))]
#[test]
fn the_portable_backend_says_that_it_has_none() {
    let error = SignalWatch::install(&[Signal::Interrupt]).unwrap_err();
    assert!(error.to_string().contains("portable"), "{error}");
    // Nothing to watch for is no error anywhere.
    let _watch = SignalWatch::install(&[]).unwrap();
    assert_eq!(received(), None);
}

/// Each part runs in a process of its own, since signals and handlers are the whole process'.
#[cfg(all(target_os = "linux", not(luna_portable)))]
mod linux {
    use super::*;
    use luna_machine::signals::{SAME_REQUEST, event_count, wait_for_event};
    use luna_platform::clock::Instant;
    use nix::sys::signal::{self as sys, kill};
    use nix::unistd::Pid;
    use std::io::{BufRead, BufReader};
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Child, Command, ExitStatus, Stdio};
    use std::time::Duration;

    const PART: &str = "LUNA_TEST_PART";

    fn watchdog() -> Instant {
        Instant::now() + Duration::from_secs(60)
    }

    /// Runs `part` of this very test binary, and returns when it said that it is ready.
    fn start(part: &str) -> Child {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "signals::linux::part", "--nocapture"])
            .env(PART, part)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.as_mut().unwrap()).lines();
        assert!(
            lines.any(|line| line.is_ok_and(|line| line.contains("ready"))),
            "{part} did not get ready"
        );
        child
    }

    fn signal(child: &Child, signal: sys::Signal) {
        kill(Pid::from_raw(child.id() as i32), signal).unwrap();
    }

    fn end_of(mut child: Child) -> ExitStatus {
        child.wait().unwrap()
    }

    /// What the child processes run; nothing when the test binary runs it as a test.
    #[test]
    fn part() {
        let Ok(part) = std::env::var(PART) else {
            return;
        };
        match part.as_str() {
            // Two signals within the time of one request are one; the handlers are restored in the
            // end.
            "one" => {
                let watch = SignalWatch::install(&[Signal::Interrupt, Signal::Terminate]).unwrap();
                let other = SignalWatch::install(&[Signal::Interrupt]).unwrap();
                let seen = event_count();
                assert_eq!(received(), None);
                println!("ready");
                assert_eq!(wait_for_event(seen, watchdog()), seen.wrapping_add(1));
                assert_eq!(received(), Some(15));
                drop(watch);
                assert_eq!(received(), Some(15), "another watch still lives");
                drop(other);
                let again = SignalWatch::install(&[Signal::Interrupt]).unwrap();
                assert_eq!(received(), None, "forgotten with the last watch");
                drop(again);
                std::process::exit(7);
            }
            // Waits for a second signal, which ends it.
            "two" => {
                let seen = event_count();
                let _watch = SignalWatch::install(&[Signal::Interrupt, Signal::Terminate]).unwrap();
                println!("ready");
                wait_for_event(seen, watchdog());
                assert_eq!(received(), Some(2));
                std::thread::sleep(SAME_REQUEST);
                println!("taken");
                wait_for_event(event_count(), watchdog());
                std::process::exit(8);
            }
            // After the last watch a signal does what it did before.
            "restored" => {
                drop(SignalWatch::install(&[Signal::User1]).unwrap());
                println!("ready");
                wait_for_event(event_count(), watchdog());
                std::process::exit(9);
            }
            other => panic!("no part {other}"),
        }
    }

    #[test]
    fn the_first_signal_is_an_event() {
        let child = start("one");
        signal(&child, sys::Signal::SIGTERM);
        assert_eq!(end_of(child).code(), Some(7));
    }

    #[test]
    fn a_signal_sent_twice_at_once_is_one_request() {
        // The two calls may be kept apart by whatever else the machine does, so there is more than
        // one attempt.
        let is_one = (0..20).any(|_| {
            let mut child = start("two");
            signal(&child, sys::Signal::SIGINT);
            signal(&child, sys::Signal::SIGINT);
            let mut lines = BufReader::new(child.stdout.as_mut().unwrap()).lines();
            let lives = lines.any(|line| line.is_ok_and(|line| line.contains("taken")));
            child.kill().unwrap();
            end_of(child);
            lives
        });
        assert!(is_one, "the second one ended it each time");
    }

    #[test]
    fn a_second_signal_ends_the_program() {
        let mut child = start("two");
        signal(&child, sys::Signal::SIGINT);
        let mut lines = BufReader::new(child.stdout.as_mut().unwrap()).lines();
        assert!(lines.any(|line| line.is_ok_and(|line| line.contains("taken"))));
        signal(&child, sys::Signal::SIGTERM);
        assert_eq!(end_of(child).code(), Some(128 + 15));
    }

    #[test]
    fn handlers_of_before_come_back() {
        let child = start("restored");
        signal(&child, sys::Signal::SIGUSR1);
        assert_eq!(end_of(child).signal(), Some(sys::Signal::SIGUSR1 as i32));
    }
}
