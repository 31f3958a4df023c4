//! What callgrind writes: how often each instruction was executed.

use std::collections::BTreeMap;

/// An instruction: the file that it is in, and its address there.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CodeAddress {
    /// The program's or the library's path.
    pub(crate) object: String,
    /// As in the file's own tables, wherever it was loaded.
    pub(crate) address: u64,
}

/// An instruction's data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Executed {
    /// The function that it is part of; others may be inlined there.
    pub(crate) function: String,
    /// How often it was executed.
    pub(crate) times: u64,
}

/// What was executed between two marks.
#[derive(Debug, Default)]
pub(crate) struct Profile {
    pub(crate) executed: BTreeMap<CodeAddress, Executed>,
}

impl Profile {
    /// Reads a part of callgrind's output, written with
    /// `--dump-instr=yes --compress-pos=no --compress-strings=no`, with one event.
    ///
    /// # Errors
    ///
    /// The text does not have that form, or does not add up to its stated total.
    pub(crate) fn parse(text: &str) -> Result<Profile, String> {
        let mut profile = Profile::default();
        let mut object = String::new();
        let mut function = String::new();
        let mut is_callees = false;
        let mut stated = None;
        for line in text.lines() {
            if let Some((key, value)) = line.split_once('=')
                && key.bytes().all(|byte| byte.is_ascii_lowercase())
            {
                match key {
                    "ob" => object = value.to_owned(),
                    "fn" => function = value.to_owned(),
                    // The next line has the counts of the called function, which are on its own
                    // lines too.
                    "calls" => is_callees = true,
                    "fl" | "fi" | "fe" | "cob" | "cfi" | "cfl" | "cfn" => {}
                    _ => return Err(format!("unknown in a profile: {line}")),
                }
            } else if line.starts_with("0x") {
                if std::mem::take(&mut is_callees) {
                    continue;
                }
                let (address, times) =
                    cost(line).ok_or_else(|| format!("not a cost in a profile: {line}"))?;
                let place = CodeAddress {
                    object: object.clone(),
                    address,
                };
                let executed = profile.executed.entry(place).or_insert_with(|| Executed {
                    function: function.clone(),
                    times: 0,
                });
                executed.times += times;
            } else if let Some(total) = line.strip_prefix("totals: ") {
                stated = total.parse().ok();
            } else if let Some(events) = line.strip_prefix("events: ")
                && events.trim() != "Ir"
            {
                return Err(format!("more than instructions in a profile: {events}"));
            }
        }
        let counted = profile.total();
        if stated != Some(counted) {
            return Err(format!(
                "a profile of {counted} instructions that states {stated:?}"
            ));
        }
        Ok(profile)
    }

    /// How many instructions were executed in all.
    pub(crate) fn total(&self) -> u64 {
        self.executed.values().map(|one| one.times).sum()
    }
}

/// Reads `0x1234 LINE TIMES`, of which the line is not of interest.
fn cost(line: &str) -> Option<(u64, u64)> {
    let mut words = line.split_ascii_whitespace();
    let address = u64::from_str_radix(words.next()?.strip_prefix("0x")?, 16).ok()?;
    let times = words.nth(1)?.parse().ok()?;
    words.next().is_none().then_some((address, times))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
# callgrind format
desc: Trigger: --dump-before=mark
positions: instr line
events: Ir
summary: 107

ob=/lib/libc.so.6
fl=clone.S
fn=clone
cob=/bin/program
cfn=program::run
calls=1 0x1000 0
0x10 100 107

ob=/bin/program
fl=main.rs
fn=program::run
0x1000 5 3
fi=atomic.rs
0x1004 9 100
fe=main.rs
0x1000 6 4
totals: 107
";

    #[test]
    fn costs_are_added_up_by_address_without_those_of_callees() {
        let profile = Profile::parse(TEXT).unwrap();
        let seen: Vec<_> = profile
            .executed
            .iter()
            .map(|(at, what)| (&at.object[..], at.address, &what.function[..], what.times))
            .collect();
        assert_eq!(
            seen,
            [
                ("/bin/program", 0x1000, "program::run", 7),
                ("/bin/program", 0x1004, "program::run", 100),
            ]
        );
        assert_eq!(profile.total(), 107);
    }

    #[test]
    fn a_profile_that_does_not_add_up_is_refused() {
        assert!(Profile::parse(&TEXT.replace("totals: 107", "totals: 108")).is_err());
        assert!(Profile::parse(&TEXT.replace("totals: 107\n", "")).is_err());
        assert!(Profile::parse(&TEXT.replace("Ir", "Ir Dr")).is_err());
        assert!(Profile::parse(&TEXT.replace("calls=", "jump=")).is_err());
    }
}
