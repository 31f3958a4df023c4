//! Network management: commands, states, boot-up and heartbeat messages.

use super::NodeId;
use crate::Frame;
use luna::{Error, Sender};
use std::fmt;

/// The state of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum NmtState {
    /// It has just begun: the boot-up message.
    BootUp,
    /// It does no more than network management and heartbeats.
    Stopped,
    /// All but PDOs: it is set up in this state.
    PreOperational,
    /// It works.
    Operational,
}

impl NmtState {
    pub(crate) fn of(code: u8) -> Option<Self> {
        match code & 0x7F {
            0 => Some(NmtState::BootUp),
            4 => Some(NmtState::Stopped),
            5 => Some(NmtState::Operational),
            0x7F => Some(NmtState::PreOperational),
            _ => None,
        }
    }

    pub(crate) fn code(self) -> u8 {
        match self {
            NmtState::BootUp => 0,
            NmtState::Stopped => 4,
            NmtState::Operational => 5,
            NmtState::PreOperational => 0x7F,
        }
    }
}

impl fmt::Display for NmtState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            NmtState::BootUp => "boot-up",
            NmtState::Stopped => "stopped",
            NmtState::PreOperational => "pre-operational",
            NmtState::Operational => "operational",
        })
    }
}

/// What a node is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum NmtCommand {
    /// To become operational.
    Start,
    /// To stop.
    Stop,
    /// To become pre-operational.
    EnterPreOperational,
    /// To begin anew as after power-on.
    ResetNode,
    /// To begin its communication anew.
    ResetCommunication,
}

impl NmtCommand {
    fn code(self) -> u8 {
        match self {
            NmtCommand::Start => 1,
            NmtCommand::Stop => 2,
            NmtCommand::EnterPreOperational => 128,
            NmtCommand::ResetNode => 129,
            NmtCommand::ResetCommunication => 130,
        }
    }

    /// Its message, to one node, or to all. To be sent at once in an emergency, say:
    /// `NmtCommand::Stop.frame(None)`.
    pub fn frame(self, to: Option<NodeId>) -> Frame {
        frame(0, &[self.code(), to.map_or(0, NodeId::number)])
    }

    /// The command of a frame and the node that it is for, none for all; if it is such a frame.
    pub fn decode(frame: &Frame) -> Option<(Self, Option<NodeId>)> {
        let ([code, to], Some(0)) = (frame.data(), frame.standard_id()) else {
            return None;
        };
        let command = match code {
            1 => NmtCommand::Start,
            2 => NmtCommand::Stop,
            128 => NmtCommand::EnterPreOperational,
            129 => NmtCommand::ResetNode,
            130 => NmtCommand::ResetCommunication,
            _ => return None,
        };
        match to {
            0 => Some((command, None)),
            to => Some((command, Some(NodeId::new(*to)?))),
        }
    }
}

/// A heartbeat, or a boot-up message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Heartbeat {
    /// Whose.
    pub node: NodeId,
    /// The state that it says.
    pub state: NmtState,
}

impl Heartbeat {
    /// Its message.
    pub fn frame(self) -> Frame {
        frame(self.node.heartbeat(), &[self.state.code()])
    }

    /// The heartbeat of a frame, if it is one.
    pub fn decode(frame: &Frame) -> Option<Self> {
        let [code] = frame.data() else {
            return None;
        };
        Some(Self {
            node: NodeId::of(frame.standard_id()?, 0x700)?,
            state: NmtState::of(*code)?,
        })
    }
}

/// Commands nodes: see [`Network::nmt`](super::Network::nmt).
#[derive(Debug, Clone)]
pub struct Nmt(pub(super) Sender<Frame>);

impl Nmt {
    /// Commands a node, or all. There is no answer; the heartbeat shows the state.
    ///
    /// Cancel-safe. Real-time path: yes, as a send.
    ///
    /// # Errors
    ///
    /// The controller has ended.
    pub async fn command(&self, command: NmtCommand, to: Option<NodeId>) -> luna::Result<()> {
        self.0.send(command.frame(to)).await.map_err(Error::from)
    }
}

/// A frame with data and an identifier that fit.
pub(crate) fn frame(id: u16, data: &[u8]) -> Frame {
    // Identifiers here have 11 bits, those of PDOs are checked, data has at most 8 bytes: else
    // this is a defect, which the tests of all messages would find.
    Frame::standard(id, &data[..data.len().min(8)])
        .unwrap_or_else(|| unreachable!("11 bits and 8 bytes fit"))
}
