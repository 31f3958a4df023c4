//! From noted addresses to names.

use crate::room::Raw;
use crate::{Violation, watch};
use luna_core::current::ProcessId;
use luna_core::path;
use std::fmt::Write;

/// Converts a noted violation, with the names of its process, thread and functions.
pub(crate) fn violation(raw: &Raw, times: u64) -> Violation {
    Violation {
        kind: raw.kind,
        process: ProcessId::from_number(raw.process).map(|process| {
            path::process_name(process).unwrap_or_else(|| format!("number {process}"))
        }),
        thread: watch::thread_name(raw.thread),
        times,
        backtrace: backtrace(raw.addresses()),
    }
}

/// Functions of the guard are no part of what was done.
fn is_guards_own(name: &str) -> bool {
    name.contains("luna_path_guard::")
}

/// Nor are the ways to the allocator and from a signal.
fn is_way_to_guard(name: &str) -> bool {
    name.contains("__rust_")
        || name.starts_with("alloc::alloc::")
        || name.starts_with("<alloc::alloc::Global")
        || name.contains("__restore_rt")
        // What has no name in libc is the way from the signal.
        || name.starts_with("0x")
}

/// Below these there is only how the thread came to run processes.
fn is_end(name: &str) -> bool {
    name.contains("luna_core::executor::turns") || name.contains("os_thread::run")
}

struct Function {
    name: String,
    place: Option<String>,
}

fn backtrace(addresses: &[usize]) -> String {
    let functions: Vec<Function> = addresses.iter().flat_map(|&at| functions(at)).collect();
    // The guard's own functions are the innermost; functions of a test with the same names are
    // further out.
    let innermost = functions.len().min(24);
    let after = functions[..innermost]
        .iter()
        .rposition(|function| is_guards_own(&function.name))
        .map_or(0, |last| last + 1);
    let begin = after
        + functions[after..]
            .iter()
            .take_while(|function| is_way_to_guard(&function.name))
            .count();
    let mut text = String::new();
    for (number, function) in functions[begin..].iter().enumerate() {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{number:6}: {}", function.name);
        if let Some(place) = &function.place {
            let _ = writeln!(text, "             at {place}");
        }
        if is_end(&function.name) {
            break;
        }
    }
    text
}

/// The function at an address, with those inlined into it, the innermost first.
fn functions(address: usize) -> Vec<Function> {
    let mut functions = Vec::new();
    backtrace::resolve(std::ptr::without_provenance_mut(address), |symbol| {
        let place = symbol.filename().map(|file| {
            let line = symbol.lineno().unwrap_or(0);
            format!("{}:{line}", file.display())
        });
        functions.push(Function {
            name: symbol
                .name()
                .map_or_else(|| format!("{address:#x}"), |name| format!("{name:#}")),
            place,
        });
    });
    if functions.is_empty() {
        functions.push(Function {
            name: format!("{address:#x}"),
            place: None,
        });
    }
    functions
}
