//! Blocks that run in a process of the operating system of their own.

use std::{
    process::{self, Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use super::case::{Block, Case};

/// Whether this process was started for one block.
static APART: AtomicBool = AtomicBool::new(false);

/// Ends this process with `elapsed` as its block's result, if the case is measured
/// [`apart`](Case::apart); otherwise does nothing.
///
/// Everything that the block has started is left to the operating system.
pub fn finish(elapsed: Duration) {
    finish_with(elapsed.as_secs_f64() * 1e9);
}

/// As [`finish`], for a block that returns a figure.
pub fn finish_with(figure: f64) {
    if APART.load(Ordering::Relaxed) {
        println!("{figure}");
        process::exit(0);
    }
}

/// In the process started for it: runs the block, and prints its figure.
pub(super) fn run_here(case: &mut Case, operations: u64) -> ! {
    APART.store(true, Ordering::Relaxed);
    match &mut case.block {
        Block::Timed(block) => finish(block(operations)),
        Block::Once(block) => finish_with(block()),
    }
    unreachable!("this process has ended with the block's figure")
}

/// Starts a process for one block of `case`. Returns its figure, in nanoseconds if the block is
/// timed.
pub(super) fn run(case: &Case, operations: u64) -> f64 {
    let program = std::env::current_exe().expect("the system knows which program runs");
    let mut command = Command::new(program);
    command
        .args(["--apart", &case.title(), &operations.to_string()])
        .stdin(Stdio::null())
        .stderr(Stdio::inherit());
    if !super::is_quick() {
        command.arg("--bench");
    }
    let output = command.output().expect("this program can be started again");
    assert!(
        output.status.success(),
        "the process of the block: {}",
        output.status
    );
    let text = String::from_utf8_lossy(&output.stdout);
    text.trim()
        .parse()
        .unwrap_or_else(|_| panic!("no figure came from the process of the block: {text:?}"))
}
