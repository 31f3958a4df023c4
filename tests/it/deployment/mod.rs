//! System files: what they state goes over the program, and what is wrong in them has its line.

mod environment;
mod errors;

use crate::common;
use common::{TempFile, watchdog};
use luna::error::SetupError;
use luna::inspect::{Composition, ProcessPart, ThreadPart};
use luna::prelude::*;
use luna::report::DeploymentReport;
use luna::safety::{BudgetKind, OnOverrun};
use luna::{Error, Report};
use std::time::Duration;

const MILLISECOND: Duration = Duration::from_millis(1);
const CYCLES: u64 = 5;

/// A machine's program: an urgent executor, one that has time, and a thread.
fn describe(system: &mut System) -> luna::Result<()> {
    let control = system.executor("control").core(0).policy(Policy::fifo(80));
    let control = control.build()?;
    let axis = control.process("x axis").priority(20);
    let axis = axis.cycle_budget(MILLISECOND).on_overrun(OnOverrun::Warn);
    axis.spawn(async {
        let mut tick = luna::periodic("x axis", MILLISECOND)?;
        for _ in 0..CYCLES {
            tick.next().await;
        }
        Ok(())
    })?;
    let slow = system.executor("slow").build()?;
    slow.process("planner").spawn(async { Ok(()) })?;
    let console = system.thread("console").process("operator");
    console.spawn(async { Ok(()) })?;
    Ok(())
}

/// The program with a file, on a virtual clock: of the machine nothing is asked.
fn deployed(file: &str) -> luna::Result<(System, String)> {
    let file = TempFile::with("deployment.toml", file);
    let path = file.0.display().to_string();
    let mut system = System::new("machine");
    system.virtual_clock();
    system.deployment_from(&file.0)?;
    describe(&mut system)?;
    Ok((system, path))
}

fn run(file: &str) -> luna::Result<Report> {
    deployed(file)?.0.run()
}

fn thread<'c>(composition: &'c Composition, name: &str) -> &'c ThreadPart {
    let mut threads = composition.threads.iter();
    threads.find(|thread| thread.name == name).unwrap()
}

fn process<'c>(composition: &'c Composition, on: &str, name: &str) -> &'c ProcessPart {
    let mut processes = thread(composition, on).processes.iter();
    processes.find(|process| process.name == name).unwrap()
}

fn deployment(report: &Report) -> &DeploymentReport {
    report.deployment.as_ref().unwrap()
}

#[test]
fn without_a_file_the_program_decides() {
    let _watch = watchdog();
    let mut system = System::new("machine");
    system.virtual_clock();
    describe(&mut system).unwrap();
    let composition = system.composition();
    let control = thread(&composition, "control");
    assert_eq!((control.core, control.policy), (Some(0), Policy::fifo(80)));
    assert_eq!(process(&composition, "control", "x axis").priority, 20);
    assert_eq!(system.run().unwrap().deployment, None);
}

#[test]
fn a_laptop_and_a_machine_run_one_program() {
    let _watch = watchdog();
    let (system, _) = deployed(
        "[executor.control]\ncore = \"any\"\npolicy = \"other\"\n[loop.\"x axis\"]\nperiod = \"10 ms\"\n",
    )
    .unwrap();
    let composition = system.composition();
    let control = thread(&composition, "control");
    assert_eq!((control.core, control.policy), (None, Policy::Other));
    let report = system.run().unwrap();
    assert_eq!(report.loops["x axis"].period, 10 * MILLISECOND);
    assert!(report.elapsed >= 10 * MILLISECOND * CYCLES as u32);

    // What the file does not state is the program's.
    let (system, path) = deployed(
        "[executor.control]\ncore = 3\npolicy = \"rr:70\"\n[executor.slow]\npolicy = \"fifo:20\"\n[executor.console]\ncore = 2\n",
    )
    .unwrap();
    let composition = system.composition();
    let control = thread(&composition, "control");
    assert_eq!(
        (control.core, control.policy),
        (Some(3), Policy::round_robin(70))
    );
    let slow = thread(&composition, "slow");
    assert_eq!((slow.core, slow.policy), (None, Policy::fifo(20)));
    assert_eq!(thread(&composition, "console").core, Some(2));
    let report = system.run().unwrap();
    assert_eq!(report.loops["x axis"].period, MILLISECOND);
    let expected = format!(
        "system file {path}:\n\
         \x20 line 2: executor `control`: core 3 (the program: 0)\n\
         \x20 line 3: executor `control`: policy rr:70 (the program: fifo:80)\n\
         \x20 line 5: executor `slow`: policy fifo:20 (the program: other)\n\
         \x20 line 7: executor `console`: core 2 (the program: any)"
    );
    assert_eq!(deployment(&report).to_string(), expected);
    assert!(report.to_string().contains("line 2: executor `control`"));
}

