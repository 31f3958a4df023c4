//! LUNA's kernel without an operating system: what docs/no-std.md describes, in code.
//!
//! - `cpu`: a simulated CPU on the host, with interrupts at random places and a virtual clock. The
//!   kernel's tests run on it: `cargo test -p luna-bare --features bare`.
//! - `cortex_m`: a port for Cortex-M, to be copied.
//!
//! Without the feature `bare` there is nothing here: the kernel then has an operating system.

#![cfg_attr(target_os = "none", no_std)]

#[cfg(all(feature = "bare", target_arch = "arm", target_os = "none"))]
pub mod cortex_m;
#[cfg(all(feature = "bare", not(target_os = "none")))]
pub mod cpu;
