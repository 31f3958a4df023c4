//! The properties of `check.always`.
//!
//! A property has an event, with a field for each variable and each action that it names. The
//! processes that it names take part in it: one that waits or has ended offers the event with its
//! own fields as they are, and stays where it is. So the fields of the event are what is the case
//! in one state of the model. The property holds if no such event has values for which it is false.
//!
//! A process with `par` cannot offer it: while its branches begin and end by some events, it is in
//! none of the model's states.

use super::arithmetic::{Terms, number};
use super::{Writer, comment};
use crate::language::expr::Expr;
use crate::network::{Atom, Network};
use std::fmt::Write;

/// A property with more combinations of values is not exported: FDR would list them.
const MAX_EVENTS: i64 = 10_000;

/// What a property names, a field of its event.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) agent: usize,
    pub(super) of: Seen,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seen {
    Variable(usize),
    /// Whether the agent is at one of these places.
    At(Vec<usize>),
}

/// A property, named by the numbers of its fields.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) fields: Vec<Field>,
    ranges: Vec<(i64, i64)>,
    holds: Expr<usize>,
}

impl Property {
    /// Why it is not exported, if it is not.
    pub(super) fn of(network: &Network, property: &Expr<Atom>) -> Result<Self, &'static str> {
        let (mut fields, mut ranges) = (Vec::new(), Vec::new());
        let mut name = |atom: &Atom| {
            let (process, of, range) = match atom {
                Atom::Variable(slot) => {
                    let found = &network.variables[*slot];
                    let range = (found.low.into(), found.high.into());
                    (found.process, Seen::Variable(*slot), range)
                }
                Atom::At(all) => {
                    let places = all.iter().map(|(_, place)| *place).collect();
                    let process = network.agents[all[0].0].process;
                    (process, Seen::At(places), (0, 1))
                }
            };
            let mut agents = network.agents.iter();
            if agents.any(|agent| agent.process == process && agent.parent.is_some()) {
                return Err("it names a process with `par`");
            }
            let agent = network.processes[process].agent;
            let field = Field { agent, of };
            let known = fields.iter().position(|known| *known == field);
            Ok(Expr::Name(known.unwrap_or_else(|| {
                fields.push(field);
                ranges.push(range);
                fields.len() - 1
            })))
        };
        let holds = property.map(&mut name)?;
        let sizes = ranges.iter().map(|(low, high)| high - low + 1);
        let events = sizes.fold(1_i64, i64::saturating_mul);
        let terms = Terms {
            names: &[],
            ranges: &ranges,
        };
        if fields.is_empty() {
            return Err("it names no process");
        }
        if events > MAX_EVENTS {
            return Err("what it names has more than 10 000 combinations of values");
        }
        if terms.range(&holds).is_none() {
            return Err("it may compute a number beyond 32 bits");
        }
        Ok(Self {
            fields,
            ranges,
            holds,
        })
    }

    fn is_of(&self, agent: usize) -> bool {
        self.fields.iter().any(|field| field.agent == agent)
    }
}

/// The names of what a property becomes.
#[derive(Debug)]
pub(super) struct PropertyNames {
    pub(super) channel: String,
    /// The set of its events that must not happen.
    pub(super) wrong: String,
    pub(super) fields: Vec<String>,
}