#[test]
fn processes_have_the_level_the_budgets_and_the_executor_of_the_file() {
    let _watch = watchdog();
    // `slow` is made after the process that is to run there.
    let (system, path) = deployed(
        "[process.\"x axis\"]\npriority = 9\non = \"slow\"\npoll_budget = \"2 ms\"\ncycle_budget = \"3 ms\"\non_overrun = \"emergency\"\n\
         [process.planner]\non = \"control\"\n",
    )
    .unwrap();
    let report = system.run().unwrap();
    let composition = system.composition();
    assert_eq!(process(&composition, "slow", "x axis").priority, 9);
    assert_eq!(process(&composition, "control", "planner").priority, 16);
    let axis = &report.processes[0];
    let budgets: Vec<_> = axis
        .budgets
        .iter()
        .map(|one| (one.kind, one.budget, one.on_overrun))
        .collect();
    let expected = [
        (BudgetKind::Poll, 2 * MILLISECOND, OnOverrun::Emergency),
        (BudgetKind::Cycle, 3 * MILLISECOND, OnOverrun::Emergency),
    ];
    assert_eq!(budgets, expected);
    let expected = format!(
        "system file {path}:\n\
         \x20 line 2: process `x axis`: priority 9 (the program: 20)\n\
         \x20 line 3: process `x axis`: on slow (the program: control)\n\
         \x20 line 4: process `x axis`: poll_budget 2 ms (the program: none)\n\
         \x20 line 5: process `x axis`: cycle_budget 3 ms (the program: 1 ms)\n\
         \x20 line 6: process `x axis`: on_overrun emergency (the program: warn)\n\
         \x20 line 8: process `planner`: on control (the program: slow)"
    );
    assert_eq!(deployment(&report).to_string(), expected);
}

#[test]
fn a_budget_that_is_not_stated_stays() {
    let _watch = watchdog();
    let report = run("[process.\"x axis\"]\npoll_budget = \"2 ms\"\n").unwrap();
    let budgets = &report.processes[0].budgets;
    assert_eq!(budgets.len(), 2);
    assert_eq!(budgets[1].budget, MILLISECOND);
    assert_eq!(budgets[0].on_overrun, OnOverrun::Warn);
}

#[test]
fn stacks_spinning_and_settings_of_the_system() {
    let _watch = watchdog();
    let file = "[system]\nstrict = true\nlock_memory = false\n[executor.slow]\nstack_size = 262144\nspin_before_sleep = \"50 us\"\n";
    let report = run(file).unwrap();
    let lines: Vec<_> = deployment(&report)
        .overrides
        .iter()
        .map(|one| {
            (
                one.line,
                one.key,
                one.program.as_deref().unwrap(),
                &*one.file,
            )
        })
        .collect();
    let expected = [
        (2, "strict", "false", "true"),
        (5, "stack_size", "2097152", "262144"),
        (6, "spin_before_sleep", "0 s", "50 us"),
    ];
    assert_eq!(lines, expected);
}

/// In effect: an executor that is not pinned cannot spin, which a strict system refuses.
#[test]
fn a_strict_file_refuses_what_the_machine_does_not_give() {
    let _watch = watchdog();
    let describe = |file: &TempFile| {
        let mut system = System::new("machine");
        system.deployment_from(&file.0).unwrap();
        let main = system.executor("main").build().unwrap();
        main.process("one").spawn(async { Ok(()) }).unwrap();
        system.run()
    };
    let spin = "[executor.main]\nspin_before_sleep = \"50 us\"\n";
    let report = describe(&TempFile::with("spin", spin)).unwrap();
    assert_eq!(report.threads[0].shortfalls.len(), 1);
    let strict = TempFile::with("strict", &format!("[system]\nstrict = true\n{spin}"));
    let error = describe(&strict).unwrap_err();
    assert!(
        matches!(&error, Error::Setup(SetupError::Refused { of, .. }) if of == "main"),
        "{error}"
    );
}

#[test]
fn what_the_program_states_too_is_no_change() {
    let _watch = watchdog();
    let file = "[system]\nlock_memory = false\n[executor.control]\ncore = 0\npolicy = \"fifo:80\"\n\
                [process.\"x axis\"]\non = \"control\"\npriority = 20\ncycle_budget = \"1000 us\"\n\
                on_overrun = \"warn\"\n[loop.\"x axis\"]\nperiod = \"1 ms\"\n";
    let report = run(file).unwrap();
    let said = deployment(&report).to_string();
    assert!(said.ends_with(".toml: it changes nothing"), "{said}");
}

/// The file cannot hide what is wrong in the program.
#[test]
fn the_programs_own_period_is_checked() {
    let _watch = watchdog();
    let file = TempFile::with("zero", "[loop.axis]\nperiod = \"2 ms\"\n");
    let mut system = System::new("machine");
    system.virtual_clock();
    system.deployment_from(&file.0).unwrap();
    let main = system.executor("main").build().unwrap();
    let body = async { luna::periodic("axis", Duration::ZERO).map(drop) };
    main.process("axis").spawn(body).unwrap();
    let error = system.run().unwrap_err();
    assert!(error.to_string().contains("period of 0"), "{error}");
}

