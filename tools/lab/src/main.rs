//! Runs programs under PREEMPT_RT kernels in QEMU, for amd64 and arm64, and measures what LUNA
//! costs there, exactly.

mod arch;
mod archive;
mod boot;
mod build;
mod cargo;
mod exact;
mod libraries;
mod place;
mod run;
mod setup;
mod suites;

use crate::place::Place;
use std::env;
use std::process::ExitCode;

const USAGE: &str = "\
Runs programs under a PREEMPT_RT kernel of Debian, and on 64-bit Arm, in QEMU without KVM.

Usage: lab setup [--arm]
       lab run [OPTIONS] FILE... -- COMMANDS
       lab exact [show | gate | record] [--seed SEED]
       lab test amd64|arm64 [--package PACKAGE]...
       lab cargo ARGUMENTS...

  setup    installs QEMU, and unpacks the kernel, BusyBox, the C library and rt-tests for amd64;
           with --arm for arm64 too, with a compiler for it
  run      boots the kernel with the FILEs in /lab and runs the COMMANDS there, by BusyBox' sh as
           root; prints what they print, and ends with their exit code
             --arch amd64|arm64   the guest's processor [default: amd64]
             --exact SHIFT        an instruction takes 2^SHIFT ns of the guest's time, nothing else
                                  takes any: one processor, and the same figures at each run
             --seed SEED          of the guest's random numbers, which place its memory [default: 1]
             --cpus N             processors [default: 2; 1 with --exact]
             --memory MIB         [default: 1536]
             --timeout S          of the host's time [default: 600]
  exact    the wake-up latencies of LUNA beside bare system calls, in instructions
             show                 prints them with their goals (default)
             gate                 fails where one exceeds the recorded one by too much
             record               writes them to tools/lab/recorded.txt
             --seed SEED          arranges memory and phases otherwise [default: 1]
  test     the test programs of the kernel crates, and on amd64 those of luna-rt, on two processors
  cargo    cargo for aarch64-unknown-linux-gnu: `lab cargo build --package luna-core`

Its files are in target/lab of the checkout, or in the folder LUNA_LAB.
Exit codes of run: those of the commands; 124 out of time; 125 the guest did not end as it should.
docs/internals/laboratory.md says what the figures mean.";

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let (command, rest) = match arguments.split_first() {
        None => ("", &[][..]),
        Some((command, rest)) => (command.as_str(), rest),
    };
    let place = Place::of_environment();
    let ended = match command {
        "setup" => setup::command(&place, rest),
        "run" => run::command(&place, rest),
        "exact" => exact::command(&place, rest),
        "test" => suites::command(&place, rest),
        "cargo" => cargo::command(&place, rest),
        _ => Err(USAGE.to_owned()),
    };
    match ended {
        Ok(code) => ExitCode::from(code),
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}
