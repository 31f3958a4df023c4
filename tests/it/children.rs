//! What a program that a process starts has of its executor: its core and its blocked signals,
//! unless it is started as an ordinary one.

#![cfg(all(target_os = "linux", not(luna_portable)))]

use crate::common;
use common::{SpawnOk, skip, watchdog};
use luna::prelude::*;
use luna::realtime::ordinary_child;
use luna_machine::facts::parse::core_list;
use luna_machine::facts::task::field;
use std::process::{Command, Stdio};

/// The cores and the blocked signals of a program.
fn started(by: impl FnOnce(&mut Command) -> &mut Command) -> (Vec<usize>, u64) {
    let mut command = Command::new("cat");
    command.arg("/proc/self/status").stdin(Stdio::null());
    let output = common::output(by(&mut command));
    let status = String::from_utf8(output.stdout).unwrap();
    let cores = core_list(field(&status, "Cpus_allowed_list").unwrap()).unwrap();
    let blocked = field(&status, "SigBlk").unwrap();
    (cores, u64::from_str_radix(blocked, 16).unwrap())
}

#[test]
fn a_child_gets_back_what_its_executor_has_given_up() {
    let _watch = watchdog();
    let all = luna_platform::thread::available_cores();
    if all.len() < 2 {
        return skip("this machine has one core");
    }
    let core = all[0];
    let mut system = System::new("starter");
    let control = system.executor("control").core(core).build().unwrap();
    control.process("starter").spawn_ok(async move {
        const TERMINATE: u64 = 1 << (15 - 1);
        let (cores, blocked) = started(|command| command);
        assert_eq!(cores, [core], "it inherits the core");
        assert!(blocked & TERMINATE != 0);
        let (cores, blocked) = started(ordinary_child);
        assert_eq!(cores, all);
        assert!(blocked & TERMINATE == 0);
        Ok(())
    });
    system.run().unwrap();
}
