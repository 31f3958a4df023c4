//! Messages: text with a level, formatted by the caller into a buffer of fixed size.

use crate::format::Level;
use crate::hub::Hub;
use crate::lane::{self, Head, MAX_WORDS};
use luna_core::current;
use luna_machine::signals;
use std::fmt::{self, Write};
use std::io::{self, Write as _};

/// Bytes for the target and the text of a message.
const ROOM: usize = (MAX_WORDS - MESSAGE_HEAD) * 8;

/// Words before the text: head, time stamp, lengths and level, process.
pub(crate) const MESSAGE_HEAD: usize = 4;

/// The most bytes of a target: the rest is the text's.
const MAX_TARGET: usize = 96;

/// The mark of a text that was cut.
const CUT: &str = "…";

/// Records a message from `target`, a part of the program.
///
/// Real-time path: yes, if formatting the arguments is. It formats into 480 bytes on the stack, of
/// which the target takes its length; longer text is cut off and marked. Wait-free, no allocation,
/// no system call where the system records. A message for which the ring has no room is dropped and
/// counted.
///
/// Without a recording, a thread off the real-time path writes the message to standard error, and a
/// thread on the path drops it. During a recording, a message on the path by a thread without rings
/// is dropped and counted.
///
/// ```
/// use luna_logger::{Level, message};
/// message(Level::Warn, "pump", format_args!("pressure is {} bar", 7.5));
/// ```
pub fn message(level: Level, target: &str, text: fmt::Arguments<'_>) {
    write(level, target, |to| to.write_fmt(text));
}

/// As [`message`], for a text that `fill` writes.
pub(crate) fn write(level: Level, target: &str, fill: impl FnOnce(&mut Text) -> fmt::Result) {
    // On the path a thread has its rings, or none.
    let hub = lane::hub_of_lane().or_else(|| (!current::on_path()).then(Hub::for_messages)?);
    let Some(hub) = hub else {
        if current::on_path() {
            Hub::count_lost_message();
        } else {
            let mut text = Text::new("");
            let _ = fill(&mut text);
            // Standard error may be closed.
            let line = format!("{level:<5} {target}: {}\n", text.as_str());
            let _ = signals::without_write_signals(|| io::stderr().write_all(line.as_bytes()));
        }
        return;
    };
    let mut text = Text::new(target);
    // An error comes from a `Display` of the user's. The message is what was written until then.
    let _ = fill(&mut text);
    let process = current::process(|process| process.map_or(0, |process| process.id().get()));
    let mut entry = [0; MAX_WORDS];
    lane::message(&hub, |stamp| text.entry(&mut entry, level, process, stamp));
}

/// A text in room of fixed size.
pub(crate) struct Text {
    bytes: [u8; ROOM],
    /// Where the text begins, behind the target.
    begin: usize,
    end: usize,
    is_cut: bool,
}

impl Text {
    fn new(target: &str) -> Self {
        let target = &target[..target.floor_char_boundary(MAX_TARGET)];
        let mut bytes = [0; ROOM];
        bytes[..target.len()].copy_from_slice(target.as_bytes());
        Self {
            bytes,
            begin: target.len(),
            end: target.len(),
            is_cut: false,
        }
    }

    fn as_str(&self) -> &str {
        // It is made of whole characters.
        std::str::from_utf8(&self.bytes[self.begin..self.end]).unwrap_or_default()
    }

    fn push(&mut self, text: &str) {
        self.bytes[self.end..self.end + text.len()].copy_from_slice(text.as_bytes());
        self.end += text.len();
    }

    /// The text as an entry for a ring.
    fn entry<'a>(
        &self,
        entry: &'a mut [u64; MAX_WORDS],
        level: Level,
        process: u32,
        stamp: u64,
    ) -> &'a [u64] {
        let words = MESSAGE_HEAD + self.end.div_ceil(8);
        entry[0] = Head::new(Head::MESSAGE, words, 0).0;
        entry[1] = stamp;
        entry[2] = Lengths {
            target: self.begin as u16,
            text: (self.end - self.begin) as u16,
            level: level as u8,
            is_cut: self.is_cut,
        }
        .word();
        entry[3] = process.into();
        let (eights, _) = self.bytes.as_chunks::<8>();
        for (word, eight) in entry[MESSAGE_HEAD..words].iter_mut().zip(eights) {
            *word = u64::from_le_bytes(*eight);
        }
        &entry[..words]
    }
}

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if self.is_cut {
            return Ok(());
        }
        if self.end + text.len() + CUT.len() <= ROOM {
            self.push(text);
            return Ok(());
        }
        let left = ROOM - self.end - CUT.len();
        self.push(&text[..text.floor_char_boundary(left)]);
        self.push(CUT);
        self.is_cut = true;
        Ok(())
    }
}

/// The third word of a message's entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lengths {
    pub(crate) target: u16,
    pub(crate) text: u16,
    pub(crate) level: u8,
    pub(crate) is_cut: bool,
}

impl Lengths {
    fn word(self) -> u64 {
        u64::from(self.target)
            | u64::from(self.text) << 16
            | u64::from(self.level) << 32
            | u64::from(self.is_cut) << 40
    }

    pub(crate) fn of(word: u64) -> Self {
        Self {
            target: word as u16,
            text: (word >> 16) as u16,
            level: (word >> 32) as u8,
            is_cut: word >> 40 & 1 != 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_fits_is_whole_and_one_that_does_not_is_marked() {
        let most = ROOM - "pump".len() - CUT.len();
        for (length, is_cut) in [(0, false), (most, false), (most + 1, true), (9000, true)] {
            let mut text = Text::new("pump");
            text.write_str(&"x".repeat(length)).unwrap();
            assert_eq!(text.is_cut, is_cut, "{length}");
            assert_eq!(text.as_str().ends_with(CUT), is_cut);
            assert_eq!(text.as_str().trim_end_matches(CUT).len(), length.min(most));
        }
    }

    #[test]
    fn a_text_is_cut_between_characters_whatever_its_pieces() {
        let mut text = Text::new(&"ä".repeat(100));
        assert!(text.begin <= MAX_TARGET);
        for _ in 0..1000 {
            text.write_str("3€").unwrap();
        }
        assert!(text.is_cut && text.as_str().ends_with(CUT));
        assert!(text.as_str().starts_with("3€3€"));
    }

    #[test]
    fn the_third_word_holds_what_was_put() {
        let lengths = Lengths {
            target: 96,
            text: 480,
            level: 5,
            is_cut: true,
        };
        assert_eq!(Lengths::of(lengths.word()), lengths);
    }
}
