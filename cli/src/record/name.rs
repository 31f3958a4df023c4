//! How files are called: by system and start, `arm-20261122-120807.luna`.

use luna_logger::Peer;
use std::fs::OpenOptions;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// How many recordings of one system and second there may be in a folder.
const MAX: u32 = 10_000;

/// Makes a file in `folder` that was not there, for what `peer` records.
pub(super) fn new_file(folder: &Path, peer: &Peer) -> io::Result<PathBuf> {
    let (day, second) = utc(peer.started);
    let (year, month, day) = day;
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    let name = format!(
        "{}-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}",
        plain(&peer.system)
    );
    for number in 1..=MAX {
        let path = folder.join(match number {
            1 => format!("{name}.luna"),
            _ => format!("{name}-{number}.luna"),
        });
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(_) => return Ok(path),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => {
                let text = format!("{}: {error}", path.display());
                return Err(io::Error::new(error.kind(), text));
            }
        }
    }
    Err(io::Error::other("there are too many files of this name"))
}

/// A name as a part of a file's name and of a line: letters, digits, `-` and `_`, at most 64 of
/// them.
pub(super) fn plain(name: &str) -> String {
    let plain: String = name
        .chars()
        .take(64)
        .map(|one| match one {
            'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '_' => one,
            _ => '_',
        })
        .collect();
    match plain.is_empty() {
        true => "unnamed".to_owned(),
        false => plain,
    }
}

/// Year, month and day, and the second of the day, of nanoseconds since 1970 in UTC.
pub(super) fn utc(nanos: i64) -> ((i64, u32, u32), u32) {
    let seconds = nanos.div_euclid(1_000_000_000);
    let second = seconds.rem_euclid(86_400) as u32;
    // Years that begin in March: the day that some have more is the last. Eras of 400 years are
    // alike.
    let day = seconds.div_euclid(86_400) + 719_468;
    let (era, day) = (day.div_euclid(146_097), day.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = (day - (153 * month + 2) / 5 + 1) as u32;
    let (month, next) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    ((year + era * 400 + next, month as u32, day), second)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        let at = |seconds: i64| utc(seconds * 1_000_000_000);
        assert_eq!(at(0), ((1970, 1, 1), 0));
        assert_eq!(at(-1), ((1969, 12, 31), 86_399));
        assert_eq!(at(951_782_400), ((2000, 2, 29), 0));
        assert_eq!(at(951_868_800), ((2000, 3, 1), 0));
        assert_eq!(at(1_735_689_599), ((2024, 12, 31), 86_399));
        assert_eq!(at(4_107_542_400), ((2100, 3, 1), 0));
    }

    #[test]
    fn names_lead_nowhere_else() {
        assert_eq!(plain("../../etc/passwd\n"), "______etc_passwd_");
        assert_eq!(plain(""), "unnamed");
        assert_eq!(plain(&"x".repeat(1000)).len(), 64);
    }
}
