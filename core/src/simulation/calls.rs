//! The blocking calls that processes of a simulation have begun: their results come in the order of
//! their beginnings, whichever is there first.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What gives a call's result to its process, and wakes it.
pub(crate) type Delivery = Box<dyn FnOnce() + Send>;

/// The calls under way. A plain lock: a buddy thread and the simulation's are not on a real-time
/// path.
#[derive(Default)]
pub(super) struct CallsUnderWay(Mutex<Begun>);

#[derive(Default)]
struct Begun {
    /// The number of the first one in the queue.
    first: u64,
    calls: VecDeque<Option<Delivery>>,
}

/// What becomes of the oldest call.
pub(super) enum Oldest {
    None,
    UnderWay,
    Done(Delivery),
}

impl CallsUnderWay {
    fn lock(&self) -> MutexGuard<'_, Begun> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A call begins; gives its number.
    pub(super) fn begin(&self) -> u64 {
        let mut begun = self.lock();
        begun.calls.push_back(None);
        begun.first + begun.calls.len() as u64 - 1
    }

    /// The call of this number is done.
    pub(super) fn done(&self, number: u64, delivery: Delivery) {
        let mut begun = self.lock();
        let index = number.wrapping_sub(begun.first) as usize;
        if let Some(call) = begun.calls.get_mut(index) {
            *call = Some(delivery);
        }
    }

    /// Takes the oldest call out if it is done.
    pub(super) fn oldest(&self) -> Oldest {
        let mut begun = self.lock();
        match begun.calls.front_mut().map(Option::take) {
            None => Oldest::None,
            Some(None) => Oldest::UnderWay,
            Some(Some(delivery)) => {
                begun.calls.pop_front();
                begun.first += 1;
                Oldest::Done(delivery)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_oldest_comes_first_whichever_is_done_first() {
        let (calls, order) = (CallsUnderWay::default(), Arc::new(Mutex::new(Vec::new())));
        let numbers = [calls.begin(), calls.begin(), calls.begin()];
        for number in [numbers[2], numbers[1]] {
            let order = order.clone();
            calls.done(number, Box::new(move || order.lock().unwrap().push(number)));
        }
        assert!(matches!(calls.oldest(), Oldest::UnderWay));
        calls.done(numbers[0], Box::new(|| ()));
        while let Oldest::Done(delivery) = calls.oldest() {
            delivery();
        }
        assert_eq!(*order.lock().unwrap(), numbers[1..]);
        assert!(matches!(calls.oldest(), Oldest::None));
        assert_eq!(calls.begin(), 3);
    }
}
