//! Recordings that the demo makes, and what is asked of them in a wrong way.

use crate::run::{command, file, luna, text};

/// Each program that reads a recording of the logger or a replay log distinguishes them.
#[test]
fn a_recording_and_a_replay_log_are_told_apart() {
    let (log, replay) = (file("apart.luna"), file("apart.replay"));
    let [log, replay] = [&log, &replay].map(|path| path.to_str().expect("a path of this test"));
    let demo = ["demo", "--seconds", "0.01", "--calibrated", "--virtual"];
    let made = luna(&[&demo[..], &["--record", replay, "--log", log]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let of_logger = ("is a recording of the logger (.luna)", "luna scope");
    let of_replay = ("is a replay log (.replay)", "luna demo --replay");
    for (arguments, (what, instead)) in [
        (&["demo", "--replay", log][..], of_logger),
        (&["convert", replay, "--to", "csv"], of_replay),
        (&["scope", replay, "--listen", "127.0.0.1:0"], of_replay),
    ] {
        let output = luna(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(what) && error.contains(instead), "{error}");
    }
}

/// A name that says another kind of file than what would be in it is refused by each program that
/// makes one, and nothing is written.
#[test]
fn a_name_of_the_other_kind_of_file_is_refused() {
    let (log, replay) = (file("other-kind.luna"), file("other-kind.replay"));
    let is_replay = ("replay log", replay.to_str().expect("a path of this test"));
    let is_log = ("recording of", log.to_str().expect("a path of this test"));
    let demo = ["demo", "--seconds", "0.01", "--calibrated", "--virtual"];
    let with = |more: &[&str]| luna(&[&demo[..], more].concat());
    let by_variable = command(&demo)
        .env("LUNA_LOG", &replay)
        .output()
        .expect("the program starts");
    let record = ["record", "--listen", "127.0.0.1:0", "--once", "-o"];
    for (output, code, (kind, path)) in [
        (with(&["--log", is_replay.1]), 2, is_replay),
        (with(&["--record", is_log.1]), 2, is_log),
        (luna(&[&record[..], &[is_replay.1]].concat()), 2, is_replay),
        (by_variable, 1, is_replay),
    ] {
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{error}");
        for part in [kind, path, ".luna", ".replay"] {
            assert!(error.contains(part), "{part} in {error}");
        }
    }
    assert!(!log.exists() && !replay.exists());
}

/// The report and an error name the file that `--log` names.
#[test]
fn the_demo_names_the_file_that_it_records_to() {
    let log = file("named.luna");
    let log = log.to_str().expect("a path of this test");
    let demo = ["demo", "--seconds", "0.01", "--calibrated", "--virtual"];
    let scope = ["--scope", "127.0.0.1:0"];
    for more in [&[][..], &scope] {
        let made = luna(&[&demo[..], &["--replace", "--log", log], more].concat());
        let said = text(&made.stdout);
        assert!(said.contains(&format!(" to {log} (")), "{said}");
    }
    if cfg!(target_os = "linux") {
        let failed = luna(&[&demo[..], &["--log", "/dev/full"]].concat());
        let error = text(&failed.stderr);
        assert!(error.contains("cannot record to /dev/full: "), "{error}");
    }
}

/// On a virtual clock a cycle and all of its samples have one time: a row for each cycle has what a
/// row for each instant has.
#[test]
fn a_row_of_a_cycle_has_the_samples_of_that_cycle_on_a_virtual_clock() {
    let log = file("cycles.luna");
    let log = log.to_str().expect("a path of this test");
    let demo = ["demo", "--seconds", "0.01", "--calibrated", "--virtual"];
    let made = luna(&[&demo[..], &["--log", log]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let table = |name: &str, more: &[&str]| {
        let to = file(name);
        let to = to.to_str().expect("a path of this test");
        let converted = luna(&[&["convert", log, "--to", "csv", "-o", to], more].concat());
        assert!(converted.status.success(), "{}", text(&converted.stderr));
        std::fs::read_to_string(to).expect("a table")
    };
    let cycles = table("cycles.csv", &["--per-cycle", "timer"]);
    assert_eq!(cycles, table("default.csv", &[]));
    assert_eq!(cycles, table("instants.csv", &["--per-sample"]));
    assert_eq!(cycles.lines().count(), 1 + 10, "{cycles}");
    for (number, row) in (1..).zip(cycles.lines().skip(1)) {
        assert!(row.starts_with(&format!("0.{number:03}000000,")), "{row}");
        assert!(!row.split(',').any(str::is_empty), "{row}");
    }
}

/// Rows and cells are CSV's alone, and a time does not end before it begins.
#[test]
fn options_that_have_no_effect_are_refused() {
    let log = file("options.luna");
    let log = log.to_str().expect("a path of this test");
    let demo = ["demo", "--seconds", "0.01", "--calibrated", "--virtual"];
    let made = luna(&[&demo[..], &["--log", log]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let mut cases = vec![
        ("perfetto", &["--per-cycle", "timer"][..], "--to csv"),
        ("perfetto", &["--per-sample"], "--to csv"),
        ("perfetto", &["--hold"], "--to csv"),
        ("csv", &["--from", "2", "--until", "1"], "later than --from"),
        ("csv", &["--from", "1", "--until", "1"], "later than --from"),
    ];
    if cfg!(feature = "mcap") {
        cases.push(("mcap", &["--per-cycle", "timer"], "--to csv"));
        cases.push(("mcap", &["--hold"], "--to csv"));
    }
    let to = file("options.out");
    // Of an earlier run that has failed.
    let _ = std::fs::remove_file(&to);
    let path = to.to_str().expect("a path of this test");
    for (format, options, why) in cases {
        let convert = ["convert", log, "--to", format, "-o", path];
        let output = luna(&[&convert[..], options].concat());
        let error = text(&output.stderr);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{format} {options:?}: {error}"
        );
        assert!(
            error.contains(options[0]) && error.contains(why),
            "{options:?}: {error}"
        );
        assert!(!to.exists(), "{format} {options:?}");
    }
}
