//! What is wrong in a model is reported with its place, and nothing makes the reader panic.

use luna_model::{Model, TEMPLATE};
use proptest::prelude::*;

const PHILOSOPHERS: &str = include_str!("../../../../examples/models/philosophers-repaired.toml");
const PUMP: &str = include_str!("../../../../examples/models/sorting-pump.toml");
const COMMSTIME: &str = include_str!("../../../../examples/models/commstime.toml");

/// The error of a model in which one text was replaced.
fn error(model: &str, from: &str, to: &str) -> String {
    assert!(model.contains(from), "{from}");
    let changed = model.replacen(from, to, 1);
    let problem = Model::parse("m.toml", &changed).expect_err("the model is wrong");
    problem.to_string()
}

#[test]
fn errors_name_the_place_the_value_and_what_to_do() {
    for (model, from, to, expected) in [
        (
            PHILOSOPHERS,
            "\"left[i]\"",
            "\"lft[i]\"",
            "m.toml:39:14: there is no channel of this name here: `lft[i]`; is `left` meant?",
        ),
        (
            PHILOSOPHERS,
            "left_back!;",
            "lft_back!;",
            "m.toml:13:3: the process has no such port: `lft_back`; is `left_back` meant?",
        ),
        (
            PUMP,
            "from?x;\n  if x < kept",
            "from?k;\n  if x < kept",
            "m.toml:19:8: the variable of a `for` cannot be set: `k`; use a variable of the \
             process and `while`",
        ),
        (
            PHILOSOPHERS,
            "think;",
            "think $",
            "m.toml:10:9: this character has no meaning: `$`; remove it",
        ),
        (
            PHILOSOPHERS,
            "left_back!;",
            "left_back?;",
            "m.toml:13:3: the port has the other direction: `left_back`; change it in `ports`, or \
             use `!` to send and `?` to receive",
        ),
        (
            PHILOSOPHERS,
            "(i + 4) % 5",
            "(i + 4) % 0",
            "m.toml:50:20: an expression here divides by zero: `right[(i + 4) % 0]`; change it",
        ),
        (
            PUMP,
            "array = 2",
            "array = 0",
            "m.toml:41:1: the array has the size 0: `between`; use 1 or more, and at most 20000 \
             in all",
        ),
        (
            PUMP,
            "process = \"Pump\"",
            "process = \"Pomp\"",
            "m.toml:54:20: there is no process of this name: `\"Pomp\"`; is `Pump` meant?",
        ),
        (
            COMMSTIME,
            "on = \"fast\"",
            "on = \"slow\"",
            "m.toml:50:6: there is no executor of this name: `\"slow\"`; there are: fast",
        ),
        (
            COMMSTIME,
            "fifo:80",
            "fifo:100",
            "m.toml:39:10: the priority is out of range: `\"fifo:100\"`; choose 1 (lowest) to 99",
        ),
        (
            COMMSTIME,
            "fifo:80",
            "fif:80",
            "m.toml:39:10: this is no policy: `\"fif:80\"`; write `other`, `fifo:1` to \
             `fifo:99`, `rr:1` to `rr:99`, or `deadline:200000/500000/1000000`: runtime, deadline \
             and period in ns",
        ),
        (
            COMMSTIME,
            "priority = 1",
            "priority = 32",
            "m.toml:65:12: this number is out of range: `32`; write one from 0 to 31",
        ),
    ] {
        assert_eq!(error(model, from, to), expected);
    }
}

#[test]
fn a_process_that_is_made_of_itself_is_refused() {
    let text =
        "[process.A.part]\na = { process = \"A\" }\n[system.part]\na = { process = \"A\" }\n";
    let problem = Model::parse("m.toml", text).expect_err("it has no end");
    assert!(problem.message.contains("made of itself"), "{problem}");
}

#[test]
fn deep_nesting_and_long_chains_are_refused() {
    let body = |inner: &str| {
        let text =
            format!("[process.A]\nbody = \"{inner}\"\n[system.part]\na = {{ process = \"A\" }}\n");
        Model::parse("m.toml", &text).map(|_| ())
    };
    assert!(body(&format!("{}x{}", "loop { ".repeat(5000), " }".repeat(5000))).is_err());
    assert!(body(&format!("assert {}1{}", "(".repeat(5000), ")".repeat(5000))).is_err());
    assert!(body(&format!("assert {}1", "-".repeat(5000))).is_err());
    assert!(body(&format!("assert 1{}", " + 1".repeat(50_000))).is_err());
    assert!(body(&"x; ".repeat(5000)).is_ok());
}

/// A valid file in which pieces are removed, doubled, replaced or moved.
fn mutated() -> impl Strategy<Value = String> {
    let file = prop::sample::select(vec![PHILOSOPHERS, PUMP, COMMSTIME, TEMPLATE]);
    let piece = prop::sample::select(vec![
        "",
        "\"",
        "{",
        "}",
        "[",
        "]",
        "|",
        "!",
        "?",
        ";",
        "=",
        "0",
        "-1",
        "99999999999",
        "i",
        "x",
        "loop",
        "alt {",
        "par { x | y }",
        "\\u00e9",
        "é",
        "\n",
        "'''",
        "\"\"\"",
        "%",
        "/ 0",
        "if",
        "for k in 0..9",
        "@eat",
        "array = 3",
        "..",
        "..-5",
        "\u{0}",
    ]);
    let change = (any::<prop::sample::Index>(), 0_usize..12, piece);
    (file, prop::collection::vec(change, 1..5)).prop_map(|(file, changes)| {
        let mut letters: Vec<char> = file.chars().collect();
        for (at, removed, piece) in changes {
            let at = at.index(letters.len() + 1);
            let end = (at + removed).min(letters.len());
            letters.splice(at..end, piece.chars());
        }
        letters.into_iter().collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_text_makes_the_reader_panic(text in mutated()) {
        match Model::parse("m.toml", &text) {
            Ok(model) => {
                // Whatever is a model can be explored, drawn and exported.
                prop_assert!(model.explore(200).states <= 200);
                prop_assert!(model.to_svg().ends_with("</svg>\n"));
                prop_assert!(!model.to_promela().is_empty());
                // A number may have become too large for that.
                let lines = text.split('\n').count();
                let line = model.to_cspm().map_or_else(|error| error.line, |_| 1);
                prop_assert!((1..=lines).contains(&line), "{}", line);
            }
            Err(problem) => {
                let lines = text.split('\n').count();
                prop_assert!((1..=lines).contains(&problem.line), "{}", problem);
                prop_assert!(problem.column >= 1);
                prop_assert!(!problem.message.is_empty() && !problem.advice.is_empty());
            }
        }
    }

    #[test]
    fn no_body_makes_the_reader_panic(body in "[a-cx0-9{}()|!?;=+%<>&. -]{0,60}") {
        let text = format!(
            "[process.A]\nvariables.x = \"0..9\"\nbody = '{body}'\n[system.part]\na = {{ process = \"A\" }}\n"
        );
        if let Ok(model) = Model::parse("m.toml", &text) {
            prop_assert!(model.explore(200).states <= 200);
        }
    }
}
