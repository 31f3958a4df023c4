//! Watchdogs: they fire when they are not fed in time.

mod heartbeat;

use crate::csp::process::Process;
use crate::error::Result;
use heartbeat::Heartbeat;
use luna_channels::{Due, Stamp, When};
use luna_core::deferred_free::Shared;
use luna_platform::clock::Instant;
use std::time::Duration;

/// How often, at most, a process checks whether its expired watchdog was reset.
const SHORTEST_LOOK: Duration = Duration::from_millis(1);

/// Fires when it is not fed in time.
///
/// Its handles are clones of one another: some feed it, some wait until it has
/// [`expired`](Self::expired) or run a [`process`](Self::process) that calls a function then.
/// Feeding costs one look at the clock and one compare-and-swap: no timer is set anew, no thread is
/// woken. A waiter wakes once a timeout, looks when it was fed last, and sleeps on.
///
/// Exact: it has expired at an instant if and only if, since the watch began, there was a time as
/// long as its timeout without a feed. So a late feed does not hide the expiry, however late the
/// waiters wake. It then stays expired until it is [`reset`](Self::reset). The watch begins with
/// the first feed or the first wait, not when it is made: a system's start does not count.
///
/// What is guarded cannot switch it off by its end: a process that has ended, failed or was
/// cancelled feeds no more, so the watchdog expires. One that ends on purpose says so before, by
/// [`retire`](Self::retire). Give what is guarded a [`feeder`](Self::feeder), which cannot reset.
///
/// ```
/// use luna::safety::Watchdog;
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let watchdog = Watchdog::new(Duration::from_millis(5));
/// let fed = watchdog.clone();
/// let mut system = System::new("guarded");
/// let executor = system.executor("main").build()?;
/// executor.process("control").spawn(async move {
///     for _ in 0..3 {
///         fed.feed();
///         luna::after(Duration::from_millis(1)).await;
///     }
///     Ok(()) // and then no more
/// })?;
/// executor.process("guard").spawn(async move {
///     let (_commands, commanded) = luna::channel::<f64>();
///     luna::alt! {
///         _ = commanded.recv() => unreachable!("nobody commands"),
///         _ = watchdog.expired() => assert!(watchdog.has_expired()), // stop the motors
///     }
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Watchdog {
    heartbeat: Shared<Heartbeat>,
    chosen: Stamp,
}

impl Watchdog {
    /// A watchdog with a `timeout` of at least 1 ns: it expects a feed in each.
    /// Allocates; not for the real-time path.
    pub fn new(timeout: Duration) -> Watchdog {
        Watchdog {
            heartbeat: Shared::new(Heartbeat::new(timeout)),
            chosen: Stamp::new(),
        }
    }

    /// Feeds it, from any thread. If it has expired, nothing happens.
    ///
    /// Real-time path: yes; O(1), no system call, no allocation, no lock. Wait-free: a step is
    /// repeated only if another thread's feed, which had begun before, came between; so at most
    /// once for each of the threads that feed.
    ///
    /// ```
    /// let watchdog = luna::safety::Watchdog::new(std::time::Duration::from_secs(60));
    /// watchdog.feed();
    /// assert!(!watchdog.has_expired());
    /// ```
    #[inline]
    pub fn feed(&self) {
        self.heartbeat.feed(Instant::now());
    }

    /// Whether it has expired by now. Real-time path: yes; O(1), and it also begins the watch.
    pub fn has_expired(&self) -> bool {
        self.heartbeat.look(Instant::now()).is_none()
    }

    /// Begins a new watch now, whatever was before: from then on it can be fed, and expire, again.
    /// Real-time path: yes; O(1).
    ///
    /// ```
    /// use std::time::Duration;
    /// let watchdog = luna::safety::Watchdog::new(Duration::from_nanos(1));
    /// watchdog.feed();
    /// while !watchdog.has_expired() {}
    /// watchdog.feed();
    /// assert!(watchdog.has_expired()); // until
    /// watchdog.reset();
    /// ```
    pub fn reset(&self) {
        self.heartbeat.reset(Instant::now());
    }

    /// The time within which it expects a feed.
    pub fn timeout(&self) -> Duration {
        self.heartbeat.timeout()
    }

