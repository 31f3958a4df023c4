//! Tests of the simulated card. One program; a module a subject.

mod card;
mod mesaflash;
