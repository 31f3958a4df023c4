//! Counts what was seen, by kind: shows that the networks do what is to be proven.

use crate::operational::network::{
    Entry, Event, Failure, Form, Guard, Network, Outcome, Patience, Step,
};
use std::collections::BTreeMap;

#[derive(Debug, Default)]
pub(crate) struct Tally(BTreeMap<String, u32>);

impl Tally {
    pub(crate) fn count(&mut self, network: &Network, trace: &[Entry]) {
        let mut current = vec![0; network.agents.len()];
        for entry in trace {
            match entry.event {
                Event::Begins(step) => current[entry.agent] = usize::from(step),
                Event::Ends(outcome) => {
                    let step = &network.agents[entry.agent].steps[current[entry.agent]];
                    let kind = format!("{}: {}", kind(step, outcome), result(outcome));
                    *self.0.entry(kind).or_default() += 1;
                }
                Event::Waits | Event::Leaves => {}
            }
        }
    }

    /// Panics unless all of this has been seen.
    pub(crate) fn assert_complete(&self) {
        let mut expected = Vec::new();
        for construct in ["alt", "pri_alt"] {
            for result in ["sent", "closed", "poisoned"] {
                for form in ["send", "send_from", "send_with"] {
                    expected.push(format!("{construct} {form}: {result}"));
                }
            }
            for result in ["received", "closed", "poisoned"] {
                expected.push(format!("{construct} recv: {result}"));
            }
            expected.push(format!("{construct} sync: done"));
            expected.push(format!("{construct}: expired"));
            expected.push(format!("{construct}: skipped"));
        }
        for (patience, other) in [
            ("", ""),
            ("try ", "skipped"),
            ("timeout ", "expired"),
            ("dropped ", "expired"),
        ] {
            expected.push(format!("{patience}send: sent"));
            expected.push(format!("{patience}recv: received"));
            if !other.is_empty() {
                expected.push(format!("{patience}send: {other}"));
                expected.push(format!("{patience}recv: {other}"));
            }
        }
        for kind in [
            "send_from: sent",
            "send_with: sent",
            "par: done",
            "par: failed",
            "poison: done",
            "drop: done",
            "fair Alternative: received",
            "fair Alternative: closed",
            "fair Alternative: poisoned",
            "prioritized Alternative: received",
            "prioritized Alternative: closed",
            "prioritized Alternative: poisoned",
            "sync: done",
            "fail: failed",
            "pri_alt dropped: expired",
        ] {
            expected.push(kind.to_owned());
        }
        expected.retain(|kind| !self.0.contains_key(kind));
        assert!(
            expected.is_empty(),
            "never seen: {expected:?}, but {self:?}"
        );
    }
}

fn kind(step: &Step, outcome: Outcome) -> String {
    match step {
        Step::Plain(guard, patience) => {
            let patience = match patience {
                Patience::Forever => "",
                Patience::Timeout(_) => "timeout ",
                Patience::Dropped(_) => "dropped ",
                Patience::Try => "try ",
            };
            // Only a send that waits for ever has a choice of form.
            let form = match patience {
                "" => operation(*guard),
                _ if matches!(guard, Guard::Recv { .. }) => "recv",
                _ => "send",
            };
            format!("{patience}{form}")
        }
        Step::Alternative { fair, offers, .. } => {
            let construct = if *fair { "alt" } else { "pri_alt" };
            match outcome {
                Outcome::Sent(place)
                | Outcome::Received(place, _)
                | Outcome::Failed(place, _)
                | Outcome::Synced(place) => {
                    format!(
                        "{construct} {}",
                        operation(offers[usize::from(place)].guard)
                    )
                }
                Outcome::Expired(place) if usize::from(place) == offers.len() => {
                    format!("{construct} dropped")
                }
                _ => construct.to_owned(),
            }
        }
        Step::Registered { fair: true, .. } => "fair Alternative".to_owned(),
        Step::Registered { fair: false, .. } => "prioritized Alternative".to_owned(),
        Step::Poison(_) => "poison".to_owned(),
        Step::Drop(_) => "drop".to_owned(),
        Step::Sync(_) => "sync".to_owned(),
        Step::Par(_) => "par".to_owned(),
        Step::Fail => "fail".to_owned(),
        Step::Yield => "yield".to_owned(),
    }
}

fn operation(guard: Guard) -> &'static str {
    match guard {
        Guard::Send {
            form: Form::Given, ..
        } => "send",
        Guard::Send {
            form: Form::From, ..
        } => "send_from",
        Guard::Send {
            form: Form::With, ..
        } => "send_with",
        Guard::Recv { .. } => "recv",
        Guard::Sync { .. } => "sync",
        Guard::After(_) => "after",
    }
}

fn result(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Sent(_) => "sent",
        Outcome::Received(..) => "received",
        Outcome::Failed(_, Failure::Closed) => "closed",
        Outcome::Failed(_, Failure::Poisoned) => "poisoned",
        Outcome::Failed(_, Failure::Own) => "failed",
        Outcome::Expired(_) => "expired",
        Outcome::Skipped => "skipped",
        Outcome::Done | Outcome::Synced(_) | Outcome::Joined { failed: false } => "done",
        Outcome::Joined { failed: true } => "failed",
        Outcome::Broken(_) => "broken",
    }
}
