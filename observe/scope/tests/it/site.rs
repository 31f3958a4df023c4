//! Another page by the scope's server.

use super::server::{get, settings, view, words};
use luna_scope::{Scope, Site};
use serde_json::json;
use std::sync::Arc;
use tungstenite::Message;

struct Echo;

impl Site for Echo {
    fn file(&self, path: &str) -> Option<(&'static str, &'static [u8])> {
        (path == "/echo.js").then_some(("text/javascript", b"echo"))
    }

    fn answer(&self, message: &str) -> String {
        json!({"echo": message}).to_string()
    }
}

fn scope() -> Scope {
    Scope::open(settings().site(Arc::new(Echo)).unwrap()).unwrap()
}

fn token(scope: &Scope) -> String {
    scope.url().split_once("#token=").unwrap().1.to_owned()
}

#[test]
fn its_files_are_served_and_checked_as_the_scopes() {
    let scope = scope();
    for path in ["/echo.js", "/style.css", "/"] {
        assert_eq!(get(&scope, path, "Host: localhost"), 200, "{path}");
    }
    assert_eq!(get(&scope, "/nothing.js", "Host: localhost"), 404);
    assert_eq!(get(&scope, "/echo.js", "Host: evil.example"), 421);
    let foreign = "Host: localhost\r\nOrigin: http://evil.example";
    assert_eq!(get(&scope, "/echo.js", foreign), 403);
}

#[test]
fn it_answers_what_has_the_token() {
    let scope = scope();
    let mut socket = view(&scope);
    let first = json!({"type": "token", "token": token(&scope)});
    socket.send(Message::text(first.to_string())).unwrap();
    assert_eq!(words(&mut socket).unwrap()["type"], "authorized");
    for text in ["a", &"long ".repeat(100_000)] {
        socket.send(Message::text(text)).unwrap();
        assert_eq!(words(&mut socket).unwrap()["echo"], text);
    }
}

#[test]
fn without_the_token_it_answers_nothing() {
    let scope = scope();
    let mut wrong = token(&scope);
    wrong.pop();
    for first in [
        "a".to_owned(),
        json!({"type": "token", "token": wrong}).to_string(),
        json!({"type": "edit"}).to_string(),
    ] {
        let mut socket = view(&scope);
        socket.send(Message::text(first)).unwrap();
        assert_eq!(words(&mut socket), None);
    }
}
