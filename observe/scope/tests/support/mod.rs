//! Shared by the browser's tests, the screenshots and the frame rate measurement.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each program that includes it uses a part of it"
)]

pub mod browser;
#[cfg(target_os = "linux")]
pub mod cell;
pub mod feeder;
pub mod machine;
