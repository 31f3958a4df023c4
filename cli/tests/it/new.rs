//! `luna new`: each template compiles without a warning, passes its tests and runs, and what is
//! there is never overwritten.

use crate::package::{folder, lock, run_cargo, workspace};
use crate::run::{luna, path, text};
use std::fs;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn command(arguments: &[&str], project: &Path) -> Output {
    luna(&[&["new", path(project)], arguments].concat())
}

/// A project in a folder far from the checkout, which goes with it.
struct Project {
    path: PathBuf,
    _folder: tempfile::TempDir,
}

impl Deref for Project {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

/// A project of a template, in the layout of rustfmt. The command is run far from the checkout.
fn project(template: &str) -> Project {
    let elsewhere = tempfile::tempdir().expect("a folder of its own");
    let name = format!("new-{template}");
    let output = crate::run::command(&["new", "--template", template, &name])
        .current_dir(&elsewhere)
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains("README.md"), "{said}");
    let here = fs::canonicalize(workspace()).expect("it is there");
    let here = format!(
        "it depends on LUNA in {}: the checkout that",
        here.display()
    );
    assert!(said.contains(&here), "{said}");
    let project = Project {
        path: elsewhere.path().join(name),
        _folder: elsewhere,
    };
    lock(&project);
    for file in [
        ".gitignore",
        ".github/workflows/ci.yml",
        "README.md",
        "Cargo.toml",
    ] {
        let text = fs::read_to_string(project.join(file)).expect("it is there");
        assert!(!text.contains("{{"), "{file}: {text}");
    }
    if Command::new("rustfmt").arg("--version").output().is_ok() {
        let main = project.join("src/main.rs");
        let check = Command::new("rustfmt")
            .args(["--edition", "2024", "--check"])
            .arg(main)
            .output()
            .expect("it is there");
        assert!(check.status.success(), "{}", text(&check.stdout));
    } else {
        eprintln!("skipped: the layout of the templates: rustfmt is missing");
    }
    project
}

/// What the tests of the project say on standard output: all of them pass.
fn test(project: &Path) -> String {
    let output = run_cargo(project, "test", &[]);
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{}{errors}", text(&output.stdout));
    assert!(!errors.contains("warning"), "{errors}");
    text(&output.stdout).to_owned()
}

/// Both streams of a run of a second.
fn run(project: &Path, arguments: &[&str]) -> String {
    let arguments = [&["--quiet", "--", "1"], arguments].concat();
    let output = run_cargo(project, "run", &arguments);
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{said}");
    said
}

#[test]
fn a_loop() {
    let project = project("loop");
    assert!(test(&project).contains("2 passed"));
    let said = run(&project, &[]);
    assert!(said.contains("system `new-loop`: completed"), "{said}");
    assert!(said.contains("\ncontrol "), "{said}");
    let said = run(&project, &["--deployment", "system.toml"]);
    assert!(
        said.contains("executor `control`: core 0 (the program: "),
        "{said}"
    );
    for (arguments, wrong) in [
        (
            ["soon"].as_slice(),
            "`soon`: the argument is a number of seconds",
        ),
        (&["1", "soon"], "`soon`: this argument is one too many"),
        (&["--fast"], "`--fast`: the argument is a number of seconds"),
    ] {
        let arguments = [&["--quiet", "--"], arguments].concat();
        let output = run_cargo(&project, "run", &arguments);
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stderr).contains(wrong), "{output:?}");
    }
    // A loop that the program lacks fails the test.
    let file = project.join("system.toml");
    let whole = fs::read_to_string(&file).expect("it is there");
    let wrong = "[loop.contrl]\nperiod = \"1 ms\"\n";
    fs::write(&file, format!("{whole}{wrong}")).expect("it is writable");
    let output = run_cargo(&project, "test", &["--quiet"]);
    assert!(!output.status.success());
    let said = text(&output.stdout);
    assert!(said.contains("no loop of this name began"), "{said}");
    // What is wrong in the file has its line.
    fs::write(&file, whole.replace("fifo:80", "fifo:800")).expect("it is writable");
    let output = run_cargo(
        &project,
        "run",
        &["--quiet", "--", "--deployment", "system.toml"],
    );
    assert_eq!(output.status.code(), Some(1));
    let errors = text(&output.stderr);
    assert!(
        errors.contains("system.toml:15:10: the priority is out of range"),
        "{errors}"
    );
}

