//! The program of `luna demo`, for the tests of `luna`, which are built with it.

use luna_command::alloc::Counting;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new(luna::realtime::on_path);

fn main() -> ExitCode {
    // SAFETY: no other thread has been started.
    unsafe { luna_command::begin() };
    luna_demo::run(&ALLOCATOR)
}
