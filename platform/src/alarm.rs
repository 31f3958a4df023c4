//! An alarm for a thread that is busy: at a deadline the kernel interrupts it, and its handler sets
//! a bit of a word that the thread reads anyway.
//!
//! So a busy thread sees its deadlines without reading the clock. It is a POSIX timer of the
//! thread's own (`timer_create`, `SIGEV_THREAD_ID`). Its signal is a real-time signal that had no
//! handler when the first alarm was made: the highest such number below `SIGRTMAX`. The handler
//! stays for the program's life. System calls that can be restarted are restarted (`SA_RESTART`).
//! Where the kernel refuses the timer, and on the portable backend, [`Alarm::new`] returns nothing:
//! the thread then reads the clock itself.
//!
//! [`EventAlarm`] uses the same signal for a thread that waits for [events](crate::signals).

pub use crate::backend::alarm::{Alarm, EventAlarm};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Instant;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::Duration;

    const BIT: u64 = 1 << 5;

    /// An alarm of this thread with its word. None where the platform has none.
    fn alarm() -> Option<(Alarm, Arc<AtomicU64>)> {
        let word = Arc::new(AtomicU64::new(1));
        let alarm = Alarm::new(word.clone(), |word| word, BIT)?;
        Some((alarm, word))
    }

    /// Spins until the bit is set, and takes it.
    fn wait(word: &AtomicU64) -> Instant {
        while word.load(Ordering::Relaxed) & BIT == 0 {
            std::hint::spin_loop();
        }
        assert_eq!(word.swap(1, Ordering::Relaxed), 1 | BIT);
        Instant::now()
    }

    #[test]
    fn it_sets_its_bit_when_its_deadline_has_come_and_not_before() {
        let Some((alarm, word)) = alarm() else {
            println!("skipped: it_sets_its_bit_when_its_deadline_has_come: needs Linux");
            return;
        };
        assert!(alarm.take_rung().is_none());
        for _ in 0..3 {
            let deadline = Instant::now() + Duration::from_millis(2);
            assert!(alarm.arm(deadline));
            let seen = wait(&word);
            let rung = alarm.take_rung().unwrap();
            assert!(deadline <= rung && rung <= seen);
            assert!(alarm.take_rung().is_none(), "it was taken");
        }
        // A deadline that has passed fires at once.
        assert!(alarm.arm(Instant::from_nanos(0)));
        wait(&word);
    }

    #[test]
    fn what_is_disarmed_or_gone_sets_nothing() {
        let Some((alarm, word)) = alarm() else {
            println!("skipped: what_is_disarmed_or_gone_sets_nothing: needs Linux");
            return;
        };
        let end = Instant::now() + Duration::from_millis(5);
        assert!(alarm.arm(end));
        alarm.disarm();
        while Instant::now() < end + Duration::from_millis(5) {}
        assert_eq!(word.load(Ordering::Relaxed), 1);
        assert!(alarm.arm(Instant::now() + Duration::from_millis(2)));
        drop(alarm);
        let end = Instant::now() + Duration::from_millis(5);
        while Instant::now() < end {}
        assert_eq!(word.load(Ordering::Relaxed), 1);
        assert_eq!(Arc::strong_count(&word), 1, "the alarm has let go of it");
    }

    #[test]
    fn a_thread_has_one_and_each_thread_its_own() {
        let Some((_alarm, word)) = alarm() else {
            println!("skipped: a_thread_has_one_and_each_thread_its_own: needs Linux");
            return;
        };
        assert!(alarm().is_none(), "this thread has one");
        let other = std::thread::spawn(|| {
            let (alarm, word) = alarm().unwrap();
            assert!(alarm.arm(Instant::now()));
            wait(&word);
        });
        other.join().unwrap();
        assert_eq!(word.load(Ordering::Relaxed), 1, "it was another's");
    }

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
    fn a_thread_that_blocks_all_signals_hears_it() {
        use nix::sys::signal::{SigSet, SigmaskHow, pthread_sigmask};
        let thread = std::thread::spawn(|| {
            pthread_sigmask(SigmaskHow::SIG_BLOCK, Some(&SigSet::all()), None).unwrap();
            let (alarm, word) = alarm().unwrap();
            assert!(alarm.arm(Instant::now()));
            wait(&word);
        });
        thread.join().unwrap();
    }
}
