//! `luna doctor` as its users meet it: on this machine, whatever it is, and on another's files.

use crate::run::{json, luna, text};
use serde_json::Value;
use std::path::PathBuf;
use std::process::Output;

fn doctor(arguments: &[&str]) -> Output {
    luna(&[&["doctor"], arguments].concat())
}

/// The findings of one part: (name, verdict).
fn part<'a>(diagnosis: &'a Value, part: &str) -> Vec<(&'a str, &'a str)> {
    let findings = diagnosis["findings"].as_array().expect("findings");
    let of_part = findings.iter().filter(|finding| finding["part"] == part);
    of_part
        .map(|finding| {
            let word = |key: &str| finding[key].as_str().expect("a word");
            (word("name"), word("verdict"))
        })
        .collect()
}

#[test]
fn this_machine_is_examined_measured_and_tested() {
    let output = doctor(&["--quick", "--json"]);
    let diagnosis = json(&output);
    let code = output.status.code().expect("an exit code");
    assert_eq!(diagnosis["exit_code"], code, "{diagnosis}");
    // Whatever the machine is like, the library works on it.
    assert_ne!(diagnosis["fitness"], "broken", "{diagnosis}");
    assert_eq!(diagnosis["schema"], 2);
    // What a self-test provokes on purpose is not printed.
    let errors = text(&output.stderr);
    assert!(!errors.contains("luna: process"), "{errors}");
    assert_eq!(diagnosis["this_machine"], true);
    for (of, at_least) in [("machine", 37), ("measurement", 5), ("self_test", 28)] {
        let findings = part(&diagnosis, of);
        assert!(findings.len() >= at_least, "{of}: {findings:?}");
    }
    let all = diagnosis["findings"].as_array().expect("findings");
    for finding in all {
        let is_good = finding["verdict"] == "good";
        assert_eq!(finding["advice"].is_null(), is_good, "{finding}");
        for key in ["name", "read", "from", "why"] {
            assert!(
                finding[key].as_str().is_some_and(|text| !text.is_empty()),
                "{key}: {finding}"
            );
        }
        if let Some(times) = finding["ns"].as_object() {
            let times = ["min", "p50", "p99", "max"].map(|key| times[key].as_u64());
            assert!(
                times.iter().all(Option::is_some) && times.is_sorted(),
                "{finding}"
            );
        }
    }
    let sum = |key: &str| -> u64 {
        let counts = diagnosis[key].as_object().expect("counts");
        counts.values().filter_map(Value::as_u64).sum()
    };
    let self_tests = part(&diagnosis, "self_test").len();
    assert_eq!(sum("self_tests"), self_tests as u64);
    assert_eq!(sum("counts"), (all.len() - self_tests) as u64);
}

#[test]
fn the_table_of_this_machine() {
    let output = doctor(&["--no-measure", "--no-self-test", "--explain"]);
    let table = text(&output.stdout);
    for part in [
        "the machine",
        "preemption",
        "clock-source",
        "why:",
        "Exit code",
    ] {
        assert!(table.contains(part), "{part} in:\n{table}");
    }
    assert!(!table.contains("self-test\n") && !table.contains("measured\n"));
    let longest = table.lines().map(|line| line.chars().count()).max();
    assert!(longest <= Some(110), "{longest:?} in:\n{table}");
}

#[test]
fn another_machines_files() {
    let root = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("another");
    for (file, text) in [
        ("proc/sys/kernel/osrelease", "6.12.9\n"),
        ("proc/sys/kernel/version", "#1 SMP PREEMPT_RT\n"),
        ("proc/self/status", "CapEff:\t0\nCpus_allowed_list:\t0-3\n"),
        (
            "proc/self/limits",
            "Max realtime priority 99 99\nMax locked memory unlimited unlimited\n",
        ),
        ("sys/devices/system/cpu/online", "0-3\n"),
        ("sys/devices/system/cpu/isolated", "2\n"),
    ] {
        let path = root.join(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    }
    let root = root.to_str().expect("a path");
    let output = doctor(&["--root", root, "--json"]);
    let diagnosis = json(&output);
    assert_eq!(output.status.code(), Some(0), "{diagnosis}");
    assert_eq!(diagnosis["core"], 2);
    assert_eq!(diagnosis["this_machine"], false);
    let machine = part(&diagnosis, "machine");
    assert!(machine.contains(&("preemption", "good")), "{machine:?}");
    assert!(machine.contains(&("throttling", "unknown")), "{machine:?}");
    // This machine's speed is not that one's.
    assert!(part(&diagnosis, "measurement").is_empty());
    assert!(part(&diagnosis, "self_test").is_empty());

    let limits = PathBuf::from(root).join("proc/self/limits");
    std::fs::write(limits, "Max realtime priority 0 0\n").expect("a file");
    assert_eq!(doctor(&["--root", root]).status.code(), Some(1));
    // Nothing is bad where nothing could be read, but fitness is not shown either.
    let nothing = doctor(&["--root", env!("CARGO_TARGET_TMPDIR")]);
    assert_eq!(nothing.status.code(), Some(4));

    let no_core = doctor(&["--root", root, "--core", "4"]);
    assert_eq!(no_core.status.code(), Some(2));
    assert!(text(&no_core.stderr).contains("0-3"), "{no_core:?}");
}

#[test]
fn bad_arguments_end_with_2() {
    for (arguments, part) in [
        (&["--root", "/no/such/folder"][..], "/no/such/folder"),
        (&["--core", "one"], "--core"),
        (&["--fast"], "--fast"),
    ] {
        let output = doctor(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(part), "{arguments:?}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn help_says_the_exit_codes_and_the_keys() {
    let output = doctor(&["--help"]);
    let help = text(&output.stdout);
    for part in [
        "Exit codes: 0 fit",
        "1 unfit",
        "3 broken",
        "fitness",
        "--root",
        "verdict",
    ] {
        assert!(help.contains(part), "{part} in:\n{help}");
    }
}
