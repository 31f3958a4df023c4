//! One channel.

use crate::deadlines::{Beside, on_one_executor_beside};
use crate::laps::{laps, laps_here};
use crate::on_one_executor;
use luna::Instant;
use luna::prelude::*;
use std::time::Duration;

/// Later than all that is counted, and sooner than the deadlines beside it.
const SOON: Duration = Duration::from_secs(500);

pub(crate) fn rendezvous(steps: u64) -> luna::Result<()> {
    rendezvous_beside(Beside::Nothing, steps)
}

pub(crate) fn rendezvous_with_deadlines(steps: u64) -> luna::Result<()> {
    rendezvous_beside(Beside::Deadlines, steps)
}

/// The receiver waits first each time, and its timeout is cancelled by the value.
pub(crate) fn rendezvous_in_time(steps: u64) -> luna::Result<()> {
    on_one_executor_beside("rendezvous", Beside::Deadlines, |executor, end| {
        let (output, input) = luna::channel();
        executor.process("consumer").spawn(move || async move {
            laps(steps, async |expected| {
                assert_eq!(input.recv_timeout(SOON).await, Ok(expected));
            })
            .await?;
            drop(end);
            Ok(())
        })?;
        executor.process("producer").spawn(async move {
            let mut number = 0;
            while output.send(number).await.is_ok() {
                number += 1;
            }
            Ok(())
        })
    })
}

fn rendezvous_beside(beside: Beside, steps: u64) -> luna::Result<()> {
    on_one_executor_beside("rendezvous", beside, |executor, end| {
        let (output, input) = luna::channel();
        executor.process("producer").spawn(async move {
            let mut number = 0;
            while output.send(number).await.is_ok() {
                number += 1;
            }
            Ok(())
        })?;
        executor.process("consumer").spawn(move || async move {
            laps(steps, async |expected| {
                assert_eq!(input.recv().await, Ok(expected));
            })
            .await?;
            drop(end);
            Ok(())
        })
    })
}

/// Both ends in one process, which never waits.
pub(crate) fn buffered(steps: u64) -> luna::Result<()> {
    on_one_executor("buffered", |executor| {
        let (output, input) = luna::buffered(Buffer::fifo(1));
        executor.process("both ends").spawn(move || async move {
            laps(steps, async |number| {
                assert_eq!(output.send(number).await, Ok(()));
                assert_eq!(input.recv().await, Ok(number));
            })
            .await
        })
    })
}

/// As [`buffered`], with a timeout each.
pub(crate) fn buffered_in_time(steps: u64) -> luna::Result<()> {
    on_one_executor("buffered", |executor| {
        let (output, input) = luna::buffered(Buffer::fifo(1));
        executor.process("both ends").spawn(move || async move {
            laps(steps, async |number| {
                assert_eq!(output.send_timeout(number, SOON).await, Ok(()));
                assert_eq!(input.recv_timeout(SOON).await, Ok(number));
            })
            .await
        })
    })
}

/// As [`buffered`], with a deadline that both share.
pub(crate) fn buffered_until(steps: u64) -> luna::Result<()> {
    on_one_executor("buffered", |executor| {
        let (output, input) = luna::buffered(Buffer::fifo(1));
        executor.process("both ends").spawn(move || async move {
            let deadline = Instant::now() + SOON;
            laps(steps, async |number| {
                assert_eq!(output.send_deadline(number, deadline).await, Ok(()));
                assert_eq!(input.recv_deadline(deadline).await, Ok(number));
            })
            .await
        })
    })
}

/// On the main thread: there is no executor.
pub(crate) fn plain_thread(steps: u64) -> luna::Result<()> {
    let (output, input) = luna::buffered(Buffer::fifo(1));
    laps_here(steps, |number| {
        assert_eq!(output.try_send(number), Ok(()));
        assert_eq!(input.try_recv(), Ok(number));
    });
    Ok(())
}
