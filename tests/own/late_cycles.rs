//! Late cycles report their cause: what ran instead, what the kernel counted, and whether it was
//! the loop itself.

use crate::common;
use common::{COMPLETE, PLACEMENTS, Placement, SpawnOk, burn_until, has_real_time, skip};
use luna::Instant;
use luna::prelude::*;
use luna::report::{LateCauseKind, LateCycle, LoopReport, ThreadUsage};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(20);

/// Past the slot by some periods, so that a machine that is busy elsewhere cannot cause a greater
/// lateness by chance.
const HOG: Duration = Duration::from_millis(150);

fn culprit(cycle: &LateCycle) -> Option<&str> {
    cycle.ran_instead.as_ref().map(|one| one.process.as_str())
}

/// The late cycle that waited for `slot`.
fn at(report: &LoopReport, slot: Instant) -> &LateCycle {
    let found = report.late_cycles.iter().find(|one| one.slot == slot);
    found.unwrap_or_else(|| panic!("{slot:?} is not in {:?}", report.late_cycles))
}

#[test]
fn one_that_ran_instead_is_named() {
    own_process!();
    // Again if a busy machine gave the hog its turn too late.
    assert!((0..50).any(|_| a_hog_is_named()));
}

/// Whether the hog began in time to be in the way; then it is named.
fn a_hog_is_named() -> bool {
    let (notify, slot) = luna::buffered(Buffer::fifo(1));
    let (begins, began) = luna::buffered(Buffer::fifo(1));
    let (busy, free) = luna::channel::<Instant>();
    let mut system = System::new("named");
    let main = system.executor("main").build().unwrap();
    main.process("servo").priority(30).spawn_ok(async move {
        let mut tick = luna::periodic("servo", PERIOD)?;
        let first = tick.next().await;
        // The hog gets its message within a cycle, and runs past the end of the next slot.
        busy.send(first.deadline + PERIOD + HOG).await?;
        notify.try_send(first.deadline + PERIOD)?;
        tick.next().await;
        Ok(())
    });
    main.process("hog").priority(10).spawn_ok(async move {
        let until = free.recv().await?;
        begins.try_send(luna::now())?;
        burn_until(until);
        Ok(())
    });
    // It has its turns too, but short ones.
    main.process("other").priority(20).spawn_ok(async {
        for _ in 0..10 {
            luna::after(Duration::from_millis(1)).await;
        }
        Ok(())
    });
    let report = system.run().unwrap();
    let servo = &report.loops["servo"];
    let slot = slot.try_recv().unwrap();
    if began.try_recv().unwrap() >= slot {
        return false;
    }
    let cycle = at(servo, slot);
    assert_eq!(culprit(cycle), Some("hog"), "{cycle:?}");
    assert!(cycle.ran_instead.as_ref().unwrap().took >= HOG);
    assert!(cycle.lateness >= HOG && cycle.own_overrun.is_zero());
    assert!(cycle.previous_run.is_some_and(|run| run < HOG));
    assert!(servo.late >= 1 && servo.late_after == PERIOD / 10);
    let text = report.to_string();
    assert!(text.contains("`hog` ran instead for "), "{text}");
    true
}

#[test]
fn loops_that_wake_together_name_the_one_before() {
    own_process!();
    // Again if a busy machine gave the previous process its turn too late, or held the second up
    // for longer than the first.
    assert!((0..50).any(|_| the_one_before_is_named()));
}

