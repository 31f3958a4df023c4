//! The machine around a LUNA program: what a system needs of its operating system beside threads,
//! clocks and locks.
//!
//! Processes and channels need none of it. It is for the framework, the command, devices and
//! observers.
//!
//! - [`signals`], [`crash`], [`parent`]: requests to end, crashes, and the end of the parent
//!   process, as events; [`alarm`]: a timer that is such an event. [`forked`]: whether this is a
//!   child that has none of the program's threads. [`event_count`]: how threads wait for
//!   events. [`failover`]: jobs in order, by threads of which
//!   some may hang.
//! - [`memory`], [`latency`]: what a real-time system holds while it runs.
//! - [`shortfall`]: what was refused, why, and how to get it. [`facts`]: what the machine is. [`tai`]: the time that computers can have in
//!   common. [`counter`]: the processor's. [`threads`]: threads in relation to others.
//! - [`usage`], [`steal`]: what may have made a thread late: page faults, switches, a hypervisor.
//! - `file`: reading and writing without waiting (on Unix); [`socket`]: datagrams; [`new_file`]:
//!   files that replace others as a whole.
//!
//! As in `luna-platform`, each backend is a folder that defines the same names: `linux` is
//! complete, and `portable` has the standard library alone.

#![allow(
    clippy::new_without_default,
    reason = "what is made here belongs to one thread or system: made on purpose, not by default"
)]

// The model is the same for either checker: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

#[cfg(not(loom))]
pub mod alarm;
#[cfg(not(loom))]
pub mod counter;
#[cfg(not(loom))]
pub mod crash;
pub mod event_count;
#[cfg(not(loom))]
pub mod facts;
pub mod failover;
#[cfg(all(unix, not(loom)))]
pub mod file;
#[cfg(not(loom))]
pub mod forked;
#[cfg(not(loom))]
pub mod latency;
#[cfg(not(loom))]
pub mod memory;
#[cfg(not(loom))]
pub mod new_file;
#[cfg(not(loom))]
pub mod parent;
#[cfg(not(loom))]
pub mod shortfall;
#[cfg(not(loom))]
pub mod signals;
#[cfg(not(loom))]
pub mod socket;
#[cfg(not(loom))]
pub mod steal;
#[cfg(not(loom))]
pub mod tai;
#[cfg(not(loom))]
pub mod threads;
#[cfg(not(loom))]
pub mod usage;

#[cfg(all(target_os = "linux", not(luna_portable), not(loom)))]
#[path = "linux/mod.rs"]
mod backend;
#[cfg(all(not(all(target_os = "linux", not(luna_portable))), not(loom)))]
#[path = "portable/mod.rs"]
mod backend;
