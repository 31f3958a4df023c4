//! Runs an operation under callgrind.

use crate::operations::Operation;
use crate::profile::{CodeAddress, Executed, Profile};
use object::{Object, ObjectSymbol};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The function of the operations' program that is called before each lap and after the last.
const MARK: &str = "luna_instructions_mark";

/// The part of callgrind's output with the second lap. The first part is the start, the second the
/// warm-up lap.
const SHORT_LAP: u32 = 3;
/// The part that holds the third lap.
const LONG_LAP: u32 = 4;

/// Makes the GNU C library ignore optional processor features. The names are of before and after
/// its version 2.33.
const PLAIN_COPIES: &str = "glibc.cpu.hwcaps=-AVX2,-AVX_Fast_Unaligned_Load,-AVX512VL,-ERMS,-FSRM,-SSSE3,-SSE4_1,-SSE4_2,\
-AVX2_Usable,-AVX_Usable,-Fast_Unaligned_Copy";

/// What an operation executes.
#[derive(Debug)]
pub(crate) struct Counted {
    /// How many instructions, of the thread that the operation is on.
    pub(crate) instructions: f64,
    /// Which, and how often each.
    pub(crate) places: BTreeMap<CodeAddress, Share>,
}

impl Counted {
    /// Whether all of them are the program's own, and none is a library's.
    pub(crate) fn is_own(&self, program: &Path) -> bool {
        self.places
            .keys()
            .all(|place| Path::new(&place.object) == program)
    }
}

/// An instruction's share of an operation.
#[derive(Debug)]
pub(crate) struct Share {
    /// The function that it is part of.
    pub(crate) function: String,
    /// How often it is executed an operation.
    pub(crate) times: f64,
}

/// Whether callgrind can be run here.
pub(crate) fn is_there() -> bool {
    Command::new("valgrind")
        .arg("--version")
        .output()
        .is_ok_and(|said| said.status.success())
}

/// Counts an operation.
///
/// # Errors
///
/// When the run fails, or leaves other files than expected.
pub(crate) fn count(program: &Path, operation: &Operation) -> Result<Counted, String> {
    let folder = Folder::new(operation)?;
    let mut command = Command::new("valgrind");
    command
        .args(["--quiet", "--tool=callgrind"])
        // Output is written for the thread that reaches the mark, with its own counts only.
        .arg("--separate-threads=yes")
        .arg(format!("--dump-before={MARK}"))
        .args(["--dump-instr=yes", "--compress-pos=no"])
        .arg("--compress-strings=no")
        .arg(format!("--callgrind-out-file={}", folder.file().display()))
        .arg(program)
        .args(["do", &operation.name])
        // What else is in the environment shifts the stack.
        .env_clear()
        .envs(env::vars_os().filter(|(name, _)| name == "PATH" || name == "VALGRIND_LIB"))
        // The C library copies memory in the way that every processor can.
        .env("GLIBC_TUNABLES", PLAIN_COPIES);
    let run = command
        .output()
        .map_err(|error| format!("valgrind: {error}"))?;
    if !run.status.success() {
        return Err(format!(
            "`{}` under valgrind: {}\n{}",
            operation.name,
            run.status,
            String::from_utf8_lossy(&run.stderr)
        ));
    }
    let short = folder.part(SHORT_LAP)?;
    check_addresses(program, &short)?;
    let long = folder.part(LONG_LAP)?;
    Ok(difference(short, long, operation.count as f64))
}

/// Whether callgrind's addresses are those of the program's file, independent of where it was
/// loaded. All known versions do that.
fn check_addresses(program: &Path, profile: &Profile) -> Result<(), String> {
    let bytes = fs::read(program).map_err(|error| format!("{}: {error}", program.display()))?;
    let file = object::File::parse(&*bytes).map_err(|error| error.to_string())?;
    let in_file = file.symbol_by_name(MARK).map(|symbol| symbol.address());
    let mut executed = profile.executed.iter();
    let in_profile = executed
        .find(|(_, executed)| executed.function == MARK)
        .map(|(place, _)| place.address);
    if in_file.is_none() || in_file != in_profile {
        return Err(format!(
            "`{MARK}` is at {in_file:#x?} of the program, and at {in_profile:#x?} of callgrind's output"
        ));
    }
    Ok(())
}

/// What `operations` more operations executed more.
fn difference(short: Profile, long: Profile, operations: f64) -> Counted {
    let mut differences: BTreeMap<CodeAddress, (String, i64)> = BTreeMap::new();
    for (sign, profile) in [(1, long), (-1, short)] {
        for (place, Executed { function, times }) in profile.executed {
            differences.entry(place).or_insert((function, 0)).1 += sign * times as i64;
        }
    }
    let total: i64 = differences.values().map(|(_, times)| times).sum();
    let shares = differences
        .into_iter()
        .filter(|(_, (_, times))| *times != 0);
    let instructions = total as f64 / operations;
    let places = shares
        .map(|(place, (function, times))| {
            let times = times as f64 / operations;
            (place, Share { function, times })
        })
        .collect();
    Counted {
        instructions,
        places,
    }
}

/// Where callgrind writes to. It goes with this.
struct Folder(PathBuf);

impl Folder {
    fn new(operation: &Operation) -> Result<Folder, String> {
        let name: String = operation
            .name
            .chars()
            .map(|one| if one.is_alphanumeric() { one } else { '-' })
            .collect();
        let path = env::temp_dir().join(format!("luna-instructions-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(Folder(path))
    }

    fn file(&self) -> PathBuf {
        self.0.join("out")
    }

    /// The part of this number: one file, since one thread makes marks.
    fn part(&self, number: u32) -> Result<Profile, String> {
        let beginning = format!("out.{number}-");
        let files: Vec<PathBuf> = entries(&self.0)?
            .into_iter()
            .filter(|path| {
                path.file_name()
                    .is_some_and(|name| name.to_string_lossy().starts_with(&beginning))
            })
            .collect();
        let [file] = &files[..] else {
            return Err(format!(
                "callgrind left {} files of part {number}",
                files.len()
            ));
        };
        let text =
            fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
        Profile::parse(&text)
    }
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let read = || -> std::io::Result<Vec<PathBuf>> {
        fs::read_dir(folder)?
            .map(|entry| Ok(entry?.path()))
            .collect()
    };
    read().map_err(|error| format!("{}: {error}", folder.display()))
}

impl Drop for Folder {
    fn drop(&mut self) {
        // On failure, the files stay in the system's temporary folder.
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(costs: &[(u64, u64)]) -> Profile {
        let executed = costs.iter().map(|&(address, times)| {
            let place = CodeAddress {
                object: "/program".to_owned(),
                address,
            };
            let function = "f".to_owned();
            (place, Executed { function, times })
        });
        Profile {
            executed: executed.collect(),
        }
    }

    #[test]
    fn what_both_laps_have_in_common_is_no_operations() {
        let short = profile(&[(1, 7), (2, 100), (4, 3)]);
        let long = profile(&[(1, 7), (2, 200), (3, 50), (4, 1)]);
        let counted = difference(short, long, 50.0);
        let shares: Vec<_> = counted
            .places
            .iter()
            .map(|(place, share)| (place.address, share.times))
            .collect();
        // An instruction that the longer lap executed less often belongs to a rare event.
        assert_eq!(shares, [(2, 2.0), (3, 1.0), (4, -0.04)]);
        assert!((counted.instructions - 2.96).abs() < 1e-9);
        assert!(counted.is_own(Path::new("/program")));
        assert!(!counted.is_own(Path::new("/other")));
    }
}
