//! Each edit, on texts as people write them.

use super::{Draft, Edit, EditError, Kind, Thing, Value};

const FILE: &str = r#"# Two processes and a channel.
name = "pair"   # its name

# --- processes ---

# Sends.
[process.Source]
ports = { out = "send" } # one port
body = "loop { out! }"

# --- more ---

# Receives.
[process.Sink]
ports = { into = "receive" }
body = "loop { into? }"

[system.channel]
wire = { buffer = "fifo 2" }   # between them

# The first part.
[system.part.source]
process = "Source"
bind.out = "wire"
priority = 3            # 0 to 31

[system.part.sink]
process = "Sink"
bind = { into = "wire" }
period   =   "1 ms"

# For the check.
[check.always]
fine = "!(source@x && other.source@x)"
# The end.
"#;

fn thing(kind: Kind, name: &str) -> Thing {
    Thing {
        kind,
        within: None,
        name: name.to_owned(),
    }
}

fn set(kind: Kind, name: &str, key: &str, value: impl Into<Option<&'static str>>) -> Edit {
    Edit::Set {
        thing: thing(kind, name),
        key: key.to_owned(),
        value: value.into().map(|text| Value::Text(text.to_owned())),
    }
}

fn after(text: &str, edits: &[Edit]) -> Result<String, EditError> {
    let mut draft = Draft::new("pair.toml", text).unwrap();
    draft.apply(edits)?;
    assert!(draft.undo());
    assert_eq!(draft.text(), text);
    assert!(draft.redo());
    Ok(draft.text().to_owned())
}

/// An edit does to the text what these replacements do.
#[track_caller]
fn does(edit: Edit, replacements: &[(&str, &str)]) {
    let mut expected = FILE.to_owned();
    for (from, to) in replacements {
        assert!(expected.contains(from), "{from}");
        expected = expected.replace(from, to);
    }
    assert_eq!(after(FILE, std::slice::from_ref(&edit)).unwrap(), expected);
    let windows = after(&FILE.replace('\n', "\r\n"), &[edit]).unwrap();
    assert_eq!(windows, expected.replace('\n', "\r\n"));
}

#[test]
fn a_value_changes_alone() {
    does(
        Edit::Set {
            thing: thing(Kind::Part, "source"),
            key: "priority".to_owned(),
            value: Some(Value::Number(12)),
        },
        &[("priority = 3 ", "priority = 12 ")],
    );
    does(
        set(Kind::Part, "sink", "period", "2 ms"),
        &[("\"1 ms\"", "\"2 ms\"")],
    );
    does(
        set(Kind::Channel, "wire", "buffer", "overwrite_oldest 1"),
        &[("fifo 2", "overwrite_oldest 1")],
    );
    does(
        set(Kind::Process, "Source", "body", "loop {\n  out!\n}\n"),
        &[("\"loop { out! }\"", "\"\"\"\nloop {\n  out!\n}\n\"\"\"")],
    );
}

#[test]
fn a_new_key_comes_last_in_its_table() {
    does(
        set(Kind::Part, "source", "cost", "5 us"),
        &[("0 to 31\n", "0 to 31\ncost = \"5 us\"\n")],
    );
    does(
        set(Kind::Channel, "wire", "type", "0..3"),
        &[("\"fifo 2\" }", "\"fifo 2\", type = \"0..3\" }")],
    );
    does(
        set(Kind::Process, "Source", "ports.more", "receive"),
        &[("\"send\" }", "\"send\", more = \"receive\" }")],
    );
    does(
        Edit::Set {
            thing: thing(Kind::Part, "sink"),
            key: "at".to_owned(),
            value: Some(Value::Place([-40, 120])),
        },
        &[("\"1 ms\"\n", "\"1 ms\"\nat = [-40, 120]\n")],
    );
}

#[test]
fn a_key_goes_with_its_line() {
    does(
        set(Kind::Part, "source", "priority", None),
        &[("priority = 3            # 0 to 31\n", "")],
    );
    does(
        set(Kind::Channel, "wire", "buffer", None),
        &[("{ buffer = \"fifo 2\" }", "{}")],
    );
    does(
        set(Kind::Part, "source", "bind.out", None),
        &[("bind.out = \"wire\"\n", "")],
    );
}

#[test]
fn a_thing_is_added_behind_the_others() {
    does(
        Edit::Add {
            thing: thing(Kind::Part, "second"),
            keys: vec![
                ("process".to_owned(), Value::Text("Sink".to_owned())),
                ("bind.into".to_owned(), Value::Text("wire".to_owned())),
                ("at".to_owned(), Value::Place([8, 16])),
            ],
        },
        &[(
            "\"1 ms\"\n",
            "\"1 ms\"\n\n[system.part.second]\nprocess = \"Sink\"\nbind.into = \"wire\"\nat = [8, 16]\n",
        )],
    );
    does(
        Edit::Add {
            thing: thing(Kind::Channel, "other"),
            keys: vec![("array".to_owned(), Value::Number(5))],
        },
        &[("between them\n", "between them\nother = { array = 5 }\n")],
    );
    does(
        Edit::Add {
            thing: thing(Kind::Process, "Third"),
            keys: vec![
                ("ports.a".to_owned(), Value::Text("send".to_owned())),
                ("ports.b".to_owned(), Value::Text("receive".to_owned())),
                ("body".to_owned(), Value::Text("a!; b?".to_owned())),
            ],
        },
        &[(
            "\"loop { into? }\"\n",
            "\"loop { into? }\"\n\n[process.Third]\nports = { a = \"send\", b = \"receive\" }\n\
             body = \"a!; b?\"\n",
        )],
    );
}

