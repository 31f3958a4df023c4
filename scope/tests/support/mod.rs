//! What the browser's tests, the pictures and the measurement have in common.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each program that includes it uses a part of it"
)]

pub mod browser;
pub mod feeder;
pub mod machine;
