//! Channels of all kinds, in both directions.

use super::{Numbers, Order, Scene};
use crate::same_core::shared::How;
use luna::{Buffer, Receiver, Sender, alt, buffered, channel};

/// How full the unbounded channel gets: it allocates when it grows, so it does so before.
const MAX: usize = 64;

struct Kind {
    names: [&'static str; 2],
    make: fn() -> (Sender<u64>, Receiver<u64>),
    drops: bool,
    unbounded: bool,
}

const KINDS: [Kind; 5] = [
    Kind {
        names: ["rendezvous, received", "rendezvous, sent"],
        make: || channel(),
        drops: false,
        unbounded: false,
    },
    Kind {
        names: ["fifo, received", "fifo, sent"],
        make: || buffered(Buffer::fifo(3)),
        drops: false,
        unbounded: false,
    },
    Kind {
        names: ["overwrite oldest, received", "overwrite oldest, sent"],
        make: || buffered(Buffer::overwrite_oldest(3)),
        drops: true,
        unbounded: false,
    },
    Kind {
        names: ["overwrite newest, received", "overwrite newest, sent"],
        make: || buffered(Buffer::overwrite_newest(3)),
        drops: true,
        unbounded: false,
    },
    Kind {
        names: ["unbounded, received", "unbounded, sent"],
        make: || {
            let (sender, receiver) = buffered(Buffer::allocating_unbounded());
            (0..2 * MAX as u64).for_each(|_| sender.try_send(0).unwrap());
            while receiver.try_recv().is_ok() {}
            (sender, receiver)
        },
        drops: false,
        unbounded: true,
    },
];

pub(super) fn scenes() -> Vec<Scene> {
    let of_kind = |kind: &'static Kind| [received(kind), sent(kind)];
    KINDS.iter().flat_map(of_kind).collect()
}

/// The high side receives.
fn received(kind: &'static Kind) -> Scene {
    let (sender, receiver) = (kind.make)();
    let receiver = receiver.external();
    // Reads how much is buffered.
    let gauge = receiver.clone();
    Scene::new(
        kind.names[0],
        async move |high| {
            let mut order = Order::new(kind.drops);
            for _ in 0..high.rounds {
                high.pause().await;
                let value = match high.how() {
                    How::Try if high.random.below(2) == 0 => {
                        high.try_to(|| receiver.try_recv()).ok()
                    }
                    How::Try => {
                        let choose = async {
                            alt! {
                                value = receiver.recv() => value.ok(),
                                skip => None,
                            }
                        };
                        high.try_in(choose).await
                    }
                    How::Await => Some(high.wait_for(receiver.recv()).await.unwrap()),
                    How::Block => Some(high.block(|| receiver.blocking_recv()).unwrap()),
                };
                value.into_iter().for_each(|value| order.check(value));
            }
            receiver.poison();
        },
        async move |low| {
            let mut numbers = Numbers::new();
            while low.goes_on().await {
                if kind.unbounded && gauge.buffered() >= MAX {
                    low.work(300);
                    continue;
                }
                if low.random.below(2) == 0 {
                    let number = numbers.take();
                    if let Err(error) = sender.try_send(number) {
                        numbers.give_back(error.into_inner());
                    }
                } else {
                    // An error is the end of the scene.
                    let _ = low.offer(sender.send_from(numbers.slot())).await;
                }
            }
        },
    )
}

/// The high side sends.
fn sent(kind: &'static Kind) -> Scene {
    let (sender, receiver) = (kind.make)();
    let sender = sender.external();
    Scene::new(
        kind.names[1],
        async move |high| {
            let mut numbers = Numbers::new();
            for _ in 0..high.rounds {
                high.pause().await;
                match high.how() {
                    How::Try if high.random.below(2) == 0 => {
                        let number = numbers.take();
                        if let Err(error) = high.try_to(|| sender.try_send(number)) {
                            numbers.give_back(error.into_inner());
                        }
                    }
                    How::Try => {
                        let choose = async {
                            alt! {
                                sent = sender.send_from(numbers.slot()) => sent.unwrap(),
                                skip => {}
                            }
                        };
                        high.try_in(choose).await;
                    }
                    How::Await => {
                        let sent = high.wait_for(sender.send(numbers.take())).await;
                        sent.unwrap();
                    }
                    How::Block => high.block(|| sender.blocking_send(numbers.take())).unwrap(),
                }
            }
            sender.poison();
        },
        async move |low| {
            let mut order = Order::new(kind.drops);
            while low.goes_on().await {
                let value = if low.random.below(2) == 0 {
                    receiver.try_recv().ok()
                } else {
                    low.offer(receiver.recv()).await.and_then(Result::ok)
                };
                value.into_iter().for_each(|value| order.check(value));
            }
        },
    )
}
