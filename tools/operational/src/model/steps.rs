//! Internal steps: what happens between what agents do by themselves.

use super::{Phase, State, before_step};
use crate::network::{Chosen, Failure, Guard, Network, Outcome, Patience, Step};

impl State {
    /// All states that one internal step leads to. Empty only if no agent can go on without a step
    /// of its own.
    pub fn internal(&self, network: &Network, next: &mut Vec<State>) {
        for number in 0..self.agents.len() {
            let status = &self.agents[number];
            if let Some((channel, failure)) = status.ending {
                next.push(
                    self.changed(|after| after.notify_one(network, number, channel, failure)),
                );
                continue;
            }
            match status.phase {
                Phase::Begun => self.try_step(network, number, next),
                Phase::Opening => next.push(self.waiting(network, number)),
                Phase::Waiting => self.stop_waiting(network, number, next),
                Phase::Settled(outcome) if self.may_withdraw(network, number) => {
                    next.push(self.changed(|after| after.give_back(network, number, outcome)));
                }
                Phase::Leaving {
                    next: place,
                    failed,
                } => {
                    let ends = self.ends_to_drop(network, number);
                    if let Some(&end) = ends.get(usize::from(place)) {
                        next.push(self.changed(|after| {
                            after.agents[number].phase = Phase::Leaving {
                                next: place + 1,
                                failed,
                            };
                            after.drop_end(number, end);
                        }));
                    }
                }
                _ => {}
            }
        }
    }

    /// Lets a leaving agent drop an end of a channel that no agent will use any more, so that no
    /// agent can see the drop. `uses` lists for each channel its users, and the last step of each.
    pub fn drop_unseen(&mut self, network: &Network, uses: &[Vec<(usize, u8)>]) -> bool {
        for number in 0..self.agents.len() {
            let Phase::Leaving { next, failed } = self.agents[number].phase else {
                continue;
            };
            let ends = self.ends_to_drop(network, number);
            let Some(&end) = ends.get(usize::from(next)) else {
                continue;
            };
            let is_used = |&(user, last): &(usize, u8)| {
                let status = &self.agents[user];
                let is_over = matches!(status.phase, Phase::Leaving { .. } | Phase::Left { .. });
                !is_over && status.step <= last
            };
            if self.agents[number].ending.is_none() && !uses[end.channel].iter().any(is_used) {
                self.agents[number].phase = Phase::Leaving {
                    next: next + 1,
                    failed,
                };
                self.drop_end(number, end);
                return true;
            }
        }
        false
    }

    fn try_step(&self, network: &Network, number: usize, next: &mut Vec<State>) {
        let status = &self.agents[number];
        let step = &network.agents[number].steps[usize::from(status.step)];
        if let Some(place) = step.dropped_at() {
            // Before it is tried.
            next.push(self.settled(number, Outcome::Expired(place)));
        }
        match step {
            Step::Plain(guard, patience) => {
                // A sibling's failure is asked after by those operations that may wait.
                if *patience != Patience::Try && self.is_marked(network, number) {
                    next.push(self.settled(number, Outcome::Failed(0, Failure::Poisoned)));
                } else if self.is_ready(network, *guard) {
                    next.push(self.changed(|after| after.take(network, number, 0, *guard)));
                } else if *patience == Patience::Try {
                    next.push(self.settled(number, Outcome::Skipped));
                } else {
                    // A timeout may fire as soon as it waits.
                    next.push(self.waiting(network, number));
                }
            }
            Step::Alternative { fair, skip, .. } => {
                self.try_alternative(network, number, *fair, *skip, next)
            }
            Step::Registered { fair, .. } => self.try_registered(network, number, *fair, next),
            Step::Poison(end) => next.push(self.changed(|after| {
                after.agents[number].phase = Phase::Settled(Outcome::Done);
                after.end(number, end.channel, Failure::Poisoned);
            })),
            Step::Drop(end) => next.push(self.changed(|after| {
                after.agents[number].phase = Phase::Settled(Outcome::Done);
                after.drop_end(number, *end);
            })),
            Step::Sync(barrier) => {
                let guard = Guard::Sync { barrier: *barrier };
                if self.is_marked(network, number) {
                    self.fail_marked(network, number, next);
                } else if self.is_ready(network, guard) {
                    next.push(self.changed(|after| after.take(network, number, 0, guard)));
                } else {
                    next.push(self.waiting(network, number));
                }
            }
            Step::Par(branches) => next.push(self.changed(|after| {
                after.agents[number].phase = Phase::Waiting;
                for &branch in branches {
                    let status = &mut after.agents[branch];
                    (status.step, status.phase) = before_step(&network.agents[branch], 0);
                }
            })),
            Step::Fail => next.push(self.settled(number, Outcome::Failed(0, Failure::Own))),
            Step::Yield => unreachable!("it is left out"),
        }
    }

