//! The same tests of loops that the timer manager wakes.

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

/// What wakes the loops of these tests.
fn timers() -> luna::time::Timers {
    luna::time::Timers::Manager
}

/// A system with loops that [`timers`] wake.
fn system(name: &str) -> luna::System {
    let mut system = luna::System::new(name);
    system.timers(timers());
    system
}
