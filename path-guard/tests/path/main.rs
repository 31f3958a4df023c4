//! Everything of LUNA that runs on the real-time path, held to the path's rules: nothing is allocated, freed, blocked on or asked of the system that the rules do
//! not allow. `control` shows that each breach is seen; `scenarios` is what is run. What is new joins there by one function in a list.

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
    // Not by a macro, whose output the harness keeps to itself.
    let _ = writeln!(
        std::io::stderr(),
        "skipped: the_path_keeps_to_its_rules: {}",
        luna_path_guard::coverage()
    );
}