/// Whether one that ran before all began in time for that; then it is named.
fn the_one_before_is_named() -> bool {
    let mut system = System::new("together");
    let main = system.executor("main").build().unwrap();
    let (ready, go) = luna::channel::<Instant>();
    let (begins, began) = luna::buffered(Buffer::fifo(1));
    let (notify, took) = luna::buffered::<Duration>(Buffer::fifo(2));
    let notify_too = notify.clone();
    main.process("first").priority(30).spawn_ok(async move {
        let mut tick = luna::periodic("first", PERIOD)?;
        let begun = luna::now();
        ready.send(begun).await?;
        tick.next().await;
        // Longer than the one before, also where a busy machine held that one up.
        let turn = luna::now();
        burn_until(turn + 2 * (HOG + (turn - begun)));
        Ok(notify_too.try_send(luna::now() - turn)?)
    });
    main.process("second").priority(20).spawn_ok(async move {
        luna::periodic("second", PERIOD)?.next().await;
        let turn = luna::now();
        burn_until(turn + HOG);
        Ok(notify.try_send(luna::now() - turn)?)
    });
    main.process("third").priority(15).spawn_ok(async {
        luna::periodic("third", PERIOD)?.next().await;
        Ok(())
    });
    // Until all slots have passed. One read of the clock then wakes all, and with no deadline left
    // there is no other read.
    main.process("before").priority(10).spawn_ok(async move {
        let until = go.recv().await? + HOG;
        begins.try_send(luna::now())?;
        burn_until(until);
        Ok(())
    });
    let report = system.run().unwrap();
    let began = began.try_recv().unwrap();
    let first = report.loops["first"].late_cycles.first();
    let [of_first, of_second] = [(); 2].map(|()| took.try_recv().unwrap());
    if first.is_none_or(|cycle| began >= cycle.slot) || of_first < of_second + HOG / 2 {
        return false;
    }
    let worst = |name: &str| report.loops[name].late_cycles[0].clone();
    assert_eq!(culprit(&worst("first")), Some("before"));
    for name in ["second", "third"] {
        let cycle = worst(name);
        // Of the two that ran before the third the first ran longer: each has its own turn.
        assert_eq!(culprit(&cycle), Some("first"), "{name}: {cycle:?}");
        assert!(cycle.ran_instead.as_ref().unwrap().took >= 2 * HOG);
    }
    true
}

#[test]
fn a_loop_that_overran_itself_blames_nobody() {
    own_process!();
    for place in PLACEMENTS {
        let (notify, slot) = luna::buffered(Buffer::fifo(1));
        let mut system = System::new("itself");
        place
            .process(&mut system, "main", "loop")
            .spawn_ok(async move {
                let mut tick = luna::periodic("loop", PERIOD)?;
                let cycle = tick.next().await;
                notify.try_send(cycle.deadline + PERIOD)?;
                burn_until(cycle.deadline + PERIOD + HOG);
                tick.next().await;
                Ok(())
            });
        let report = system.run().unwrap();
        let worst = at(&report.loops["loop"], slot.try_recv().unwrap());
        assert!(worst.own_overrun >= HOG, "{worst:?}");
        assert!(worst.lateness >= worst.own_overrun);
        assert!(worst.previous_run.is_some_and(|run| run >= HOG));
        assert_ne!(culprit(worst), Some("loop"), "{place:?}: {worst:?}");
        let named = worst.causes();
        let own = named
            .iter()
            .find(|one| one.kind == LateCauseKind::OwnOverrun);
        assert!(own.is_some_and(|own| own.percent >= 50), "{worst}");
    }
}

#[test]
fn page_faults_of_the_cycle_before_are_counted() {
    own_process!();
    if !COMPLETE {
        skip("the portable layer does not know of page faults");
        return;
    }
    for place in PLACEMENTS {
        let (notify, faults) = luna::buffered(Buffer::fifo(1));
        let mut system = System::new("faults");
        place
            .process(&mut system, "main", "loop")
            .spawn_ok(async move {
                let count = || ThreadUsage::of_current_thread().unwrap().minor_faults;
                let mut tick = luna::periodic("loop", PERIOD)?.accounted();
                let fresh = || vec![0_u8; 8 << 20];
                // Faults of an earlier cycle are not charged to the late one.
                let touch = |memory: &mut [u8]| {
                    for page in memory.chunks_mut(4096) {
                        std::hint::black_box(page)[0] = 1;
                    }
                };
                tick.next().await;
                let mut first = fresh();
                touch(&mut first);
                let cycle = tick.next().await;
                // Both are kept, so that neither is made of the other.
                let before = count();
                let mut second = fresh();
                touch(&mut second);
                notify.try_send((count() - before, cycle.deadline + PERIOD))?;
                burn_until(cycle.deadline + PERIOD + HOG);
                tick.next().await;
                Ok(())
            });
        let report = system.run().unwrap();
        let (touched, slot) = faults.try_recv().unwrap();
        assert!(touched > 0);
        let worst = at(&report.loops["loop"], slot);
        let usage = worst.usage.unwrap();
        assert!(
            usage.counted.minor_faults >= touched,
            "{touched}: {usage:?}"
        );
        assert!(usage.counted.cpu_time > Duration::ZERO);
        // Since the cycle before, and no longer.
        let began = worst.slot + worst.lateness;
        assert_eq!(usage.until, began);
        let waited = worst.lateness - worst.own_overrun;
        assert_eq!(usage.elapsed(), worst.previous_run.unwrap() + waited);
    }
}

