//! An alternative of a process with a replay log.

use super::{Choice, State};
use crate::alternative::offer::Offer;
use crate::replay::{self, Logged, Stage};
use core::task::{Context, Poll};
use luna_core::current;
use luna_core::replay_log::{Event, Turn, What};

/// A replayed one looks at the recorded guard alone.
impl Logged for Choice<'_, '_> {
    type Output = u32;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.state {
            State::New | State::Listed => Stage::New,
            State::Chosen(_) | State::GaveWay(_) => Stage::GaveWay,
            State::Failed | State::Over => Stage::Over,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        let is_new = self.state == State::New;
        match turn {
            Turn::Look => return replay::differs("an alternative chooses"),
            Turn::Given(event) if event.what == What::Chosen => {
                let choice = u32::try_from(event.number).unwrap_or(u32::MAX);
                self.is_plain = false; // A closed offer is not.
                for (number, offer) in self.offers.iter_mut().enumerate() {
                    if number != choice as usize {
                        offer.close();
                    }
                }
                match self
                    .offers
                    .get(choice as usize)
                    .filter(|offer| offer.is_open())
                {
                    Some(offer) if offer.is_of_time() => self.state = State::Chosen(choice),
                    Some(_) => self.has_skip = false,
                    // The time had come, or none was ready: there is no partner to wait for.
                    None if self.has_skip && choice as usize == self.offers.len() => {
                        self.state = State::Chosen(choice);
                    }
                    None => return replay::differs("an alternative has no such guard"),
                }
            }
            _ => {}
        }
        if is_new {
            let guards = self.offers.iter().filter_map(Offer::guard);
            guards.for_each(|guard| guard.note_logged());
        }
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
        self.poll_in(current::Turn::of(cx))
    }

    unsafe fn success(&self, output: Option<&u32>, own: u64) -> Event {
        let chosen = match (output, self.state) {
            (Some(number), _) => *number,
            (None, State::Chosen(number) | State::GaveWay(number)) => number,
            (None, _) => unreachable!("no guard was chosen"),
        };
        let guard = self.offers.get(chosen as usize).and_then(Offer::guard);
        let stamp = replay::stamp(guard.map_or(0, |guard| guard.order()), own);
        Event::new(What::Chosen, u64::from(chosen), stamp)
    }

    fn keep(&mut self, number: u32) {
        self.state = State::GaveWay(number);
    }
}
