//! Alternatives with guards on both sides of two channels, against opposite ones.

use super::{Numbers, Order, Scene};
use crate::same_core::shared::How;
use luna::{Receiver, Sender, alt, channel, pri_alt};

pub(super) fn scenes() -> [Scene; 2] {
    [
        scene("alternatives, fair", true),
        scene("alternatives, prioritized", false),
    ]
}

struct Side {
    sender: Sender<u64>,
    receiver: Receiver<u64>,
    fair: bool,
    numbers: Numbers,
    order: Order,
}

impl Side {
    fn new(sender: Sender<u64>, receiver: Receiver<u64>, fair: bool) -> Self {
        Self {
            sender,
            receiver,
            fair,
            numbers: Numbers::new(),
            order: Order::new(false),
        }
    }

    /// Receives or sends, whichever can be first; says whether it could.
    async fn choose(&mut self) -> bool {
        let (sender, receiver) = (&self.sender, &self.receiver);
        let received = if self.fair {
            alt! {
                value = receiver.recv() => value.map(Some).map_err(drop),
                sent = sender.send_from(self.numbers.slot()) => sent.map(|()| None).map_err(drop),
            }
        } else {
            pri_alt! {
                value = receiver.recv() => value.map(Some).map_err(drop),
                sent = sender.send_from(self.numbers.slot()) => sent.map(|()| None).map_err(drop),
            }
        };
        self.note(received)
    }

    /// The same, but only what can be at once.
    async fn choose_or_skip(&mut self) -> bool {
        let (sender, receiver) = (&self.sender, &self.receiver);
        let received = if self.fair {
            alt! {
                sent = sender.send_from(self.numbers.slot()) => sent.map(|()| None).map_err(drop),
                value = receiver.recv() => value.map(Some).map_err(drop),
                skip => Ok(None),
            }
        } else {
            pri_alt! {
                sent = sender.send_from(self.numbers.slot()) => sent.map(|()| None).map_err(drop),
                value = receiver.recv() => value.map(Some).map_err(drop),
                skip => Ok(None),
            }
        };
        self.note(received)
    }

    fn note(&mut self, received: Result<Option<u64>, ()>) -> bool {
        if let Ok(Some(value)) = received {
            self.order.check(value);
        }
        received.is_ok()
    }
}

fn scene(name: &'static str, fair: bool) -> Scene {
    let (up, from_below) = channel();
    let (down, from_above) = channel();
    let (down, from_below) = (down.external(), from_below.external());
    Scene::new(
        name,
        async move |high| {
            let mut side = Side::new(down, from_below, fair);
            for _ in 0..high.rounds {
                high.pause().await;
                let goes_on = match high.how() {
                    How::Try => high.try_in(side.choose_or_skip()).await,
                    _ => high.wait_for(side.choose()).await,
                };
                assert!(goes_on);
            }
            side.sender.poison();
            side.receiver.poison();
        },
        async move |low| {
            let mut side = Side::new(up, from_above, fair);
            while low.goes_on().await {
                if low.random.below(2) == 0 {
                    side.choose_or_skip().await;
                } else {
                    let _ = low.offer(side.choose()).await;
                }
            }
        },
    )
}
