//! Alternatives as a user writes them: one program with a place for every kind of guard in each
//! position, opened by preconditions.

use crate::operational::network::{Form, Guard, Offer, Outcome, Value};
use crate::operational::operate::{failure, received, sent};
use crate::operational::play::Ends;
use luna::{SendError, alt, pri_alt};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// What the guards of one position need, and what shows afterwards whether they kept to the rules.
struct Position<'a> {
    offer: Option<&'a Offer>,
    place: u8,
    /// How often `send_with` has made its value.
    made: Arc<AtomicU32>,
}

impl<'a> Position<'a> {
    fn new(offers: &'a [Offer], place: u8) -> Position<'a> {
        Position {
            offer: offers.get(usize::from(place)),
            place,
            made: Arc::default(),
        }
    }

    fn open(&self) -> Option<Guard> {
        self.offer
            .filter(|offer| offer.open)
            .map(|offer| offer.guard)
    }

    /// What is sent in this form, if this position sends.
    fn sends(&self, asked: Form) -> Option<(usize, Value)> {
        match self.open() {
            Some(Guard::Send {
                channel,
                value,
                form,
            }) if form == asked => Some((channel, value)),
            _ => None,
        }
    }

    fn receives(&self) -> Option<usize> {
        match self.open() {
            Some(Guard::Recv { channel }) => Some(channel),
            _ => None,
        }
    }

    fn syncs(&self) -> Option<usize> {
        match self.open() {
            Some(Guard::Sync { barrier }) => Some(barrier),
            _ => None,
        }
    }

    fn delay(&self) -> Option<Duration> {
        match self.open() {
            Some(Guard::After(micros)) => Some(Duration::from_micros(micros.into())),
            _ => None,
        }
    }

    /// Where `send_from` takes its value.
    fn slot(&self) -> Option<Value> {
        self.sends(Form::From).map(|(_, value)| value)
    }

    fn make(&self, value: Value) -> impl FnOnce() -> Value + Send + 'static {
        let made = self.made.clone();
        move || {
            made.fetch_add(1, Ordering::Relaxed);
            value
        }
    }

    fn keeps_its_value(&self, result: Result<(), SendError<()>>) -> Outcome {
        match result {
            Ok(()) => Outcome::Sent(self.place),
            Err(error) => Outcome::Failed(self.place, failure(error.is_poisoned())),
        }
    }

    /// A value is taken out of its slot, and made, by its own communication and by no other.
    fn checked(&self, slot: Option<Value>, outcome: Outcome) -> Outcome {
        let is_sent = outcome == Outcome::Sent(self.place);
        if self.sends(Form::From).is_some() && slot != self.slot().filter(|_| !is_sent) {
            return Outcome::Broken("the slot of `send_from` is not as it should be");
        }
        let made = self.sends(Form::With).is_some() && is_sent;
        if self.made.load(Ordering::Relaxed) != u32::from(made) {
            return Outcome::Broken("`send_with` made a value that is not sent, or none that is");
        }
        outcome
    }
}

/// All the guards that three positions may offer, in their order; then `skip`, if it is given.
macro_rules! choice {
    ($construct:ident, $ends:ident, $first:ident $first_slot:ident, $second:ident $second_slot:ident, $third:ident $third_slot:ident $(, $skip:expr)?) => {
        choice!(@ $construct, $ends, [$first $first_slot $second $second_slot $third $third_slot] [] $($skip)?)
    };
    (@ $construct:ident, $ends:ident, [$position:ident $slot:ident $($rest:ident)*] [$($guards:tt)*] $($skip:expr)?) => {
        choice!(@ $construct, $ends, [$($rest)*] [
            $($guards)*
            result = $ends.receiver($position.receives().unwrap()).recv(), if $position.receives().is_some() =>
                received($position.place, result),
            result = $ends.sender($position.sends(Form::Given).unwrap().0).send($position.sends(Form::Given).unwrap().1),
                if $position.sends(Form::Given).is_some() =>
                sent($position.place, $position.sends(Form::Given).unwrap().1, result),
            result = $ends.sender($position.sends(Form::From).unwrap().0).send_from(&mut $slot),
                if $position.sends(Form::From).is_some() =>
                $position.keeps_its_value(result),
            result = $ends.sender($position.sends(Form::With).unwrap().0).send_with($position.make($position.sends(Form::With).unwrap().1)),
                if $position.sends(Form::With).is_some() =>
                $position.keeps_its_value(result),
            () = $ends.barrier($position.syncs().unwrap()).sync(), if $position.syncs().is_some() =>
                Outcome::Synced($position.place),
            () = luna::after($position.delay().unwrap()), if $position.delay().is_some() =>
                Outcome::Expired($position.place),
        ] $($skip)?)
    };
    (@ $construct:ident, $ends:ident, [] [$($guards:tt)*]) => { $construct! { $($guards)* } };
    (@ $construct:ident, $ends:ident, [] [$($guards:tt)*] $skip:expr) => { $construct! { $($guards)* skip => { $skip } } };
}

/// Does the alternative.
pub(crate) async fn alternative(ends: &Ends, fair: bool, offers: &[Offer], skip: bool) -> Outcome {
    let received_from = |offer: &Offer| match offer.guard {
        Guard::Recv { channel } if offer.open => Some(channel),
        _ => None,
    };
    if let [first, second] = offers
        && let (Some(first), Some(second)) = (received_from(first), received_from(second))
        && !skip
    {
        return choose_input(ends, fair, first, second).await;
    }
    choose(ends, fair, offers, skip).await
}

async fn choose(ends: &Ends, fair: bool, offers: &[Offer], skip: bool) -> Outcome {
    let [first, second, third] = [0, 1, 2].map(|place| Position::new(offers, place));
    let [mut a, mut b, mut c] = [first.slot(), second.slot(), third.slot()];
    let outcome = match (fair, skip) {
        (true, false) => choice!(alt, ends, first a, second b, third c),
        (false, false) => choice!(pri_alt, ends, first a, second b, third c),
        (true, true) => choice!(alt, ends, first a, second b, third c, Outcome::Skipped),
        (false, true) => choice!(pri_alt, ends, first a, second b, third c, Outcome::Skipped),
    };
    let positions = [(&first, a), (&second, b), (&third, c)];
    positions
        .into_iter()
        .fold(outcome, |outcome, (position, slot)| match outcome {
            Outcome::Broken(_) => outcome,
            _ => position.checked(slot, outcome),
        })
}

/// Two channels received from without preconditions, as most alternatives are.
async fn choose_input(ends: &Ends, fair: bool, first: usize, second: usize) -> Outcome {
    let (first, second) = (ends.receiver(first), ends.receiver(second));
    if fair {
        alt! {
            result = first.recv() => received(0, result),
            result = second.recv() => received(1, result),
        }
    } else {
        pri_alt! {
            result = first.recv() => received(0, result),
            result = second.recv() => received(1, result),
        }
    }
}
