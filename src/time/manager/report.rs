//! What the manager did, reported when the system has ended.

use crate::time::short;
use luna_platform::thread::Policy;
use std::fmt;
use std::time::Duration;

/// What the timer manager did: part of the [`Report`](crate::Report) of a system with
/// [`Timers::Manager`](crate::time::Timers::Manager).
///
/// What the loops did of their slots stands in their own
/// [`LoopReport`](crate::report::LoopReport)s: a tick that the manager was late for, and a slot
/// that a loop missed, are different faults.
///
/// ```
/// use luna::prelude::*;
/// use luna::time::Timers;
/// use std::time::Duration;
///
/// let mut system = System::new("servo");
/// system.timers(Timers::Manager);
/// let main = system.executor("main").build()?;
/// for (name, millis) in [("servo", 1), ("planner", 2)] {
///     main.process(name).spawn(async move {
///         let mut tick = luna::periodic(name, Duration::from_millis(millis))?;
///         for _ in 0..6 / millis {
///             tick.next().await;
///         }
///         Ok(())
///     })?;
/// }
/// let report = system.run()?;
/// let timers = report.timers.unwrap();
/// // Fewer than slots, where a loop came late.
/// println!("{} wake-ups, {:?} late at most", timers.woken, timers.latest);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TimersReport {
    /// The policy that its thread had, read back from the system.
    pub policy: Policy,
    /// How many wake-ups of loops it made.
    pub woken: u64,
    /// The longest time from a slot of a loop, or of a periodic callback, until the manager dealt
    /// with it: its own lateness.
    pub latest: Duration,
    /// The callbacks, in the order of their making.
    pub callbacks: Vec<CallbackReport>,
    /// How many callbacks were dropped while the system ran and made room for others: they do not
    /// stand in the list.
    pub earlier_callbacks: u64,
}

/// One callback.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct CallbackReport {
    /// Its name.
    pub name: String,
    /// How often it was called.
    pub calls: u64,
    /// The slots that passed whole without a call.
    pub missed: u64,
    /// How many calls took longer than 100 µs.
    pub too_long: u64,
    /// The longest call, on the wall's clock.
    pub longest: Duration,
    /// The longest time from a slot, or an instant, until the call.
    pub latest: Duration,
    /// Whether it panicked, which ended it and the system.
    pub panicked: bool,
}

/// How many callbacks the table shows.
const CALLBACKS_SHOWN: usize = 16;

impl fmt::Display for TimersReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "timer manager: {}, {} wake-ups, {} late at most",
            self.policy,
            self.woken,
            short(self.latest)
        )?;
        for one in self.callbacks.iter().take(CALLBACKS_SHOWN) {
            write!(
                f,
                "\n  callback `{}`: {} calls, {} missed, {} at most, {} late at most",
                one.name,
                one.calls,
                one.missed,
                short(one.longest),
                short(one.latest)
            )?;
            if one.too_long > 0 {
                write!(f, ", {} times too long", one.too_long)?;
            }
            if one.panicked {
                f.write_str(", panicked")?;
            }
        }
        let others = self.callbacks.len().saturating_sub(CALLBACKS_SHOWN);
        if others > 0 {
            write!(f, "\n  and {others} callbacks more")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_tells_both_sides_overruns() {
        let report = TimersReport {
            policy: Policy::fifo(98),
            woken: 2_000,
            latest: Duration::from_micros(4_200),
            callbacks: vec![
                CallbackReport {
                    name: "sample".to_owned(),
                    calls: 10,
                    missed: 2,
                    too_long: 1,
                    longest: Duration::from_micros(150),
                    ..CallbackReport::default()
                };
                CALLBACKS_SHOWN + 1
            ],
            ..TimersReport::default()
        };
        let text = report.to_string();
        for part in [
            "fifo:98, 2000 wake-ups, 4.20 ms late at most",
            "`sample`: 10 calls, 2 missed, 150.0 us at most",
            "1 times too long",
            "and 1 callbacks more",
        ] {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
    }
}
