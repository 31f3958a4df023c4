//! Tests of the links. One program; a module a subject.

#[path = "../common/mod.rs"]
mod common;

#[cfg(feature = "net")]
mod cycle;
mod driver;
mod gpio;
mod joystick;
mod serial;
mod tcp;
mod udp;
