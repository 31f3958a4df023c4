//! What can happen in a state, and what buffers do.

use super::state::{Move, Semantics, State};
use crate::file::Side;
use crate::network::{Buffering, Label};

impl Semantics<'_> {
    /// All that can happen next.
    pub(crate) fn moves(&self, state: &State, moves: &mut Vec<Move>) {
        moves.clear();
        for agent in 0..self.network.agents.len() {
            if self.is_ending(state, agent) {
                moves.push(Move {
                    agent,
                    edge: 0,
                    partner: None,
                    is_closed: false,
                    is_end: true,
                });
            }
            for (number, edge) in self.edges(state, agent).iter().enumerate() {
                if !self.is_open(state, edge) {
                    continue;
                }
                let mut add = |partner, is_closed| {
                    moves.push(Move {
                        agent,
                        edge: number,
                        partner,
                        is_closed,
                        is_end: false,
                    });
                };
                let Some((channel, side)) = edge.label.end() else {
                    add(None, false);
                    continue;
                };
                let found = &self.network.channels[channel];
                let length = self.length(state, channel);
                if self.is_closed(state, found, side, length) {
                    add(None, true);
                    continue;
                }
                // What is called off may have met its partner just before.
                if self.is_called_off(state, agent) {
                    add(None, true);
                }
                match (side, found.kind) {
                    (Side::Receive, Buffering::Rendezvous) => {}
                    (Side::Receive, _) if length == 0 => {}
                    (Side::Send, Buffering::Fifo(n)) if length == n as i32 => {}
                    (Side::Send, Buffering::Rendezvous) => {
                        for &other in &self.receivers[channel] {
                            for (at, edge) in self.edges(state, other).iter().enumerate() {
                                let receives =
                                    matches!(edge.label, Label::Receive(c, _) if c == channel);
                                if other != agent && receives && self.is_open(state, edge) {
                                    add(Some((other, at)), false);
                                }
                            }
                        }
                    }
                    _ => add(None, false),
                }
            }
        }
    }

    /// Puts a value into a buffer that takes one.
    pub(super) fn put(&self, state: &mut State, channel: usize, value: i32) {
        let kind = self.network.channels[channel].kind;
        let at = self.contents[channel];
        let mut length = state[at] as usize;
        if length == kind.capacity() {
            if let Buffering::OverwriteOldest(_) = kind {
                state.copy_within(at + 2..at + 1 + length, at + 1);
            }
            length -= 1;
        }
        state[at + 1 + length] = value;
        state[at] = length as i32 + 1;
    }

    /// Removes the oldest value. What is behind the last value is 0, so that equal states look alike.
    pub(super) fn get(&self, state: &mut State, channel: usize) {
        let at = self.contents[channel];
        let length = state[at] as usize;
        state.copy_within(at + 2..at + 1 + length, at + 1);
        state[at + length] = 0;
        state[at] = length as i32 - 1;
    }
}
