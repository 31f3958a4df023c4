//! The program of `luna demo`: the machines of the thesis, simulated. [`run`] is all of it.

mod args;
mod card;
#[cfg(target_os = "linux")]
mod head;
mod jiwy;
#[cfg_attr(not(target_os = "linux"), path = "no_joystick.rs")]
mod joystick;
mod machine;
mod output;
#[cfg(target_os = "linux")]
mod production_cell;
mod replay;
mod scope;
mod table;
#[cfg(target_os = "linux")]
mod tulip;

use clap::Parser;
use luna_command::alloc::Counting;
use luna_command::failure::Failure;
use luna_command::{columns, exit, failure, place, print, report, text};
use std::process::ExitCode;

/// Does what the command line asks for. `allocator` is that of the program.
pub fn run(allocator: &Counting) -> ExitCode {
    luna_command::end(run_machine(&args::Demos::parse(), allocator))
}

fn run_machine(demos: &args::Demos, allocator: &Counting) -> Result<ExitCode, Failure> {
    #[cfg(target_os = "linux")]
    {
        use args::Machine;
        match &demos.machine {
            Some(Machine::ProductionCell(arguments)) => return production_cell::run(arguments),
            Some(Machine::ProductionCellUnit(unit)) => return production_cell::run_unit(unit),
            Some(Machine::Head(arguments)) => return head::run(arguments, allocator),
            Some(Machine::HeadVision(arguments)) => return head::run_vision(arguments),
            Some(Machine::Tulip(arguments)) => return tulip::run(arguments, allocator),
            Some(Machine::TulipOperator(arguments)) => return tulip::run_operator(arguments),
            None => {}
        }
    }
    jiwy::run(&demos.jiwy, allocator)
}
