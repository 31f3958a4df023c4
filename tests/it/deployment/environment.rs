//! Where the program names no file, the environment may.

use super::*;
use std::process::Command;

/// What a child of the next test does: the program names no file.
#[test]
fn part() {
    let Some(name) = common::part() else { return };
    let mut system = System::new("machine");
    if name == "another" {
        let file = TempFile::with("another", "[executor.main]\npolicy = \"fifo:8\"\n");
        system.deployment_from(&file.0).unwrap();
    }
    match system.executor("main").build() {
        Ok(_) => {
            let composition = system.composition();
            println!("it has {}", thread(&composition, "main").policy);
        }
        Err(error) => println!("{error}"),
    }
}

#[test]
fn the_environment_names_a_file_where_the_program_does_not() {
    let _watch = watchdog();
    let good = TempFile::with("good", "[executor.main]\npolicy = \"fifo:7\"\n");
    let bad = TempFile::with("bad", "\n[executor.main]\ncore = -1\n");
    let wrong = format!(
        "{}:3:8: this number is out of range: `-1`; write one from 0 to 4095; LUNA_DEPLOYMENT names \
         this file, also for the system `machine`",
        bad.0.display()
    );
    let unreadable = "; LUNA_DEPLOYMENT names this file, also for the system `machine`";
    for (file, part, line) in [
        (good.0.display().to_string(), "none", "it has fifo:7"),
        (good.0.display().to_string(), "another", "it has fifo:8"),
        (String::new(), "none", "it has other"),
        (bad.0.display().to_string(), "none", &*wrong),
        ("/nowhere/system.toml".to_owned(), "none", unreadable),
    ] {
        let mut program = Command::new(std::env::current_exe().unwrap());
        program.env("LUNA_DEPLOYMENT", file);
        let ended = common::Program::start_by(program, "deployment::environment::part", part).end();
        assert!(ended.output.contains(line), "{ended:?}");
    }
}