#[test]
fn an_axis() {
    let project = project("axis");
    assert!(test(&project).contains("3 passed"));
    let said = run(
        &project,
        &["--set", "axis/kp=10", "--deployment", "system.toml"],
    );
    assert!(said.contains("largest error: "), "{said}");
    assert!(
        said.contains("process `axis`: cycle_budget 500 us (the program: none)"),
        "{said}"
    );
}

#[test]
fn a_cell() {
    let project = project("cell");
    assert!(test(&project).contains("3 passed"));
    let said = run(&project, &["--deployment", "system.toml"]);
    assert!(said.contains("20 blocks were stacked"), "{said}");
    assert!(
        said.contains("process `press`: priority 20 (the program: 16)"),
        "{said}"
    );
}

/// Where ROS 2 is built anyway: its libraries take minutes.
#[cfg(feature = "hosts")]
#[test]
fn a_node_of_ros2() {
    let project = project("ros2");
    assert!(test(&project).contains("3 passed"));
    let said = run(&project, &["--deployment", "system.toml"]);
    assert!(said.contains("\ndrive "), "{said}");
}

#[test]
fn all_templates_are_made() {
    for template in ["loop", "axis", "cell", "ros2"] {
        let project = folder(&format!("new-made/{template}-1"));
        let output = command(&["-t", template], &project);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let file = |name: &str| fs::read_to_string(project.join(name)).expect("it is there");
        assert!(file("README.md").starts_with(&format!("# {template}-1\n")));
        assert!(file("Cargo.toml").contains(&format!("name = \"{template}-1\"")));
        assert!(file("system.toml").contains("[executor."));
    }
}

#[test]
fn a_project_depends_on_a_repository_that_is_stated() {
    let elsewhere = tempfile::tempdir().expect("a folder of its own");
    let url = "https://host.example/luna";
    let output = crate::run::command(&["new", "arm", "--template", "axis", "--git", url])
        .current_dir(&elsewhere)
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let manifest =
        fs::read_to_string(elsewhere.path().join("arm/Cargo.toml")).expect("it is there");
    let said = text(&output.stdout);
    assert!(
        said.contains("it depends on LUNA of https://host.example/luna"),
        "{said}"
    );
    for package in ["luna-rt", "luna-plants", "luna-safety-blocks"] {
        let line = format!("{package} = {{ git = \"{url}\"");
        assert!(manifest.contains(&line), "{manifest}");
    }
}

#[test]
fn what_cannot_be_made_is_refused() {
    let there = folder("new-there");
    fs::create_dir_all(&there).expect("it is made");
    let refused = |arguments: &[&str], project: &Path, why: &str| {
        let output = command(arguments, project);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(why), "{errors}");
    };
    refused(
        &[],
        &there,
        "this is there already: give another name, or remove it",
    );
    assert_eq!(fs::read_dir(&there).expect("it is there").count(), 0);
    let nothing = folder("new-nothing");
    refused(
        &["--template", "arm"],
        &nothing,
        "[possible values: loop, axis, cell, ros2]",
    );
    refused(
        &["--luna", "/nowhere"],
        &nothing,
        "this is no checkout of LUNA",
    );
    refused(
        &[],
        &folder("New Arm"),
        "`New Arm` cannot be the name of a project: use lower-case letters, digits, `-` and `_`, a \
         letter first, and no word of Rust or Cargo; `new-arm` can be one",
    );
    assert!(!nothing.exists());
}
