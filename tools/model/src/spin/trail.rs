//! SPIN's trails in the words of the model.

use super::promela::{Mark, Promela};
use crate::explore::words::Said;
use crate::explore::{StepParts, TraceStep};
use crate::network::{Buffering, Edge, Label, Network};

/// The moves of a trail; of an endless run the part that is repeated comes after a
/// line that says so.
pub(crate) fn words(network: &Network, promela: &Promela, trail: &str) -> Vec<TraceStep> {
    let mut lines = Vec::new();
    let mut last = None;
    let mut sender: Option<Mark> = None;
    for line in trail.lines() {
        if line.contains("START OF CYCLE") {
            lines.push(TraceStep {
                text: "for ever:".to_owned(),
                parts: StepParts::Note,
            });
            continue;
        }
        let Some((step, at)) = place(line) else {
            continue;
        };
        let Some(&mark) = promela.moves.get(&at) else {
            continue;
        };
        // A `d_step` writes several lines.
        if last.replace((step, at)) == Some((step, at)) {
            continue;
        }
        let Some(edge) = edge(network, mark) else {
            continue;
        };
        let said = |agent: usize, edge: &Edge, partner: Option<usize>| {
            let said = Said {
                agent,
                edge,
                partner,
                value: None,
                is_closed: mark.is_closed,
            };
            said.step(network)
        };
        let is_rendezvous = edge.label.end().is_some_and(|(channel, _)| {
            network.channels[channel].kind == Buffering::Rendezvous && !mark.is_closed
        });
        match (&edge.label, sender) {
            (Label::Send(..), _) if is_rendezvous => sender = Some(mark),
            (Label::Receive(..), Some(from)) if is_rendezvous => {
                sender = None;
                if let Some(sent) = self::edge(network, from) {
                    lines.push(said(from.agent, sent, Some(mark.agent)));
                }
            }
            _ => lines.push(said(mark.agent, edge, None)),
        }
    }
    lines
}

/// The step's number and the line of the model, of `12: proc 3 (p3:1) model.pml:45 (state 7) [c]`.
fn place(line: &str) -> Option<(u64, usize)> {
    let (step, rest) = line.trim_start().split_once(':')?;
    let step = step.parse().ok()?;
    // What ends with no statement is where a process is in the end.
    let (_, rest) = rest
        .split_once("model.pml:")
        .filter(|_| line.contains('['))?;
    let digits = rest
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(rest.len());
    Some((step, rest[..digits].parse().ok()?))
}

fn edge(network: &Network, mark: Mark) -> Option<&Edge> {
    let place = &network.agents[mark.agent].code[mark.place];
    place.step.edges().get(mark.edge)
}
