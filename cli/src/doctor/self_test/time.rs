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
];

const MILLISECOND: Duration = Duration::from_millis(1);

fn delay() -> Outcome {
    on_one_executor(|executor| {
        let (long, order) = luna::buffered(luna::Buffer::fifo(2));
        let short = long.clone();
        for (name, sender, delay) in [
            ("long", long, 4 * MILLISECOND),
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
        })?;
        Ok(())
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
        })?;
        Ok(())
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
        })?;
        Ok(())
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
        })?;
        Ok(())
    })?;
    let kept = report.loops.remove("loop");
    let kept = kept.map(|one| (one.cycles, one.cycles + one.missed == one.slots_elapsed));
    same("cycles kept, and the sum holds", kept, Some((CYCLES, true)))?;
    Ok(format!("{CYCLES} cycles"))
}
