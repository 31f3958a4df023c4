//! Three threads on one core. The high one waits for something that the low one has, and the one
//! between would run instead of both. With inheritance the one between does not run at all while
//! the high one waits. Without, the high one waits for all that the one between does. Measured in
//! the processor time of the one between, so that no machine can falsify it. Beside each test is a
//! control without inheritance, which shows that an inversion would be seen.

#![cfg(target_os = "linux")]

mod between;
mod calls;
mod locks;
mod mutexes;
mod stage;

use luna::Policy;
use luna_platform::thread::{Attributes, Mode, Thread, spawn};
use std::convert::Infallible;

const HIGH: u8 = 80;
const MIDDLE: u8 = 50;
const LOW: u8 = 20;
const ROUNDS: usize = 50;

fn thread<T: Send + 'static>(
    name: &str,
    core: usize,
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Thread<T> {
    let attributes = Attributes::new(name)
        .core(core)
        .policy(Policy::fifo(priority))
        .mode(Mode::Strict);
    spawn(attributes, |_| Ok::<_, Infallible>(()), |()| body()).unwrap()
}
