//! The same tests of loops that the timer manager wakes.

mod common;

#[path = "loops/bad_loops.rs"]
mod bad_loops;
#[path = "loops/overrun.rs"]
mod overrun;
#[path = "loops/periodic.rs"]
mod periodic;
#[path = "loops/phased_loops.rs"]
mod phased_loops;
#[path = "loops/prepared_loops.rs"]
mod prepared_loops;
