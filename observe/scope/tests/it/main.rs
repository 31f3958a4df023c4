//! Tests of the scope: its server, and its page in a browser. One program; a module a subject.

#[path = "../support/mod.rs"]
mod support;

mod browser;
mod many_connections;
mod server;
mod site;
