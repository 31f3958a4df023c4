//! The text of a report about a late cycle.

use super::accounting::{UsageSince, short};
use luna_events::code::late;
use luna_platform::clock::{Instant, nanos};
use std::fmt;
use std::time::Duration;

/// A cycle of a loop that began late, and what is known of the cause.
///
/// What was measured stands in the fields. [`causes`](Self::causes) are those that explain at least
/// half of the lateness, each with its share; there may be several, and none. A cycle without a
/// known cause was most often held up below the program: by an interrupt, the core's sleep, or a
/// hypervisor. Its `Display` is one line, with the causes.
///
/// ```
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let mut system = System::new("machine");
/// let main = system.executor("main").build()?;
/// main.process("hog").priority(20).spawn(async {
///     luna::after(Duration::from_millis(15)).await;
///     let end = luna::now() + Duration::from_millis(200);
///     while luna::now() < end {} // past the slot at 20 ms, and more
///     Ok(())
/// })?;
/// main.process("servo").priority(30).spawn(async {
///     let mut tick = luna::periodic("servo", Duration::from_millis(10))?;
///     while tick.next().await.number < 3 {}
///     Ok(())
/// })?;
/// let report = system.run()?;
/// for cycle in &report.loops["servo"].late_cycles {
///     println!("{cycle}"); // the worst first: `hog` ran instead, unless another program did
/// }
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LateCycle {
    /// The number of the slot that was served, on its grid.
    pub number: u64,
    /// When the cycle should have begun: the slot that the loop waited for.
    pub slot: Instant,
    /// From then until it did.
    pub lateness: Duration,
    /// How long the loop itself was still busy with the cycle before when the slot came; zero if it
    /// waited in time.
    pub own_overrun: Duration,
    /// How long the cycle before ran, if there was one.
    pub previous_run: Option<Duration>,
    /// The process of the same executor that ran longest while this cycle should have begun, be it
    /// for a small part of the lateness; always `None` for a process on a thread of its own.
    pub ran_instead: Option<RanInstead>,
    /// What the kernel counted of the thread, in a window of its own that is longer than the
    /// lateness: it need not have to do with this cycle. `None` on a virtual clock.
    pub usage: Option<UsageSince>,
    /// The core that the cycle began on. `None` on a virtual clock.
    pub core: Option<usize>,
    /// What a hypervisor took from that core. `None` where it is not reported, or no sample was
    /// taken.
    pub stolen: Option<StolenTime>,
}

/// A process that ran while the cycle of a loop should have begun: part of [`LateCycle`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RanInstead {
    /// The process.
    pub process: String,
    /// Whether it is the loop's own, of which another part ran.
    pub is_own: bool,
    /// How much of the lateness it ran.
    pub took: Duration,
}

/// What a hypervisor took from a core within the lateness of a cycle: part of [`LateCycle`].
///
/// It is sampled about each tenth of a second, so a shorter lateness has bounds alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct StolenTime {
    /// What cannot have been taken before or after.
    pub at_least: Duration,
    /// What was taken in the samples around, be it before or after.
    pub at_most: Duration,
}

/// What explains at least half of a cycle's lateness.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LateCause {
    /// What it was.
    pub kind: LateCauseKind,
    /// How much of the lateness it explains.
    pub explains: Duration,
    /// The same in per cent of the lateness, rounded down.
    pub percent: u64,
}

/// The kinds of [`LateCause`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum LateCauseKind {
    /// The loop was still busy with the cycle before.
    OwnOverrun,
    /// Another part of the loop's process, which has this name, ran.
    OwnProcess(String),
    /// The process of this name ran, on the same executor.
    OtherProcess(String),
    /// Other threads had the core, and this one waited in the queue for it.
    OtherThread,
    /// A hypervisor had the core.
    Hypervisor,
}

impl LateCycle {
    /// The causes that explain at least half of the lateness each, the one that explains most
    /// first. They may overlap: a process runs for longer where a hypervisor takes the core from
    /// it. What was counted or sampled in a longer window than the lateness is taken for the least
    /// that must have been within the lateness.
    pub fn causes(&self) -> Vec<LateCause> {
        let own = Some((LateCauseKind::OwnOverrun, self.own_overrun));
        let ran = self.ran_instead.as_ref().map(|ran| {
            let kind = match ran.is_own {
                true => LateCauseKind::OwnProcess,
                false => LateCauseKind::OtherProcess,
            };
            (kind(ran.process.clone()), ran.took)
        });
        let queued = self.usage.and_then(|usage| usage.queued_since(self.slot));
        let queued = queued.map(|queued| (LateCauseKind::OtherThread, queued));
        let stolen = self.stolen.map(|stolen| stolen.at_least);
        let stolen = stolen.map(|stolen| (LateCauseKind::Hypervisor, stolen));
        let all = [own, ran, queued, stolen].into_iter().flatten();
        let mut named: Vec<_> = all
            .filter_map(|(kind, explains)| {
                let percent = late::named_percent(nanos(explains), nanos(self.lateness))?;
                let explains = explains.min(self.lateness);
                Some(LateCause {
                    kind,
                    explains,
                    percent,
                })
            })
            .collect();
        named.sort_by_key(|cause| std::cmp::Reverse(cause.explains));
        named
    }
}

