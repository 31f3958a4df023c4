//! Where a body waits: an external choice.

use super::{CspmError, Writer};
use crate::file::Side;
use crate::network::{Buffering, Edge, Label};

impl Writer<'_> {
    /// Waits at a place for one of these.
    pub(super) fn wait(
        &self,
        agent: usize,
        place: usize,
        edges: &[Edge],
    ) -> Result<String, CspmError> {
        let own = &self.names.agents[agent];
        let line = self.network.agents[agent].code[place].line;
        let mut options = Vec::new();
        for edge in edges {
            let next = self.call(agent, edge.next);
            let mut offers = match &edge.label {
                Label::Send(..) | Label::Receive(..) => self.communication(agent, edge, next),
                Label::Choice | Label::Skip => {
                    vec![format!("choose.{own}.{} -> {next}", edge.line)]
                }
                Label::After => vec![format!("after.{own} -> {next}")],
                Label::Own(name) => vec![format!("{}.{own} -> {next}", self.names.actions[name])],
            };
            if let Some((channel, side)) = edge.label.end() {
                let fail = self.fail(agent);
                if self.alphabets.closed(channel, side).contains(&agent) {
                    let name = self.names.channels[channel].closed(side);
                    offers.push(format!("{name}.{own} -> {fail}"));
                }
                let by = self.alphabets.called_off_by(agent);
                offers
                    .extend(by.iter().map(|&by| {
                        format!("called_off.{}.{own} -> {fail}", self.names.agents[by])
                    }));
            }
            let condition = edge
                .condition
                .as_ref()
                .map(|found| self.terms().condition(found));
            options.extend(offers.into_iter().map(|offer| match &condition {
                None => format!("({offer})"),
                Some(condition) => format!("({condition} & ({offer}))"),
            }));
        }
        options.extend(self.observations(agent, place, &self.call(agent, place)));
        let mut text = match options.is_empty() {
            true => "STOP".to_owned(),
            false => options.join("\n  [] "),
        };
        // What is offered must have a value, and one of the channel's; the first guard first.
        for edge in edges.iter().rev() {
            let at = if edge.line == 0 { line } else { edge.line };
            let broken = self.broken(agent, at);
            if let Label::Send(channel, Some(value)) = &edge.label {
                let range = self.range(agent, at, value)?;
                let mut conditions = self.terms().faults(value);
                if let Some(values) = self.network.channels[*channel].values {
                    conditions.extend(self.terms().outside(value, range, values));
                }
                // A guard with a false precondition is not evaluated.
                if let Some(condition) = &edge.condition {
                    let condition = self.terms().condition(condition);
                    for one in &mut conditions {
                        *one = format!("(if {condition} then {one} else false)");
                    }
                }
                text = self.unless(&conditions, &broken, text);
            }
            if let Some(condition) = &edge.condition {
                self.range(agent, at, condition)?;
                text = self.unless(&self.terms().faults(condition), &broken, text);
            }
        }
        Ok(text)
    }

    /// The communication of an edge, if it has partners.
    fn communication(&self, agent: usize, edge: &Edge, next: String) -> Vec<String> {
        let Some((channel, side)) = edge.label.end() else {
            return Vec::new();
        };
        let own = &self.names.agents[agent];
        let found = &self.network.channels[channel];
        let names = &self.names.channels[channel];
        let (senders, receivers) = (
            &self.alphabets.senders[channel],
            &self.alphabets.receivers[channel],
        );
        let (users, partners) = match side {
            Side::Send => (senders, receivers),
            Side::Receive => (receivers, senders),
        };
        let own = if users.len() > 1 {
            format!("!{own}")
        } else {
            String::new()
        };
        let name = match (found.kind, side) {
            (Buffering::Rendezvous, _) => {
                // No process meets itself.
                let others: Vec<usize> = partners
                    .iter()
                    .copied()
                    .filter(|&other| other != agent)
                    .collect();
                if others.is_empty() {
                    return Vec::new();
                }
                let other = match partners.len() {
                    1 => String::new(),
                    _ => format!("?other:{}", self.agents(&others)),
                };
                match side {
                    Side::Send => format!("{}{own}{other}", names.plain),
                    Side::Receive => format!("{}{other}{own}", names.plain),
                }
            }
            (_, Side::Send) => format!("{}{own}", names.put),
            (_, Side::Receive) => format!("{}{own}", names.get),
        };
        let event = match &edge.label {
            Label::Send(_, Some(value)) => format!("{name}!{}", self.terms().number(value)),
            Label::Receive(_, variable) if found.values.is_some() => match variable {
                None => format!("{name}?value"),
                Some(slot) => format!("{name}?{}", self.names.variables[*slot]),
            },
            _ => name,
        };
        let mut next = next;
        if let Label::Receive(_, Some(slot)) = &edge.label
            && let Some((low, high)) = found.values
        {
            let variable = &self.network.variables[*slot];
            let value = crate::language::expr::Expr::Name(*slot);
            let range = (low.into(), high.into());
            let outside = self
                .terms()
                .outside(&value, range, (variable.low, variable.high));
            if let Some(outside) = outside {
                let broken = self.broken(agent, edge.line);
                next = format!("(if {outside} then {broken} else {next})");
            }
        }
        vec![format!("{event} -> {next}")]
    }
}
