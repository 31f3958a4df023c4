//! Tests that change their whole process: signal handlers.

mod signals;