/// Its process is spawned while the system runs.
#[test]
fn a_thread_for_later_has_the_values_of_the_file() {
    let _watch = watchdog();
    let file = TempFile::with("later", "[executor.console]\npolicy = \"fifo:9\"\n");
    let mut system = System::new("machine");
    system.virtual_clock();
    system.deployment_from(&file.0).unwrap();
    let main = system.executor("main").build().unwrap();
    let console = system.thread("console").process("operator");
    let body = async move { console.spawn(async { Ok(()) }).map(drop) };
    main.process("parent").spawn(body).unwrap();
    let report = system.run().unwrap();
    let overrides = &deployment(&report).overrides;
    assert_eq!((overrides.len(), &*overrides[0].file), (1, "fifo:9"));
}

#[test]
fn a_loop_that_never_began_is_reported() {
    let _watch = watchdog();
    let report = run("[loop.\"x axs\"]\nperiod = \"2 ms\"\n").unwrap();
    assert!(
        deployment(&report).to_string().ends_with(
            "line 2: loop `x axs`: period 2 ms, which had no effect: no loop of this name began"
        ),
        "{report}"
    );
    assert_eq!(report.loops["x axis"].period, MILLISECOND);
}

/// A loop's guard is judged by the period that it has.
#[test]
fn loops_of_a_pre_run_have_the_period_of_the_file() {
    struct Axis(Option<luna::Periodic>);

    impl Process for Axis {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.0 = Some(luna::periodic("axis", MILLISECOND)?);
            Ok(())
        }

        async fn run(&mut self) -> luna::Result<()> {
            let tick = self.0.as_mut().unwrap();
            tick.next().await;
            assert_eq!(tick.period(), 3 * MILLISECOND);
            Ok(())
        }
    }

    let _watch = watchdog();
    let file = TempFile::with("pre-run", "[loop.axis]\nperiod = \"3 ms\"\n");
    let mut system = System::new("machine");
    system.virtual_clock();
    system.deployment_from(&file.0).unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("axis").spawn(Axis(None)).unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.loops["axis"].period, 3 * MILLISECOND);
    assert_eq!(report.elapsed, 3 * MILLISECOND);
}

#[test]
fn a_process_that_comes_again_has_the_values_again() {
    let _watch = watchdog();
    let file = TempFile::with("again", "[process.child]\npriority = 25\non = \"b\"\n");
    let mut system = System::new("machine");
    system.virtual_clock();
    system.deployment_from(&file.0).unwrap();
    let a = system.executor("a").build().unwrap();
    system.executor("b").build().unwrap();
    let observer = system.observer();
    let child = a.process("child").one_of_many();
    child.spawn(async { Ok(()) }).unwrap();
    let parent = a.clone().process("parent");
    let body = async move {
        luna::after(MILLISECOND).await;
        a.process("child").one_of_many().spawn(async { Ok(()) })?;
        let composition = observer.composition();
        let b = thread(&composition, "b");
        let children = b.processes.iter().filter(|one| one.name == "child");
        assert!(children.clone().all(|child| child.priority == 25));
        assert_eq!(children.count(), 2);
        Ok(())
    };
    parent.spawn(body).unwrap();
    system.run().unwrap();
}

#[test]
fn a_file_comes_first_and_once() {
    let _watch = watchdog();
    let file = TempFile::with("late", "");
    let too_late = |system: &mut System| {
        let error = system.deployment_from(&file.0).unwrap_err();
        assert!(
            matches!(&error, Error::Setup(SetupError::DeploymentTooLate { .. })),
            "{error}"
        );
    };
    let mut system = System::new("machine");
    system.executor("main").build().unwrap();
    too_late(&mut system);
    let mut system = System::new("machine");
    system.deployment_from(&file.0).unwrap();
    too_late(&mut system);
    let mut system = System::new("machine");
    let error = system.deployment_from("/nowhere/system.toml").unwrap_err();
    assert!(
        error.to_string().starts_with("/nowhere/system.toml: "),
        "{error}"
    );
}

#[test]
fn the_option_of_a_command_line() {
    let _watch = watchdog();
    let file = TempFile::with("option", "[executor.main]\npolicy = \"fifo:7\"\n");
    for form in ["--deployment FILE", "--deployment=FILE"] {
        let form = form.replace("FILE", &file.0.display().to_string());
        let arguments = form.split(' ').chain(["--other", "--", "--deployment"]);
        let mut system = System::new("machine");
        let others = system.deployment_arguments(arguments.map(str::to_owned));
        assert_eq!(others.unwrap(), ["--other", "--", "--deployment"]);
        system.executor("main").build().unwrap();
        let composition = system.composition();
        assert_eq!(thread(&composition, "main").policy, Policy::fifo(7));
    }
    let mut system = System::new("machine");
    let others = system.deployment_arguments(["--deployments".to_owned()]);
    assert_eq!(others.unwrap(), ["--deployments"]);
}
