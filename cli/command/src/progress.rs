//! How far long work is: a line on standard error, if that is a terminal.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

/// Work that is done by then shows nothing.
const QUIET: Duration = Duration::from_millis(500);

/// A line is replaced after this time at the earliest.
const PAUSE: Duration = Duration::from_millis(200);

/// To the begin of the line, and what is right of it away.
const CLEAR: &[u8] = b"\r\x1b[K";

/// A line that says how far some work is, until this is dropped. Nothing is written to a pipe or a
/// file. What is printed elsewhere meanwhile does not look well: drop this before.
#[derive(Debug)]
pub struct Progress<W: Write = io::Stderr> {
    /// None if nobody looks.
    to: Option<W>,
    next: Instant,
    is_shown: bool,
}

impl Progress {
    /// Of work that begins now.
    pub fn new() -> Self {
        let to = io::stderr();
        let to = to.is_terminal().then_some(to);
        Self::on(to, Instant::now())
    }
}

impl Default for Progress {
    fn default() -> Self {
        Self::new()
    }
}

impl<W: Write> Progress<W> {
    fn on(to: Option<W>, now: Instant) -> Self {
        Self {
            to,
            next: now + QUIET,
            is_shown: false,
        }
    }

    /// Shows this text, if the last one has stood for a while. To be called often: without a
    /// terminal it does nothing, with one it looks at the clock.
    pub fn show(&mut self, text: impl FnOnce() -> String) {
        if self.to.is_some() {
            self.show_at(Instant::now(), text);
        }
    }

    /// Shows this text at once: for work that cannot say how far it is.
    pub fn say(&mut self, text: &str) {
        self.put(text);
    }

    fn show_at(&mut self, now: Instant, text: impl FnOnce() -> String) {
        if now >= self.next {
            self.next = now + PAUSE;
            self.put(&text());
        }
    }

    fn put(&mut self, text: &str) {
        let Some(to) = &mut self.to else { return };
        // A line that breaks could not be taken back.
        let text: String = text.chars().take(72).collect();
        let line = [CLEAR, text.as_bytes()].concat();
        let shown = to.write_all(&line).and_then(|()| to.flush());
        match shown {
            Ok(()) => self.is_shown = true,
            // The terminal is gone: the work goes on.
            Err(_) => self.to = None,
        }
    }
}

impl<W: Write> Drop for Progress<W> {
    fn drop(&mut self) {
        if let Some(to) = self.to.as_mut().filter(|_| self.is_shown) {
            let _ = to.write_all(CLEAR).and_then(|()| to.flush());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_comes_after_a_while_is_replaced_now_and_then_and_goes() {
        let mut written = Vec::new();
        let start = Instant::now();
        let mut progress = Progress::on(Some(&mut written), start);
        for (millis, text) in [(0, "a"), (499, "b"), (500, "c"), (650, "d"), (700, "e")] {
            progress.show_at(start + Duration::from_millis(millis), || text.to_owned());
        }
        drop(progress);
        assert_eq!(written, b"\r\x1b[Kc\r\x1b[Ke\r\x1b[K");
    }

    #[test]
    fn what_is_soon_done_shows_nothing_and_a_long_line_is_cut() {
        let mut written = Vec::new();
        let start = Instant::now();
        let mut progress = Progress::on(Some(&mut written), start);
        progress.show_at(start, || "never".to_owned());
        drop(progress);
        assert!(written.is_empty());
        let mut progress = Progress::on(Some(&mut written), start);
        progress.say(&"x".repeat(500));
        drop(progress);
        assert_eq!(written.len(), 2 * CLEAR.len() + 72);
    }

    #[test]
    fn without_a_terminal_no_text_is_made() {
        let mut progress = Progress::<Vec<u8>>::on(None, Instant::now() - QUIET);
        progress.show(|| unreachable!("nobody looks"));
        progress.say("nothing");
    }
}
