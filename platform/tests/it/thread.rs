//! Threads have what they asked for, say what they did not get, and inherit nothing.

#![cfg(not(loom))]

use luna_platform::thread::{
    Attributes, Mode, Policy, Refusal, SpawnError, Why, apply_to_current, current_policy, spawn,
};
use std::convert::Infallible;
use std::rc::Rc;
use std::sync::mpsc;

/// Runs `look` as the body of a thread with `attributes`.
fn on<T: Send + 'static>(attributes: Attributes, look: impl FnOnce() -> T + Send + 'static) -> T {
    let thread = spawn(attributes, |_| Ok::<_, Infallible>(()), |()| look())
        .expect("best effort makes the thread");
    thread.join().expect("the body does not panic")
}

/// Whether this process gets SCHED_FIFO; says why a test is skipped where it does not.
fn real_time(test: &str) -> bool {
    let attributes = Attributes::new("probe")
        .policy(Policy::fifo(80))
        .mode(Mode::Strict);
    match spawn(attributes, |_| Ok::<_, Infallible>(()), |()| ()) {
        Ok(thread) => thread.join().is_ok(),
        Err(error) => {
            report!("skipped: {test}: {error}");
            false
        }
    }
}

#[test]
fn smoke() {
    let attributes = Attributes::new("smoke");
    let thread = spawn(
        attributes,
        |_| Ok::<_, Infallible>(Rc::new(1)),
        |one| *one + 1,
    )
    .unwrap();
    assert_eq!(thread.name(), "smoke");
    assert_eq!(thread.obtained().policy, Policy::Other);
    assert!(thread.obtained().refusals.is_empty());
    assert_eq!(thread.join().unwrap(), 2);
}

#[test]
fn returns_only_after_the_set_up() {
    let (done, is_done) = mpsc::channel();
    let (go, may_go) = mpsc::channel::<()>();
    let thread = spawn(
        Attributes::new("slow set-up"),
        move |_| done.send(std::thread::current().name().map(str::to_owned)),
        move |()| may_go.recv(),
    )
    .unwrap();
    // Without waiting: it is there already.
    assert_eq!(is_done.try_recv().unwrap().as_deref(), Some("slow set-up"));
    assert!(!thread.is_finished());
    go.send(()).unwrap();
    assert!(thread.join().unwrap().is_ok());
}

#[test]
fn a_failing_set_up_is_the_error_and_the_body_does_not_run() {
    let token = std::sync::Arc::new(());
    let in_body = token.clone();
    let error = spawn(
        Attributes::new("fails"),
        |_| Err::<(), _>("no sensor"),
        move |()| drop(in_body),
    )
    .unwrap_err();
    assert!(matches!(error, SpawnError::SetUp("no sensor")));
    assert_eq!(
        std::sync::Arc::strong_count(&token),
        1,
        "the body was dropped"
    );
}

#[test]
fn a_panicking_set_up_is_an_error() {
    let setup = |_: &_| -> Result<(), Infallible> { panic!("as the test wants") };
    match spawn(Attributes::new("panics"), setup, |()| ()).unwrap_err() {
        SpawnError::SetUpPanicked { name, message } => {
            assert_eq!(
                (name.as_str(), message.as_str()),
                ("panics", "as the test wants")
            );
        }
        other => panic!("{other}"),
    }
}

#[test]
fn a_panicking_body_is_what_join_gives() {
    let thread = spawn(
        Attributes::new("panics"),
        |_| Ok::<_, Infallible>(()),
        |()| panic!("as the test wants"),
    )
    .unwrap();
    assert!(thread.join().is_err());
}

