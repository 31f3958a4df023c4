//! Extended rendezvous: the sender is held until the receiver is done.

use super::{Numbers, Order, Scene};
use crate::same_core::shared::How;
use luna::{alt, channel};

pub(super) fn scenes() -> [Scene; 2] {
    [received(), sent()]
}

/// The high side receives, and holds the low one.
fn received() -> Scene {
    let (sender, receiver) = channel::<u64>();
    let receiver = receiver.external();
    Scene::new(
        "extended, received",
        async move |high| {
            let mut order = Order::new(false);
            for _ in 0..high.rounds {
                high.pause().await;
                let value = if high.how() == How::Try {
                    let choose = async {
                        alt! {
                            value = receiver.recv_extended() => value.ok(),
                            skip => None,
                        }
                    };
                    high.try_in(choose).await
                } else {
                    Some(high.wait_for(receiver.recv_extended()).await.unwrap())
                };
                if let Some(value) = value {
                    if high.random.below(2) == 0 {
                        high.pause().await;
                    }
                    order.check(high.try_to(|| value.finish()));
                }
            }
            receiver.poison();
        },
        async move |low| {
            let mut numbers = Numbers::new();
            while low.goes_on().await {
                let _ = low.offer(sender.send_from(numbers.slot())).await;
            }
        },
    )
}

/// The high side is held.
fn sent() -> Scene {
    let (sender, receiver) = channel();
    let sender = sender.external();
    Scene::new(
        "extended, sent",
        async move |high| {
            let mut numbers = Numbers::new();
            for _ in 0..high.rounds {
                high.pause().await;
                match high.how() {
                    // A sender that does not wait meets no receiver that would hold it.
                    How::Try => {
                        let number = numbers.take();
                        if let Err(error) = high.try_to(|| sender.try_send(number)) {
                            numbers.give_back(error.into_inner());
                        }
                    }
                    How::Await => high.wait_for(sender.send(numbers.take())).await.unwrap(),
                    How::Block => high.block(|| sender.blocking_send(numbers.take())).unwrap(),
                }
            }
            sender.poison();
        },
        async move |low| {
            let mut order = Order::new(false);
            while low.goes_on().await {
                if let Some(Ok(value)) = low.offer(receiver.recv_extended()).await {
                    low.work(300);
                    order.check(value.finish());
                }
            }
        },
    )
}
