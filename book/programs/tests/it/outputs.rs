//! What each program prints is what the book shows.
//!
//! `outputs/NAME.txt` is all that `src/bin/NAME.rs` prints. `outputs/NAME.measured.txt` is for a
//! program that measures: each of its lines is printed, in this order, and figures with their units
//! may differ. Every program has one of the two. `NAME_theirs` is the same in another framework: it
//! prints what `NAME` does.

use crate::files;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");

/// Where cargo has put the programs.
const BESIDE: &str = env!("CARGO_BIN_EXE_hello");

const UNITS: [&str; 8] = ["ns", "us", "µs", "ms", "s", "%", "bytes", "KiB"];

/// A line without what a measurement decides.
fn pattern(line: &str) -> String {
    let mut kept: Vec<&str> = Vec::new();
    for word in line.split_whitespace() {
        let figure = word.trim_start_matches(['(', '-']);
        let is_figure = figure.starts_with(|first: char| first.is_ascii_digit());
        match kept.last() {
            Some(&"#") if UNITS.contains(&word.trim_end_matches([',', ';', ')'])) => {}
            _ if is_figure => kept.push("#"),
            _ => kept.push(word),
        }
    }
    kept.join(" ")
}

/// Fails if `expected` is not in `printed`, line by line.
fn compare_measured(name: &str, expected: &str, printed: &str) {
    let mut lines = printed.lines().map(pattern);
    for line in expected.lines().map(pattern) {
        assert!(
            lines.any(|printed| printed == line),
            "{name} does not print `{line}` where the book shows it, but:\n{printed}"
        );
    }
}

#[test]
fn programs_print_what_the_book_shows() {
    let outputs = Path::new(FOLDER).join("outputs");
    let programs = files(&Path::new(FOLDER).join("src/bin"), "rs");
    assert!(programs.len() >= 8);
    for program in &programs {
        let name = program.file_stem().unwrap().to_str().unwrap();
        let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        // What an earlier run of the tests has recorded would be kept.
        let _ = fs::remove_dir_all(&place);
        fs::create_dir_all(&place).unwrap();
        let output = Command::new(Path::new(BESIDE).with_file_name(name))
            .current_dir(&place)
            .env_remove("LUNA_LOG")
            .output()
            .unwrap();
        let printed = String::from_utf8(output.stdout).unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name}: {errors}\n{printed}");
        let shown = name.trim_end_matches("_theirs");
        let exact = outputs.join(format!("{shown}.txt"));
        let measured = outputs.join(format!("{name}.measured.txt"));
        // Makes the files: read them before they are committed. Measurements are cut by hand.
        if env::var_os("LUNA_BOOK_WRITE").is_some() && !measured.exists() {
            fs::write(&exact, &printed).unwrap();
        }
        if let Ok(expected) = fs::read_to_string(&measured) {
            compare_measured(name, &expected, &printed);
        } else {
            let expected = fs::read_to_string(&exact)
                .unwrap_or_else(|error| panic!("{}: {error}", exact.display()));
            assert_eq!(printed, expected, "{name}");
        }
    }
    for shown in files(&outputs, "txt") {
        let name = shown.file_name().unwrap().to_str().unwrap();
        let of =
            |program: &PathBuf| program.file_stem().unwrap().to_str() == name.split('.').next();
        assert!(programs.iter().any(of), "{name} is of no program");
    }
}

#[test]
fn patterns_ignore_figures_alone() {
    assert_eq!(
        pattern("fifo:80: half within 12 us,"),
        "fifo:80: half within #"
    );
    assert_eq!(pattern("a   1.2 ms  b"), "a # b");
    assert_ne!(
        pattern("the axis is at 1.2 rad"),
        pattern("the axis is at 1.2 m")
    );
}

/// The other side of a page, where its tools are there.
#[test]
fn their_go_prints_the_same() {
    let folder = Path::new(FOLDER).join("theirs/go");
    let Ok(output) = Command::new("go")
        .args(["run", "."])
        .current_dir(&folder)
        .output()
    else {
        println!("skipped: the program in Go: go is missing");
        return;
    };
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let expected = fs::read(Path::new(FOLDER).join("outputs/from_go.txt")).unwrap();
    assert_eq!(output.stdout, expected);
}
