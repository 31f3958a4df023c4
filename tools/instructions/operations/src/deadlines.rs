//! Deadlines that are pending on the executor while something else is counted.

use crate::on_one_executor;
use luna::prelude::*;
use std::future::poll_fn;
use std::task::Poll;
use std::time::Duration;

/// What lives on the executor beside the operation.
#[derive(Clone, Copy)]
pub(crate) enum Beside {
    Nothing,
    /// A loop that waits for its next cycle, and a hundred timeouts. None of them comes: Valgrind's
    /// time is not that of a processor, and a count is to be exact.
    Deadlines,
}

/// How many timeouts are pending.
const TIMEOUTS: u64 = 100;

/// When the first of them comes.
const FAR: Duration = Duration::from_secs(1000);

/// As [`on_one_executor`]. What is given to `spawn` is to be dropped when the operation has ended.
pub(crate) fn on_one_executor_beside<T>(
    name: &str,
    beside: Beside,
    spawn: impl FnOnce(&luna::Executor, Option<Sender<()>>) -> luna::Result<T>,
) -> luna::Result<()> {
    on_one_executor(name, |executor| {
        let Beside::Deadlines = beside else {
            return spawn(executor, None);
        };
        let (end, ended) = luna::channel();
        // The others begin when all deadlines are pending.
        let beside = executor.process("beside").priority(31);
        beside.spawn(move || async move {
            let mut tick = luna::periodic("loop", FAR)?;
            let mut next = Box::pin(tick.next());
            let timeouts =
                (0..TIMEOUTS).map(|number| luna::after(FAR + Duration::from_secs(number)));
            let mut timeouts: Vec<_> = timeouts.map(Box::pin).collect();
            poll_fn(|context| {
                assert!(next.as_mut().poll(context).is_pending());
                for timeout in &mut timeouts {
                    assert!(timeout.as_mut().poll(context).is_pending());
                }
                Poll::Ready(())
            })
            .await;
            assert!(ended.recv().await.is_err());
            Ok(())
        })?;
        spawn(executor, Some(end))
    })
}
