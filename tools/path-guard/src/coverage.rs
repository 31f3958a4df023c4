//! How much of the path's rules a guard can see here.

use std::fmt;

/// The rules that [`check`](crate::check) can enforce in this build and on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Coverage {
    /// Memory, and system calls with the locks that wait by them.
    Complete,
    /// Memory alone: what the machine lacks for the rest.
    MemoryAlone {
        /// Why.
        why: String,
    },
    /// Nothing: this build has no guard in it.
    Nothing,
}

impl fmt::Display for Coverage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Coverage::Complete => f.write_str("memory, system calls and locks are watched"),
            Coverage::MemoryAlone { why } => {
                write!(f, "system calls and locks are not watched: {why}")
            }
            Coverage::Nothing => f.write_str(
                "nothing is watched: it needs a build with RUSTFLAGS=\"--cfg luna_path_guard\"",
            ),
        }
    }
}

/// Tests what a guard detects here: the first call allocates, frees and makes a system call as if
/// on the path.
///
/// # Panics
///
/// If the program's global allocator is not [`Allocator`](crate::Allocator): a guard that detects
/// nothing must not pass.
///
/// ```
/// # #[global_allocator]
/// # static ALLOCATOR: luna_path_guard::Allocator = luna_path_guard::Allocator::new();
/// match luna_path_guard::coverage() {
///     luna_path_guard::Coverage::Complete => println!("a test that passes has kept to the rules"),
///     less => println!("{less}"),
/// }
/// ```
#[track_caller]
pub fn coverage() -> Coverage {
    #[cfg(luna_path_guard)]
    return crate::scope::probed();
    #[cfg(not(luna_path_guard))]
    Coverage::Nothing
}
