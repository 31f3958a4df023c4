//! A system file: what it states about executors, processes and loops goes over what the program
//! states. Read before the start; `docs/system-file.md` describes the file.

mod budgets;
mod read;
mod report;
mod stated;
mod threads;

pub use budgets::{Budgets, OnOverrun};
pub use report::{DeploymentReport, Override};

use crate::file::{Problem, Source, nearest};
use luna_platform::clock::nanos;
use stated::{At, Named, Stated};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The variable of the environment that names a file.
pub const VARIABLE: &str = "LUNA_DEPLOYMENT";

/// The most bytes of a loop's name.
pub const LONGEST_LOOP_NAME: usize = 63;

/// Why a system file cannot be followed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DeploymentError {
    /// It cannot be read.
    #[error("{path}: {message}")]
    File {
        /// Its path.
        path: String,
        /// The system's error.
        message: String,
    },
    /// Something is wrong in it.
    #[error("{0}")]
    Wrong(Box<Problem>),
}

/// The file of one system, and what it has changed.
pub struct Deployment {
    name: String,
    text: String,
    /// What errors say of a file that the environment names.
    named_by: String,
    stated: Stated,
    done: Mutex<Done>,
}

#[derive(Default)]
struct Done {
    /// By their numbers.
    executors: Vec<String>,
    /// Executors and threads.
    threads: Vec<String>,
    processes: Vec<String>,
    /// The system starts.
    is_settled: bool,
    /// By where they stand.
    overrides: BTreeMap<usize, Override>,
}

impl Deployment {
    /// Of the system whose name is given, if the environment names the file.
    ///
    /// # Errors
    ///
    /// It cannot be read, or something is wrong in it.
    pub fn read(path: &Path, system: Option<&str>) -> Result<Self, DeploymentError> {
        let name = path.display().to_string();
        let named_by = system.map_or(String::new(), |system| {
            format!("; {VARIABLE} names this file, also for the system `{system}`")
        });
        let unreadable = |message: String| DeploymentError::File {
            path: name.clone(),
            message: message + &named_by,
        };
        let text = std::fs::read_to_string(path).map_err(|error| unreadable(error.to_string()))?;
        let source = Source {
            name: &name,
            text: &text,
        };
        let stated = read::read(source)
            .map_err(unreadable)?
            .map_err(|problem| in_setup(problem, &named_by))?;
        Ok(Self {
            name,
            text,
            named_by,
            stated,
            done: Mutex::default(),
        })
    }