#[test]
fn a_thread_that_was_preempted_has_waited_in_the_queue() {
    own_process!();
    if !has_real_time() {
        skip("needs SCHED_FIFO");
        return;
    }
    let (busy, free) = luna::buffered(Buffer::fifo(1));
    let mut system = System::new("preempted");
    system
        .thread("low")
        .core(0)
        .policy(Policy::fifo(10))
        .process("loop")
        .spawn_ok(async move {
            let mut tick = luna::periodic("loop", PERIOD)?.accounted();
            let cycle = tick.next().await;
            // Wakes a thread that takes the core here, and gives it back after the slot.
            busy.try_send(cycle.deadline + PERIOD + HOG)?;
            tick.next().await;
            Ok(())
        });
    system
        .thread("high")
        .core(0)
        .policy(Policy::fifo(20))
        .process("hog")
        .spawn_ok(async move {
            burn_until(free.recv().await?);
            Ok(())
        });
    let report = system.run().unwrap();
    let worst = &report.loops["loop"].late_cycles[0];
    assert_eq!((worst.core, culprit(worst)), (Some(0), None));
    let counted = worst.usage.unwrap().counted;
    assert!(counted.involuntary_switches >= 1, "{worst:?}");
    assert!(counted.cpu_time < HOG, "{worst:?}");
    if let Some(delay) = counted.run_delay {
        assert!(delay >= PERIOD, "{worst:?}");
    }
    if counted.run_delay.is_some() {
        let text = worst.to_string();
        assert!(
            text.contains("other threads had its core for at least "),
            "{text}"
        );
    }
}

#[test]
fn only_the_worst_are_kept_and_all_are_counted() {
    own_process!();
    let mut system = System::new("many");
    Placement::Executor
        .process(&mut system, "main", "loop")
        .spawn_ok(async {
            let mut tick = luna::periodic("loop", Duration::from_millis(1))?
                .late_after(Duration::from_micros(100));
            for _ in 0..20 {
                let cycle = tick.next().await;
                // Until the middle of a slot that is not the next.
                burn_until(cycle.deadline + Duration::from_micros(2500));
            }
            Ok(())
        });
    let report = system.run().unwrap();
    let report = &report.loops["loop"];
    assert_eq!(report.late_after, Duration::from_micros(100));
    assert!(report.late >= 19, "{}", report.late);
    assert_eq!(report.late_cycles.len(), 8);
    assert!(
        report
            .late_cycles
            .is_sorted_by_key(|cycle| std::cmp::Reverse(cycle.lateness))
    );
    assert_eq!(report.late_cycles[0].lateness, report.wake_latency.max());
}

#[test]
fn what_is_never_late_is_asked_nothing() {
    own_process!();
    let mut system = System::new("patient");
    let main = system.executor("main").build().unwrap();
    main.process("loop").spawn_ok(async {
        let mut tick = luna::periodic("loop", PERIOD)?.late_after(Duration::MAX);
        let cycle = tick.next().await;
        burn_until(cycle.deadline + PERIOD + HOG);
        tick.next().await;
        Ok(())
    });
    let report = system.run().unwrap();
    let report = &report.loops["loop"];
    assert_eq!((report.late, report.late_cycles.len()), (0, 0));
    assert!(report.wake_latency.max() >= HOG);
}
