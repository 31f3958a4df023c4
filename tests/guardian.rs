//! The guardian: what it does when the system's program is killed, and that it does nothing
//! otherwise. The test harness does not run this program, since its guardians write to its standard
//! output.

#[cfg(not(all(target_os = "linux", not(luna_portable))))]
fn main() {
    println!("skipped: the guardian: this is not the complete backend");
}

#[cfg(all(target_os = "linux", not(luna_portable)))]
fn main() {
    linux::main();
}

#[cfg(all(target_os = "linux", not(luna_portable)))]
mod linux {
    use luna::Error;
    use luna::error::SetupError;
    use luna::prelude::*;
    use luna::safety::{Cause, Degree, Guardian};
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::{ForkResult, Pid, fork, pause};
    use std::fs;
    use std::io::{BufRead, BufReader};
    use std::path::{Path, PathBuf};
    use std::process::{Command, Stdio};
    use std::time::Duration;

    const PART: &str = "LUNA_TEST_PART";
    /// The file that stands for the machine: what it holds is the output.
    const MACHINE: &str = "LUNA_TEST_MACHINE";

    fn machine() -> PathBuf {
        std::env::var_os(MACHINE).expect("the test sets it").into()
    }

    fn output(machine: &Path) -> String {
        fs::read_to_string(machine).unwrap()
    }

    fn set_output(machine: &Path, output: &str) {
        // Replaced in one step, so that no reader sees half of it.
        let fresh = machine.with_extension(format!("{}", std::process::id()));
        fs::write(&fresh, output).unwrap();
        fs::rename(fresh, machine).unwrap();
    }

    pub(super) fn main() {
        luna::safety::guard(
            || Ok(machine()),
            |machine| set_output(&machine, "neutral by the guardian"),
        );
        if let Ok(part) = std::env::var(PART) {
            return play(&part);
        }
        // The harness' arguments are ignored; `--list` asks for names.
        if std::env::args().any(|argument| argument == "--list") {
            return;
        }
        let tests = [
            ("killed at random instants", killed as fn(&Path)),
            (
                "killed, with a copy that holds the pipe",
                outlived_by_a_copy,
            ),
            ("an orderly end", orderly),
            (
                "an emergency that went well, and one that did not",
                emergencies,
            ),
            ("a guardian that is lost", lost),
            ("guardians that do not start", not_started),
        ];
        // Side by side, each with a machine of its own: a guardian reacts within seconds, and is
        // waited for.
        std::thread::scope(|scope| {
            for (number, (name, test)) in tests.into_iter().enumerate() {
                scope.spawn(move || {
                    let machine = format!("luna-machine-{}-{number}", std::process::id());
                    let machine = std::env::temp_dir().join(machine);
                    test(&machine);
                    let _ = fs::remove_file(&machine);
                    println!("test {name} ... ok");
                });
            }
        });
    }

    fn system() -> System {
        let mut system = System::new("guarded");
        system.guardian(Guardian::this_program());
        system
    }

    fn play(part: &str) {
        let machine = machine();
        match part {
            "moving" => {
                let mut system = system();
                let main = system.executor("main").build().unwrap();
                main.process("servo")
                    .spawn(async move {
                        set_output(&machine, "moving");
                        println!("moving");
                        std::future::pending().await
                    })
                    .unwrap();
                system.run().unwrap();
            }
            "forking" => {
                let mut system = system();
                let main = system.executor("main").build().unwrap();
                main.process("servo")
                    .spawn(async move {
                        set_output(&machine, "moving");
                        // SAFETY: the child only sleeps: it takes no lock and runs no handler of
                        // this program.
                        match unsafe { fork() }.unwrap() {
                            ForkResult::Child => loop {
                                pause();
                            },
                            ForkResult::Parent { child } => println!("{child}"),
                        }
                        std::future::pending().await
                    })
                    .unwrap();
                system.run().unwrap();
            }
            "orderly" => {
                let mut system = system();
                let main = system.executor("main").build().unwrap();
                main.process("servo")
                    .spawn(async move {
                        set_output(&machine, "neutral by the process");
                        Ok(())
                    })
                    .unwrap();
                system.run().unwrap();
            }
            "well" | "badly" => {
                let mut system = system();
                let is_well = part == "well";
                let own = machine.clone();
                // A file is written there: a busy disk takes its time.
                system.on_emergency_within("neutral", Duration::from_secs(30), move || {
                    if is_well {
                        set_output(&own, "neutral by the function");
                    } else {
                        panic!("the device does not answer");
                    }
                });
                let main = system.executor("main").build().unwrap();
                main.process("servo")
                    .spawn(async move {
                        set_output(&machine, "moving");
                        Err(luna::emergency(Error::other("now")))
                    })
                    .unwrap();
                system.run().unwrap_err();
            }
            other => panic!("no part {other}"),
        }
    }

