//! The command `lab`, as users call it. Tests that boot a guest are skipped, by name, where QEMU or
//! the guest's kernel is missing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn lab(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
    command.args(arguments).output().expect("it was built")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Whether guests can be booted; if not, says that the test is skipped.
fn can_boot(test: &str) -> bool {
    // What a guest needs is looked at before the files that it is to have.
    let said = text(&lab(&["run", "/no/such/file", "--", "true"]).stderr);
    let can_boot = said.starts_with("/no/such/file");
    if !can_boot {
        println!("skipped: {test}: {}", said.trim());
    }
    can_boot
}

#[test]
fn without_arguments_it_prints_its_usage() {
    for arguments in [&[][..], &["boot"], &["--help"]] {
        let output = lab(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(
            text(&output.stderr).contains("Usage: lab setup"),
            "{arguments:?}"
        );
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn what_is_missing_is_said_by_name_and_nothing_is_judged() {
    let nothing = tempfile::tempdir().unwrap();
    let without = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
        command
            .env("LUNA_LAB", nothing.path())
            .env("PATH", nothing.path());
        command.args(arguments).output().expect("it was built")
    };
    let run = without(&["run", "--", "true"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(
        text(&run.stderr).contains("qemu-system-x86_64 is missing"),
        "{run:?}"
    );
    let gate = without(&["exact", "gate"]);
    assert_eq!(gate.status.code(), Some(0), "{gate:?}");
    assert!(
        text(&gate.stdout).starts_with("skipped: exact latencies: "),
        "{gate:?}"
    );
    let test = without(&["test", "amd64"]);
    assert_eq!(test.status.code(), Some(0), "{test:?}");
    assert!(
        text(&test.stdout).starts_with("skipped: tests on PREEMPT_RT: "),
        "{test:?}"
    );
    let setup = without(&["setup"]);
    assert_eq!(setup.status.code(), Some(2));
    assert!(text(&setup.stderr).contains("qemu-system-x86"), "{setup:?}");
    assert_eq!(fs::read_dir(nothing.path()).unwrap().count(), 0);
}

#[test]
fn a_guest_runs_programs_of_the_user() {
    if !can_boot("a_guest_runs_programs_of_the_user") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // A name that a shell would take apart, and a program with a library that the guest's packages
    // do not have.
    let odd = folder.path().join("a file; poweroff -f");
    fs::write(&odd, "as it is").unwrap();
    let mut arguments = vec![
        "run",
        "--exact",
        "1",
        "--timeout",
        "300",
        odd.to_str().unwrap(),
    ];
    let built = program_with_library(folder.path());
    let files: Vec<_> = built
        .iter()
        .flatten()
        .map(|path| path.to_str().unwrap())
        .collect();
    if let [program, _] = files[..] {
        let output = lab(&["run", program, "--", "true"]);
        assert_eq!(output.status.code(), Some(2));
        let said = text(&output.stderr);
        assert!(
            said.contains("program needs libanswer.so, which is in none of"),
            "{said}"
        );
    }
    arguments.extend(&files);
    let commands = match built {
        Some(_) => {
            "cat '/lab/a file; poweroff -f'; echo; uname -v; /lab/program; echo 'lab>>> 0'; exit 7"
        }
        None => "cat '/lab/a file; poweroff -f'; echo; uname -v; echo 'lab>>> 0'; exit 7",
    };
    arguments.extend(["--", commands]);
    let output = lab(&arguments);
    let printed = text(&output.stdout);
    assert_eq!(
        output.status.code(),
        Some(7),
        "{printed}\n{}",
        text(&output.stderr)
    );
    let lines: Vec<_> = printed.lines().collect();
    assert_eq!(lines[0], "as it is", "{printed}");
    assert!(lines[1].contains("PREEMPT_RT"), "{printed}");
    assert_eq!(*lines.last().unwrap(), "lab>>> 0", "{printed}");
    if built.is_some() {
        assert_eq!(lines[2], "the answer is 42", "{printed}");
    }
}

/// A program that needs a shared library of its own, and the library; `None` without a C compiler.
fn program_with_library(folder: &Path) -> Option<[PathBuf; 2]> {
    let sources = [
        ("answer.c", "int answer(void) { return 42; }"),
        (
            "program.c",
            "#include <stdio.h>\nint answer(void);\n\
             int main(void) { printf(\"the answer is %d\\n\", answer()); return 0; }",
        ),
    ];
    for (name, source) in sources {
        fs::write(folder.join(name), source).unwrap();
    }
    let cc = |arguments: &[&str]| {
        let mut command = Command::new("cc");
        command
            .current_dir(folder)
            .args(arguments)
            .status()
            .is_ok_and(|status| status.success())
    };
    let is_built = cc(&["-shared", "-fPIC", "-o", "libanswer.so", "answer.c"])
        && cc(&["-o", "program", "program.c", "-L.", "-lanswer"]);
    if !is_built {
        println!("skipped: a program with a library of its own: a C compiler is missing");
        return None;
    }
    Some(["program", "libanswer.so"].map(|name| folder.join(name)))
}
