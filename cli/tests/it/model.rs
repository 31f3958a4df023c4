//! `luna model`: what it prints, and its exit codes.

use crate::run::{command, example, file, luna_model, path, text};
use serde_json::{Value, json};
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
fn check_prints_json_for_scripts() {
    let json = |file: &str, more: &[&str]| {
        let of = example(file);
        let output = luna_model(&[&["check", path(&of), "--json"], more].concat());
        let found: Value = serde_json::from_slice(&output.stdout).expect("it is JSON alone");
        assert_eq!(found["exit_code"], json!(output.status.code()));
        assert_eq!(found["schema"], 1);
        found
    };
    let found = json("philosophers.toml", &[]);
    let deadlock = &found["findings"][0];
    assert_eq!(
        (&deadlock["kind"], &deadlock["steps"]),
        (&json!("deadlock"), &json!(10))
    );
    assert_eq!(deadlock["trace"].as_array().unwrap().len(), 10);
    assert_eq!(deadlock["circle"].as_array().unwrap().len(), 10);
    assert_eq!(
        (&found["is_complete"], &found["exit_code"]),
        (&json!(true), &json!(1))
    );
    let found = json("sieve.toml", &["--max-states", "10"]);
    assert_eq!(
        (&found["limit"], &found["exit_code"]),
        (&json!("states"), &json!(4))
    );
    assert_eq!(
        (&found["findings"], &found["spin"]),
        (&json!([]), &Value::Null)
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

/// So many processes of 8 variables, of which each counts in its own time: more states than any
/// memory holds.
fn many(processes: usize) -> String {
    let names: Vec<String> = (0..8).map(|number| format!("v{number}")).collect();
    let types: Vec<String> = names
        .iter()
        .map(|name| format!("{name} = \"0..3\""))
        .collect();
    let steps = names
        .iter()
        .map(|name| format!("work; {name} = ({name} + 1) % 4"));
    let steps: Vec<String> = steps.collect();
    let steps = steps.join("; ");
    format!(
        "[process.Counter]\nvariables = {{ {} }}\nbody = \"loop {{ {steps} }}\"\n\n\
         [system.part.counter]\nprocess = \"Counter\"\narray = {processes}\n",
        types.join(", ")
    )
}

#[test]
fn check_ends_at_its_bound_of_memory_with_4() {
    let path = file("many.toml");
    fs::write(&path, many(200)).unwrap();
    let name = path.display().to_string();
    let output = luna_model(&["check", &name, "--max-memory", "4M"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert!(said.contains("200 processes"), "{said}");
    assert!(
        said.contains("and there are more than 4 MiB hold: raise --max-memory"),
        "{said}"
    );
    let output = luna_model(&["check", &name, "--max-memory", "4X"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("no size, such as 512M"));
}

/// Without a bound it takes half of what is free: here, below a limit of the address space. Before,
/// such a program was aborted.
#[cfg(target_os = "linux")]
#[test]
fn check_ends_below_the_limits_of_the_program() {
    let path = file("many-limited.toml");
    fs::write(&path, many(20)).unwrap();
    let output = std::process::Command::new("sh")
        .args(["-c", "ulimit -v 100000; exec \"$0\" model check \"$1\""])
        .args([env!("CARGO_BIN_EXE_luna"), path.to_str().unwrap()])
        .output()
        .unwrap();
    let said = text(&output.stdout);
    let complained = text(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{said}{complained}");
    assert!(said.contains("raise --max-memory"), "{said}");
    // Progress is for terminals alone.
    assert_eq!(complained, "");
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
