//! What the page's messages do to the file.

use super::*;
use std::fs;

struct Page {
    folder: tempfile::TempDir,
    desk: Desk,
}

impl Page {
    fn open() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.toml"), luna_model::TEMPLATE).unwrap();
        let desk = Desk::open(&folder.path().join("a.toml"), None).unwrap();
        Self { folder, desk }
    }

    fn ask(&self, message: &Value) -> Value {
        serde_json::from_str(&self.desk.answer(&message.to_string())).unwrap()
    }

    fn set(&self, thing: &str, key: &str, value: Value) -> Value {
        let (kind, name) = thing.split_once(' ').unwrap();
        let thing = json!({"kind": kind, "name": name});
        let edit = json!({"do": "set", "thing": thing, "key": key, "value": value});
        self.ask(&json!({"type": "edit", "edits": [edit]}))
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("a.toml")
    }

    fn text(&self) -> String {
        fs::read_to_string(self.path()).unwrap()
    }
}

const PRIORITY: &str = "period = \"1 ms\"\npriority = 4\n";

#[test]
fn a_whole_model_is_written_and_undone() {
    let page = Page::open();
    let shown = page.set("part producer", "priority", json!(4));
    assert_eq!(
        (&shown["is_saved"], &shown["refused"]),
        (&json!(true), &Value::Null)
    );
    let changed = luna_model::TEMPLATE.replace("period = \"1 ms\"\n", PRIORITY);
    assert_eq!(page.text(), changed);
    assert_eq!(page.ask(&json!({"type": "undo"}))["redo"], true);
    assert_eq!(page.text(), luna_model::TEMPLATE);
    page.ask(&json!({"type": "redo"}));
    assert_eq!(page.text(), changed);
}

#[test]
fn what_cannot_be_read_is_refused_and_what_is_not_whole_waits() {
    let page = Page::open();
    let shown = page.set("process Consumer", "body", json!("loop { eat eat }"));
    assert_eq!(shown["refused"]["thing"]["name"], "Consumer");
    assert_eq!(
        (&shown["refused"]["line"], &shown["undo"]),
        (&json!(14), &json!(false))
    );
    let shown = page.set("part consumer", "bind.input", Value::Null);
    assert_eq!(
        (&shown["is_saved"], &shown["refused"]),
        (&json!(false), &Value::Null)
    );
    assert_eq!(shown["problem"]["thing"]["name"], "consumer");
    assert_eq!(page.text(), luna_model::TEMPLATE);
    let shown = page.set("part consumer", "bind.input", json!("values"));
    assert_eq!(
        (&shown["is_saved"], &shown["problem"]),
        (&json!(true), &Value::Null)
    );
    // By the model's limit, which the page shows, or by another.
    assert_eq!(shown["max_states"], luna_model::DEFAULT_MAX_STATES);
    let whole = page.ask(&json!({"type": "check", "max_states": null}));
    assert_eq!(
        (&whole["type"], &whole["limit"]),
        (&json!("checked"), &Value::Null)
    );
    let cut = page.ask(&json!({"type": "check", "max_states": 1}));
    assert_eq!(
        (&cut["is_complete"], &cut["limit"]),
        (&json!(false), &json!("states"))
    );
    assert_eq!(page.ask(&json!({"type": "progress"}))["type"], "progress");
}

#[test]
fn a_change_by_another_program_is_read_and_not_overwritten() {
    let page = Page::open();
    let version = page.set("part producer", "priority", json!(9))["version"].clone();
    let foreign = luna_model::TEMPLATE.replace("first steps", "other steps");
    fs::write(page.path(), &foreign).unwrap();
    let shown = page.set("part producer", "priority", json!(4));
    assert!(
        shown["refused"]["error"]
            .as_str()
            .unwrap()
            .contains("another program")
    );
    assert_eq!(shown["view"]["name"], "other steps");
    assert_eq!(page.text(), foreign);
    // What cannot be read stops all edits until it can.
    fs::write(page.path(), "nonsense").unwrap();
    let shown = page.set("part producer", "priority", json!(4));
    assert!(shown["note"].as_str().unwrap().contains("unreadable"));
    assert_eq!(page.text(), "nonsense");
    fs::write(page.path(), &foreign).unwrap();
    assert_eq!(
        page.ask(&json!({"type": "look", "version": version}))["type"],
        "view"
    );
    page.set("part producer", "priority", json!(4));
    assert_eq!(
        page.text(),
        foreign.replace("period = \"1 ms\"\n", PRIORITY)
    );
}

#[test]
fn a_strange_message_is_answered_and_does_nothing() {
    let page = Page::open();
    for message in [
        "",
        "{}",
        "{\"type\":\"edit\",\"edits\":[{\"do\":\"burn\"}]}",
    ] {
        let answer: Value = serde_json::from_str(&page.desk.answer(message)).unwrap();
        assert_eq!(answer["type"], "failed");
    }
    assert_eq!(page.text(), luna_model::TEMPLATE);
}
