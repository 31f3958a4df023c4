//! Tests of the demonstrator. One program; a module a subject.

mod model;
