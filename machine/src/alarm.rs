//! A timer of the kernel, for a thread that waits for [events](crate::signals).

pub use crate::backend::alarm::EventAlarm;

#[cfg(test)]
mod tests {
    use super::*;
    use luna_platform::clock::Instant;
    use std::time::Duration;

    #[test]
    fn an_event_alarm_ends_the_wait_of_the_thread_that_made_it() {
        use crate::signals::{event_count, wait_for_event};
        use std::sync::mpsc;
        let (made, alarm) = mpsc::channel();
        let (armed, is_armed) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            made.send(EventAlarm::here()).unwrap();
            let Ok(at) = is_armed.recv() else { return };
            // Other tests announce events too.
            loop {
                let seen = event_count();
                if Instant::now() >= at {
                    return;
                }
                wait_for_event(seen, at + Duration::from_secs(60));
            }
        });
        let Some(alarm) = alarm.recv().unwrap() else {
            println!("skipped: an_event_alarm_ends_the_wait: needs Linux");
            return;
        };
        let at = Instant::now() + Duration::from_millis(20);
        assert!(alarm.arm(at));
        armed.send(at).unwrap();
        thread.join().unwrap();
        assert!(
            Instant::now() < at + Duration::from_secs(30),
            "its deadline came"
        );
    }

    /// A program may block all signals before it starts its threads, to read them from a file.
    #[cfg(all(target_os = "linux", not(luna_portable)))]
    #[test]
    fn an_event_alarm_interrupts_a_thread_that_blocks_all_signals() {
        use crate::signals::{event_count, wait_for_event};
        use nix::sys::signal::{SigSet, SigmaskHow, pthread_sigmask};
        let thread = std::thread::spawn(|| {
            pthread_sigmask(SigmaskHow::SIG_BLOCK, Some(&SigSet::all()), None).unwrap();
            let alarm = EventAlarm::here().unwrap();
            let seen = event_count();
            assert!(alarm.arm(Instant::now()));
            wait_for_event(seen, Instant::NEVER);
        });
        thread.join().unwrap();
    }
}
