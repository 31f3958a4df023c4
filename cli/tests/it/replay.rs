//! Counterexamples of `luna model check --replay`: generated programs follow them, or say where
//! they depart.

use crate::generate::{build, generate, random};
use crate::is_long;
use crate::package::{folder, run_cargo};
use crate::run::{example, luna_model, path, text};
use luna_model::{FindingKind, Model};
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

/// Writes the way to the model's deadlock into the folder of the generated package.
fn counterexample(model: &Path, folder: &Path) -> PathBuf {
    let file = folder.join("deadlock.replay");
    let output = luna_model(&["check", "--replay", path(&file), path(model)]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    file
}

/// What the package says of a counterexample, and its exit code.
fn follow(folder: &Path, file: &Path) -> (String, Option<i32>) {
    let file = file.display().to_string();
    let output = run_cargo(folder, "run", &["--quiet", "--", "--replay", &file]);
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    (said, output.status.code())
}

/// Changes a file, in which `from` is to be found.
fn change(file: &Path, from: &str, to: &str) {
    let before = fs::read_to_string(file).expect("the file is there");
    assert!(before.contains(from), "{before}");
    fs::write(file, before.replace(from, to)).expect("it is writable");
}

#[test]
fn philosophers_deadlock_as_in_the_model_until_their_code_is_repaired() {
    let folder = folder("replayed-philosophers");
    let model = example("philosophers.toml");
    generate(&model, &folder);
    build(&folder);
    let file = counterexample(&model, &folder);
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(1), "{said}");
    let head = "the program follows the counterexample (5 of 5 communications), and is deadlocked as in the model\n";
    assert!(said.starts_with(head), "{said}");
    for wait in [
        "`philosopher[4]` waits to send on `right[4]`\n",
        "`fork[4]` waits to receive from `left_back[4]`\n",
    ] {
        assert!(said.contains(wait), "{said}");
    }

    // A philosopher that does not get the right fork puts the left one back: the repair.
    let philosopher = folder.join("src/processes/philosopher.rs");
    let repaired = "
        let patience = std::time::Duration::from_millis(10);
        if right.send_timeout((), patience).await.is_err() {
            left_back.send(()).await?;
            continue;
        }
";
    change(&philosopher, "        right.send(()).await?;\n", repaired);
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(3), "{said}");
    let head = "the program follows the counterexample (5 of 5 communications), and is not deadlocked there\n\
                it goes on: philosopher[0] -> fork[0]: left_back[0]\n";
    assert!(said.starts_with(head), "{said}");

    // Other forks first.
    change(&philosopher, "        left.send(()).await?;\n", "");
    change(
        &philosopher,
        "        eat();",
        "left.send(()).await?;\neat();",
    );
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(3), "{said}");
    let head = "the program departs from the counterexample after 0 of 5 communications\n\
                next there: philosopher[0] -> fork[0]: left[0]\n";
    assert!(said.starts_with(head), "{said}");
}

