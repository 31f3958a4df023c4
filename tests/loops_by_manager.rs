//! The tests of loops once more, with the timer manager instead of the executors' deadlines.

#[path = "bad_loops.rs"]
mod bad_loops;
#[path = "overrun.rs"]
mod overrun;
#[path = "periodic.rs"]
mod periodic;
#[path = "phased_loops.rs"]
mod phased_loops;
