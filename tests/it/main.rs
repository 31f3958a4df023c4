//! Whole systems under test, as users build them. One program; a module a subject.
//! Tests that need a process or the machine to themselves are in `tests/own`.

#![expect(
    clippy::duplicate_mod,
    reason = "the tests of loops are built once for each source of wake-ups"
)]

#[path = "../shared/mod.rs"]
mod shared;

#[path = "../common/mod.rs"]
mod common;
#[path = "../levels/mod.rs"]
mod levels;

mod bad_input;
mod bad_moment;
mod blocking;
mod children;
mod composition;
mod crashes;
mod deadlock;
mod defects;
#[cfg(feature = "toml")]
mod deployment;
mod devices;
mod docs;
mod driven_clock;
mod ended_inputs;
mod ending_signals;
#[cfg(feature = "events")]
mod events;
mod evidence;
mod external;
mod external_broken;
mod external_devices;
mod external_ends;
mod failed_branches;
mod forked;
mod handles;
mod hostile;
mod large_values;
mod left_behind;
mod locks;
mod logging;
mod loops_by_executor;
mod loops_by_manager;
mod never_run;
mod operational;
mod overdue_budgets;
mod panic_hook;
mod panics;
mod par;
mod par_errors;
mod parameters;
mod parameters_properties;
mod parameters_recorded;
mod parents_death;
mod phases;
mod post_run;
mod pre_run_fails;
mod pri_par;
mod raised_emergency;
mod record;
mod record_constructs;
mod record_cut;
mod record_damage;
mod report;
mod run;
mod safety_state;
mod signals;
mod signals_at_files;
mod signals_while_blocked;
mod spawn_at_start_and_end;
mod spawn_while_running;
mod stand_ins;
mod standard_error;
mod standard_input;
mod strict;
mod supervisor_panics;
mod unwind;
mod usage;
mod virtual_clock;
mod virtual_traces;
mod watch;
mod watchdog;
mod write_signals;
