use super::*;
use crate::System;
use crate::csp::process::Phases;
use crate::system::plan::{Member, On};
use luna_core::ProcessSpec;
use luna_platform::thread::Attributes;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

/// What a body refers to.
struct Owner(Arc<AtomicBool>);

impl Phases for Owner {
    fn pre_run(&mut self) -> crate::Result<()> {
        Ok(())
    }

    fn post_run(&mut self) {}

    fn words(&self) -> Vec<usize> {
        Vec::new()
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

#[test]
fn a_panic_after_the_end_drops_nothing_of_the_one_that_was_left_behind_in_it() {
    let system = System::new("left behind");
    let plan = system.plan.clone();
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let (runs, is_running) = mpsc::channel();
    let (release, released) = mpsc::channel::<()>();
    let (ends, has_ended) = mpsc::channel();
    let is_gone = Arc::new(AtomicBool::new(false));
    let seen = is_gone.clone();
    let handle = executor.spawn(ProcessSpec::new("stuck"), move || async move {
        runs.send(()).unwrap();
        released.recv().unwrap();
        ends.send(seen.load(Ordering::SeqCst)).unwrap();
    });
    let (id, owner) = (handle.id(), Box::new(Owner(is_gone)));
    let member = Member::new(handle, On::Executor(0), None, Some(owner));
    plan.members().started.enter(id, member, &plan.emergency);
    executor.release();
    is_running.recv().unwrap();
    let mut system_threads = SystemThreads {
        plan: &plan,
        simulation: None,
        executors: [("main".to_owned(), executor)].into(),
        threads: VecDeque::new(),
        has_left_behind: false,
        is_over: false,
    };
    let reports = system_threads.end(|_, _| false);
    assert!(reports[0].abandoned);
    // As by a panic behind that end: there is no thread left that could be detached.
    drop(system_threads);
    drop((system, plan));
    release.send(()).unwrap();
    let was_gone = has_ended.recv().unwrap();
    assert!(!was_gone, "it was dropped while its body ran");
}

#[test]
fn a_real_time_thread_that_used_up_its_share_is_reported_with_the_setting() {
    let root = std::env::temp_dir().join(format!("luna-limits-{}", std::process::id()));
    let folder = root.join("proc/sys/kernel");
    std::fs::create_dir_all(&folder).unwrap();
    for (file, text) in [
        ("osrelease", "6.1.0-rt"),
        ("sched_rt_runtime_us", "950000"),
        ("sched_rt_period_us", "1000000"),
    ] {
        std::fs::write(folder.join(file), text).unwrap();
    }
    let thread = |name: &str, policy, millis| ThreadReport {
        name: name.to_owned(),
        policy,
        core: Some(1),
        shortfalls: Vec::new(),
        abandoned: false,
        processor_time: Some(Duration::from_millis(millis)),
        limit: None,
    };
    let mut threads = vec![
        thread("busy", Policy::Fifo(80), 2500),
        thread("ordinary", Policy::Other, 2500),
        thread("idle", Policy::RoundRobin(80), 100),
    ];
    let elapsed = Duration::from_millis(2600);
    note_limits(&mut threads, &Source::folder(&root), elapsed);
    std::fs::remove_dir_all(root).unwrap();
    let limited: Vec<_> = threads.iter().map(|one| one.limit.is_some()).collect();
    assert_eq!(limited, [true, false, false]);
    let report = crate::Report {
        threads,
        really_elapsed: elapsed,
        ..crate::Report::default()
    };
    let line = "busy had core 1 for 96.2 % of the run. Real-time threads may have \
                950ms of each 1s (/proc/sys/kernel/sched_rt_runtime_us)";
    let text = report.to_string();
    assert!(text.contains(line), "{text}");
}
