//! What happened in a test, in order.

use std::sync::{Arc, Mutex};

#[derive(Clone, Default)]
pub(crate) struct Log(pub(crate) Arc<Mutex<Vec<String>>>);

impl Log {
    pub(crate) fn add(&self, what: impl Into<String>) {
        self.0.lock().unwrap().push(what.into());
    }

    /// What adds `what` each time that it is called.
    pub(crate) fn noter(&self, what: &str) -> impl FnMut() + Send + 'static {
        let (log, what) = (self.clone(), what.to_owned());
        move || log.add(&what)
    }

    pub(crate) fn all(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }

    /// What happened between two events.
    pub(crate) fn between(&self, first: &str, last: &str) -> Vec<String> {
        let log = self.0.lock().unwrap();
        let at = |what| log.iter().position(|event| event == what).unwrap();
        log[at(first) + 1..at(last)].to_vec()
    }
}
