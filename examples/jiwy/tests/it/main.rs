//! Tests of the demonstrator. One program; a module a subject.

mod card;
mod model;
