//! CSPm, the input language of FDR.
//!
//! The text is a network of sequential processes under one replicated alphabetised parallel,
//! `|| i : Agent @ [A(i)] P(i)`: one for each body, one for each branch of `par`, one for each
//! buffer. The network is static, so FDR compiles each process by itself.
//!
//! - A place of a body is a definition, with the variables that the body uses as its parameters.
//! - A wait is an external choice. `choose` and `skip` are events `choose.process.line` of the
//!   process alone, not `|~|`: so a counterexample names the branch, and a loop of choices is
//!   guarded. They are hidden for the question of divergence, which makes them internal choices.
//!   `after` and actions are events that stay visible: what waits for a time does not diverge.
//! - A rendezvous is `channel.sender.receiver.value`, and in the alphabets of these two only; a
//!   sender, receiver or value that there is but one of is left out. A buffer is a process of its
//!   own, with events `channel_put` and `channel_get`.
//! - A branch of `par` waits for `start`, gets the variables that it uses by `give` events, and at
//!   its end gives back by `take` events those that it has set. One event for each variable: an
//!   event with all of them would have the product of their ranges. Until the branch has ended it
//!   is the only one that uses what it sets, so nothing sees that this takes several steps.
//! - A process that has ended does `ends`, and offers `channel_no_sender.process` and
//!   `channel_no_receiver.process` for ever. Such an event needs all processes on the other side,
//!   and the buffer, so it happens when all have ended and the buffer is empty. A branch that has
//!   failed offers `called_off` to the branches beside it.
//! - When all processes have ended, they do `over` for ever. So what has ended is no deadlock, and
//!   nothing depends on how a check treats `SKIP`.
//! - What breaks an assertion does `broken.process.line` for ever. It is no deadlock.
//! - A property of `check.always` is an event of its own: see [`always`].
//! - A circle of steps without a wait has an event `step`, hidden where divergence is asked for.
//!
//! Numbers of a model have 32 bits, and those of FDR have no overflow that could be seen. So an
//! expression is exported only if the ranges of its variables show that it stays within 32 bits.

mod agent;
mod alphabets;
mod always;
mod arithmetic;
mod buffer;
mod names;
mod wait;

use crate::network::Network;
use crate::spin::ending::Ending;
use alphabets::Alphabets;
use always::Property;
use names::Names;
use std::fmt::Write;

/// A model that cannot be exported to CSPm without changing its meaning.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {process} {reason}; {advice}")]
pub struct CspmError {
    /// In the file, from 1.
    pub line: usize,
    /// The process, with the parts that it is in.
    pub process: Box<str>,
    /// What cannot be exported.
    pub reason: Box<str>,
    /// What to do.
    pub advice: Box<str>,
}

/// The network in CSPm.
pub(crate) fn cspm(network: &Network) -> Result<String, CspmError> {
    let ending = Ending::of(network);
    let alphabets = Alphabets::of(network, &ending);
    let always = network.always.iter();
    let properties: Vec<_> = always
        .map(|(_, property)| Property::of(network, property))
        .collect();
    let variables = network.variables.iter();
    let mut writer = Writer {
        network,
        names: Names::of(network, &alphabets, &properties),
        ranges: variables
            .map(|variable| (variable.low.into(), variable.high.into()))
            .collect(),
        properties,
        ending,
        alphabets,
        text: String::new(),
    };
    for agent in 0..network.agents.len() {
        writer.agent(agent)?;
    }
    for channel in 0..network.channels.len() {
        writer.buffer(channel);
    }
    Ok(writer.whole())
}

struct Writer<'a> {
    network: &'a Network,
    ending: Ending,
    alphabets: Alphabets,
    names: Names,
    /// Of the variables.
    ranges: Vec<arithmetic::Range>,
    /// Of `check.always`: each as it is exported, or why it is not.
    properties: Vec<Result<Property, &'static str>>,
    text: String,
}

impl Writer<'_> {
    /// All of the file: the processes are written by now, so what they use is known.
    fn whole(mut self) -> String {
        let processes = std::mem::take(&mut self.text);
        let mut text = format!(
            "-- {}, from a model of LUNA\n\n",
            comment(&self.network.name)
        );
        text.push_str("-- The processes, the branches of `par` in them, and the buffers\n");
        let agents = self.alphabets.components(self.network);
        let names: Vec<&str> = agents
            .iter()
            .map(|one| self.names.component(*one))
            .collect();
        let _ = writeln!(text, "datatype Agent = {}\n", names.join(" | "));
        self.channels(&mut text);
        self.property_channels(&mut text);
        text.push_str("\n-- What breaks an assertion, or leaves a range\n");
        text.push_str("BROKEN(a, line) = broken.a.line -> BROKEN(a, line)\n");
        self.helpers(&processes, &mut text);
        text.push_str(&processes);
        text.push_str("\n-- The system: what is in two alphabets is done by both\n");
        for component in &agents {
            let events = self.alphabet(*component);
            let name = self.names.component(*component);
            let _ = writeln!(text, "A({name}) = {{| {} |}}", events.join(", "));
        }
        for component in &agents {
            let (name, start) = (self.names.component(*component), self.start(*component));
            let _ = writeln!(text, "P({name}) = {start}");
        }
        self.composition(&mut text);
        self.assertions(&mut text);
        text
    }

    /// What `/` and `%` do with numbers below 0: as in Rust, towards 0.
    fn helpers(&self, processes: &str, text: &mut String) {
        if processes.contains("quotient(") || processes.contains("remainder(") {
            text.push_str("\n-- Division that rounds towards 0\n");
            text.push_str(concat!(
                "quotient(a, b) = if a >= 0 then (if b > 0 then a / b else (-(a / (-b))))",
                " else (if b > 0 then (-((-a) / b)) else (-a) / (-b))\n",
                "remainder(a, b) = a - (b * quotient(a, b))\n"
            ));
        }
        if processes.contains("without_newest(") {
            text.push_str("\n-- A buffer that loses its newest value\n");
            text.push_str(concat!(
                "without_newest(q) = if #q == 1 then <> else ",
                "<head(q)> ^ without_newest(tail(q))\n"
            ));
        }
    }

    fn assertions(&self, text: &mut String) {
        let silent = self.silent();
        let _ = writeln!(
            text,
            "\n-- What is neither a communication, nor an action, nor time that passes\n\
             Silent = {{| {} |}}",
            silent.join(", ")
        );
        text.push_str(concat!(
            "\n-- No assertion is broken. If one is, what the others say of the runs after it ",
            "counts for nothing\n",
            "assert STOP [T= System \\ diff(Events, {| broken |})\n",
            "-- No deadlock\n",
            "assert System :[deadlock free [F]]\n",
            "-- No livelock\n",
            "assert System \\ Silent :[divergence free]\n"
        ));
        self.property_assertions(text);
    }
}

/// The lines at which something may be told.
fn lines(network: &Network) -> Vec<String> {
    let mut lines = std::collections::BTreeSet::from([0]);
    for place in network.agents.iter().flat_map(|agent| &agent.code) {
        lines.insert(place.line);
        lines.extend(place.step.edges().iter().map(|edge| edge.line));
    }
    lines.iter().map(usize::to_string).collect()
}

/// A comment goes to the end of its line.
fn comment(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
