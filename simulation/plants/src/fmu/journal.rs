//! What an FMU logs: it becomes a message of LUNA, and while the FMU is set up, the reason of a
//! refusal.

use fmi::fmi2::binding as two;
use fmi::fmi3::binding as three;
use luna::log::{Level, message};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A reason is not longer, in bytes: an FMU may log as much as it likes.
const LONGEST: usize = 1024;

/// Takes what one instance logs, on any thread. It is given to the FMU as the environment that it
/// passes back.
pub(super) struct Journal {
    /// Of its messages.
    target: String,
    is_set_up: AtomicBool,
    /// What it has logged while it was set up, but for what is well.
    said: Mutex<String>,
}

impl Journal {
    pub(super) fn new(name: &str) -> Self {
        Self {
            target: format!("fmu {name}"),
            is_set_up: AtomicBool::new(false),
            said: Mutex::new(String::new()),
        }
    }

    fn said(&self) -> MutexGuard<'_, String> {
        self.said.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What it has logged so far of a refusal.
    pub(super) fn reason(&self) -> String {
        self.said().clone()
    }

    /// From now on a step may be on the real-time path: nothing is kept any more.
    pub(super) fn set_up(&self) {
        self.is_set_up.store(true, SeqCst);
    }

    fn take(&self, level: Level, category: &str, text: &str) {
        let text = text.trim_end();
        send(level, &self.target, category, text);
        if level == Level::Info || self.is_set_up.load(SeqCst) {
            return;
        }
        let mut said = self.said();
        if !said.is_empty() && said.len() + 2 < LONGEST {
            said.push_str("; ");
        }
        let room = LONGEST.saturating_sub(said.len());
        said.push_str(&text[..text.floor_char_boundary(room)]);
    }
}

fn send(level: Level, target: &str, category: &str, text: &str) {
    match category {
        "" => message(level, target, format_args!("{text}")),
        category => message(level, target, format_args!("{category}: {text}")),
    }
}

/// What an FMU logs. Without the environment it is of no instance that is known.
///
/// # Safety
///
/// The environment is null, or that of an instance that lives. The texts are null, or end with a
/// zero, and stay until the return.
unsafe fn take(
    environment: *mut c_void,
    level: Level,
    category: *const c_char,
    text: *const c_char,
) {
    let text_of = |text: *const c_char| match text.is_null() {
        true => Default::default(),
        // SAFETY: it is not null, so by the caller's promise it ends, and stays that long.
        false => unsafe { CStr::from_ptr(text) }.to_string_lossy(),
    };
    let (category, text) = (text_of(category), text_of(text));
    // SAFETY: by the caller's promise it is null, or a journal that lives: the instance holds it.
    match unsafe { environment.cast::<Journal>().as_ref() } {
        Some(journal) => journal.take(level, &category, &text),
        None => send(level, "fmu", &category, text.trim_end()),
    }
}

/// A status that the standard does not have here is no reason to stop: it is one more warning.
fn level(status: c_int, good: c_int, errors: [c_int; 2]) -> Level {
    match status {
        status if status == good => Level::Info,
        status if errors.contains(&status) => Level::Error,
        _ => Level::Warn,
    }
}

unsafe extern "C" {
    /// Of `log.c`: it makes the text, and calls [`logged_two`].
    #[link_name = "luna_plants_fmu_log"]
    pub(super) fn log_two(
        environment: two::fmi2ComponentEnvironment,
        instance: two::fmi2String,
        status: two::fmi2Status,
        category: two::fmi2String,
        format: two::fmi2String,
        ...
    );
}

#[unsafe(export_name = "luna_plants_fmu_logged")]
unsafe extern "C" fn logged_two(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    text: *const c_char,
) {
    let good = two::fmi2Status_fmi2OK as c_int;
    let errors = [two::fmi2Status_fmi2Error, two::fmi2Status_fmi2Fatal].map(|one| one as c_int);
    // SAFETY: `log.c` passes on what the FMU gave, and a text of its own. By the standard the FMU
    // gives the environment of its instance, and texts; or nulls, as some do.
    unsafe { take(environment, level(status, good, errors), category, text) };
}

/// The logger of an FMU of version 3.
pub(super) unsafe extern "C" fn log_three(
    environment: three::fmi3InstanceEnvironment,
    status: three::fmi3Status,
    category: three::fmi3String,
    text: three::fmi3String,
) {
    let good = three::fmi3Status_fmi3OK as c_int;
    let errors = [three::fmi3Status_fmi3Error, three::fmi3Status_fmi3Fatal];
    let level = level(status as c_int, good, errors.map(|one| one as c_int));
    // SAFETY: by the standard the FMU gives the environment of its instance, and texts; or nulls,
    // as some do.
    unsafe { take(environment, level, category, text) };
}
