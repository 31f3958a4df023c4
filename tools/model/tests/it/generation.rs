//! What is generated of a model. That it compiles and runs is tested with the command.

use luna_model::{File, Luna, Model};
use std::path::PathBuf;

const EVERYTHING: &str = include_str!("everything.toml");
const PUMP: &str = include_str!("../../../../examples/models/sorting-pump.toml");
const JIWY: &str = include_str!("../../../../examples/models/jiwy.toml");

fn files(model: &str) -> Vec<File> {
    let model = Model::parse("m.toml", model).unwrap_or_else(|problem| panic!("{problem}"));
    let files = model.generate(&Luna::Version("1.2.3".to_owned()));
    files.unwrap_or_else(|problem| panic!("{problem}"))
}

fn text(files: &[File], path: &str) -> String {
    let found = files.iter().find(|file| file.path == path);
    found
        .unwrap_or_else(|| panic!("{path} is missing"))
        .text
        .clone()
}

/// The error of a model in which one text was replaced.
fn error(model: &str, from: &str, to: &str) -> String {
    assert!(model.contains(from), "{from}");
    let changed = model.replacen(from, to, 1);
    let model = Model::parse("m.toml", &changed).unwrap_or_else(|problem| panic!("{problem}"));
    let problem = model.generate(&Luna::Version("1.2.3".to_owned()));
    problem.expect_err("it cannot be generated").to_string()
}

#[test]
fn what_is_generated_is_apart_from_what_is_written_by_hand() {
    for model in [EVERYTHING, PUMP, JIWY] {
        for file in files(model) {
            let is_below = file.path.starts_with("src/generated/");
            assert_eq!(file.is_generated, is_below, "{}", file.path);
            assert_eq!(File::was_generated(&file.text), is_below, "{}", file.path);
        }
    }
}

#[test]
fn names_are_those_of_the_model() {
    let system = text(&files(PUMP), "src/generated/system.rs");
    for name in [
        "channel::<i32>(\"pump.between[1]\", None)",
        "main.process(\"pump.middle\")",
        "Network::new(\"sorting pump\", script)",
    ] {
        assert!(system.contains(name), "{name} in {system}");
    }
}

#[test]
fn deployment_is_that_of_the_model() {
    let files = files(JIWY);
    let system = text(&files, "src/generated/system.rs");
    for part in [
        "network.executor(\"control\", Some(1), Policy::fifo(80))?",
        "network.executor(\"operator\", None, Policy::Other)?",
        "control.process(\"tilt.gate\").priority(11)",
        "process_period: Duration::from_millis(1),",
        "channel::<types::Duty>(\"pan.safe\", None)",
        "channel::<f64>(\"pan_stick\", Some(Buffer::overwrite_oldest(1)))",
    ] {
        assert!(system.contains(part), "{part} in {system}");
    }
    let timer = text(&files, "src/processes/timer.rs");
    assert!(timer.contains("loop {\n        slots.next().await;\n        pan.send(()).await?;"));
    let types = files.iter().find(|file| file.path == "src/types.rs");
    let types = types.expect("the model names types");
    let missing: Vec<&str> = types.missing_in("pub struct Position;").collect();
    assert_eq!(missing, ["Duty"]);
}

#[test]
fn two_types_do_not_become_one() {
    let said = error(
        JIWY,
        "safe = { type = \"Duty\" }",
        "safe = { type = \"duty\" }",
    );
    let expected = "the types `Duty` and `duty` are both `Duty` in Rust";
    assert!(said.contains(expected), "{said}");
}

#[test]
fn each_statement_has_its_rust() {
    let body = text(&files(EVERYTHING), "src/processes/everything.rs");
    for part in [
        // A guard with a precondition, and what it receives where nothing else sets it.
        "        outcome = numbers.recv(), if n > 0 && !b => {\n            x = outcome?;\n",
        "            let seen = outcome?;\n            truth.send(!seen).await?;\n",
        "        _ = luna::after(AFTER) => {\n            think();\n",
        "        outcome = out.send(n + 1), if b => {\n            outcome?;\n",
        // `skip` with a precondition is due at once, behind all others.
        "        _ = luna::after(std::time::Duration::ZERO), if is_last != 0 => {\n",
        "        skip => {\n            think();\n        }\n    }\n",
        "            n = i32::from(outcome?);\n",
        "    while n < limit {\n        n += 1;\n",
        "    n = 2 * n % 9;\n",
        "    for k in 0..limit {\n        let chosen = choice_3.of(2);\n        if chosen == 0 {\n",
        "            truth.send(k == 1).await?;\n",
        "        branch(async {\n            b = truths.recv().await?;\n            Ok(())\n        }),\n",
        "    assert!(!(b && n == 1) || k2 >= 0);\n",
        "            stop().await;\n",
        "fn think() {\n    // What `think` does.\n}\n",
        "    assert!((0..=9).contains(&k2));\n",
    ] {
        assert!(body.contains(part), "{part} in {body}");
    }
    assert!(!body.contains("unseen"), "behind a loop without an end");
}