#[test]
fn a_core_that_does_not_exist() {
    let strict = Attributes::new("nowhere").core(70_000).mode(Mode::Strict);
    let error = spawn(strict, |_| Ok::<_, Infallible>(()), |()| ()).unwrap_err();
    assert!(
        matches!(
            error,
            SpawnError::Refused(Refusal::Core { asked: 70_000, .. })
        ),
        "{error}"
    );
    assert!(error.to_string().contains("core 70000"), "{error}");

    let thread = spawn(
        Attributes::new("nowhere").core(900),
        |_| Ok::<_, Infallible>(()),
        |()| (),
    )
    .unwrap();
    assert_eq!(thread.obtained().core, None);
    match thread.obtained().refusals.as_slice() {
        [Refusal::Core { asked: 900, why }] => {
            assert!(matches!(why, Why::Kernel(_) | Why::Unsupported), "{why:?}");
        }
        other => panic!("{other:?}"),
    }
    thread.join().unwrap();
}

#[test]
fn a_policy_is_read_back_or_a_refusal() {
    for policy in [Policy::fifo(1), Policy::fifo(80), Policy::round_robin(97)] {
        let (obtained, seen) = {
            let thread = spawn(
                Attributes::new("p").policy(policy),
                |_| Ok::<_, Infallible>(()),
                |()| current_policy(),
            )
            .unwrap();
            (thread.obtained().clone(), thread.join().unwrap())
        };
        assert_eq!(obtained.policy, seen);
        match obtained.refusals.as_slice() {
            [] => assert_eq!(seen, policy),
            [Refusal::Policy { asked, .. }] => {
                assert_eq!((*asked, seen), (policy, Policy::Other));
                println!("{}", obtained.refusals[0]);
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn the_framework_gets_98_and_99() {
    if !real_time("the_framework_gets_98_and_99") {
        return;
    }
    for priority in [98, 99] {
        let attributes =
            Attributes::framework("framework", Policy::fifo(priority)).mode(Mode::Strict);
        assert_eq!(on(attributes, current_policy), Policy::fifo(priority));
    }
}

#[test]
fn the_calling_thread_can_have_attributes_too() {
    std::thread::spawn(|| {
        let before = current_policy();
        let obtained =
            apply_to_current(&Attributes::new("applied").policy(Policy::fifo(20))).unwrap();
        assert_eq!(obtained.policy, current_policy());
        let obtained = apply_to_current(&Attributes::new("applied")).unwrap();
        assert_eq!((obtained.policy, current_policy()), (before, before));
        assert!(obtained.refusals.is_empty());
        assert!(apply_to_current(&Attributes::new("bad").policy(Policy::fifo(0))).is_err());
    })
    .join()
    .unwrap();
}

/// What only this backend can show.
#[cfg(all(target_os = "linux", not(luna_portable)))]
mod linux {
    use super::*;
    use luna_platform::thread::{available_cores, current_core};
    use std::fs;

    /// A line of the calling thread's `/proc` status.
    fn status(key: &str) -> String {
        let status = fs::read_to_string("/proc/thread-self/status").unwrap();
        let line = status
            .lines()
            .find_map(|line| line.strip_prefix(key))
            .unwrap();
        line.trim_start_matches(':').trim().to_owned()
    }

    fn minor_faults() -> u64 {
        let stat = fs::read_to_string("/proc/thread-self/stat").unwrap();
        // Field 10, counted after the name, which may hold spaces.
        stat.rsplit_once(')')
            .unwrap()
            .1
            .split_whitespace()
            .nth(7)
            .unwrap()
            .parse()
            .unwrap()
    }

    #[test]
    fn pinned_to_each_allowed_core() {
        for core in available_cores() {
            let seen = on(
                Attributes::new("pinned").core(core).mode(Mode::Strict),
                || (current_core(), status("Cpus_allowed_list")),
            );
            assert_eq!(seen, (Some(core), core.to_string()));
        }
    }

    #[test]
    fn nothing_is_inherited() {
        let mask = on(Attributes::new("unpinned"), || status("Cpus_allowed_list"));
        let real_time = real_time("nothing_is_inherited, the part about policies");
        let core = available_cores()[0];
        let parent = Attributes::new("parent")
            .core(core)
            .policy(Policy::fifo(50));
        let (here, plain, ours) = on(parent, move || {
            let plain = std::thread::spawn(current_policy).join().unwrap();
            let ours = on(Attributes::new("child"), || {
                (current_policy(), status("Cpus_allowed_list"))
            });
            (current_policy(), plain, ours)
        });
        assert_eq!(here.is_real_time(), real_time);
        assert_eq!(plain, Policy::Other);
        assert_eq!(ours, (Policy::Other, mask));
    }

    #[test]
    fn a_child_of_a_thread_without_the_reset_is_ordinary_too() {
        if !real_time("a_child_of_a_thread_without_the_reset_is_ordinary_too") {
            return;
        }
        let child = std::thread::spawn(|| {
            // As `chrt -f 30 program` would: without SCHED_RESET_ON_FORK.
            let pid = fs::read_link("/proc/thread-self").unwrap();
            let tid = pid.file_name().unwrap().to_str().unwrap().to_owned();
            match std::process::Command::new("chrt")
                .args(["-f", "-p", "30", &tid])
                .status()
            {
                Ok(status) if status.success() => {}
                _ => return None,
            }
            assert_eq!(
                std::thread::spawn(current_policy).join().unwrap(),
                Policy::fifo(30),
                "it does inherit"
            );
            Some(on(Attributes::new("child"), current_policy))
        });
        match child.join().unwrap() {
            Some(policy) => assert_eq!(policy, Policy::Other),
            None => report!(
                "skipped: a_child_of_a_thread_without_the_reset_is_ordinary_too: no chrt here"
            ),
        }
    }

    #[test]
    fn names_are_cut_between_characters() {
        for (name, kept) in [
            ("short", "short"),
            ("exactly-15-byte", "exactly-15-byte"),
            ("sixteen-bytes-16", "sixteen-bytes-1"),
            // The 15th byte is the first half of `ä`.
            ("fourteen-bytesäx", "fourteen-bytes"),
        ] {
            let thread = spawn(
                Attributes::new(name),
                |_| Ok::<_, Infallible>(()),
                |()| {
                    fs::read_to_string("/proc/thread-self/comm")
                        .unwrap()
                        .trim_end()
                        .to_owned()
                },
            )
            .unwrap();
            assert_eq!(thread.name(), name);
            assert_eq!(thread.join().unwrap(), kept);
        }
    }

    #[test]
    fn the_stack_is_there_already() {
        #[inline(never)]
        fn use_stack(left: usize) -> usize {
            let buffer = std::hint::black_box([left as u8; 16 << 10]);
            if left == 0 {
                buffer[0].into()
            } else {
                use_stack(left - 1) + usize::from(buffer[1] & 1)
            }
        }
        let thread = spawn(
            Attributes::new("deep").stack_size(2 << 20),
            |obtained| Ok::<_, Infallible>(obtained.stack_size),
            |size| {
                let before = minor_faults();
                std::hint::black_box(use_stack(48));
                (size, minor_faults() - before)
            },
        )
        .unwrap();
        let (size, faults) = thread.join().unwrap();
        assert!(size >= (2 << 20) - (64 << 10), "{size}");
        // Untouched, this depth of more than 768 KiB would take some 190 faults; reading the count
        // takes a few.
        assert!(faults < 20, "{faults} page faults");
    }

    #[test]
    fn sleeps_are_precise() {
        let slack = on(Attributes::new("precise"), || {
            nix::sys::prctl::get_timerslack().unwrap()
        });
        assert_eq!(slack, 1);
    }

    #[test]
    fn signals_that_end_the_program_go_elsewhere() {
        let blocked = on(Attributes::new("quiet"), || {
            u64::from_str_radix(&status("SigBlk"), 16).unwrap()
        });
        for signal in [1, 2, 3, 15] {
            assert_ne!(blocked & (1 << (signal - 1)), 0, "signal {signal}");
        }
        assert_eq!(blocked & (1 << (11 - 1)), 0, "faults stay deadly");
    }
}