#[test]
fn choices_alternatives_values_buffers_and_ends_are_followed() {
    let folder = folder("replayed-cell");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/replay.toml");
    generate(&model, &folder);
    build(&folder);
    let file = counterexample(&model, &folder);
    let script = fs::read_to_string(&file).expect("it was written");
    for step in [
        "source chooses 1\n",
        "source -> mixer: second = 2\n",
        "log finds closed: log\n",
        "mixer -> (buffer): out = 5\n",
    ] {
        assert!(script.contains(step), "{script}");
    }
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(1), "{said}");
    let all = "\
the program follows the counterexample (8 of 8 communications), and is deadlocked as in the model
`source` has ended
`log` has ended
`mixer` has ended
`sink` waits to receive from `back`
`keeper` waits to receive from `never`
`other` waits to receive from `back`
";
    assert_eq!(said, all);

    // Without the branch the source takes the first one.
    let other = folder.join("other.replay");
    fs::write(&other, script.replace("source chooses 1\n", "")).expect("it is writable");
    let (said, code) = follow(&folder, &other);
    assert_eq!(code, Some(3), "{said}");
    let waits = "`source` waits to send on `first`\n";
    assert!(
        said.contains("after 0 of 8") && said.contains(waits),
        "{said}"
    );

    // A branch that the `choose` does not have.
    fs::write(&other, script.replace("chooses 1\n", "chooses 7\n")).expect("it is writable");
    let (said, code) = follow(&folder, &other);
    assert_eq!(code, Some(3), "{said}");
    let problem = "but `source` has no branch 7 of 2\n";
    assert!(said.contains(problem), "{said}");

    // What the file says of the end is compared.
    let waits = "sink waits: receive back\n";
    fs::write(&other, script.replace(waits, "sink waits: stop\n")).expect("it is writable");
    let (said, code) = follow(&folder, &other);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("deadlocked though not as in the model\n"),
        "{said}"
    );

    for (text, wrong) in [
        (
            "[system]\n",
            "this is no file of `luna model check --replay`",
        ),
        (
            "deadlock mill\nsource ends\n",
            "the file is of the model `mill`, the program of `cell`; write the file anew: `luna \
             model check MODEL --replay FILE`",
        ),
        (
            "deadlock cell\nsorce chooses 1\n",
            "the program has no process `sorce`",
        ),
        (
            "deadlock cell\nsinc waits: stop\n",
            "the program has no process `sinc`",
        ),
        (
            "deadlock cell\nsource sleeps\n",
            "line 2 cannot be read: source sleeps",
        ),
        (
            "deadlock cell\nsource -> mixer: third\n",
            "the program has not all of this: source -> mixer: third",
        ),
    ] {
        fs::write(&other, text).expect("it is writable");
        let (said, code) = follow(&folder, &other);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(wrong), "{said}");
    }

    // All steps are taken, and a process does not end in order.
    let keeper = folder.join("src/processes/keeper.rs");
    let failure = "return Err(luna::Error::other(\"it is worn\"));\n        never.recv().await?;";
    change(&keeper, "never.recv().await?;", failure);
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(3), "{said}");
    let head =
        "the program departs from the counterexample after 8 of 8 communications\nbut there:\n";
    assert!(said.starts_with(head), "{said}");
    for line in ["`keeper` has failed\n", "process `keeper`: it is worn\n"] {
        assert!(said.contains(line), "{said}");
    }
    change(&keeper, failure, "never.recv().await?;");

    let mixer = folder.join("src/processes/mixer.rs");
    change(&mixer, "x + y", "x");
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(3), "{said}");
    let head = "the program departs from the counterexample after 6 of 8 communications\n\
                next there: mixer -> (buffer): out = 5\n\
                but its value is 2, in the model 5\n";
    assert!(said.starts_with(head), "{said}");

    change(&mixer, "first.recv().await?", "panic!(\"broken\")");
    let (said, code) = follow(&folder, &file);
    assert_eq!(code, Some(3), "{said}");
    let head = "the program departs from the counterexample after 1 of 8 communications: it ends\n";
    assert!(said.starts_with(head) && said.contains("broken"), "{said}");
}

/// Whether an alternative has a port in two guards.
fn has_twins(model: &str) -> bool {
    model.split("alt {").skip(1).any(|alternative| {
        let mut depth = 0;
        let mut is_over = false;
        let guards = alternative.split(|letter| {
            match letter {
                '{' => depth += 1,
                '}' if depth == 0 => is_over = true,
                '}' => depth -= 1,
                _ => {}
            }
            is_over || (letter == '|' && depth == 0)
        });
        // What is behind its end is split into letters.
        let ports = guards.filter_map(|guard| {
            let end = guard.find(['!', '?'])?;
            let port = guard[..end].trim();
            port.chars().all(char::is_alphanumeric).then_some(port)
        });
        let mut ports: Vec<&str> = ports.filter(|port| !port.is_empty()).collect();
        let count = ports.len();
        ports.sort_unstable();
        ports.dedup();
        ports.len() < count
    })
}

/// Deadlocks of random models: one in each run, 40 with LUNA_LONG=1. Not those with what a replay
/// does not drive.
#[test]
fn random_programs_deadlock_as_their_models() {
    let seed = env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    let mut seed: u64 = seed.unwrap_or(20_261_127);
    let mut left = if is_long() { 40 } else { 1 };
    while left > 0 {
        seed = seed.wrapping_add(1);
        let random = random::model(&mut random::Random(seed));
        if ["skip", "after", "par "]
            .iter()
            .any(|word| random.contains(word))
            || has_twins(&random)
        {
            continue;
        }
        let model = Model::parse("random", &random).expect("it is a model");
        let found = model.explore(100_000).findings;
        let deadlock = found.iter().find(|one| one.kind == FindingKind::Deadlock);
        if deadlock.is_none_or(|deadlock| deadlock.trace.len() < 6) {
            continue;
        }
        left -= 1;
        println!("LUNA_SEED={}\n{random}", seed.wrapping_sub(1));
        let folder = folder("replayed-random");
        fs::create_dir_all(folder.parent().expect("it has one")).expect("it is made");
        let file = folder.with_extension("toml");
        fs::write(&file, random).expect("it is writable");
        generate(&file, &folder);
        let file = counterexample(&file, &folder);
        let (said, code) = follow(&folder, &file);
        let script = fs::read_to_string(&file).expect("it was written");
        assert_eq!(code, Some(1), "{script}{said}");
        assert!(
            said.contains("deadlocked as in the model\n"),
            "{script}{said}"
        );
    }
}
