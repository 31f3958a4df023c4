//! What is there is not lost without being asked for, results are whole or not there, and a command
//! that could not do all that it was asked does not exit with 0.
#![cfg(target_os = "linux")]

use crate::run::{command, file, json, luna, path, programs, text};
use luna_logger::format::Reader;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

const RUN: [&str; 6] = [
    "demo",
    "--virtual",
    "--seconds",
    "0.05",
    "--calibrated",
    "--json",
];

fn demo(arguments: &[&str]) -> Output {
    luna(&[&RUN[..], arguments].concat())
}

/// A folder that one test alone has, and that is empty.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

#[track_caller]
fn refused(output: &Output, parts: &[&str]) {
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let said = text(&output.stderr);
    assert!(parts.iter().all(|part| said.contains(part)), "{said}");
}

#[test]
fn a_recording_that_is_there_is_replaced_on_request_alone() {
    for (option, name) in [("--log", "kept.luna"), ("--record", "kept.replay")] {
        let kept = file(name);
        fs::write(&kept, "evidence").unwrap();
        let output = demo(&[option, path(&kept)]);
        refused(&output, &["kept.", "there already"]);
        assert_eq!(fs::read(&kept).unwrap(), b"evidence");
        let output = demo(&[option, path(&kept), "--replace"]);
        assert!(output.status.success(), "{output:?}");
        assert!(fs::read(&kept).unwrap().len() > 1000);
    }
}

#[test]
fn a_conversion_that_is_there_is_replaced_on_request_alone() {
    let folder = folder("conversions");
    let recording = folder.join("run.luna");
    assert!(demo(&["--log", path(&recording)]).status.success());
    for format in ["csv", "perfetto"] {
        let output = folder.join("run.out");
        let to = [
            "convert",
            path(&recording),
            "--to",
            format,
            "-o",
            path(&output),
        ];
        fs::write(&output, "by hand").unwrap();
        refused(
            &command(&to).output().unwrap(),
            &["run.out", "there already", "--replace"],
        );
        assert_eq!(fs::read(&output).unwrap(), b"by hand");
        let replaced = luna(&to);
        assert!(replaced.status.success(), "{replaced:?}");
        assert_ne!(fs::read(&output).unwrap(), b"by hand");
    }
    // Nothing is left of what was written meanwhile.
    let names = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let left = names.filter(|name| name.to_string_lossy().ends_with(".part"));
    assert_eq!(left.count(), 0);
}

/// The limit of files stands for a full disk.
#[test]
fn a_conversion_that_cannot_be_written_leaves_nothing() {
    let folder = folder("limited-conversion");
    let recording = folder.join("run.luna");
    assert!(demo(&["--log", path(&recording)]).status.success());
    let output = folder.join("run.csv");
    let script = "ulimit -f 1; exec \"$0\" convert \"$1\" --to csv -o \"$2\"";
    let limited = std::process::Command::new("sh")
        .args(["-c", script])
        .args([env!("CARGO_BIN_EXE_luna"), path(&recording), path(&output)])
        .output()
        .unwrap();
    refused(&limited, &["File too large"]);
    let names: Vec<_> = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(names, ["run.luna"]);
}

#[test]
fn a_run_whose_log_cannot_be_written_is_no_success() {
    // Its head already is refused: nothing has begun.
    let output = demo(&["--log", "/dev/full"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    // It is refused while it runs: the run is complete, and its log is not.
    let folder = folder("limited-log");
    for machine in [&[][..], &["head"]] {
        let log = folder.join(format!("{}.luna", machine.len()));
        let script = "ulimit -f 16; exec \"$0\" \"$@\"";
        let mut limited = std::process::Command::new("sh");
        limited.args(["-c", script, env!("CARGO_BIN_EXE_luna"), "demo"]);
        limited
            .env("LUNA_PROGRAMS", programs())
            .args(machine)
            .args(["--virtual", "--seconds", "1", "--json"]);
        let output = limited.args(["--log", path(&log)]).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let said = text(&output.stderr);
        assert!(said.contains("is not complete: File too large"), "{said}");
        // What is there is whole.
        let bytes = fs::read(&log).unwrap();
        let mut reader = Reader::new(&bytes[..]).unwrap();
        while reader.next().unwrap().is_some() {}
        if machine.is_empty() {
            assert_eq!(json(&output)["complete"], true);
        }
    }
}

#[test]
fn a_result_that_cannot_be_printed_is_no_success() {
    let full = || fs::File::create("/dev/full").unwrap();
    let model = crate::run::example("commstime.toml");
    let model = crate::run::path(&model);
    for arguments in [
        &RUN[..],
        &["doctor", "--no-measure", "--no-self-test", "--json"],
        &["list"],
        &["jitter", "--loops", "10", "--policy", "other"],
        &["model", "draw", model, "-o", "-"],
        &["model", "check", model],
    ] {
        let output = command(arguments).stdout(full()).output().unwrap();
        assert!(!output.status.success(), "{arguments:?}: {output:?}");
    }
    let histogram = [
        "--loops",
        "10",
        "--policy",
        "other",
        "--histogram",
        "/dev/full",
    ];
    let output = luna(&[&["jitter"], &histogram[..]].concat());
    assert_eq!(output.status.code(), Some(2), "{output:?}");
}
