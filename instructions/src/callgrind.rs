//! Runs an operation under callgrind.

use crate::operations::Operation;
use crate::profile::{Place, Profile};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The function of the operations' program that stands before each lap and after the last.
const MARK: &str = "luna_instructions_mark";

/// The part of callgrind's output that holds the second lap. The first part is the start, the second the lap that warms up.
const SHORT_LAP: u32 = 3;
/// The part that holds the third lap.
const LONG_LAP: u32 = 4;

/// Has the GNU C library leave aside what some processors have and others have not. Names of before and after its version 2.33.
const PLAIN_COPIES: &str = "glibc.cpu.hwcaps=-AVX2,-AVX_Fast_Unaligned_Load,-AVX512VL,-ERMS,-FSRM,-SSSE3,-SSE4_1,-SSE4_2,\
-AVX2_Usable,-AVX_Usable,-Fast_Unaligned_Copy";

/// What an operation executes.
#[derive(Debug)]
pub(crate) struct Counted {
    /// How many instructions, of the thread that the operation is on.
    pub(crate) instructions: f64,
    /// Which, and how often each.
    pub(crate) places: BTreeMap<Place, Share>,
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
        // Of the threads the one that comes to the mark is written down, with what it alone has executed.
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
    let long = folder.part(LONG_LAP)?;
    Ok(difference(short, long, operation.count as f64))
}

/// What `operations` more operations executed more.
fn difference(short: Profile, long: Profile, operations: f64) -> Counted {
    let instructions = (long.total() as f64 - short.total() as f64) / operations;
    let mut places = BTreeMap::new();
    for (sign, profile) in [(1.0, long), (-1.0, short)] {
        for (place, executed) in profile.executed {
            let share = places.entry(place).or_insert_with(|| Share {
                function: executed.function,
                times: 0.0,
            });
            share.times += sign * executed.times as f64 / operations;
        }
    }
    places.retain(|_, share| share.times != 0.0);
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
        // What is left lies in the system's folder for it.
        let _ = fs::remove_dir_all(&self.0);
    }
}
