//! The program of `luna demo`.

use luna_command::alloc::Counting;
use std::process::ExitCode;

/// Counts allocations, which the real-time path must not make.
#[global_allocator]
static ALLOCATOR: Counting = Counting::new(luna::realtime::on_path);

fn main() -> ExitCode {
    // SAFETY: no other thread has been started.
    unsafe { luna_command::begin() };
    luna_demo::run(&ALLOCATOR)
}
