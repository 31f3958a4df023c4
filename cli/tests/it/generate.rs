//! `luna model generate`: what it makes of a model compiles, runs, and is kept where it is written
//! by hand.

use crate::is_long;
use crate::package::{folder, lock, run_cargo, workspace};
use crate::run::{self, example, luna_model, path, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

#[path = "../../../tools/model/tests/it/random.rs"]
pub(crate) mod random;

fn command(model: &Path, folder: &Path, options: &[&str]) -> Output {
    luna_model(&[&["generate", path(model), "-o", path(folder)], options].concat())
}

/// What the command says of each file: `written`, `unchanged` or `kept`, and its path.
pub(crate) fn generate(model: &Path, folder: &Path) -> String {
    let luna = workspace().display().to_string();
    let output = command(model, folder, &["--luna", &luna]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    lock(folder);
    text(&output.stdout).to_owned()
}

pub(crate) fn build(folder: &Path) {
    let output = run_cargo(folder, "build", &[]);
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(!said.contains("warning"), "{said}");
}

/// The report of a run, which is to end with this exit code.
fn run(folder: &Path, seconds: &str, code: i32) -> String {
    let output = run_cargo(folder, "run", &["--quiet", "--", "--seconds", seconds]);
    let said = text(&output.stdout);
    let errors = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}{errors}");
    said.to_owned()
}

/// Whether a line says this of this file.
fn says(said: &str, what: &str, file: &str) -> bool {
    let mut lines = said.lines();
    lines.any(|line| line.starts_with(what) && line.contains(file))
}

#[test]
fn jiwy_runs_and_keeps_what_is_written_by_hand() {
    let folder = folder("jiwy");
    let said = generate(&example("jiwy.toml"), &folder);
    for file in [
        "src/generated/system.rs",
        "src/processes/motor.rs",
        "src/types.rs",
        "Cargo.toml",
    ] {
        assert!(says(&said, "written", file), "{said}");
    }
    build(&folder);
    let report = run(&folder, "1", 0);
    assert!(
        report.contains("system `jiwy`") && report.contains("\ntimer "),
        "{report}"
    );

    // A person changes a process; the model stays, and then it changes.
    let motor = folder.join("src/processes/motor.rs");
    let mut by_hand = fs::read_to_string(&motor).expect("it was generated");
    by_hand.push_str("\n// By hand.\n");
    fs::write(&motor, &by_hand).expect("it is writable");
    let said = generate(&example("jiwy.toml"), &folder);
    assert!(says(&said, "kept", "src/processes/motor.rs"), "{said}");
    assert!(
        says(&said, "unchanged", "src/generated/system.rs"),
        "{said}"
    );
    assert_eq!(fs::read_to_string(&motor).expect("it is there"), by_hand);

    let model = fs::read_to_string(example("jiwy.toml")).expect("the model is there");
    let changed = model
        .replace("[process.Limits]", "[process.Bounds]")
        .replace("process = \"Limits\"", "process = \"Bounds\"")
        .replace(
            "ports = { bridge = \"receive\" }",
            "ports = { bridge = \"receive\", power = \"receive\" }",
        )
        .replace(
            "bind = { bridge = \"bridge\" }",
            "bind = { bridge = \"bridge\", power = \"bridge\" }",
        )
        .replace("safe = { type = \"Duty\" }", "safe = { type = \"Safe\" }");
    let file = folder.join("changed.toml");
    fs::write(&file, changed).expect("it is writable");
    let said = generate(&file, &folder);
    assert!(says(&said, "written", "src/generated/system.rs"), "{said}");
    assert!(says(&said, "written", "src/processes/bounds.rs"), "{said}");
    let gone = "src/processes/limits.rs: no process of the model has this file";
    assert!(says(&said, "kept", gone), "{said}");
    assert!(
        said.contains("src/types.rs: `Safe`: define it there"),
        "{said}"
    );
    assert_eq!(fs::read_to_string(&motor).expect("it is there"), by_hand);
    let output = run_cargo(&folder, "build", &[]);
    let said = text(&output.stderr);
    assert!(!output.status.success(), "{said}");
    assert!(
        said.contains("pattern does not mention field `power`"),
        "{said}"
    );
    assert!(said.contains("processes/motor.rs"), "{said}");
}

#[test]
fn each_statement_compiles_and_runs() {
    let folder = folder("everything");
    let model = workspace().join("tools/model/tests/it/everything.toml");
    generate(&model, &folder);
    build(&folder);
    run(&folder, "0.2", 0);
}

/// Bodies that no person writes. With LUNA_LONG=1 a hundred of them, else two.
#[test]
fn random_models_compile_without_a_warning() {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    let seed: u64 = seed.unwrap_or(20_261_121);
    for number in 0..if is_long() { 100 } else { 2 } {
        let model = random::model(&mut random::Random(seed.wrapping_add(number)));
        println!("LUNA_SEED={}\n{model}", seed.wrapping_add(number));
        let folder = folder("random");
        fs::create_dir_all(folder.parent().expect("it has one")).expect("it is made");
        let file = folder.with_extension("toml");
        fs::write(&file, model).expect("it is writable");
        generate(&file, &folder);
        build(&folder);
    }
}

#[test]
fn a_deadlock_ends_at_the_limit_and_names_what_waits() {
    let folder = folder("philosophers");
    generate(&example("philosophers.toml"), &folder);
    build(&folder);
    let report = run(&folder, "2", 1);
    for part in [
        "still waited: `philosopher[4]` to send on `right[4]`",
        "still waited: `fork[0]` to receive from `left_back[0]`",
        "system `philosophers` is deadlocked",
    ] {
        assert!(report.contains(part), "{part}: {report}");
    }
}

#[test]
fn what_is_generated_is_formatted() {
    if Command::new("rustfmt").arg("--version").output().is_err() {
        println!("skipped: rustfmt is missing");
        return;
    }
    let folder = folder("formatted");
    let everything = workspace().join("tools/model/tests/it/everything.toml");
    generate(&everything, &folder);
    let main = folder.join("src/main.rs");
    let output = Command::new("rustfmt")
        .args(["--check", "--edition", "2024"])
        .arg(main)
        .output();
    let output = output.expect("it starts");
    assert!(output.status.success(), "{}", text(&output.stdout));
}

#[test]
fn a_folder_of_something_else_is_left_alone() {
    let folder = folder("other");
    fs::create_dir_all(&folder).expect("it is made");
    fs::write(folder.join("letter.txt"), "dear").expect("it is writable");
    let output = command(&example("sieve.toml"), &folder, &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("the folder holds something else"));
    assert_eq!(fs::read_dir(&folder).expect("it is there").count(), 1);

    fs::create_dir_all(folder.join("src/generated")).expect("it is made");
    fs::write(folder.join("src/generated/mod.rs"), "mine").expect("it is writable");
    let output = command(&example("sieve.toml"), &folder, &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("this file was not generated"));

    let file = folder.join("letter.txt");
    let output = command(&example("sieve.toml"), &file, &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("letter.txt"));
}

/// What stands in the way is found before anything is written.
#[test]
fn a_folder_in_place_of_a_file_is_refused_at_once() {
    let folder = folder("in-the-way");
    generate(&example("sieve.toml"), &folder);
    let system = folder.join("src/generated/system.rs");
    fs::remove_file(&system).expect("it was generated");
    let last = folder.join("src/processes/printer.rs");
    fs::remove_file(&last).expect("it was generated");
    fs::create_dir(&last).expect("it is made");
    let output = command(&example("sieve.toml"), &folder, &[]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(said.contains("printer.rs: this is no file"), "{said}");
    assert!(!system.exists(), "nothing was written");
}

#[test]
fn a_library_for_an_existing_package_is_noted() {
    let folder = folder("other-library");
    let said = generate(&example("sieve.toml"), &folder);
    assert!(!said.contains("--luna"), "{said}");
    let said = generate(&example("sieve.toml"), &folder);
    assert!(!said.contains("--luna"), "{said}");
    let manifest = folder.join("Cargo.toml");
    let text = fs::read_to_string(&manifest).expect("it was generated");
    let own = text.replace("luna-rt = {", "luna-rt = { version = \"1\",");
    fs::write(&manifest, own).expect("it is writable");
    let said = generate(&example("sieve.toml"), &folder);
    assert!(says(&said, "kept", "Cargo.toml"), "{said}");
    assert!(said.contains("Cargo.toml: --luna is not used"), "{said}");
}

#[test]
fn the_library_is_found_or_stated() {
    let folder = folder("library");
    let output = command(&example("sieve.toml"), &folder, &["--luna", "/"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("this is no checkout of LUNA"));
    assert!(!folder.exists(), "nothing was written");

    // Tests run in a package of the checkout.
    assert_eq!(
        command(&example("sieve.toml"), &folder, &[]).status.code(),
        Some(0)
    );
    let manifest = fs::read_to_string(folder.join("Cargo.toml")).expect("it was written");
    assert!(manifest.contains("luna-rt = { path = "), "{manifest}");
}

#[test]
fn a_closed_output_and_hidden_files_are_no_obstacle() {
    let folder = folder("hidden");
    fs::create_dir_all(folder.join(".git")).expect("the folder is made");
    let luna = workspace().display().to_string();
    let mut child = run::command(&["model", "generate", "--luna", &luna, "-o"])
        .arg(&folder)
        .arg(example("commstime.toml"))
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("the program starts");
    drop(child.stdout.take());
    child.wait().expect("the program ends");
    // All was written before the first line was printed.
    for file in [
        "Cargo.toml",
        "src/main.rs",
        "src/generated/system.rs",
        "src/processes/delta.rs",
    ] {
        assert!(folder.join(file).is_file(), "{file}");
    }
    let temporary = fs::read_dir(folder.join("src")).expect("it can be read");
    let mut names = temporary.map(|entry| entry.expect("it can be read").file_name());
    assert!(names.all(|name| !name.as_encoded_bytes().starts_with(b".")));
}