    /// Waits until it has expired; if it has, and was not reset, that is at once, each time. Alone,
    /// or as a guard of an alternative.
    ///
    /// Cancel-safe. Real-time path: yes; O(log n) for n delays of this thread, no allocation; it
    /// wakes once a timeout while the watchdog is fed.
    ///
    /// ```
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let watchdog = luna::safety::Watchdog::new(Duration::from_millis(1));
    ///     watchdog.expired().await;
    ///     assert!(watchdog.has_expired());
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[track_caller]
    pub fn expired(&self) -> When<WatchdogExpiry<'_>> {
        When::new(WatchdogExpiry(self))
    }

    /// Ends the watch for good: it does not expire any more, and feeds and resets do nothing. For
    /// what is guarded, before it ends on purpose. Returns false, and changes nothing, if it has
    /// expired by now.
    ///
    /// Real-time path: yes; O(1).
    ///
    /// ```
    /// let watchdog = luna::safety::Watchdog::new(std::time::Duration::from_secs(60));
    /// watchdog.feed();
    /// assert!(watchdog.retire() && !watchdog.has_expired());
    /// ```
    pub fn retire(&self) -> bool {
        self.heartbeat.retire(Instant::now())
    }

    /// A handle for what is guarded: it feeds, and cannot reset. Not for the real-time path of
    /// another process: make it at the set-up.
    ///
    /// ```
    /// let watchdog = luna::safety::Watchdog::new(std::time::Duration::from_secs(60));
    /// let feeder = watchdog.feeder();
    /// feeder.feed();
    /// assert!(!watchdog.has_expired());
    /// ```
    pub fn feeder(&self) -> Feeder {
        Feeder(self.heartbeat.clone())
    }

    /// A process, to be spawned, that calls `on_expiry` each time the watchdog expires; if it is
    /// reset after that, the watch goes on.
    ///
    /// Give it the highest priority of its executor, or an executor of its own above the processes
    /// that it watches, since a callback comes as late as its process. If all other handles are
    /// gone, no feed can come: it expires, and calls. The process ends after that call, or, without
    /// one, when the watchdog was [retired](Self::retire); it notices that when it next would have
    /// expired. `on_expiry` runs on the real-time path: it must not block.
    ///
    /// ```
    /// use luna::safety::Watchdog;
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let watchdog = Watchdog::new(Duration::from_millis(1));
    /// let (emergency, called) = luna::buffered(Buffer::overwrite_oldest(1));
    /// let mut system = System::new("guarded");
    /// let guards = system.executor("guards").policy(Policy::fifo(90)).build()?;
    /// guards.process("watchdog").spawn(watchdog.process(move || {
    ///     let _ = emergency.try_send("not fed");
    /// }))?;
    /// let control = system.executor("control").build()?;
    /// control.process("hangs").spawn(async move {
    ///     watchdog.feed();
    ///     assert_eq!(called.recv().await?, "not fed"); // instead of feeding
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn process<F: FnMut() + Send>(&self, on_expiry: F) -> WatchdogProcess<F> {
        WatchdogProcess {
            watchdog: self.clone(),
            on_expiry,
        }
    }

    fn is_alone(&self) -> bool {
        self.heartbeat.is_only()
    }
}

/// Feeds a [`Watchdog`]: the handle of what is guarded, from [`Watchdog::feeder`]. Dropping it
/// ends no watch: the watchdog expires. Clones feed the same one.
#[derive(Debug, Clone)]
pub struct Feeder(Shared<Heartbeat>);

impl Feeder {
    /// As [`Watchdog::feed`].
    #[inline]
    pub fn feed(&self) {
        self.0.feed(Instant::now());
    }

    /// As [`Watchdog::retire`]: before an end on purpose.
    pub fn retire(&self) -> bool {
        self.0.retire(Instant::now())
    }
}

/// What [`Watchdog::expired`] waits for.
#[derive(Debug)]
pub struct WatchdogExpiry<'a>(&'a Watchdog);

impl Due for WatchdogExpiry<'_> {
    type Output = ();

    fn due_at(&self, now: Instant) -> Instant {
        self.0.heartbeat.look(now).unwrap_or(now)
    }

    fn stamp(&self) -> Option<&Stamp> {
        Some(&self.0.chosen)
    }

    fn serve(&mut self, _: Instant) {}
}

/// A process that calls a function when a watchdog expires: see [`Watchdog::process`].
#[must_use = "it is a process: spawn it"]
pub struct WatchdogProcess<F> {
    watchdog: Watchdog,
    on_expiry: F,
}

impl<F: FnMut() + Send> Process for WatchdogProcess<F> {
    async fn run(&mut self) -> Result<()> {
        loop {
            // Not `expired`, which waits for ever for one that is retired.
            while let Some(due) = self.watchdog.heartbeat.look(Instant::now()) {
                if self.watchdog.heartbeat.is_retired() {
                    return Ok(());
                }
                luna_channels::at(due).await;
            }
            let expiry = self.watchdog.heartbeat.expiry();
            (self.on_expiry)();
            while expiry.is_some() && self.watchdog.heartbeat.expiry() == expiry {
                if self.watchdog.is_alone() {
                    return Ok(());
                }
                // A reset wakes no waiter.
                luna_channels::after(self.watchdog.timeout().max(SHORTEST_LOOK)).await;
            }
        }
    }
}

luna_platform::debug_fields!(impl[F] WatchdogProcess<F>, |process| watchdog: process.watchdog);
