//! Shows messages on standard error, from a detached thread, since its reader may be slow.

use crate::monitor::Monitor;
use crate::thread::start;
use std::fmt;
use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

/// The most bytes of lines that wait.
const ROOM: usize = 1 << 20;

/// The longest wait at the end of a recording for lines that are not shown yet.
pub(super) const END_WITHIN: Duration = Duration::from_secs(1);

/// The recorder's end. After it is dropped, the thread writes the waiting lines and ends.
pub(super) struct Show {
    shared: Arc<Monitor<State>>,
}

#[derive(Default)]
struct State {
    /// What waits, whole lines.
    lines: Vec<u8>,
    /// Lines without room since the last time that their number was shown.
    left_out: u64,
    is_writing: bool,
    is_over: bool,
}

impl State {
    fn is_idle(&self) -> bool {
        self.lines.is_empty() && self.left_out == 0 && !self.is_writing
    }
}

impl Show {
    /// On standard error.
    pub(super) fn start() -> io::Result<Self> {
        Self::on(|lines| io::stderr().lock().write_all(lines))
    }

    /// By `write`, which gets whole lines.
    fn on(mut write: impl FnMut(&[u8]) -> io::Result<()> + Send + 'static) -> io::Result<Self> {
        let shared = Arc::<Monitor<State>>::default();
        let theirs = shared.clone();
        // The thread is detached: it may block in a write for ever.
        start("luna-messages", move || {
            let mut lines = Vec::new();
            while take(&theirs, &mut lines) {
                // Standard error may be closed. Recording continues.
                let _ = write(&lines);
                theirs.change(|state| state.is_writing = false);
            }
        })?;
        Ok(Self { shared })
    }

    /// Shows a line, if there is room; otherwise counts it, and shows the count later. Never waits
    /// for the reader.
    pub(super) fn line(&self, line: fmt::Arguments<'_>) {
        self.shared.change(|state| {
            let length = state.lines.len();
            // A vector takes all.
            let _ = writeln!(state.lines, "{line}");
            // A later line must not precede the count of the lines left out.
            if state.left_out > 0 || state.lines.len() > ROOM {
                state.lines.truncate(length);
                state.left_out += 1;
            }
        });
    }

    /// Waits until all is shown, or the limit has passed. Returns whether all is.
    pub(super) fn end(&self, limit: Duration) -> bool {
        let state = self.shared.lock();
        let waited = self
            .shared
            .wait_while_within(state, limit, |state| !state.is_idle());
        waited.is_idle()
    }
}

impl Drop for Show {
    fn drop(&mut self) {
        self.shared.change(|state| state.is_over = true);
    }
}

/// Waits for lines, and takes them. False when there come no more.
fn take(shared: &Monitor<State>, lines: &mut Vec<u8>) -> bool {
    let mut state = shared.wait_while(shared.lock(), |state| state.is_idle() && !state.is_over);
    if state.is_idle() {
        return false;
    }
    lines.clear();
    std::mem::swap(&mut state.lines, lines);
    let left_out = std::mem::take(&mut state.left_out);
    if left_out > 0 {
        let _ = writeln!(
            lines,
            "luna: {left_out} messages not shown: standard error was too slow"
        );
    }
    state.is_writing = true;
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::channel;

    #[test]
    fn a_slow_reader_delays_nothing_and_omitted_lines_are_counted() {
        let (begins, begun) = channel();
        let (open, gate) = channel::<()>();
        let shown = Arc::new(Mutex::new(Vec::new()));
        let there = shown.clone();
        let show = Show::on(move |lines| {
            let _ = begins.send(());
            // Open for good when the other end is gone.
            let _ = gate.recv();
            there.lock().unwrap().extend_from_slice(lines);
            Ok(())
        })
        .unwrap();
        show.line(format_args!("first"));
        begun.recv().unwrap();
        // From here on nothing is taken.
        let long = "x".repeat(999);
        let room = ROOM / 1000;
        for _ in 0..room + 7 {
            show.line(format_args!("{long}"));
        }
        assert!(!show.end(Duration::ZERO));
        drop(open);
        assert!(show.end(Duration::from_secs(600)));
        let shown = String::from_utf8(shown.lock().unwrap().clone()).unwrap();
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!((lines.len(), lines[0]), (room + 2, "first"));
        assert!(lines[1..=room].iter().all(|line| *line == long));
        assert!(lines[room + 1].starts_with("luna: 7 messages not shown"));
    }
}
