//! What is wrong in a system file, with its line.

use super::*;

/// What is wrong with the file, from its line on.
fn refused(file: &str) -> String {
    let error = run(file).expect_err("there is something wrong");
    let Error::Setup(SetupError::Deployment(problem)) = &error else {
        panic!("{error}");
    };
    assert!(problem.file.ends_with(".toml"), "{problem}");
    error.to_string()[problem.file.len() + 1..].to_owned()
}

#[test]
fn names_that_the_program_does_not_have() {
    let _watch = watchdog();
    for (file, message) in [
        (
            "\n[executor.contrl]\ncore = 0\n",
            "2:11: the system has no such executor: `contrl`; is `control` meant?",
        ),
        (
            "[process.\"x-axis\"]\npriority = 3\n",
            "1:10: the system has no such process: `\"x-axis\"`; is `x axis` meant?",
        ),
        (
            "[process.\"x axis\"]\npriority = 3\non = \"fast\"\n",
            "3:6: the system has no such executor: `\"fast\"`; there are: control, slow",
        ),
        (
            "[executors.control]\ncore = 0\n",
            "1:2: this key has no meaning here: `executors`; is `executor` meant?",
        ),
        (
            "[executor.control]\ncores = 0\n",
            "2:1: this key has no meaning here: `cores`; is `core` meant?",
        ),
    ] {
        assert_eq!(refused(file), message);
    }
}

#[test]
fn values_out_of_range() {
    let _watch = watchdog();
    let deadline = "deadline:200000/500000/1000000";
    let policies = "write `other`, `fifo:1` to `fifo:97`, `rr:1` to `rr:97`, or \
                    `deadline:200000/500000/1000000`: runtime, deadline and period in ns";
    for (table, line, message) in [
        (
            "executor.control",
            "policy = \"fifo:98\"",
            "2:10: the priority is out of range: `\"fifo:98\"`; choose 1 (lowest) to 97, since 98 and \
             99 are the timer manager's and the emergency manager's"
                .to_owned(),
        ),
        (
            "executor.console",
            "policy = \"deadline:6000/5000/9000\"",
            "2:10: the times (runtime/deadline/period in ns) are impossible: \
             `\"deadline:6000/5000/9000\"`; choose 1024 ns <= runtime <= deadline <= period"
                .to_owned(),
        ),
        (
            "executor.control",
            "policy = \"fif:9\"",
            format!("2:10: this is no policy: `\"fif:9\"`; {policies}"),
        ),
        (
            "executor.control",
            "core = \"2\"",
            "2:8: this value has no meaning here: `\"2\"`; there are: any".to_owned(),
        ),
        (
            "executor.control",
            "stack_size = 1.5",
            "2:14: a whole number is expected: `1.5`; write one from 131072 to 1073741824"
                .to_owned(),
        ),
        (
            "executor.control",
            "core = 5000",
            "2:8: this number is out of range: `5000`; write one from 0 to 4095".to_owned(),
        ),
        (
            "executor.control",
            "spin_before_sleep = \"2 ms\"",
            "2:21: this is too long to look for work: `\"2 ms\"`; write `0 us` to `1000 us`"
                .to_owned(),
        ),
        (
            "executor.control",
            "stack_size = 1000",
            "2:14: this number is out of range: `1000`; write one from 131072 to 1073741824"
                .to_owned(),
        ),
        (
            "process.\"x axis\"",
            "priority = 32",
            "2:12: this number is out of range: `32`; write one from 0 to 31".to_owned(),
        ),
        (
            "process.\"x axis\"",
            "cycle_budget = \"0 ms\"",
            "2:16: this is no time: `\"0 ms\"`; write a whole number from 1 to 1000000000 and ns, us, \
             ms or s: `1 ms`"
                .to_owned(),
        ),
        (
            "process.\"x axis\"",
            "on_overrun = \"poisn\"",
            "2:14: this value has no meaning here: `\"poisn\"`; is `poison` meant?".to_owned(),
        ),
        (
            "process.\"x axis\"",
            "period = \"2 ms\"",
            "2:1: a period is that of a loop, and a process may have several: `period`; write \
             `period` below `[loop.NAME]`, with the loop's name"
                .to_owned(),
        ),
        (
            "process.planner",
            "on_overrun = \"warn\"",
            "2:14: this process has no budget that it could overrun: `\"warn\"`; write \
             `poll_budget` or `cycle_budget` beside it"
                .to_owned(),
        ),
        (
            "process.operator",
            "on = \"slow\"",
            "2:6: this process has a thread of its own, since it may block: `\"slow\"`; leave `on` \
             out, or spawn the process on an executor"
                .to_owned(),
        ),
        (
            "process.operator",
            "priority = 3",
            "2:12: this process has a thread of its own, where this does nothing: `3`; write the \
             policy of the thread below `[executor]`"
                .to_owned(),
        ),
        (
            "loop.\"x axis\"",
            "period = 2",
            "2:10: a text is expected: `2`; write it in quotes".to_owned(),
        ),
        (
            "system",
            "strict = \"yes\"",
            "2:10: yes or no is expected: `\"yes\"`; write `true` or `false`".to_owned(),
        ),
        (
            "executor.slow",
            &format!("policy = \"{deadline}\""),
            format!(
                "2:10: an executor cannot have this policy, whose budget would stop all its \
                 processes: `\"{deadline}\"`; write `fifo:1` to `fifo:97`"
            ),
        ),
        (
            "executor.console",
            &format!("policy = \"{deadline}\"\ncore = 0"),
            format!(
                "2:10: a thread that is pinned to a core cannot have this policy: \
                 `\"{deadline}\"`; write `core = \"any\"` beside it"
            ),
        ),
    ] {
        assert_eq!(refused(&format!("[{table}]\n{line}\n")), message);
    }
    assert!(refused("[executor.control\n").starts_with("1:"));
    let nothing = refused("[loop.\"x axis\"]\n");
    assert!(nothing.starts_with("1:7: nothing is stated of this loop"));
}