#[test]
fn a_loop_that_may_not_wait_lets_others_run() {
    let yields = "luna::yield_now().await;";
    let files = files(EVERYTHING);
    let does = |process| text(&files, &format!("src/processes/{process}.rs")).contains(yields);
    assert!(
        does("spinner"),
        "it sends to a buffer that never lets it wait"
    );
    assert!(!does("sink") && !does("feeder"));
}

#[test]
fn what_rust_cannot_have_is_refused_with_its_place() {
    let with_port = |name: &str| {
        let model =
            EVERYTHING.replacen("ports = {", &format!("ports = {{ {name} = \"receive\","), 1);
        model.replacen("bind = {", &format!("bind = {{ {name} = \"go\","), 1)
    };
    for (model, from, to, expected) in [
        (
            &*with_port("type"),
            "",
            "",
            "`type` is a word of Rust: `type`; use another name in the model",
        ),
        (
            &with_port("choice_2"),
            "",
            "",
            "in Rust this is `choice_2`: the turn of a `choose` has that name: `choice_2`",
        ),
        (
            &with_port("is_last"),
            "",
            "",
            "in Rust this is `is_last`: the port `is_last` has that name: `isLast`",
        ),
        (
            EVERYTHING,
            "n = (n + 1) % 4 }\"",
            "n_ }\"",
            "in Rust this is `n`: the variable `n` has that name: `n_`",
        ),
        (
            EVERYTHING,
            "[process.Idle]",
            "[process.everything]\nbody = \"skip\"\n[system.part.other]\nprocess = \
             \"everything\"\n[process.Idle]",
            "in Rust this is `everything`: the process `Everything` has that name: `everything`",
        ),
        (
            EVERYTHING,
            "[process.Idle]",
            "[process.Result]\nbody = \"skip\"\n[system.part.other]\nprocess = \
             \"Result\"\n[process.Idle]",
            "in Rust this is `Result`: a type of Rust has that name: `Result`",
        ),
        (
            EVERYTHING,
            "alt { out? | truth?",
            &format!("alt {{ {} out? | truth?", "out? | ".repeat(29)),
            "an alternative of LUNA has 32 guards at most: `spun?`",
        ),
        (
            EVERYTHING,
            "image_of_2",
            "Vec<u8>",
            "the type `Vec<u8>` of this channel is no name: `images`",
        ),
        (
            EVERYTHING,
            "process = \"Idle\"\n\n[system.part.slow]",
            "process = \"Idle\"\non = \"alone\"\n\n[system.part.slow]",
            "2 processes are to run on this thread: `alone`; make it an executor",
        ),
        (
            EVERYTHING,
            "policy = \"rr:10\"",
            "policy = \"rr:98\"",
            "the policy `rr:98` is LUNA's own: `main`; use a priority of 1 to 97",
        ),
    ] {
        let said = error(model, from, to);
        assert!(
            said.starts_with("m.toml:") && said.contains(expected),
            "{said}"
        );
    }
}

#[test]
fn a_port_with_channels_of_two_types_is_refused() {
    let two = "
[process.A]
ports = { out = \"send\" }
body = \"out!1\"
[process.B]
ports = { in_ = \"receive\" }
body = \"in_?\"
[system.channel]
n = { type = \"0..1\" }
b = { type = \"bool\" }
[system.part]
a = { process = \"A\", bind = { out = \"n\" } }
a2 = { process = \"A\", bind = { out = \"b\" } }
b = { process = \"B\", bind = { in_ = \"n\" } }
b2 = { process = \"B\", bind = { in_ = \"b\" } }
";
    let said = error(two, "out!1", "out!1");
    let expected = "m.toml:3:11: channels of two types are bound to this port: `i32` and `bool`: \
                    `out`; make two processes of it, one for each type";
    assert_eq!(said, expected);
}

#[test]
fn the_manifest_depends_on_the_library_as_stated() {
    let model = Model::parse("m.toml", PUMP).expect("it is a model");
    let manifest = |luna: &Luna| {
        let files = model.generate(luna).expect("it can be generated");
        text(&files, "Cargo.toml")
    };
    let version = manifest(&Luna::Version("1.2.3".to_owned()));
    assert!(version.contains("name = \"sorting-pump\""), "{version}");
    assert!(
        version.contains("luna-rt = { version = \"1.2.3\","),
        "{version}"
    );
    let git = manifest(&Luna::Git("https://host.example/luna".to_owned()));
    assert!(
        git.contains("luna-rt = { git = \"https://host.example/luna\""),
        "{git}"
    );
    let folder = manifest(&Luna::Folder(PathBuf::from("/my \"luna\"")));
    assert!(
        folder.contains(r#"luna-rt = { path = "/my \"luna\"","#),
        "{folder}"
    );
}
