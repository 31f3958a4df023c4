//! The machine around a LUNA program: what a system needs of its operating system beside threads,
//! clocks and locks.
//!
//! Processes and channels need none of it. It is for the framework, the command, devices and
//! observers.
//!
//! - [`signals`], [`crash`], [`parent`]: requests to end, crashes, and the end of the parent
//!   process, as events; [`alarm`]: a timer that is such an event. [`forked`]: whether this is a
//!   child that has none of the program's threads.
//! - [`memory`], [`latency`]: what a real-time system holds while it runs.
//! - [`facts`]: what the machine is. [`tai`]: the time that computers can have in common.
//! - [`usage`], [`steal`]: what may have made a thread late: page faults, switches, a hypervisor.
//! - `file`: reading and writing without waiting (on Unix); [`socket`]: datagrams; [`new_file`]:
//!   files that replace others as a whole.
//!
//! As in `luna-platform`, each backend is a folder that defines the same names: `linux` is
//! complete, and `portable` has the standard library alone.

#![cfg(not(loom))]
#![allow(
    clippy::new_without_default,
    reason = "what is made here belongs to one thread or system: made on purpose, not by default"
)]

pub mod alarm;
pub mod crash;
pub mod facts;
#[cfg(unix)]
pub mod file;
pub mod forked;
pub mod latency;
pub mod memory;
pub mod new_file;
pub mod parent;
pub mod signals;
pub mod socket;
pub mod steal;
pub mod tai;
pub mod usage;

#[cfg(all(target_os = "linux", not(luna_portable)))]
#[path = "linux/mod.rs"]
mod backend;
#[cfg(not(all(target_os = "linux", not(luna_portable))))]
#[path = "portable/mod.rs"]
mod backend;
