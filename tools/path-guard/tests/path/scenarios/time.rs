//! Delays, loops, and what else waits for the clock.

use super::Places;
use luna::prelude::*;
use luna::safety::{OnOverrun, Watchdog};
use luna::time::{Overrun, Timers};
use luna::Timer;
use std::pin::pin;
use std::task::{Context, Waker};
use std::time::Duration;

const SHORT: Duration = Duration::from_micros(50);
const PERIOD: Duration = Duration::from_micros(200);

fn spin_for(duration: Duration) {
    let end = luna::now() + duration;
    while luna::now() < end {
        std::hint::spin_loop();
    }
}

pub(crate) fn delays(places: &mut Places) {
    for sleeper in 0..3 {
        places.process(&format!("sleeper {sleeper}"), async move {
            for n in 0..20 {
                luna::after(SHORT * (sleeper + 1)).await;
                luna::at(luna::now() + SHORT * (n % 3)).await;
            }
            Ok(())
        });
    }
}

/// An executor that does not sleep wakes the thread of its alarm: for the earliest deadline, an
/// earlier one that comes, and one that is dropped.
pub(crate) fn delays_of_a_busy_executor(places: &mut Places) {
    for busy in 0..3 {
        places.process(&format!("busy {busy}"), async move {
            let end = luna::now() + SHORT * 100;
            while luna::now() < end {
                luna::yield_now().await;
            }
            Ok(())
        });
    }
    for sleeper in 0..3 {
        places.process(&format!("sleeper {sleeper}"), async move {
            for n in 0..20 {
                luna::after(SHORT * (sleeper + 1)).await;
                let _ = pin!(luna::after(SHORT * n)).poll(&mut Context::from_waker(Waker::noop()));
            }
            Ok(())
        });
    }
}

const POLICIES: [(&str, Overrun); 3] = [
    ("catches up", Overrun::CatchUp),
    ("skips", Overrun::SkipToGrid),
    ("rephases", Overrun::Rephase),
];

pub(crate) fn loops(places: &mut Places) {
    for (name, policy) in POLICIES {
        let body = async move {
            let mut tick = luna::periodic(name, PERIOD)?
                .overrun(policy)
                .limit(1_000_000);
            for _ in 0..30 {
                tick.next().await;
            }
            Ok(())
        };
        places.next(name).timed().spawn(body).unwrap();
    }
}

/// Each cycle takes longer than its period.
pub(crate) fn loops_behind_time(places: &mut Places) {
    for (name, policy) in POLICIES {
        places.process(name, async move {
            let mut tick = luna::periodic(name, PERIOD)?.overrun(policy);
            for _ in 0..10 {
                let cycle = tick.next().await;
                while luna::now() < cycle.deadline + 2 * PERIOD {
                    std::hint::spin_loop();
                }
            }
            Ok(())
        });
    }
}

/// Loops on the common grid, with a guard, that follow another clock.
pub(crate) fn loops_in_phase(places: &mut Places) {
    for (name, phase) in [("first", Duration::ZERO), ("second", PERIOD / 2)] {
        places.process(name, async move {
            let mut tick = luna::periodic(name, PERIOD)?
                .phase(phase)?
                .guard_spin(PERIOD / 20)?;
            for n in 0..30 {
                tick.next().await;
                tick.correct(if n % 2 == 0 { 500 } else { -700 });
            }
            Ok(())
        });
    }
}

/// Loops that the timer manager wakes, which join its ticks and leave them, and callbacks on its
/// thread, which is on the path too.
pub(crate) fn loops_by_the_manager(places: &mut Places) {
    places.system.timers(Timers::Manager);
    let manager = places.system.timer_manager().unwrap();
    for (name, periods) in [("fine", 1), ("coarse", 5), ("odd", 3)] {
        let callback = manager.callback(name, |_| ()).unwrap();
        places.process(name, async move {
            let mut tick = luna::periodic(name, PERIOD * periods)?;
            for n in 0..30 {
                tick.next().await;
                match n % 4 {
                    0 => callback.every(PERIOD * 2, PERIOD / 2)?,
                    1 => callback.after(SHORT),
                    2 => drop(callback.cancel()),
                    _ => tick = tick.phase(PERIOD * (n % 3) / 3)?,
                }
            }
            luna::realtime::off_path(|| drop(callback));
            Ok(())
        });
    }
}

