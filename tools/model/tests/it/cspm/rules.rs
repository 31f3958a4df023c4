//! Exported models, each for one rule of the meaning or of the translation.

use super::explore::comes_after;
use super::{compare, parser};
use luna_model::Model;
use std::collections::BTreeMap;

/// Two processes with a channel `c` from the first to the second.
fn pair(channel: &str, sender: &str, receiver: &str) -> Model {
    let text = format!(
        "[process.A]\nports.c = \"send\"\nvariables = {{ x = \"-9..9 = 0\", y = \"-9..9 = 0\" }}\n\
         body = \"{sender}\"\n\
         [process.B]\nports.c = \"receive\"\n\
         variables = {{ x = \"-9..9 = 0\", y = \"-9..9 = 0\" }}\n\
         body = \"{receiver}\"\n\
         [system.channel]\nc = {{ {channel} }}\n[system.part]\n\
         a = {{ process = \"A\", bind.c = \"c\" }}\nb = {{ process = \"B\", bind.c = \"c\" }}\n"
    );
    Model::parse("pair.toml", &text).unwrap_or_else(|problem| panic!("{problem}"))
}

/// What random networks have seldom or never.
#[test]
fn exported_rules_have_the_verdicts_of_the_exploration() {
    let mut verdicts = BTreeMap::new();
    for (channel, sender, receiver) in [
        // Livelocks: polling, choices, computing, branches. What waits for a time is none.
        ("", "loop { c! }", "loop { alt { c? | skip } }"),
        ("", "loop { c! }", "loop { alt { c? | after } }"),
        ("", "loop { choose { skip | x = 1 } }", "c?"),
        ("", "loop { x = 1 - x }", "c?"),
        ("", "loop { }", "c?"),
        ("", "while x == 0 { y = (y + 1) % 3 }", "c?"),
        ("", "loop { par { x = 1 | y = 2 } }", "c?"),
        ("", "loop { par { skip | stop } }; c!", "stop"),
        (
            "",
            "c!; loop { par { x = 1; par { x = 2 | skip } | y = 1 } }",
            "c?; stop",
        ),
        // Computing that comes to an end.
        (
            "",
            "while x < 9 { x = x + 1 }; c!",
            "for k in 0..5 { x = x + k % 2 }; c?",
        ),
        // What branches set is seen behind them.
        ("", "par { x = 3; c! | y = 4 }; assert x + y == 7", "c?"),
        (
            "",
            "x = 1; y = 2; par { x = x + 3 | y = y + 4 }; assert x == 4 && y == 6; c!",
            "c?",
        ),
        (
            "",
            "x = 1; par { x = x + 3 | par { y = 4 | skip } }; assert y == 5",
            "c?",
        ),
        (
            "",
            "for j in 0..3 { par { x = x + 1; c! | y = j } }; assert x == 3 && y == 2",
            "c?; c?; c?",
        ),
        // Ends and failures.
        ("", "c!; c!", "loop { c? }"),
        ("", "c!; stop", "loop { c? }"),
        ("", "c!", "par { loop { c? } | c?; c? }; never"),
        ("", "c!", "par { loop { c? } | stop }"),
        (
            "",
            "c!",
            "par { par { c?; c?; stop | c?; c? } | loop { c? } }; assert false",
        ),
        (
            "buffer = 'fifo 2'",
            "c!; c!",
            "wait; c?; c?; got; c?; assert false",
        ),
        ("buffer = 'fifo 1'", "c!; c!; c!; assert false", "c?"),
        ("buffer = 'overwrite_oldest 1'", "loop { c! }", "c?"),
        // Buffers.
        (
            "buffer = 'fifo 2', type = '0..9'",
            "c!1; c!2; c!3; stop",
            "loop { c?x; assert x == y + 1; y = x }",
        ),
        (
            "buffer = 'overwrite_newest 2', type = '0..9'",
            "c!1; c!2; c!3",
            "c?x; assert x == 1; loop { c?x; assert x != 1 }",
        ),
        (
            "buffer = 'overwrite_newest 3', type = '0..9'",
            "c!1; c!2; c!3; c!4; stop",
            "loop { y = x; c?x; assert x == y + 1 }",
        ),
        (
            "buffer = 'overwrite_newest 3', type = '0..9'",
            "c!1; c!2; c!3; c!4; stop",
            "loop { y = x; c?x; assert x > y }",
        ),
        (
            "buffer = 'overwrite_oldest 2', type = '0..9'",
            "c!1; c!2; c!3; stop",
            "loop { y = x; c?x; assert x == y + 1 }",
        ),
        (
            "buffer = 'overwrite_oldest 2', type = '0..9'",
            "c!1; c!2; c!3; stop",
            "loop { y = x; c?x; assert x > y }",
        ),
        // Guards, choices and ranges.
        ("type = '0..9'", "alt { c! 8 / x if x != 0 | skip }", "c?"),
        ("type = '0..9'", "alt { c! 8 / x if x == 0 | skip }", "c?"),
        (
            "type = '0..9'",
            "alt { c! 8 / (4 / x) if x != 0 | skip }",
            "c?",
        ),
        ("type = '0..9'", "alt { c! 1 if 8 / x > 1 | skip }", "c?"),
        (
            "type = '0..9'",
            "loop { c!x }",
            "alt { c?x if x > 0 => got }",
        ),
        ("", "alt { c! if false }", "alt { c? if false }"),
        (
            "",
            "loop { alt { c! => x = 1 | c! => x = 2 } }",
            "loop { alt { c? | c? } }",
        ),
        ("type = '0..20'", "c!12", "c?x"),
        ("type = '0..20'", "c!9", "c?x"),
        ("type = '-20..20'", "c!(-10)", "c?x"),
        ("type = '0..3'", "for k in 0..9 { c!k }", "loop { c?x }"),
        (
            "type = 'bool'",
            "choose { c!0 | c!true }",
            "c?x; if x { c? }",
        ),
        ("", "x = 8 / x; c!", "c?"),
        ("", "assert 1 / x == 1 || true; c!", "c?"),
        ("", "if 1 % x == 0 { c! }", "c?"),
        (
            "",
            "assert !(x < 0) && -x <= 0 && (x == 0) + (y == 0) == 2 && (3 || 0); c!",
            "c?",
        ),
    ] {
        let text = format!("{channel} / {sender} / {receiver}");
        let found = compare(&pair(channel, sender, receiver), 10_000, &text);
        let found = found.unwrap_or_else(|| panic!("{text}: too many states"));
        *verdicts.entry(format!("{found:?}")).or_insert(0) += 1;
    }
    println!("{verdicts:#?}");
    assert_eq!(verdicts.len(), 5, "{verdicts:#?}");
}

