//! Channels: rendezvous in every place, buffers, calls, extended rendezvous, poison, the end.

use super::{Ends, Outcome, Test, ensure, run_both, same};
use crate::ALLOCATOR;
use luna::{Buffer, Receiver, Sender};

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "rendezvous-executor",
        component: "channels",
        shows: "values go from process to process on one executor, in order, and nothing is allocated or freed",
        run: || rendezvous(Ends::OneExecutor),
    },
    Test {
        name: "rendezvous-across",
        component: "channels",
        shows: "values go from one executor to another, in order, and nothing is allocated or freed",
        run: || rendezvous(Ends::TwoExecutors),
    },
    Test {
        name: "rendezvous-thread",
        component: "channels",
        shows: "values go from an executor to a process with a thread of its own, in order",
        run: || rendezvous(Ends::ExecutorAndThread),
    },
    Test {
        name: "buffers",
        component: "channels",
        shows: "a FIFO buffer keeps all, the overwriting ones the newest and the oldest",
        run: buffers,
    },
    Test {
        name: "call",
        component: "channels",
        shows: "each call gets its own answer, across executors",
        run: call,
    },
    Test {
        name: "extended-rendezvous",
        component: "channels",
        shows: "the sender is held until the receiver is done",
        run: extended,
    },
    Test {
        name: "poison",
        component: "channels",
        shows: "poison wakes waiting processes, on the other executor too",
        run: poison,
    },
    Test {
        name: "channel-end",
        component: "channels",
        shows: "when the last sender is gone the receiver gets what is left, and then the end",
        run: end,
    },
];

const MESSAGES: u32 = 1000;

async fn send_all(sender: Sender<u32>) -> luna::Result<()> {
    for number in 0..MESSAGES {
        sender.send(number).await?;
    }
    Ok(())
}

async fn receive_all(receiver: Receiver<u32>) -> luna::Result<()> {
    for number in 0..MESSAGES {
        same("a message", receiver.recv().await?, number)?;
    }
    ensure(
        receiver.recv().await.is_err_and(|error| error.is_closed()),
        "the channel ends",
    )
}

fn rendezvous(ends: Ends) -> Outcome {
    let (sender, receiver) = luna::channel();
    let before = ALLOCATOR.counts();
    run_both(ends, send_all(sender), receive_all(receiver))?;
    same(
        "calls of the allocator on the path",
        ALLOCATOR.counts(),
        before,
    )?;
    Ok(format!("{MESSAGES} messages"))
}

fn buffers() -> Outcome {
    for (buffer, kept) in [
        (Buffer::fifo(3), [0, 1, 2]),
        (Buffer::overwrite_oldest(3), [7, 8, 9]),
        (Buffer::overwrite_newest(3), [0, 1, 9]),
    ] {
        let (sender, receiver) = luna::buffered(buffer);
        let full = (0..10).filter(|number| sender.try_send(*number).is_err());
        let refused = full.count();
        same(
            "refused by a buffer",
            refused,
            if kept == [0, 1, 2] { 7 } else { 0 },
        )?;
        let got: Vec<i32> = std::iter::from_fn(|| receiver.try_recv().ok()).collect();
        same("kept by a buffer", got.as_slice(), &kept)?;
    }
    Ok("3 kinds".to_owned())
}

fn call() -> Outcome {
    let (client, server) = luna::channel::call_channel::<u32, u32>();
    let ask = async move {
        for number in 0..MESSAGES {
            same("an answer", client.call(number).await?, number * 2)?;
        }
        Ok(())
    };
    let answer = async move {
        while let Ok(call) = server.accept().await {
            let answer = *call * 2;
            // A client that is gone needs none.
            let _ = call.reply(answer);
        }
        Ok(())
    };
    run_both(Ends::TwoExecutors, ask, answer)?;
    Ok(format!("{MESSAGES} calls"))
}

fn extended() -> Outcome {
    let (sender, receiver) = luna::channel();
    let (done, is_done) = luna::buffered(Buffer::fifo(1));
    let left = async move {
        sender.send(1).await?;
        ensure(is_done.try_recv().is_ok(), "the receiver was done first")
    };
    let right = async move {
        let value = receiver.recv_extended().await?;
        luna::yield_now().await;
        done.try_send(())?;
        same("the value", value.finish(), 1)
    };
    run_both(Ends::OneExecutor, left, right)?;
    Ok("1 sender held".to_owned())
}

fn poison() -> Outcome {
    let (sender, receiver) = luna::channel::<()>();
    let (waits, waiting) = luna::channel();
    let left = async move {
        waits.send(()).await?;
        ensure(
            receiver
                .recv()
                .await
                .is_err_and(|error| error.is_poisoned()),
            "the receive is poisoned",
        )
    };
    let right = async move {
        waiting.recv().await?;
        sender.poison();
        Ok(())
    };
    run_both(Ends::TwoExecutors, left, right)?;
    Ok("1 channel".to_owned())
}

fn end() -> Outcome {
    let (sender, receiver) = luna::buffered(Buffer::fifo(2));
    let left = async move {
        sender.send(1).await?;
        sender.send(2).await?;
        Ok(())
    };
    let right = async move {
        same("what is left", receiver.recv().await?, 1)?;
        same("what is left", receiver.recv().await?, 2)?;
        ensure(
            receiver.recv().await.is_err_and(|error| error.is_closed()),
            "then the end",
        )
    };
    run_both(Ends::TwoExecutors, left, right)?;
    Ok("1 channel".to_owned())
}
