//! The description of a card.

use crate::idrom::{Idrom, Tag};
use std::fmt;

/// The card's data apart from its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Board {
    /// Its name, such as `7I92`.
    pub name: String,
    /// The version of LBP16.
    pub lbp16_version: u16,
    /// The version of the card's Ethernet firmware.
    pub firmware_version: u16,
    /// The settings of its jumpers, a bit each.
    pub jumpers: u16,
}

/// A card and its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Description {
    /// The card.
    pub board: Board,
    /// The configuration's name: `HOSTMOT2`.
    pub configuration: String,
    /// Its modules and pins.
    pub idrom: Idrom,
}

impl Description {
    /// How many units the module of this tag has.
    pub fn count(&self, tag: Tag) -> u8 {
        self.idrom.module(tag).map_or(0, |module| module.instances)
    }
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Description {
            board,
            configuration,
            idrom,
        } = self;
        write!(
            f,
            "{} ({}, {configuration}), LBP16 version {}, {} pins in {} ports",
            board.name, idrom.board, board.lbp16_version, idrom.width, idrom.ports
        )?;
        for module in &idrom.modules {
            write!(f, "; {} {}", module.instances, module.tag)?;
        }
        Ok(())
    }
}