/// Division rounds as in Rust: the numbers are given to the model, which asserts Rust's results.
#[test]
fn exported_division_rounds_towards_zero() {
    for a in [-9_i32, -7, -1, 0, 1, 7, 9] {
        for b in [-4_i32, -1, 1, 3] {
            let (quotient, remainder) = (a / b, a % b);
            for (wrong, is_unbroken) in [(0, true), (1, false)] {
                let body = format!(
                    "x = {a}; y = {b}; \
                     assert x / y == ({quotient}) && x % y == ({remainder}) + {wrong}; c!"
                );
                let found = compare(&pair("", &body, "c?"), 100, &body);
                let found = found.expect("a few states");
                assert_eq!(found.is_unbroken, is_unbroken, "{body}");
            }
        }
    }
}

#[test]
fn what_may_overflow_is_not_exported() {
    let text = "[process.A]\nvariables.x = \"0..2147483647\"\n\
                body = \"\"\"\nstep;\nx = x + 1\n\"\"\"\n\
                [system.part]\na = { process = \"A\" }\n";
    let model = Model::parse("large.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let error = model.to_cspm().expect_err("x + 1 may overflow");
    assert_eq!((error.line, &*error.process), (5, "a"));
    assert_eq!(
        error.to_string(),
        "line 5: a may compute a number beyond 32 bits, which FDR does not see; give its variables \
         smaller ranges"
    );
}

/// Names that CSPm has for something else, or that become the same one.
#[test]
fn exported_names_are_those_of_one_thing() {
    let text = r#"
        [process.Agent]
        ports = { within = "send", "höhe" = "send" }
        variables = { value = "0..1", q = "0..1", other = "0..1", a_b = "0..1" }
        body = """
        within!value; höhe!a_b; STOP;
        for k in 0..2 { head }; for k in 0..2 { over };
        par { other = 1 | q = 0 }
        """
        [process.P]
        ports = { union = "receive", out = "receive" }
        variables = { System = "0..1", broken = "0..1" }
        body = "union?System; out?broken; broken"
        [system.channel]
        a_b = { type = "0..1" }
        "höhe" = { type = "0..1", buffer = "fifo 1" }
        [system.part]
        a = { process = "Agent", bind = { within = "a_b", "höhe" = "höhe" } }
        a_b_put = { process = "P", bind = { union = "a_b", out = "höhe" } }
    "#;
    let model = Model::parse("names.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    assert!(compare(&model, 1000, text).is_some());
}

/// A buffer says that it has no sender only when it is empty. If `b` ended before it has sent, `d`
/// and `e` would wait for each other: `e` holds a sending end of `d`'s channel.
#[test]
fn an_exported_buffer_gives_what_it_holds_before_it_is_closed() {
    let text = r#"
        [process.A]
        ports = { c = "send" }
        body = "c!; c!"
        [process.B]
        ports = { c = "receive", d = "send" }
        body = "c?; c?; d!"
        [process.D]
        ports = { d = "receive", e = "send" }
        body = "d?; e!"
        [process.E]
        ports = { d = "send", e = "receive" }
        body = "e?"
        [system.channel]
        c = { buffer = "fifo 2" }
        d = {}
        e = {}
        [system.part]
        a = { process = "A", bind.c = "c" }
        b = { process = "B", bind = { c = "c", d = "d" } }
        d = { process = "D", bind = { d = "d", e = "e" } }
        e = { process = "E", bind = { d = "d", e = "e" } }
    "#;
    let model = Model::parse("closed.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let found = compare(&model, 1000, text).expect("a few states");
    assert!(found.is_deadlock_free);
}

#[test]
fn an_exported_buffer_without_a_receiver_takes_no_more() {
    let model = pair("buffer = 'overwrite_oldest 1'", "loop { c! }", "c?");
    let script = parser::parse(&model.to_cspm().expect("small numbers"));
    assert!(comes_after(&script, "c_get", "c_put"));
    assert!(comes_after(&script, "c_put", "ends"));
    // `b` ends first: `a` finds that out.
    assert!(!comes_after(&script, "ends", "c_put"));
    assert!(comes_after(&script, "ends", "c_no_receiver"));
}

/// A property is exported as it is in the file, or a comment says why it is not.
#[test]
fn exported_properties_hold_as_in_the_model() {
    let text = r#"
        [process.A]
        ports.c = "send"
        variables = { x = "0..3", large = "0..20000" }
        body = "c!; x = 1; act; c!; x = 3"
        [process.B]
        ports.c = "receive"
        variables = { y = "-2..3 = 0", unused = "0..3 = 2" }
        body = "loop { c?; y = 3; act; y = -1 }"
        [process.Par]
        variables.z = "0..2"
        body = "par { z = 1 | act }"
        [system.channel]
        c = {}
        [system.part]
        a = { process = "A", bind.c = "c" }
        b = { process = "B", bind.c = "c" }
        both = { process = "Par" }
        [check.always]
        "right: at its end x is 3" = "a.x != 2"
        "wrong: at its end x is 3" = "a.x < 3"
        "right: two processes" = "b.y >= -1 && (a.x != 3 || b.y != -2)"
        "wrong: two processes" = "!(a@act && b@act)"
        "wrong: a place" = "!b@act || b.y < 3"
        "right: a place" = "!b@act || b.y == 3"
        "right: never set" = "b.unused == 2"
        "wrong: no value" = "3 / a.x >= 1"
        "Par" = "both.z <= 2"
        "large" = "a.large + 1 > 0"
        "nothing" = "1 < 2"
        "overflow" = "b.y * 2147483647 < 0"
        [check.ltl]
        "soon" = "<> (a.x == 3)"
    "#;
    let model = Model::parse("always.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let exported = model.to_cspm().expect("small numbers");
    let found = compare(&model, 1000, text).expect("a few states");
    let titles = exported
        .lines()
        .filter_map(|line| line.strip_prefix("-- Always: "));
    let titles: Vec<&str> = titles.collect();
    let rights: Vec<bool> = titles
        .iter()
        .map(|title| title.starts_with("right"))
        .collect();
    assert_eq!(titles.len(), 8);
    assert_eq!(found.always, rights, "{titles:?}");
    for comment in [
        "check.always, Par: it names a process with `par`",
        "check.always, large: what it names has more than 10 000 combinations of values",
        "check.always, nothing: it names no process",
        "check.always, overflow: it may compute a number beyond 32 bits",
        "check.ltl, soon: SPIN checks it",
    ] {
        assert!(
            exported.contains(&format!("-- Not exported: {comment}\n")),
            "{exported}"
        );
    }
}
