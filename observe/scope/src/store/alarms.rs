//! The last warnings and errors, for viewers that connect when the blocks with them are gone.

use luna_logger::Level;
use luna_logger::format::Record;
use std::collections::VecDeque;

/// How many are kept.
const MAX: usize = 48;
/// The limit of their bytes in blocks: two texts each, and numbers.
pub(super) const MAX_BYTES: usize = MAX * (2 * super::declared::LONGEST + 40);

#[derive(Debug, Default)]
pub(super) struct Alarms(VecDeque<Alarm>);

#[derive(Debug)]
struct Alarm {
    /// The number of the block that it is in; none if it is in none.
    block: Option<u64>,
    thread: u32,
    time: u64,
    level: Level,
    process: u32,
    truncated: bool,
    target: String,
    text: String,
}

impl Alarms {
    /// Keeps a message that is a warning or an error, and is in this block.
    pub(super) fn take(&mut self, record: &Record<'_>, block: Option<u64>) {
        let Record::Message {
            thread,
            time,
            level: level @ (Level::Error | Level::Warn),
            process,
            truncated,
            target,
            text,
        } = *record
        else {
            return;
        };
        if self.0.len() == MAX {
            self.0.pop_front();
        }
        let kept = super::declared::cut(text);
        self.0.push_back(Alarm {
            block,
            thread,
            time,
            level,
            process,
            truncated: truncated || kept.len() < text.len(),
            target: super::declared::cut(target),
            text: kept,
        });
    }

    /// Those of the blocks from one on and before another. From none on: also those that are in no
    /// block.
    pub(super) fn between(
        &self,
        from: Option<u64>,
        before: u64,
    ) -> impl Iterator<Item = Record<'_>> {
        let found = self.0.iter();
        let found = found.filter(move |one| from <= one.block && one.block < Some(before));
        found.map(|one| Record::Message {
            thread: one.thread,
            time: one.time,
            level: one.level,
            process: one.process,
            truncated: one.truncated,
            target: &one.target,
            text: &one.text,
        })
    }
}
