//! `luna model`: what it prints, and its exit codes.

use crate::run::{command, example, file, luna_model, path, text};
use std::fs;

#[test]
fn check_prints_the_circle_and_exits_with_1() {
    let output = luna_model(&["check", path(&example("philosophers.toml"))]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("deadlock, after 10 steps:"), "{said}");
    assert!(
        said.contains("philosopher[4] -> fork[4]: left[4]"),
        "{said}"
    );
    assert!(
        said.contains("circle, each waits for the next: philosopher[0] -> fork[1]"),
        "{said}"
    );
}

#[test]
fn check_of_what_is_right_exits_with_0() {
    let output = luna_model(&["check", path(&example("philosophers-repaired.toml"))]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
}

#[test]
fn check_that_does_not_see_all_exits_with_4() {
    let output = luna_model(&["check", path(&example("sieve.toml")), "--max-states", "10"]);
    assert_eq!(output.status.code(), Some(4), "{}", text(&output.stdout));
    assert!(text(&output.stdout).contains("raise --max-states"));
}

#[test]
fn a_wrong_model_exits_with_2_and_its_place() {
    let path = file("wrong.toml");
    fs::write(&path, "[process.A]\nbody = \"a! $\"\n").unwrap();
    let output = luna_model(&["check", &path.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.contains("wrong.toml:2:12: this character has no meaning: `$`"),
        "{said}"
    );
}

#[test]
fn without_spin_the_exploration_runs_and_says_what_is_missing() {
    let model = example("commstime.toml");
    let output = command(&["model", "check", "--spin", path(&model)])
        .env("PATH", "")
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(4));
    assert!(text(&output.stdout).contains("all 53 states were looked at"));
    let said = text(&output.stderr);
    assert!(
        said.contains("spin is missing; install it (Debian: spin)"),
        "{said}"
    );
}

#[test]
fn new_writes_a_model_once_and_draw_draws_it() {
    let path = file("begun.toml");
    let name = path.display().to_string();
    assert_eq!(luna_model(&["new", &name]).status.code(), Some(0));
    assert_eq!(
        luna_model(&["new", &name]).status.code(),
        Some(2),
        "it is there already"
    );
    assert_eq!(luna_model(&["check", &name]).status.code(), Some(0));

    let svg = file("begun.svg");
    assert_eq!(luna_model(&["draw", &name]).status.code(), Some(0));
    assert!(fs::read_to_string(svg).unwrap().starts_with("<svg "));
    for (format, begin) in [("dot", "digraph "), ("mermaid", "flowchart LR")] {
        let output = luna_model(&["draw", &name, "--to", format, "-o", "-"]);
        assert!(text(&output.stdout).starts_with(begin), "{format}");
    }
    let promela = file("begun.pml");
    luna_model(&["check", &name, "--promela", &promela.display().to_string()]);
    assert!(
        fs::read_to_string(promela)
            .unwrap()
            .contains("active proctype p0()")
    );
    let cspm = file("begun.csp");
    luna_model(&["check", &name, "--cspm", &cspm.display().to_string()]);
    let cspm = fs::read_to_string(cspm).unwrap();
    assert!(
        cspm.contains("assert System :[deadlock free [F]]"),
        "{cspm}"
    );
}
