//! The places of a body, each a definition.

use super::alphabets::Component;
use super::arithmetic::number;
use super::{CspmError, Writer};
use crate::file::Side;
use crate::network::{Agent, END, Step};
use std::fmt::Write;

impl Writer<'_> {
    /// Writes the definitions of an agent.
    pub(super) fn agent(&mut self, agent: usize) -> Result<(), CspmError> {
        let found = &self.network.agents[agent];
        let _ = writeln!(self.text, "\n-- {}", super::comment(&found.name));
        for at in 0..found.code.len() {
            if !self.alphabets.reached[agent][at] {
                continue;
            }
            let text = self.place(agent, at)?;
            let place = self.call(agent, at);
            let line = found.code[at].line;
            let comment = if at == END {
                String::new()
            } else {
                format!(" -- line {line}")
            };
            let _ = writeln!(self.text, "{place} ={comment}\n  {text}");
        }
        match found.parent {
            Some(_) => self.branch(agent),
            None => self.ended(agent),
        }
        Ok(())
    }

    /// How an agent begins.
    pub(super) fn start(&self, component: Component) -> String {
        match component {
            Component::Buffer(channel) => self.empty_buffer(channel),
            Component::Agent(agent) => {
                let found = &self.network.agents[agent];
                if found.parent.is_some() {
                    return self.names.idle[agent].clone();
                }
                let slots = self.slots(agent);
                let first = slots
                    .iter()
                    .map(|&slot| number(self.network.variables[slot].first));
                self.call_with(&self.names.places[agent][found.start], first.collect())
            }
        }
    }

    /// The variables that are the parameters of an agent's places.
    fn slots(&self, agent: usize) -> Vec<usize> {
        self.network.uses(agent).0.into_iter().collect()
    }

    fn call_with(&self, name: &str, arguments: Vec<String>) -> String {
        match arguments.is_empty() {
            true => name.to_owned(),
            false => format!("{name}({})", arguments.join(", ")),
        }
    }

    /// A place, with the variables as they are.
    pub(super) fn call(&self, agent: usize, at: usize) -> String {
        self.call_with(&self.names.places[agent][at], self.arguments(agent))
    }

    fn arguments(&self, agent: usize) -> Vec<String> {
        let slots = self.slots(agent);
        slots
            .iter()
            .map(|&slot| self.names.variables[slot].clone())
            .collect()
    }

    pub(super) fn broken(&self, agent: usize, line: usize) -> String {
        format!("BROKEN({}, {line})", self.names.agents[agent])
    }

    /// What an agent does that has found a channel closed.
    pub(super) fn fail(&self, agent: usize) -> String {
        match self.network.agents[agent].parent {
            None => self.call(agent, END),
            Some(_) => self.names.over[agent].clone(),
        }
    }

    /// A process that has dropped its ends. For properties it keeps its variables.
    fn over(&self, agent: usize) -> String {
        let name = &self.names.over[agent];
        match self.is_observed(agent) {
            true => self.call_with(name, self.arguments(agent)),
            false => name.clone(),
        }
    }

    /// From a place to the next one, without a wait. A circle of such steps has an event.
    fn go(&self, agent: usize, at: usize, next: usize) -> String {
        self.go_by(agent, at, next, self.call(agent, next))
    }

    /// The same, where `call` is the next place with other values.
    fn go_by(&self, agent: usize, at: usize, next: usize, call: String) -> String {
        match next >= at && is_circle(&self.network.agents[agent], at, next) {
            true => format!("step.{} -> {call}", self.names.agents[agent]),
            false => call,
        }
    }

    /// `then`, if none of these conditions holds; each may have no value if one before it holds.
    pub(super) fn unless(&self, conditions: &[String], broken: &str, then: String) -> String {
        conditions.iter().rev().fold(then, |then, condition| {
            format!("if {condition} then {broken} else (\n  {then})")
        })
    }

    fn place(&mut self, agent: usize, at: usize) -> Result<String, CspmError> {
        let network = self.network;
        let place = &network.agents[agent].code[at];
        let broken = self.broken(agent, place.line);
        Ok(match &place.step {
            Step::End => self.end(agent),
            Step::Goto(next) => self.go(agent, at, *next),
            Step::Assign(slot, value, next) => {
                let range = self.range(agent, place.line, value)?;
                let mut conditions = self.terms().faults(value);
                let variable = &network.variables[*slot];
                conditions.extend(self.terms().outside(
                    value,
                    range,
                    (variable.low, variable.high),
                ));
                let slots = self.slots(agent);
                let arguments = slots.iter().map(|one| match one == slot {
                    true => self.terms().number(value),
                    false => self.names.variables[*one].clone(),
                });
                let name = &self.names.places[agent][*next];
                let call = self.call_with(name, arguments.collect());
                let then = self.go_by(agent, at, *next, call);
                self.unless(&conditions, &broken, then)
            }
            Step::Branch(condition, then, otherwise) => {
                self.range(agent, place.line, condition)?;
                let branches = format!(
                    "if {} then ({}) else ({})",
                    self.terms().condition(condition),
                    self.go(agent, at, *then),
                    self.go(agent, at, *otherwise)
                );
                self.unless(&self.terms().faults(condition), &broken, branches)
            }
            Step::Assert(condition, next) => {
                self.range(agent, place.line, condition)?;
                let mut conditions = self.terms().faults(condition);
                conditions.push(format!("(not {})", self.terms().condition(condition)));
                self.unless(&conditions, &broken, self.go(agent, at, *next))
            }
            Step::Fork(branches, join) => {
                let mut text = String::new();
                for &branch in branches {
                    let _ = write!(text, "start.{} -> ", self.names.agents[branch]);
                    text += &self.hands(true, branch, '!');
                }
                text + &self.call(agent, *join)
            }
            Step::Join(branches, next) => self.join(agent, at, branches, *next),
            Step::Wait(edges) => self.wait(agent, at, edges)?,
        })
    }

    /// The events by which a branch gets its variables, or gives them back: `!` on one side, `?` on
    /// the other.
    fn hands(&self, is_given: bool, branch: usize, sign: char) -> String {
        let mut text = String::new();
        for (&(given, of, slot), name) in &self.names.hands {
            if given == is_given && of == branch {
                let _ = write!(text, "{name}{sign}{} -> ", self.names.variables[slot]);
            }
        }
        text
    }

    /// The place at which an agent ends.
    fn end(&self, agent: usize) -> String {
        let name = &self.names.agents[agent];
        match self.network.agents[agent].parent {
            None => {
                let mut offers = vec![format!("(ends.{name} -> {})", self.over(agent))];
                offers.extend(self.observations(agent, END, &self.call(agent, END)));
                offers.join("\n  [] ")
            }
            Some(_) => {
                let hands = self.hands(false, agent, '!');
                format!("done.{name} -> {hands}{}", self.names.idle[agent])
            }
        }
    }

    /// Waits for the ends of branches, one after the other.
    fn join(&mut self, agent: usize, at: usize, branches: &[usize], next: usize) -> String {
        if !branches.iter().any(|&branch| self.ending.fails[branch]) {
            let ends = branches.iter().map(|&branch| {
                let hands = self.hands(false, branch, '?');
                format!("done.{} -> {hands}", self.names.agents[branch])
            });
            return ends.collect::<String>() + &self.call(agent, next);
        }
        let with = |has_failed: &str| {
            let mut arguments = self.arguments(agent);
            arguments.push(has_failed.to_owned());
            arguments
        };
        let last = format!(
            "(if has_failed then {} else {})",
            self.fail(agent),
            self.call(agent, next)
        );
        let mut text = String::new();
        for (number, &branch) in branches.iter().enumerate() {
            let to = |has_failed: &str| match self.names.joins.get(&(agent, at, number + 1)) {
                Some(name) => self.call_with(name, with(has_failed)),
                None if has_failed == "true" => self.fail(agent),
                None => last.clone(),
            };
            let name = &self.names.joins[&(agent, at, number)];
            let _ = writeln!(
                text,
                "{} =\n  (done.{branch_name} -> {}{})\n  [] (failed.{branch_name} -> {})",
                self.call_with(name, with("has_failed")),
                self.hands(false, branch, '?'),
                to("has_failed"),
                to("true"),
                branch_name = self.names.agents[branch],
            );
        }
        let first = self.call_with(&self.names.joins[&(agent, at, 0)], with("false"));
        self.text += &text;
        first
    }

    /// A branch that does not run, and one that has failed.
    fn branch(&mut self, agent: usize) {
        let (idle, failed) = (&self.names.idle[agent], &self.names.over[agent]);
        let name = &self.names.agents[agent];
        let hands = self.hands(true, agent, '?');
        let start = self.call(agent, self.network.agents[agent].start);
        let _ = writeln!(self.text, "{idle} =\n  start.{name} -> {hands}{start}");
        if !self.ending.fails[agent] {
            return;
        }
        let mut text = format!("{failed} =\n  (failed.{name} -> {failed})");
        let called = self
            .alphabets
            .calls_off
            .iter()
            .filter(|(by, _)| *by == agent);
        for (_, called) in called {
            let called = &self.names.agents[*called];
            let _ = write!(text, "\n  [] (called_off.{name}.{called} -> {failed})");
        }
        let _ = writeln!(self.text, "{text}");
    }

    /// A process that has dropped its ends.
    fn ended(&mut self, agent: usize) {
        let process = self.network.agents[agent].process;
        if !self.ending.processes[process] {
            return;
        }
        let over = self.over(agent);
        let mut offers = Vec::new();
        for (channel, names) in self.names.channels.iter().enumerate() {
            for side in Side::BOTH {
                let name = names.closed(side);
                let is_told = !self.alphabets.closed(channel, side).is_empty();
                if is_told && self.partners(channel, side).contains(&agent) {
                    offers.push(format!("({name}?other -> {over})"));
                }
            }
        }
        if self.may_be_over() {
            offers.push(format!("(over -> {over})"));
        }
        offers.extend(self.observations(agent, END, &over));
        let offers = match offers.is_empty() {
            true => "STOP".to_owned(),
            false => offers.join("\n  [] "),
        };
        let _ = writeln!(self.text, "{over} =\n  {offers}");
    }
}

/// Whether steps without a wait lead from `next` back to `at`.
fn is_circle(agent: &Agent, at: usize, next: usize) -> bool {
    let mut seen = vec![false; agent.code.len()];
    let mut open = vec![next];
    while let Some(here) = open.pop() {
        if here == at {
            return true;
        }
        let step = &agent.code[here].step;
        // These have events of their own.
        let waits = matches!(step, Step::Wait(_) | Step::Fork(..) | Step::Join(..));
        if !waits && !std::mem::replace(&mut seen[here], true) {
            open.extend(step.after());
        }
    }
    false
}