    fn try_alternative(
        &self,
        network: &Network,
        number: usize,
        fair: bool,
        skip: bool,
        next: &mut Vec<State>,
    ) {
        // With `skip`, what has no error to give is not waited for.
        let guards = self.open_guards(network, number);
        let may_fail = !skip || guards.iter().any(|(_, guard)| guard.end().is_some());
        if may_fail && self.is_marked(network, number) && self.fail_marked(network, number, next) {
            return;
        }
        let mut guards = self.open_guards(network, number);
        if fair {
            // The least recently chosen first.
            let chosen = &self.agents[number].chosen;
            let stamp = |guard: Guard| chosen.iter().position(|&past| Some(past) == guard.memory());
            guards.sort_by_key(|&(_, guard)| stamp(guard));
        }
        for (place, guard) in guards {
            if let Guard::After(_) = guard {
                // It may have expired already, or not.
                next.push(self.settled(number, Outcome::Expired(place)));
            } else if self.is_ready(network, guard) {
                next.push(self.changed(|after| after.take(network, number, place, guard)));
                return;
            }
        }
        next.push(if skip {
            self.settled(number, Outcome::Skipped)
        } else {
            self.waiting(network, number)
        });
    }

    /// Not one instant as a whole: it looks, then becomes visible to partners, then checks whether
    /// something came in between.
    fn try_registered(&self, network: &Network, number: usize, fair: bool, next: &mut Vec<State>) {
        if self.is_marked(network, number) && self.fail_marked(network, number, next) {
            return;
        }
        let mut guards = self.open_guards(network, number);
        if fair {
            let chosen = &self.agents[number].chosen;
            guards.sort_by_key(|&(_, guard)| {
                let input = guard.end().map(|end| Chosen::Input(end.channel));
                chosen.iter().position(|&past| Some(past) == input)
            });
        }
        let ready = guards
            .iter()
            .find(|(_, guard)| self.is_ready(network, *guard));
        next.push(self.changed(|after| match ready {
            Some(&(place, guard)) => after.take(network, number, place, guard),
            None => after.agents[number].phase = Phase::Opening,
        }));
    }

    fn stop_waiting(&self, network: &Network, number: usize, next: &mut Vec<State>) {
        let status = &self.agents[number];
        let step = &network.agents[number].steps[usize::from(status.step)];
        match step {
            Step::Par(branches) => {
                let mut failed = false;
                for &branch in branches {
                    match self.agents[branch].phase {
                        Phase::Left { failed: true } => failed = true,
                        Phase::Left { failed: false } => {}
                        _ => return,
                    }
                }
                next.push(self.settled(number, Outcome::Joined { failed }));
                return;
            }
            Step::Registered { .. } => {
                let guards = self.open_guards(network, number);
                if guards
                    .iter()
                    .any(|(_, guard)| self.is_ready(network, *guard))
                {
                    next.push(self.changed(|after| after.look_again(number)));
                }
            }
            Step::Plain(_, Patience::Timeout(_)) => {
                next.push(self.changed(|after| after.settle(number, Outcome::Expired(1))));
            }
            _ => {}
        }
        if let Some(place) = step.dropped_at() {
            next.push(self.changed(|after| after.settle(number, Outcome::Expired(place))));
        }
        for (place, guard) in self.open_guards(network, number) {
            if let Guard::After(_) = guard {
                next.push(self.changed(|after| after.settle(number, Outcome::Expired(place))));
                // From the instant itself on, the guards that it is preferred to can no longer be
                // taken. The agent learns later that it has passed.
                let fair = matches!(step, Step::Alternative { fair: true, .. });
                next.push(self.changed(|after| {
                    after.withdraw(number, |guard| fair || guard > place);
                }));
            }
        }
        if self.is_marked(network, number) {
            self.fail_marked(network, number, next);
        }
    }

    /// A sibling has failed: the first communication that this agent offers fails as poisoned. If
    /// it only offers to come to barriers, which cannot fail, or has stopped, it is dropped where
    /// it waits. Returns whether one of both was the case.
    fn fail_marked(&self, network: &Network, number: usize, next: &mut Vec<State>) -> bool {
        let guards = self.open_guards(network, number);
        let fails = guards.iter().find(|(_, guard)| guard.end().is_some());
        let syncs = |(_, guard): &(u8, Guard)| matches!(guard, Guard::Sync { .. });
        if let Some(&(place, _)) = fails {
            let outcome = Outcome::Failed(place, Failure::Poisoned);
            next.push(self.changed(|after| after.settle(number, outcome)));
        } else if guards.is_empty() || guards.iter().any(syncs) {
            next.push(self.changed(|after| {
                after.settle(number, Outcome::Done);
                after.agents[number].phase = Phase::Leaving {
                    next: 0,
                    failed: true,
                };
            }));
        } else {
            return false;
        }
        true
    }

    /// Whether a sibling of the agent, or of one that it is part of, has failed.
    fn is_marked(&self, network: &Network, mut number: usize) -> bool {
        while let Some(parent) = network.agents[number].parent {
            let step = usize::from(self.agents[parent].step);
            if let Step::Par(branches) = &network.agents[parent].steps[step]
                && branches
                    .iter()
                    .any(|&branch| self.agents[branch].phase == Phase::Left { failed: true })
            {
                return true;
            }
            number = parent;
        }
        false
    }
}