/// The program states the policy, and the file alone the core.
#[test]
fn a_thread_with_a_deadline_cannot_be_pinned_by_the_file() {
    let _watch = watchdog();
    let file = TempFile::with("pinned", "[executor.drive]\n\ncore = 0\n");
    let mut system = System::new("machine");
    system.deployment_from(&file.0).unwrap();
    let times = [2, 5, 10].map(Duration::from_millis);
    let policy = Policy::deadline(times[0], times[1], times[2]);
    let drive = system.thread("drive").policy(policy).process("drive");
    let error = drive.spawn(async { Ok(()) }).unwrap_err();
    let path = file.0.display();
    let expected = format!(
        "{path}:3:8: a thread of SCHED_DEADLINE cannot be pinned to a core: `0`; write `\"any\"`, or \
         another `policy` beside it"
    );
    assert_eq!(error.to_string(), expected);
}

#[test]
fn the_machine_must_have_the_core() {
    let _watch = watchdog();
    if !crate::common::COMPLETE {
        println!("skipped: without the backend for Linux no core is looked at");
        return;
    }
    let file = TempFile::with("core", "[executor.main]\n\ncore = 4000\n");
    let mut system = System::new("machine");
    system.deployment_from(&file.0).unwrap();
    let error = system.executor("main").build().unwrap_err();
    let path = file.0.display();
    let expected = format!("{path}:3:8: this machine has no such core: `4000`; write one of [0");
    assert!(error.to_string().starts_with(&expected), "{error}");
    // The program asks for it: it is the program's error, though another core would be the file's.
    let file = TempFile::with("core", "[executor.main]\ncore = \"any\"\n");
    let mut system = System::new("machine");
    system.deployment_from(&file.0).unwrap();
    assert!(system.executor("main").core(4000).build().is_ok());
    assert!(system.executor("other").core(4000).build().is_err());
}