    fn source(&self) -> Source<'_> {
        Source {
            name: &self.name,
            text: &self.text,
        }
    }

    fn done(&self) -> MutexGuard<'_, Done> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn problem<T>(&self, at: &At<T>, message: &str, advice: impl Into<String>) -> DeploymentError {
        let problem = self.source().problem(at.span.clone(), message, advice);
        in_setup(problem, &self.named_by)
    }

    /// Notes a value of the file, if it is another than the program's.
    fn note<T>(&self, at: &At<T>, of: &str, key: &'static str, program: String, file: String) {
        if program == file {
            return;
        }
        let one = Override {
            line: self.source().position(at.span.start).0,
            of: of.to_owned(),
            key,
            file,
            program: Some(program),
        };
        // A later process of the name would show what the first one was given.
        self.done().overrides.entry(at.span.start).or_insert(one);
    }

    /// An executor was made: the next one.
    pub fn enter_executor(&self, name: &str) {
        self.done().executors.push(name.to_owned());
    }

    /// A process is described.
    fn enter_process(&self, name: &str) {
        let mut done = self.done();
        // Of many with one name, one; and none of those that come while the system runs.
        if !done.is_settled && done.processes.last().is_none_or(|last| last != name) {
            done.processes.push(name.to_owned());
        }
    }

    /// A process as the file has it. If the file names an executor for it that is not made yet,
    /// [`settle`](Self::settle) places the process later. `executor` is the number of its own, if
    /// it has no thread for itself.
    ///
    /// # Errors
    ///
    /// What cannot be.
    pub fn process(
        &self,
        name: &str,
        level: &mut u8,
        executor: Option<&mut usize>,
        budgets: &mut Option<Box<Budgets>>,
    ) -> Result<(), DeploymentError> {
        self.enter_process(name);
        let Some(stated) = find(&self.stated.processes, name) else {
            return Ok(());
        };
        let of = format!("process `{name}`");
        if let Some(at) = &stated.priority {
            if executor.is_none() {
                let message = "this process has a thread of its own, where this does nothing";
                let advice = "write the policy of the thread below `[executor]`";
                return Err(self.problem(at, message, advice));
            }
            self.note(at, &of, "priority", level.to_string(), at.value.to_string());
            *level = at.value;
        }
        if let Some(at) = &stated.on {
            self.place(at, &of, executor)?;
        }
        let shown = |time: Option<Duration>| time.map_or("none".to_owned(), written);
        if let Some(at) = &stated.poll_budget {
            let budgets = budgets.get_or_insert_default();
            let program = shown(budgets.poll.replace(at.value));
            self.note(at, &of, "poll_budget", program, written(at.value));
        }
        if let Some(at) = &stated.cycle_budget {
            let budgets = budgets.get_or_insert_default();
            let program = shown(budgets.cycle.replace(at.value));
            self.note(at, &of, "cycle_budget", program, written(at.value));
        }
        if let Some(at) = &stated.on_overrun {
            let Some(budgets) = budgets else {
                let message = "this process has no budget that it could overrun";
                let advice = "write `poll_budget` or `cycle_budget` beside it";
                return Err(self.problem(at, message, advice));
            };
            let program = budgets.on_overrun.replace(at.value).unwrap_or_default();
            let (program, file) = (word(program).to_owned(), word(at.value).to_owned());
            self.note(at, &of, "on_overrun", program, file);
        }
        Ok(())
    }

    /// Places a process on the executor that the file names, if that is there.
    fn place(
        &self,
        at: &At<String>,
        of: &str,
        executor: Option<&mut usize>,
    ) -> Result<(), DeploymentError> {
        let Some(number) = executor else {
            let message = "this process has a thread of its own, since it may block";
            let advice = "leave `on` out, or spawn the process on an executor";
            return Err(self.problem(at, message, advice));
        };
        let (target, program) = {
            let done = self.done();
            let mut names = done.executors.iter();
            let target = names.position(|name| *name == at.value);
            (target, done.executors.get(*number).cloned())
        };
        if let Some(target) = target.filter(|target| target != number) {
            *number = target;
            self.note(at, of, "on", program.unwrap_or_default(), at.value.clone());
        }
        Ok(())
    }

    /// As the system starts: settings, processes of executors that came later (each with the number
    /// of its own), and names that nothing has.
    ///
    /// # Errors
    ///
    /// What cannot be.
    pub fn settle<'p>(
        &self,
        strict: &mut bool,
        lock_memory: &mut bool,
        waiting: impl IntoIterator<Item = (&'p str, Option<&'p mut usize>)>,
    ) -> Result<(), DeploymentError> {
        for (name, executor) in waiting {
            let found = find(&self.stated.processes, name);
            let Some(at) = found.and_then(|found| found.on.as_ref()) else {
                continue;
            };
            self.place(at, &format!("process `{name}`"), executor)?;
        }
        self.check_names()?;
        let flags = [
            ("strict", &self.stated.strict, strict),
            ("lock_memory", &self.stated.lock_memory, lock_memory),
        ];
        for (key, stated, setting) in flags {
            if let Some(at) = stated {
                let program = std::mem::replace(setting, at.value);
                self.note(at, "system", key, program.to_string(), at.value.to_string());
            }
        }
        Ok(())
    }

    /// Whether the program has all that the file names.
    fn check_names(&self) -> Result<(), DeploymentError> {
        let mut done = self.done();
        done.is_settled = true;
        let processes = std::mem::take(&mut done.processes);
        let unknown = |at: &At<String>, message: &str, names: &[String]| {
            let names = names.iter().map(String::as_str);
            Err(self.problem(at, message, nearest(&at.value, names)))
        };
        for (at, _) in &self.stated.threads {
            if !done.threads.contains(&at.value) {
                return unknown(at, "the system has no such executor", &done.threads);
            }
        }
        for (at, process) in &self.stated.processes {
            if !processes.contains(&at.value) {
                return unknown(at, "the system has no such process", &processes);
            }
            if let Some(at) = &process.on
                && !done.executors.contains(&at.value)
            {
                return unknown(at, "the system has no such executor", &done.executors);
            }
        }
        Ok(())
    }

    /// The period of a loop. Allocates nothing; O(loops in the file).
    pub fn period(&self, name: &str, period: Duration) -> Duration {
        let Some(found) = find(&self.stated.loops, name) else {
            return period;
        };
        found.program.store(nanos(period), Ordering::Relaxed);
        found.period.value
    }

    /// What the file has changed, in its order.
    pub fn report(&self) -> DeploymentReport {
        let mut overrides = self.done().overrides.clone();
        for (name, one) in &self.stated.loops {
            let at = &one.period;
            let program = one.program.load(Ordering::Relaxed);
            if program == nanos(at.value) {
                continue;
            }
            let of_loop = Override {
                line: self.source().position(at.span.start).0,
                of: format!("loop `{}`", name.value),
                key: "period",
                file: written(at.value),
                program: (program != 0).then(|| written(Duration::from_nanos(program))),
            };
            overrides.insert(at.span.start, of_loop);
        }
        DeploymentReport {
            file: self.name.clone(),
            overrides: overrides.into_values().collect(),
        }
    }
}

/// A problem of a file, and what named the file.
fn in_setup(mut problem: Problem, named_by: &str) -> DeploymentError {
    if !named_by.is_empty() {
        problem.advice = format!("{}{named_by}", problem.advice).into();
    }
    DeploymentError::Wrong(Box::new(problem))
}

fn find<'s, T>(all: &'s [Named<T>], name: &str) -> Option<&'s T> {
    let found = all.iter().find(|(known, _)| known.value == name);
    found.map(|(_, one)| one)
}

/// A time as it is written in a file.
fn written(time: Duration) -> String {
    let nanos = time.as_nanos();
    let units = [("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)];
    let whole = units
        .iter()
        .find(|(_, length)| nanos.is_multiple_of(*length));
    let (unit, length) = whole.copied().unwrap_or(("ns", 1));
    format!("{} {unit}", nanos / length)
}

/// The words of `on_overrun`.
const WORDS: [(&str, OnOverrun); 4] = [
    ("count", OnOverrun::Count),
    ("warn", OnOverrun::Warn),
    ("poison", OnOverrun::Poison),
    ("emergency", OnOverrun::Emergency),
];

fn word(policy: OnOverrun) -> &'static str {
    let found = WORDS.iter().find(|(_, known)| *known == policy);
    found.map_or("", |(word, _)| word)
}

luna_platform::debug_fields!(Deployment, |deployment| name: deployment.name);
