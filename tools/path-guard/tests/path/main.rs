//! All functions of LUNA on the real-time path, checked against the path's rules: no allocation, no
//! free, no blocking, no system call beyond those that the rules allow. `control` shows that each
//! breach is detected; `scenarios` has the code to run. Add a function to a list there for new
//! code.

#[cfg(luna_path_guard)]
mod control;
#[cfg(luna_path_guard)]
mod places;
#[cfg(luna_path_guard)]
mod scenarios;

#[cfg(luna_path_guard)]
#[global_allocator]
static ALLOCATOR: luna_path_guard::Allocator = luna_path_guard::Allocator::new();

#[cfg(not(luna_path_guard))]
#[test]
fn the_path_keeps_to_its_rules() {
    use std::io::Write;
    // Not by a macro: the harness captures its output.
    let _ = writeln!(
        std::io::stderr(),
        "skipped: the_path_keeps_to_its_rules: {}",
        luna_path_guard::coverage()
    );
}
