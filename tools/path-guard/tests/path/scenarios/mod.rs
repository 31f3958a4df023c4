//! The scenarios. To add one, write a function in one of these modules, and name it in the list
//! below; each is run in all placements.
//!
//! Bodies create what they need before they are spawned, or by `luna::realtime::off_path`; dropping
//! what they hold at their end must free nothing.

use super::places::{Places, hold_to_the_rules};

/// The number of repetitions of most operations.
const ROUNDS: u64 = 200;

/// Makes a test of each function.
macro_rules! scenarios {
    ($($room:ident: $($name:ident),+;)+) => {
        $(mod $room;)+
        $($(
            #[test]
            fn $name() {
                hold_to_the_rules(stringify!($name), $room::$name);
            }
        )+)+
    };
}

scenarios! {
    communication: rendezvous, rendezvous_of_two_levels, many_to_many, offers_that_do_not_wait, values_that_stay, fifo_buffers,
        overwriting_buffers, timeouts, dropped_operations, streams, closed_channels, poisoned_channels, waiting_for_the_end;
    choice: alternatives_of_inputs, alternatives_of_outputs, alternatives_on_both_sides, alternatives_with_delays, a_choice_dropped,
        fair_alternative_object, prioritized_alternative_object;
    meeting: barriers, barriers_as_guards, barriers_of_two_levels, barriers_that_are_joined_and_left, extended_rendezvous, calls, nested_calls,
        calls_that_are_given_up;
    locks: mutexes, locks_that_are_given_up, conditions, semaphores;
    time: delays, delays_of_a_busy_executor, loops, loops_behind_time, loops_in_phase, loops_by_the_manager, loops_that_account, budgets, ticks_as_guards, timers, watchdogs;
    parallel: parallel_branches, failing_branches, prioritized_branches, collections_of_branches, named_branches, named_branches_that_are_looked_at;
    threads: yields, wakes_from_plain_threads, blocking_operations_of_os_threads, ends_that_are_joined, cancelled_processes,
        processes_spawned_while_running, processes_of_types, processes_that_fail, a_limit_that_is_reached, wakers_that_outlive_their_thread, wakers_that_outlive_their_process, a_contended_lock,
        a_bias_that_is_revoked;
    files: files_that_become_ready, links;
    programs: values_to_other_programs, values_through_a_buffer, values_that_are_lent, calls_to_other_programs, blackboards;
    computers: cycles_of_a_link, cycles_of_a_loop;
    logging: signals_and_messages, signals_without_room, signals_without_a_recording;
    parameters: parameters_that_are_replaced, parameters_that_are_recorded;
}
