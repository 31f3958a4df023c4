//! What the compiler says of an alternative that is written as in other libraries.
//!
//! It checks a package of its own, so the test is left out where cargo does not run it, or where
//! the sources are not at hand.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// A branch, and what its one error says.
const WRONG: [(&str, &str); 5] = [
    (
        "v = s.recv().await => drop(v)",
        "RecvError>` is not a guard of an alternative",
    ),
    (
        "_ = all[0].recv().await => {}",
        "write the operation without `.await`: `recv()`",
    ),
    (
        "Ok(v) = s.recv() => drop(v)",
        "write `result = guard => match result { Ok(value) => .., ",
    ),
    (
        "Some(v) = s.recv(), if true => drop(v)",
        "the pattern `Some(v)` does not match every outcome",
    ),
    (
        "Ok(1 | 2) = s.recv() => {} skip => {}",
        "the pattern `Ok(1 | 2)` does not match every outcome",
    ),
];

#[test]
fn a_guard_that_is_awaited_and_a_pattern_that_may_not_match_are_one_error_in_words() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let Some(cargo) = std::env::var_os("CARGO").filter(|_| here.join("Cargo.toml").exists()) else {
        eprintln!("skipped: what the compiler says: cargo does not run this test");
        return;
    };
    // Beside what cargo builds, so that a second run takes its libraries from the first.
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("compile-errors");
    std::fs::create_dir_all(place.join("src/bin")).unwrap();
    let manifest = format!(
        "[package]\nname = \"wrong\"\nedition = \"2024\"\n[dependencies]\n\
         luna-channels = {{ path = {here:?} }}\n[workspace]\n"
    );
    std::fs::write(place.join("Cargo.toml"), manifest).unwrap();
    std::fs::copy(here.join("../Cargo.lock"), place.join("Cargo.lock")).unwrap();
    for (number, (branch, _)) in WRONG.iter().enumerate() {
        let mut program = String::from("use luna_channels::{Receiver, alt};\n");
        let _ = write!(
            program,
            "pub async fn choose(s: &Receiver<u8>, all: &[Receiver<u8>]) {{\n\
             let _ = (s, all);\nalt! {{ {branch} }}\n}}\nfn main() {{}}\n"
        );
        std::fs::write(place.join(format!("src/bin/n{number}.rs")), program).unwrap();
    }
    for (number, (branch, says)) in WRONG.iter().enumerate() {
        let output = Command::new(&cargo)
            .args([
                "check",
                "--offline",
                "--quiet",
                "--bin",
                &format!("n{number}"),
            ])
            .current_dir(&place)
            .env("CARGO_TARGET_DIR", place.join("target"))
            .env_remove("RUSTFLAGS")
            .output()
            .unwrap();
        let report = String::from_utf8_lossy(&output.stderr);
        let is_error =
            |line: &&str| line.starts_with("error") && !line.contains("could not compile");
        let errors: Vec<&str> = report.lines().filter(is_error).collect();
        assert_eq!(errors.len(), 1, "{branch}\n{report}");
        assert!(report.contains(says), "{branch}\n{report}");
    }
}