#[test]
fn a_thing_goes_with_the_comment_above_it_alone() {
    let (start, end) = (
        FILE.find("# Receives").unwrap(),
        FILE.find("\n[system.ch").unwrap(),
    );
    does(
        Edit::Remove {
            thing: thing(Kind::Process, "Sink"),
        },
        &[(&FILE[start..=end], "")],
    );
    does(
        Edit::Remove {
            thing: thing(Kind::Channel, "wire"),
        },
        &[
            ("wire = { buffer = \"fifo 2\" }   # between them\n", ""),
            ("bind.out = \"wire\"\n", ""),
            ("bind = { into = \"wire\" }\n", ""),
        ],
    );
}

#[test]
fn a_name_changes_where_it_is_used() {
    let rename = |kind, name: &str, to: &str| Edit::Rename {
        thing: thing(kind, name),
        to: to.to_owned(),
    };
    does(
        rename(Kind::Process, "Source", "Fountain"),
        &[
            ("process.Source", "process.Fountain"),
            ("\"Source\"", "\"Fountain\""),
        ],
    );
    does(
        rename(Kind::Channel, "wire", "pipe"),
        &[("wire = {", "pipe = {"), ("\"wire\"", "\"pipe\"")],
    );
    does(
        rename(Kind::Part, "source", "spring"),
        &[("part.source", "part.spring"), ("(source@x", "(spring@x")],
    );
}

#[test]
fn what_cannot_be_read_is_refused_with_its_line_and_thing() {
    let edit = set(Kind::Process, "Sink", "body", "loop {\n  into? into?\n}\n");
    let Err(EditError::Unreadable { problem, thing: at }) = after(FILE, &[edit]) else {
        panic!("the body has an error");
    };
    assert_eq!(at, Some(thing(Kind::Process, "Sink")));
    assert_eq!((problem.line, problem.column), (18, 13), "{problem}");
    let edit = set(Kind::Part, "sink", "period", "soon");
    let Err(EditError::Unreadable { thing: at, .. }) = after(FILE, &[edit]) else {
        panic!("this is no time");
    };
    assert_eq!(at, Some(thing(Kind::Part, "sink")));
    let edit = Edit::Add {
        thing: thing(Kind::Part, "sink"),
        keys: Vec::new(),
    };
    assert_eq!(
        after(FILE, &[edit]),
        Err(EditError::Taken("sink".to_owned()))
    );
    let gone = thing(Kind::Part, "gone");
    let edit = Edit::Remove {
        thing: gone.clone(),
    };
    assert_eq!(after(FILE, &[edit]), Err(EditError::NotThere(gone)));
}

#[test]
fn several_edits_are_one_step_or_none() {
    let good = set(Kind::Part, "sink", "period", "9 ms");
    let bad = set(Kind::Part, "sink", "deadline", "9");
    let mut draft = Draft::new("pair.toml", FILE).unwrap();
    draft.apply(&[good.clone(), bad]).unwrap_err();
    assert_eq!((draft.text(), draft.steps()), (FILE, (false, false)));
    draft.apply(&[good]).unwrap();
    assert_eq!(draft.steps(), (true, false));
}

#[test]
fn a_part_without_its_channel_is_a_draft_and_no_model() {
    let mut draft = Draft::new("pair.toml", FILE).unwrap();
    draft.model().unwrap_err();
    draft
        .apply(&[set(Kind::Part, "sink", "bind.into", None)])
        .unwrap();
    let problem = draft.model().unwrap_err();
    assert!(draft.view().scopes[0].parts[1].bind.is_empty());
    assert_eq!(
        draft.thing_at(problem.line),
        Some(thing(Kind::Part, "sink")),
        "{problem}"
    );
}

#[test]
fn the_view_has_what_the_file_says() {
    let view = Draft::new("pair.toml", FILE).unwrap().view();
    assert_eq!(view.name, "pair");
    assert_eq!(
        view.processes[1].ports,
        [("into".to_owned(), "receive".to_owned())]
    );
    let [source, sink] = &view.scopes[0].parts[..] else {
        panic!("there are two parts");
    };
    assert_eq!(source.run, [("priority".to_owned(), "3".to_owned())]);
    assert_eq!((sink.line, sink.is_placed), (27, false));
    assert!(
        source.area[1] + source.area[3] < sink.area[1],
        "one is above the other"
    );
}

/// `i` of an index is the number of the part.
#[test]
fn a_channel_with_the_name_of_an_index_is_renamed_alone() {
    let text = "[system.channel]\ni = { array = 2 }\n\
                [system.part.source]\nprocess = \"Source\"\narray = 2\nbind.out = \"i[(i + 1) % 2]\"\n";
    let mut draft = Draft::new("pair.toml", text).expect("its values can be read");
    let thing = thing(Kind::Channel, "i");
    let to = "pipe".to_owned();
    draft
        .apply(&[Edit::Rename { thing, to }])
        .expect("it is renamed");
    assert!(
        draft.text().contains("pipe = { array = 2 }"),
        "{}",
        draft.text()
    );
    assert!(
        draft.text().contains("bind.out = \"pipe[(i + 1) % 2]\""),
        "{}",
        draft.text()
    );
}