/// Loops with only late cycles, which query the kernel for the cause.
pub(crate) fn loops_that_account(places: &mut Places) {
    for (name, accounts) in [("asks when late", false), ("asks each time", true)] {
        places.process(name, async move {
            let mut tick = luna::periodic(name, PERIOD)?.late_after(Duration::from_nanos(1));
            if accounts {
                tick = tick.accounted();
            }
            for _ in 0..30 {
                tick.next().await;
            }
            Ok(())
        });
    }
}

/// Processes beyond their budgets in each poll and cycle, one of which is ended for it.
pub(crate) fn budgets(places: &mut Places) {
    places.error = Some("for a poll whose budget is 1µs");
    let (output, input) = luna::channel::<u32>();
    let poisoned = async move {
        let _output = output;
        spin_for(Duration::from_micros(5));
        luna::after(PERIOD).await;
        Ok(())
    };
    places
        .next("is ended")
        .poll_budget(Duration::from_micros(1))
        .on_overrun(OnOverrun::Poison)
        .spawn(poisoned)
        .unwrap();
    places.process("finds out", async move {
        assert!(input.recv().await.is_err());
        Ok(())
    });
    for (name, on_overrun) in [("counts", OnOverrun::Count), ("warns", OnOverrun::Warn)] {
        let body = async move {
            let mut tick = luna::periodic(name, PERIOD)?;
            for _ in 0..30 {
                tick.next().await;
                spin_for(Duration::from_micros(5));
            }
            Ok(())
        };
        places
            .next(name)
            .poll_budget(Duration::from_micros(1))
            .cycle_budget(Duration::from_micros(1))
            .on_overrun(on_overrun)
            .spawn(body)
            .unwrap();
    }
}

pub(crate) fn ticks_as_guards(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    places.process("ticks", async move {
        let mut ticks = luna::ticks(PERIOD)?;
        for n in 0..30 {
            ticks.tick().await;
            output.send(n).await?;
        }
        Ok(())
    });
    places.process("ticks or receives", async move {
        let mut ticks = luna::ticks(PERIOD)?;
        loop {
            pri_alt! {
                n = input.recv() => if n.is_err() { return Ok(()) },
                _ = ticks.tick() => {}
            }
        }
    });
}

pub(crate) fn timers(places: &mut Places) {
    places.process("sets timers", async move {
        let (mut one, mut two) = (Timer::new(), Timer::new());
        for _ in 0..20 {
            two.set(SHORT);
            one.set_at(luna::now() + Duration::from_secs(1000));
            alt! {
                _ = one.expired() => unreachable!(),
                _ = two.expired() => {}
            }
            assert!(one.cancel());
        }
        Ok(())
    });
}

pub(crate) fn watchdogs(places: &mut Places) {
    let watchdog = Watchdog::new(PERIOD);
    let bitten = watchdog.clone();
    let (alarm, heard) = luna::buffered::<()>(Buffer::overwrite_oldest(1));
    let guard = watchdog.process(move || drop(alarm.try_send(())));
    places.next("guard").priority(31).spawn(guard).unwrap();
    places.process("feeds, then does not", async move {
        let mut ticks = luna::ticks(PERIOD / 4)?;
        for _ in 0..20 {
            ticks.tick().await;
            watchdog.feed();
        }
        heard.recv().await?;
        Ok(())
    });
    // The last handle of this one goes at the end of a body.
    let alone = Watchdog::new(PERIOD);
    places.process("has one of its own", async move {
        alone.feed();
        alone.expired().await;
        Ok(())
    });
    places.process("waits for the watchdog", async move {
        bitten.expired().await;
        assert!(bitten.has_expired());
        bitten.reset();
        bitten.expired().await;
        Ok(())
    });
}