impl fmt::Display for LateCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            LateCauseKind::OwnOverrun => f.write_str("the cycle before overran by ")?,
            LateCauseKind::OwnProcess(name) => {
                write!(f, "another part of its process `{name}` ran instead for ")?;
            }
            LateCauseKind::OtherProcess(name) => write!(f, "`{name}` ran instead for ")?,
            LateCauseKind::OtherThread => {
                f.write_str("other threads had its core for at least ")?
            }
            LateCauseKind::Hypervisor => f.write_str("a hypervisor had its core for at least ")?,
        }
        write!(f, "{} ({} %)", short(self.explains), self.percent)
    }
}

/// What to switch on where a cause is unknown, if one of these cycles has none.
pub(crate) fn how_to_find_out<'a>(
    cycles: impl Iterator<Item = &'a LateCycle>,
) -> Option<&'static str> {
    let mut unknown = cycles.filter(|cycle| cycle.causes().is_empty());
    unknown.next().map(|_| {
        "to find an unknown cause: LUNA_LOG=run.luna LUNA_LOG_EVENTS=65536 records every turn for `luna scope run.luna`; \
         `luna doctor` shows interrupts and idle states of the core; docs/budgets.md#causes-of-late-cycles"
    })
}

impl fmt::Display for LateCycle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slot {}: {} late", self.number, short(self.lateness))?;
        let causes = self.causes();
        if causes.is_empty() {
            return f.write_str("; cause unknown");
        }
        for cause in causes {
            write!(f, "; {cause}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_machine::usage::ThreadUsage;

    fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    /// Late by 10 ms, from 2000 ms on, for an unknown reason.
    fn late_cycle() -> LateCycle {
        LateCycle {
            number: 7,
            slot: at(2000),
            lateness: ms(10),
            own_overrun: Duration::ZERO,
            previous_run: None,
            ran_instead: None,
            usage: None,
            core: Some(1),
            stolen: None,
        }
    }

    fn ran(process: &str, took: Duration) -> Option<RanInstead> {
        Some(RanInstead {
            process: process.to_owned(),
            is_own: false,
            took,
        })
    }

    /// Of the time from `since` until the cycle began the thread waited in the queue for `delay`.
    fn queued(since: Instant, delay: Duration) -> Option<UsageSince> {
        let mut counted = ThreadUsage::default();
        (counted.run_delay, counted.minor_faults) = (Some(delay), 900);
        Some(UsageSince {
            since,
            until: at(2010),
            counted,
        })
    }

    #[test]
    fn what_explains_little_is_no_cause() {
        let cycle = LateCycle {
            own_overrun: ms(4),
            ran_instead: ran("bridge", Duration::from_micros(26)),
            ..late_cycle()
        };
        assert_eq!(cycle.causes(), []);
        assert_eq!(cycle.to_string(), "slot 7: 10.00 ms late; cause unknown");
        assert!(
            how_to_find_out([&cycle].into_iter()).is_some_and(|line| line.contains("LUNA_LOG"))
        );
    }

    #[test]
    fn what_explains_half_is_named_with_its_share() {
        let cycle = LateCycle {
            own_overrun: ms(5),
            ran_instead: ran("bridge", ms(9)),
            ..late_cycle()
        };
        assert_eq!(
            cycle.to_string(),
            "slot 7: 10.00 ms late; `bridge` ran instead for 9.00 ms (90 %); \
             the cycle before overran by 5.00 ms (50 %)"
        );
    }

    #[test]
    fn figures_of_a_long_window_are_no_causes() {
        let cycle = LateCycle {
            // 1.9 s and 100 ms, of which all this may have been outside of the lateness.
            usage: queued(at(110), ms(1500)),
            stolen: Some(StolenTime {
                at_least: ms(0),
                at_most: ms(50),
            }),
            ..late_cycle()
        };
        assert_eq!(cycle.to_string(), "slot 7: 10.00 ms late; cause unknown");
    }

    #[test]
    fn what_must_have_been_within_the_lateness_is_a_cause() {
        let cycle = LateCycle {
            // 18 ms of 20: 8 do not fit before the slot.
            usage: queued(at(1990), ms(18)),
            stolen: Some(StolenTime {
                at_least: ms(6),
                at_most: ms(50),
            }),
            ..late_cycle()
        };
        assert_eq!(
            cycle.to_string(),
            "slot 7: 10.00 ms late; other threads had its core for at least 8.00 ms (80 %); \
             a hypervisor had its core for at least 6.00 ms (60 %)"
        );
    }
}