impl Writer<'_> {
    /// The properties that are exported, with their titles and names.
    fn exported(&self) -> impl Iterator<Item = (&str, &Property, &PropertyNames)> {
        let all = self.network.always.iter().zip(&self.properties);
        let all = all.zip(&self.names.properties);
        all.filter_map(|(((title, _), property), names)| {
            Some((title.as_str(), property.as_ref().ok()?, names))
        })
    }

    pub(super) fn has_properties(&self) -> bool {
        self.exported().next().is_some()
    }

    /// Whether an agent takes part in events of properties.
    pub(super) fn is_observed(&self, agent: usize) -> bool {
        self.exported()
            .any(|(_, property, _)| property.is_of(agent))
    }

    /// The channels of the properties in which an agent takes part.
    pub(super) fn observing(&self, agent: usize) -> Vec<String> {
        let all = self.exported();
        let its = all.filter(|(_, property, _)| property.is_of(agent));
        its.map(|(_, _, names)| names.channel.clone()).collect()
    }

    /// The events of properties that an agent offers at a place; after them it goes on as `here`.
    pub(super) fn observations(&self, agent: usize, place: usize, here: &str) -> Vec<String> {
        let used = self.network.uses(agent).0;
        let value = |field: &Field| match &field.of {
            _ if field.agent != agent => "?_".to_owned(),
            Seen::Variable(slot) if used.contains(slot) => {
                format!("!{}", self.names.variables[*slot])
            }
            Seen::Variable(slot) => format!("!{}", number(self.network.variables[*slot].first)),
            Seen::At(places) => format!("!{}", i32::from(places.contains(&place))),
        };
        let all = self.exported();
        let its = all.filter(|(_, property, _)| property.is_of(agent));
        its.map(|(_, property, names)| {
            let fields: String = property.fields.iter().map(value).collect();
            format!("({}{fields} -> {here})", names.channel)
        })
        .collect()
    }

    pub(super) fn property_channels(&self, text: &mut String) {
        if !self.has_properties() {
            return;
        }
        text.push_str("\n-- Properties that hold always: their variables, and whether a process is about to act\n");
        for (title, property, names) in self.exported() {
            let ranges = property.ranges.iter();
            let fields: Vec<String> = ranges.map(|range| set(*range)).collect();
            let _ = writeln!(
                text,
                "channel {} : {} -- {}",
                names.channel,
                fields.join("."),
                comment(title)
            );
        }
    }

    /// The system, in which the events of properties do not happen.
    pub(super) fn composition(&self, text: &mut String) {
        let whole = "|| i : Agent @ [A(i)] P(i)";
        if !self.has_properties() {
            let _ = writeln!(text, "System = {whole}");
            return;
        }
        let channels: Vec<&str> = self
            .exported()
            .map(|(_, _, names)| names.channel.as_str())
            .collect();
        let _ = writeln!(
            text,
            "Observed = {whole}\n\
             Observations = {{| {} |}}\n\
             System = Observed [| Observations |] STOP",
            channels.join(", ")
        );
    }

    pub(super) fn property_assertions(&self, text: &mut String) {
        for (title, property, names) in self.exported() {
            let terms = Terms {
                names: &names.fields,
                ranges: &property.ranges,
            };
            // A property that has no value does not hold.
            let holds = terms.condition(&property.holds);
            let faults = terms.faults(&property.holds);
            let holds = faults.iter().rev().fold(holds, |holds, fault| {
                format!("(if {fault} then false else {holds})")
            });
            let from = names.fields.iter().zip(&property.ranges);
            let from = from.map(|(name, range)| format!("{name} <- {}", set(*range)));
            let _ = writeln!(
                text,
                "-- Always: {title}\n\
                 {wrong} = {{{channel}.{fields} | {from}, not {holds}}}\n\
                 assert STOP [T= Observed \\ diff(Events, {wrong})",
                title = comment(title),
                wrong = names.wrong,
                channel = names.channel,
                fields = names.fields.join("."),
                from = from.collect::<Vec<_>>().join(", "),
            );
        }
        for ((title, _), property) in self.network.always.iter().zip(&self.properties) {
            if let Err(why) = property {
                let title = comment(title);
                let _ = writeln!(text, "-- Not exported: check.always, {title}: {why}");
            }
        }
        for (title, _) in &self.network.ltl {
            let title = comment(title);
            let _ = writeln!(text, "-- Not exported: check.ltl, {title}: SPIN checks it");
        }
    }
}

/// All values of a range.
fn set((low, high): (i64, i64)) -> String {
    let [low, high] = [low, high].map(|end| number(end as i32));
    format!("{{{low}..{high}}}")
}
