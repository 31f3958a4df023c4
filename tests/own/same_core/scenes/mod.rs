//! What is done on the one core: a scene is one kind of meeting, with what either side does in it.

mod alternatives;
mod barriers;
mod calls;
mod channels;
pub(crate) mod controls;
mod extended;
mod locks;
mod registered;
mod wakes;

use crate::same_core::high::High;
use crate::same_core::low::Low;
use std::future::Future;
use std::pin::Pin;

type Playing<'a> = Pin<Box<dyn Future<Output = ()> + 'a>>;

pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) high: Box<dyn for<'a> FnOnce(&'a mut High) -> Playing<'a> + Send>,
    pub(crate) low: Box<dyn for<'a> FnOnce(&'a mut Low) -> Playing<'a> + Send>,
}

impl Scene {
    fn new(
        name: &'static str,
        high: impl AsyncFnOnce(&mut High) + Send + 'static,
        low: impl AsyncFnOnce(&mut Low) + Send + 'static,
    ) -> Scene {
        Scene {
            name,
            high: Box::new(move |side| Box::pin(async move { high(side).await })),
            low: Box::new(move |side| Box::pin(async move { low(side).await })),
        }
    }
}

/// All of them, each with channels of its own.
pub(crate) fn all() -> Vec<Scene> {
    let mut scenes = channels::scenes();
    scenes.extend(extended::scenes());
    scenes.extend(calls::scenes());
    scenes.extend(alternatives::scenes());
    scenes.extend(registered::scenes());
    scenes.extend(barriers::scenes());
    scenes.extend(locks::scenes());
    scenes.extend(wakes::scenes());
    scenes
}

/// Checks that values which were sent as 1, 2, 3 and so on arrive in this order.
struct Order {
    last: u64,
    /// Some may be missing.
    drops: bool,
}

impl Order {
    fn new(drops: bool) -> Self {
        Self { last: 0, drops }
    }

    #[track_caller]
    fn check(&mut self, value: u64) {
        if self.drops {
            assert!(value > self.last, "{value} after {}", self.last);
        } else {
            assert_eq!(value, self.last + 1);
        }
        self.last = value;
    }
}

/// Numbers to be sent, each once: those that were withdrawn come again.
struct Numbers {
    slot: Option<u64>,
    last: u64,
}

impl Numbers {
    fn new() -> Self {
        Self {
            slot: None,
            last: 0,
        }
    }

    /// Where the next one is, and is still if it was not sent.
    fn slot(&mut self) -> &mut Option<u64> {
        if self.slot.is_none() {
            self.last += 1;
            self.slot = Some(self.last);
        }
        &mut self.slot
    }

    fn take(&mut self) -> u64 {
        self.slot().take().unwrap_or_default()
    }

    fn give_back(&mut self, number: u64) {
        self.slot = Some(number);
    }
}
