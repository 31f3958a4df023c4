//! Where a process waits, in Promela.

use super::ending::ancestors;
use super::promela::{Mark, Writer, expr};
use crate::file::Side;
use crate::network::{Buffering, Edge, Label};

impl Writer<'_> {
    /// Waits for one of several moves.
    pub(super) fn wait(&mut self, agent: usize, at: usize, edges: &[Edge]) {
        let network = self.network;
        if edges.is_empty() {
            self.line("  (false);");
            return;
        }
        let mut guard = 0;
        for edge in edges {
            if let Some(condition) = &edge.condition {
                self.divisors(condition);
            }
            if let Label::Send(channel, Some(value)) = &edge.label {
                let (low, high) = network.channels[*channel].values.unwrap_or((0, 0));
                let open = edge.condition.as_ref().map_or("true".to_owned(), expr);
                self.divisors_if(&open, value);
                let value = expr(value);
                let in_range = format!("({value} >= {low} && {value} <= {high})");
                self.line(&format!("  assert(!{open} || {in_range});"));
            }
            if let (true, Some(condition), Some((channel, side))) =
                (needs_choice(edge), &edge.condition, edge.label.end())
            {
                let condition = expr(condition);
                let shut = match side {
                    Side::Send => "no_receiver",
                    Side::Receive => "no_sender",
                };
                self.line(&format!(
                    "  atomic {{ if :: {condition} -> g{guard} = c{channel} :: else -> g{guard} = {shut} fi }};"
                ));
                guard += 1;
            }
        }
        self.line("  if");
        let mut guard = 0;
        for (number, edge) in edges.iter().enumerate() {
            let channel = match edge.label.end() {
                Some((channel, _)) => format!("c{channel}"),
                None => String::new(),
            };
            let channel = match needs_choice(edge) {
                true => {
                    guard += 1;
                    format!("g{}", guard - 1)
                }
                false => channel,
            };
            let mark = Mark {
                agent,
                place: at,
                edge: number,
                is_closed: false,
            };
            self.option(mark, edge, &channel);
            self.closed(mark, edge);
        }
        self.line("  fi;");
    }

    fn option(&mut self, mark: Mark, edge: &Edge, channel: &str) {
        let network = self.network;
        let open = edge.condition.as_ref().map_or("true".to_owned(), expr);
        let next = edge.next;
        let mut after = String::new();
        let statement = match &edge.label {
            Label::Send(number, value) => {
                let value = value.as_ref().map_or("0".to_owned(), |value| {
                    // The verifier evaluates it on `no_receiver`, too.
                    match edge.condition.is_some() && value.divides() {
                        true => format!("({open} -> {} : 0)", expr(value)),
                        false => expr(value),
                    }
                });
                let closed = self.when_closed(*number, Side::Send);
                let open = match &closed {
                    None => open,
                    Some(closed) => format!("({open} && !{closed})"),
                };
                let put = format!("c{number}!{value}");
                match network.channels[*number].kind {
                    Buffering::Fifo(_) if closed.is_some() => {
                        format!("d_step {{ ({open} && nfull(c{number})) -> {put} }}")
                    }
                    Buffering::Rendezvous | Buffering::Fifo(_) => format!("{channel}!{value}"),
                    Buffering::OverwriteOldest(_) => {
                        let make_room =
                            format!("if :: nfull(c{number}) :: full(c{number}) -> c{number}?_ fi");
                        format!("d_step {{ {open} -> {make_room}; {put} }}")
                    }
                    Buffering::OverwriteNewest(n) => {
                        // The newest comes to the head by n - 1 rotations.
                        let rotate = format!("c{number}?r; c{number}!r; ").repeat(n - 1);
                        let make_room = format!(
                            "if :: nfull(c{number}) :: full(c{number}) -> {rotate}c{number}?_ fi"
                        );
                        format!("d_step {{ {open} -> {make_room}; {put} }}")
                    }
                }
            }
            Label::Receive(_, None) => format!("{channel}?_"),
            Label::Receive(_, Some(slot)) => {
                let variable = &network.variables[*slot];
                let (low, high) = (variable.low, variable.high);
                after = format!("assert(v{slot} >= {low} && v{slot} <= {high}); ");
                format!("{channel}?v{slot}")
            }
            Label::Choice | Label::Skip | Label::After | Label::Own(_) => match edge.condition {
                None => "nothing = 0".to_owned(),
                Some(_) => {
                    after = "nothing = 0; ".to_owned();
                    open
                }
            },
        };
        self.out.moves.insert(self.lines + 1, mark);
        self.line(&format!("  :: {statement} ->"));
        self.line(&format!("     {after}goto L{next}"));
    }

    /// When a side finds a channel closed, if that may be.
    fn when_closed(&self, channel: usize, side: Side) -> Option<String> {
        let found = &self.network.channels[channel];
        if !self.ending.may_close(self.network, channel, side) {
            return None;
        }
        let ended = found
            .partners(side)
            .iter()
            .map(|process| format!("ended{process}"));
        let mut all: Vec<String> = ended.collect();
        if side == Side::Receive && found.kind != Buffering::Rendezvous {
            all.push(format!("empty(c{channel})"));
        }
        Some(format!("({})", all.join(" && ")))
    }

    /// The option that the channel is closed, or that a branch beside has failed.
    fn closed(&mut self, mark: Mark, edge: &Edge) {
        let network = self.network;
        let Some((channel, side)) = edge.label.end() else {
            return;
        };
        let mut reasons: Vec<String> = self.when_closed(channel, side).into_iter().collect();
        let around = ancestors(network, mark.agent);
        for agent in std::iter::once(mark.agent).chain(around) {
            for &sibling in &network.agents[agent].siblings {
                if self.ending.fails[sibling] {
                    reasons.push(format!("done{sibling} == 2"));
                }
            }
        }
        if reasons.is_empty() {
            return;
        }
        let open = edge.condition.as_ref().map_or("true".to_owned(), expr);
        let reasons = reasons.join(" || ");
        let label = self.fail_label(mark.agent);
        let mark = Mark {
            is_closed: true,
            ..mark
        };
        self.out.moves.insert(self.lines + 1, mark);
        self.line(&format!("  :: ({open} && ({reasons})) -> goto {label}"));
    }
}

/// A guard on a channel with a precondition, which Promela has not: the guard is on the channel
/// `no_sender` or `no_receiver` where the precondition is false. They are two, or a shut send would
/// meet a shut receive.
pub(super) fn needs_choice(edge: &Edge) -> bool {
    edge.condition.is_some() && edge.label.end().is_some()
}
