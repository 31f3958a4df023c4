//! Time: delays, ticks, loops.

use super::{Outcome, Test, ensure, on_one_executor, same};
use std::time::Duration;

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "delay",
        component: "time",
        shows: "a delay ends, and not before its time; the shorter of two first",
        run: delay,
    },
    Test {
        name: "ticks",
        component: "time",
        shows: "a timer channel ticks on its grid",
        run: ticks,
    },
    Test {
        name: "timeout",
        component: "time",
        shows: "a receive with a timeout gives up in time, and takes what comes before",
        run: timeout,
    },
    Test {
        name: "periodic-loop",
        component: "time",
        shows: "a loop keeps its slots or counts those it missed: kept + missed = elapsed",
        run: periodic,
    },
    Test {
        name: "phased-loops",
        component: "time",
        shows: "loops half a period apart keep that distance, one wakes by a guard spin and not before its slot, and a trim moves the slots",
        run: phased,
    },
    Test {
        name: "timer-manager",
        component: "time",
        shows: "the timer manager wakes two loops in phase, and calls a function at its slots",
        run: managed,
    },
];

const MILLISECOND: Duration = Duration::from_millis(1);

fn delay() -> Outcome {
    on_one_executor(|executor| {
        let (long, order) = luna::buffered(luna::Buffer::fifo(2));
        let short = long.clone();
        for (name, sender, delay) in [
            // Longer by more than a busy machine may keep one of them from its begin.
            ("long", long, 500 * MILLISECOND),
            ("short", short, MILLISECOND),
        ] {
            executor.process(name).spawn(async move {
                let start = luna::now();
                luna::after(delay).await;
                ensure(luna::now() - start >= delay, "not before its time")?;
                sender.send(name).await?;
                Ok(())
            })?;
        }
        executor.process("order").spawn(async move {
            let both = [order.recv().await?, order.recv().await?];
            same("the order", both, ["short", "long"])
        })
    })?;
    Ok("2 delays".to_owned())
}

fn ticks() -> Outcome {
    on_one_executor(|executor| {
        executor.process("ticks").spawn(async {
            let first = luna::now() + MILLISECOND;
            let mut ticks = luna::ticks(MILLISECOND)?.starting_at(first);
            for _ in 0..5 {
                let tick = ticks.tick().await;
                let since = (tick.slot - first).as_nanos();
                same("off the grid by", since % MILLISECOND.as_nanos(), 0)?;
                ensure(luna::now() >= tick.slot, "not before its slot")?;
            }
            Ok(())
        })
    })?;
    Ok("5 ticks".to_owned())
}

fn timeout() -> Outcome {
    on_one_executor(|executor| {
        let (sender, receiver) = luna::channel();
        executor.process("waits").spawn(async move {
            let nothing = receiver.recv_timeout(MILLISECOND).await;
            ensure(
                nothing.is_err_and(|error| error.is_timeout()),
                "the time ran out",
            )?;
            sender_comes(&receiver).await
        })?;
        executor.process("sends").spawn(async move {
            luna::after(5 * MILLISECOND).await;
            sender.send(7).await?;
            Ok(())
        })
    })?;
    Ok("1 timeout, 1 value".to_owned())
}

async fn sender_comes(receiver: &luna::Receiver<u32>) -> luna::Result<()> {
    let value = receiver.recv_timeout(Duration::from_secs(10)).await;
    same("the value", value.ok(), Some(7))
}

fn periodic() -> Outcome {
    const CYCLES: u64 = 20;
    let mut report = on_one_executor(|executor| {
        executor.process("loop").spawn(async {
            let mut tick = luna::periodic("loop", MILLISECOND)?;
            for _ in 0..CYCLES {
                tick.next().await;
            }
            Ok(())
        })
    })?;
    let kept = report.loops.remove("loop");
    let kept = kept.map(|one| (one.cycles, one.cycles + one.missed == one.slots_elapsed));
    same("cycles kept, and the sum holds", kept, Some((CYCLES, true)))?;
    Ok(format!("{CYCLES} cycles"))
}

fn managed() -> Outcome {
    let mut system = luna::System::new("managed");
    system.timers(luna::time::Timers::Manager);
    let (called, calls) = luna::buffered(luna::Buffer::fifo(64));
    let callback = system
        .timer_manager()?
        .callback("callback", move |firing| {
            // When no receiver is left, the loops have ended.
            let _ = called.try_send(luna::now() >= firing.deadline);
        })?;
    callback.every(MILLISECOND, Duration::ZERO)?;
    let (say, said) = luna::buffered(luna::Buffer::fifo(2));
    for (name, periods) in [("fine", 1), ("coarse", 3)] {
        let say = say.clone();
        system.thread(name).process(name).spawn(async move {
            let mut tick = luna::periodic(name, MILLISECOND * periods)?;
            let mut slot = tick.next().await.deadline;
            for _ in 0..12 / periods {
                slot = tick.next().await.deadline;
                ensure(luna::now() >= slot, "not before its slot")?;
            }
            say.send(slot).await?;
            Ok(())
        })?;
    }
    let main = system.executor("main").build()?;
    main.process("compares").spawn(async move {
        let [one, other] = [said.recv().await?, said.recv().await?];
        let apart = one.as_nanos().abs_diff(other.as_nanos());
        same("out of phase by", apart % 1_000_000, 0)?;
        ensure(calls.recv().await?, "called not before its slot")
    })?;
    let report = system.run()?;
    let timers = report.timers.unwrap_or_default();
    let calls = timers.callbacks.first().map_or(0, |one| one.calls);
    ensure(calls > 0 && timers.woken > 0, "it woke and called")?;
    Ok(format!("{} wake-ups, {calls} calls", timers.woken))
}

fn phased() -> Outcome {
    let period = 4 * MILLISECOND;
    on_one_executor(|executor| {
        let (say, said) = luna::buffered(luna::Buffer::fifo(1));
        executor.process("first").spawn(async move {
            let mut tick = luna::periodic("first", period)?.phase(Duration::ZERO)?;
            say.send(tick.next().await.deadline).await?;
            Ok(())
        })?;
        executor.process("second").spawn(async move {
            let mut tick = luna::periodic("second", period)?
                .phase(period / 2)?
                .guard_spin(period / 16)?;
            let first = tick.next().await;
            ensure(luna::now() >= first.deadline, "not before its slot")?;
            // The other's slot may be the later one, on a machine that is busy.
            let apart = first
                .deadline
                .as_nanos()
                .abs_diff(said.recv().await?.as_nanos());
            let apart = u128::from(apart) % period.as_nanos();
            same("apart", apart, period.as_nanos() / 2)?;
            same("moved by", tick.correct(1_000), 1_000)?;
            let second = tick.next().await;
            let moved = (second.deadline - first.deadline).as_nanos() % period.as_nanos();
            same("the slots moved by", moved, 1_000)
        })
    })?;
    Ok("2 loops".to_owned())
}
