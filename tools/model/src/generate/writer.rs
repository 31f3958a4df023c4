//! Lines of Rust, indented by their depth.

use std::fmt::Write;

#[derive(Debug, Default)]
pub(super) struct Writer {
    text: String,
    depth: usize,
}

impl Writer {
    /// What it writes is to be appended to another at this depth.
    pub(super) fn at(depth: usize) -> Self {
        Self {
            text: String::new(),
            depth,
        }
    }

    pub(super) fn append(&mut self, other: Self) {
        self.text.push_str(&other.text);
    }

    pub(super) fn line(&mut self, line: impl AsRef<str>) {
        let line = line.as_ref();
        if line.is_empty() {
            self.text.push('\n');
            return;
        }
        let indent = self.depth * 4;
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "{:indent$}{line}", "");
    }

    /// A line that ends in `{`, and what is in it.
    pub(super) fn block(&mut self, line: impl AsRef<str>, inner: impl FnOnce(&mut Self)) {
        self.open(line);
        inner(self);
        self.close("}");
    }

    pub(super) fn open(&mut self, line: impl AsRef<str>) {
        self.line(line);
        self.depth += 1;
    }

    pub(super) fn close(&mut self, line: &str) {
        self.depth -= 1;
        self.line(line);
    }

    /// Ends a block and begins the next, as `} else {`.
    pub(super) fn turn(&mut self, line: &str) {
        self.close(line);
        self.depth += 1;
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}