    fn start(part: &str, machine: &Path) -> std::process::Child {
        Command::new(std::env::current_exe().unwrap())
            .env(PART, part)
            .env(MACHINE, machine)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// Waits until the machine outputs this. The guardian is no child of this process any more, so
    /// it cannot be waited on.
    fn await_output(machine: &Path, expected: &str) {
        let patience = std::time::Instant::now();
        while output(machine) != expected {
            assert!(
                patience.elapsed() < Duration::from_secs(60),
                "{}",
                output(machine)
            );
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn killed(machine: &Path) {
        let rounds = std::env::var("LUNA_KILLS").ok();
        let rounds = rounds.and_then(|rounds| rounds.parse().ok()).unwrap_or(10);
        for round in 0..rounds {
            set_output(machine, "off");
            let mut child = start("moving", machine);
            let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
            assert_eq!(lines.next().unwrap().unwrap(), "moving");
            std::thread::sleep(Duration::from_micros(round * 97 % 1000));
            // By SIGKILL.
            child.kill().unwrap();
            child.wait().unwrap();
            await_output(machine, "neutral by the guardian");
        }
    }

    /// A bare `fork` copies the pipe's end, which so outlives the program.
    fn outlived_by_a_copy(machine: &Path) {
        set_output(machine, "off");
        let mut child = start("forking", machine);
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let copy = lines.next().unwrap().unwrap().parse().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        await_output(machine, "neutral by the guardian");
        // It still pauses, so its number is its own.
        kill(Pid::from_raw(copy), Signal::SIGKILL).unwrap();
    }

    fn orderly(machine: &Path) {
        assert!(start("orderly", machine).wait().unwrap().success());
        // The guardian has ended before the system's run did.
        assert_eq!(output(machine), "neutral by the process");
    }

    fn emergencies(machine: &Path) {
        assert!(start("well", machine).wait().unwrap().success());
        assert_eq!(output(machine), "neutral by the function");
        assert!(start("badly", machine).wait().unwrap().success());
        assert_eq!(output(machine), "neutral by the guardian");
    }

    fn lost(_: &Path) {
        for is_strict in [false, true] {
            let mut system = System::new("unguarded");
            if is_strict {
                system.strict();
            }
            system.guardian(Guardian::command("sh").arg("-c").arg("echo ready"));
            let safety = system.safety();
            let main = system.executor("main").build().unwrap();
            main.process("patient")
                .spawn(async move {
                    while safety.degree() == Degree::Normal {
                        luna::after(Duration::from_millis(1)).await;
                    }
                    Ok(())
                })
                .unwrap();
            let outcome = system.run();
            assert_eq!(outcome.is_err(), is_strict, "{outcome:?}");
            let latched = system.safety().state().latched.unwrap();
            assert_eq!(latched.cause, Cause::GuardianLost);
        }
    }

    fn not_started(_: &Path) {
        for guardian in [
            Guardian::command("/there/is/no/such/program"),
            Guardian::command("true"),
        ] {
            let mut system = System::new("unguarded");
            system.guardian(guardian);
            let error = system.run().unwrap_err();
            assert!(
                matches!(error, Error::Setup(SetupError::Guardian { .. })),
                "{error}"
            );
        }
    }
}
