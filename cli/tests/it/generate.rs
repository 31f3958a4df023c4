//! `luna model generate`: what it makes of a model compiles, runs, and is kept where it is written
//! by hand.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

#[path = "../../../tools/model/tests/it/random.rs"]
pub(crate) mod random;

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub(crate) fn example(name: &str) -> PathBuf {
    workspace().join("examples/models").join(name)
}

pub(crate) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("output is text")
}

/// A folder of one test, which is not there.
pub(crate) fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("generated")
        .join(name);
    let _ = fs::remove_dir_all(&path);
    path
}

fn command(model: &Path, folder: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_luna"))
        .args(["model", "generate"])
        .arg(model)
        .arg("-o")
        .arg(folder)
        .args(options)
        .output()
        .expect("the program starts")
}

/// What the command says of each file: `written`, `unchanged` or `kept`, and its path.
pub(crate) fn generate(model: &Path, folder: &Path) -> String {
    let luna = workspace().display().to_string();
    let output = command(model, folder, &["--luna", &luna]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // The versions that are there without a network.
    let lock = folder.join("Cargo.lock");
    if !lock.exists() {
        fs::copy(workspace().join("Cargo.lock"), lock).expect("the versions are copied");
    }
    text(&output.stdout).to_owned()
}

/// Cargo in a generated package; all of them share what they depend on.
pub(crate) fn cargo(folder: &Path, command: &str, arguments: &[&str]) -> Output {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("generated-target");
    Command::new(env::var_os("CARGO").unwrap_or("cargo".into()))
        .args([command, "--offline", "--manifest-path"])
        .arg(folder.join("Cargo.toml"))
        .args(arguments)
        .env("CARGO_TARGET_DIR", target)
        .output()
        .expect("cargo starts")
}

pub(crate) fn build(folder: &Path) {
    let output = cargo(folder, "build", &[]);
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(!said.contains("warning"), "{said}");
}

/// The report of a run, which is to end with this exit code.
fn run(folder: &Path, seconds: &str, code: i32) -> String {
    let output = cargo(folder, "run", &["--quiet", "--", "--seconds", seconds]);
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
    let output = cargo(&folder, "build", &[]);
    let said = text(&output.stderr);
    assert!(!output.status.success(), "{said}");
    assert!(
        said.contains("pattern does not mention field `power`"),
        "{said}"
    );
    assert!(said.contains("processes/motor.rs"), "{said}");
}

#[test]
fn each_example_compiles_and_runs() {
    let everything = workspace().join("tools/model/tests/it/everything.toml");
    for (model, seconds) in [
        (example("philosophers-repaired.toml"), "0.2"),
        (example("commstime.toml"), "0.2"),
        (example("sorting-pump.toml"), "60"),
        (example("sieve.toml"), "60"),
        (example("production-cell.toml"), "0.2"),
        (everything, "0.2"),
    ] {
        let folder = folder(
            model
                .file_stem()
                .and_then(|name| name.to_str())
                .unwrap_or("model"),
        );
        generate(&model, &folder);
        build(&folder);
        run(&folder, seconds, 0);
    }
}

/// Bodies that no person writes. With LUNA_LONG=1 a hundred of them, else two.
#[test]
fn random_models_compile_without_a_warning() {
    let is_long = env::var("LUNA_LONG").is_ok_and(|long| long == "1");
    let seed = env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    let seed: u64 = seed.unwrap_or(20_261_121);
    for number in 0..if is_long { 100 } else { 2 } {
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
    let mut child = Command::new(env!("CARGO_BIN_EXE_luna"))
        .args(["model", "generate", "--luna", &luna, "-o"])
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
