//! Tests of channels between programs. One program; a module a subject.

#[path = "../../../../tests/kernel/mod.rs"]
mod kernel;
#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;
#[path = "../../../../tests/shared/links.rs"]
mod links;

mod any;
mod blackboard;
mod buffers;
mod calls;
mod child;
mod corrupted;
mod death;
mod foreign;
mod guards;
mod kill;
mod kill_tasks;
mod loans;
mod look;
mod opening;
mod rendezvous;
mod room;
mod same_core;
#[cfg(feature = "serde")]
mod serde_types;

use links::{run, spawn};
use luna::Policy;
use luna_ipc::ZeroCopySend;

/// What most tests send.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("luna_ipc_test::Block")]
struct Block {
    number: u64,
    weight: f32,
    color: u8,
}

fn block(number: u64) -> Block {
    Block {
        number,
        weight: number as f32,
        color: number as u8,
    }
}

/// A name that no other test has.
fn channel_name(test: &str) -> String {
    format!("test/{}/{test}", std::process::id())
}

/// For tests with killed programs that leave files: one of them removes those of all.
fn leaving_files() -> std::sync::MutexGuard<'static, ()> {
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    ONE.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The files of a channel, or of a blackboard.
fn files(name: &str) -> Vec<String> {
    let prefix = format!("luna-ipc.{}.", name.replace('/', "+"));
    let entries = std::fs::read_dir("/dev/shm").unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with(&prefix)).collect()
}

/// Whether this process may have SCHED_FIFO.
fn has_real_time() -> bool {
    let probe = std::thread::spawn(|| {
        // SAFETY: the parameter is a valid structure, and the thread is this one.
        unsafe {
            let parameter = libc::sched_param { sched_priority: 1 };
            libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameter) == 0
        }
    });
    probe.join().unwrap()
}

/// SCHED_OTHER, and SCHED_FIFO where this process may have it.
fn policies() -> Vec<Policy> {
    if has_real_time() {
        vec![Policy::Other, Policy::fifo(30)]
    } else {
        shared::skip("the part with SCHED_FIFO: it is not granted");
        vec![Policy::Other]
    }
}
