//! Parameters: where their values come from, what is refused, and when who sees them.
#![cfg(feature = "toml")]

mod common;

use common::{setup_error, watchdog};
use luna::parameters::{DeclareError, Reason, SetError, Source, Value};
use luna::prelude::*;
use luna::{Error, Parameters, SetupError};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// A file that goes with the test.
struct TempFile(PathBuf);

impl TempFile {
    fn new(name: &str, text: &str) -> Self {
        let name = format!("luna-parameters-{name}-{}", std::process::id());
        let file = Self(std::env::temp_dir().join(name));
        file.write(text);
        file
    }

    fn write(&self, text: &str) {
        std::fs::write(&self.0, text).unwrap();
    }

    /// As a file that is watched is to be written: it is never there by halves.
    fn replace(&self, text: &str) {
        let new = self.0.with_extension("new");
        std::fs::write(&new, text).unwrap();
        std::fs::rename(new, &self.0).unwrap();
    }
}

impl Drop for TempFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    Position,
    Speed,
}

impl luna::parameters::Choice for Mode {
    const CHOICES: &'static [(&'static str, Mode)] =
        &[("position", Mode::Position), ("speed", Mode::Speed)];
}

/// One parameter of each kind.
struct All {
    kp: Parameter<f64>,
    limit: Parameter<f32>,
    count: Parameter<u8>,
    offset: Parameter<i64>,
    is_on: Parameter<bool>,
    mode: Parameter<Mode>,
    gains: Parameter<[f64; 3]>,
}

/// What they are.
type Values = (f64, f32, u8, i64, bool, Mode, [f64; 3]);

impl All {
    fn declare() -> luna::Result<Self> {
        Ok(Self {
            kp: Parameter::with_default("pan/kp", 2.0)
                .unit("1/rad")
                .range(0.0..=50.0)
                .description("of the controller")
                .register()?,
            limit: Parameter::with_default("pan/limit", 0.5)
                .range(0.1..=0.9)
                .register()?,
            count: Parameter::with_default("count", 3).register()?,
            offset: Parameter::with_default("offset", -7)
                .range(-10..=10)
                .register()?,
            is_on: Parameter::with_default("is on", false).register()?,
            mode: Parameter::with_default("mode", Mode::Position).register()?,
            gains: Parameter::with_default("gains", [1.0, 2.0, 3.0])
                .range(0.0..=9.0)
                .register()?,
        })
    }

    fn get(&self) -> Values {
        (
            self.kp.get(),
            self.limit.get(),
            self.count.get(),
            self.offset.get(),
            self.is_on.get(),
            self.mode.get(),
            self.gains.get(),
        )
    }
}

const DEFAULTS: Values = (2.0, 0.5, 3, -7, false, Mode::Position, [1.0, 2.0, 3.0]);

/// A process whose `pre_run` and body are given.
struct Made<D, P, B> {
    pre_run: P,
    declared: Option<D>,
    body: Option<B>,
}

impl<D, P, B> Process for Made<D, P, B>
where
    P: FnMut() -> luna::Result<D>,
    B: AsyncFnOnce(&D) -> luna::Result<()>,
{
    fn pre_run(&mut self) -> luna::Result<()> {
        self.declared = Some((self.pre_run)()?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        match (&self.declared, self.body.take()) {
            (Some(declared), Some(body)) => body(declared).await,
            _ => Err(Error::other("it has no body")),
        }
    }
}

fn made<D, P, B>(pre_run: P, body: B) -> Made<D, P, B>
where
    P: FnMut() -> luna::Result<D>,
    B: AsyncFnOnce(&D) -> luna::Result<()>,
{
    Made {
        pre_run,
        declared: None,
        body: Some(body),
    }
}

/// A system with one process that has all kinds, which `body` looks at; on a virtual clock.
fn run_with_all(
    describe: impl FnOnce(&mut System),
    body: impl AsyncFnOnce(&All) -> luna::Result<()> + Send + 'static,
) -> luna::Result<luna::Report> {
    let mut system = System::new("all");
    system.virtual_clock();
    describe(&mut system);
    let main = system.executor("main").build()?;
    main.process("all").spawn(made(All::declare, body))?;
    system.run()
}

#[test]
fn defaults_then_file_then_program() {
    let _watch = watchdog();
    run_with_all(
        |_| {},
        async |all: &All| {
            assert_eq!(all.get(), DEFAULTS);
            Ok(())
        },
    )
    .unwrap();
    let file = TempFile::new(
        "sources",
        "count = 0xff\nmode = \"speed\"\n\"is on\" = true\ngains = [1, 0.5, 9]\n[pan]\nkp = 2.5\nlimit = 0.9\n",
    );
    let describe = |system: &mut System| {
        system.parameters_from(&file.0).set_parameter("offset", 10);
        let arguments = ["a", "--set", "pan/kp=3", "b", "--", "--set"];
        let others = system.parameter_arguments(arguments.map(String::from));
        assert_eq!(others.unwrap(), ["a", "b", "--", "--set"]);
    };
    run_with_all(describe, async |all: &All| {
        let gains = [1.0, 0.5, 9.0];
        assert_eq!(all.get(), (3.0, 0.9, 255, 10, true, Mode::Speed, gains));
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_start_with_what_is_wrong_names_all_of_it() {
    let _watch = watchdog();
    let file = TempFile::new(
        "wrong",
        "count = 256\nmode = \"sped\"\ngains = [1, 2]\noffset = 1.0\n\n[pan]\nkp = inf\nlimit = 0.91\npk = 1\n\"is on\" = 3\n",
    );
    let has_run = Arc::new(AtomicBool::new(false));
    let runs = has_run.clone();
    let outcome = run_with_all(
        |system| {
            system
                .parameters_from(&file.0)
                .set_parameter("is on", 1)
                .set_parameter("gains", 1.0);
        },
        async move |_: &All| {
            runs.store(true, Ordering::Relaxed);
            Ok(())
        },
    );
    let SetupError::Parameters(error) = setup_error(outcome, &["no parameter was set: "]) else {
        panic!("another error");
    };
    let SetError::Refused(mut refused) = error else {
        panic!("{error}");
    };
    refused.sort_by(|one, other| one.name.cmp(&other.name));
    let path = file.0.display();
    let expected = [
        format!("{path}:1: `count` = 256: it must be 0 to 255"),
        "`gains` = 1.0: it must be a list of 3 numbers".to_owned(),
        "`is on` = 1: it must be true or false".to_owned(),
        format!(
            "{path}:2: `mode` = sped: it must be one of position, speed; did you mean `speed`?"
        ),
        format!("{path}:4: `offset` = 1.0: it must be a whole number"),
        format!("{path}:10: `pan/is on` = 3: there is no such parameter"),
        format!("{path}:7: `pan/kp` = inf: it must be finite"),
        format!("{path}:8: `pan/limit` = 0.91: it must be 0.1 to 0.9"),
        format!("{path}:9: `pan/pk` = 1: there is no such parameter; did you mean `pan/kp`?"),
    ];
    let told: Vec<String> = refused.iter().map(ToString::to_string).collect();
    assert_eq!(told, expected);
    assert!(!has_run.load(Ordering::Relaxed));
}

#[test]
fn a_name_that_comes_twice_on_a_command_line_is_refused_and_the_program_may_change_its_mind() {
    let _watch = watchdog();
    let describe = |arguments: &[&'static str]| {
        let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
        move |system: &mut System| {
            system.set_parameter("count", 1).set_parameter("count", 2);
            system.parameter_arguments(arguments).unwrap();
        }
    };
    let twice = describe(&["--set=count=3", "--set", "count=4"]);
    let outcome = run_with_all(twice, async |_: &All| Ok(()));
    setup_error(outcome, &["--set: `count` = 4: it is set twice"]);
    for (arguments, count) in [(&[][..], 2), (&["--set=count=3"][..], 3)] {
        let body = async move |all: &All| {
            assert_eq!(all.count.get(), count);
            Ok(())
        };
        run_with_all(describe(arguments), body).unwrap();
    }
    let mut system = System::new("incomplete");
    for wrong in [
        "--set",
        "--set=",
        "--set=count",
        "--parameters",
        "--parameters=",
    ] {
        let error = system.parameter_arguments([wrong.to_owned()]).unwrap_err();
        let says = match wrong.starts_with("--set") {
            true => " is not NAME=VALUE",
            false => "--parameters: it needs the name of a file",
        };
        assert!(error.to_string().contains(says), "{wrong}: {error}");
    }
}

#[test]
fn a_file_that_is_none_fails_the_start() {
    let _watch = watchdog();
    let run = |file: &PathBuf| {
        let file = file.clone();
        let outcome = run_with_all(
            |system| {
                system.parameters_from(file);
            },
            async |_: &All| Ok(()),
        );
        match setup_error(outcome, &["no parameter was set: "]) {
            SetupError::Parameters(error) => error,
            other => panic!("{other}"),
        }
    };
    let file = TempFile::new("none", "a = 1\nb = = 2\n");
    assert!(matches!(run(&file.0), SetError::File { line: Some(2), .. }));
    file.write("[pan]\nkp = 1\n[\"pan\"]\n");
    assert!(matches!(run(&file.0), SetError::File { line: Some(3), .. }));
    file.write("\"pan/kp\" = 1\n[pan]\nkp = 1\n");
    let error = run(&file.0);
    assert!(
        error
            .to_string()
            .ends_with(":3: `pan/kp` = 1: it is set twice; leave one out"),
        "{error}"
    );
    std::fs::write(&file.0, [0xff, 0xfe, 0]).unwrap();
    assert!(matches!(run(&file.0), SetError::File { line: None, .. }));
    assert!(matches!(
        run(&PathBuf::from("/nowhere/x.toml")),
        SetError::File { line: None, .. }
    ));
    // Without a word there is nothing to refuse.
    file.write("# nothing\n");
    run_with_all(
        |system| {
            system.parameters_from(&file.0);
        },
        async |_: &All| Ok(()),
    )
    .unwrap();
}

#[test]
fn what_cannot_be_declared_says_why() {
    let _watch = watchdog();
    let outside = Parameter::with_default("a", 1.0).register();
    assert!(matches!(outside, Err(DeclareError::NotInPreRun { .. })));
    let told = Arc::new(Mutex::new(Vec::new()));
    let tells = told.clone();
    let declare = move || {
        let a = Parameter::with_default("a", 1.0).unit("m").register()?;
        let shared = Parameter::with_default("s", 1).shared();
        let s = shared.clone().register()?;
        *tells.lock().unwrap() = vec![
            Parameter::with_default("a", 1.0)
                .unit("m")
                .register()
                .unwrap_err(),
            Parameter::with_default("a", 1.0).register().unwrap_err(),
            Parameter::with_default("a", 1.0_f32)
                .unit("m")
                .register()
                .unwrap_err(),
            Parameter::with_default("s", 1).register().unwrap_err(),
            Parameter::with_default("", 1.0).register().unwrap_err(),
            Parameter::with_default("x=1", 1.0).register().unwrap_err(),
            Parameter::with_default("a//b", 1.0).register().unwrap_err(),
            Parameter::with_default("r", 1.0)
                .range(2.0..=1.0)
                .register()
                .unwrap_err(),
            Parameter::with_default("r", 1.0)
                .range(0.0..=f64::NAN)
                .register()
                .unwrap_err(),
            Parameter::with_default("d", 3.0)
                .range(0.0..=2.0)
                .register()
                .unwrap_err(),
            Parameter::with_default("d", [0.0, f64::INFINITY])
                .register()
                .unwrap_err(),
            Parameter::with_default("d", 1.0)
                .unit(&"m".repeat(64))
                .register()
                .unwrap_err(),
        ];
        // A second handle of a shared one.
        Ok((a, s, shared.register()?))
    };
    let mut system = System::new("bad");
    let main = system.executor("main").build().unwrap();
    main.process("bad")
        .spawn(made(declare, async |_: &_| Ok(())))
        .unwrap();
    system.run().unwrap();
    let told: Vec<&str> = told
        .lock()
        .unwrap()
        .iter()
        .map(|error| match error {
            DeclareError::Duplicate { process, .. } => {
                assert_eq!(process, "bad");
                "duplicate"
            }
            DeclareError::Differs { .. } => "differs",
            DeclareError::Name { .. } => "name",
            DeclareError::Range { .. } => "range",
            DeclareError::Default {
                reason: Reason::OutOfRange { .. },
                ..
            } => "default",
            DeclareError::Default {
                reason: Reason::NotFinite,
                ..
            } => "not finite",
            DeclareError::TooLong {
                what: "unit",
                most: 63,
                ..
            } => "unit",
            other => panic!("{other}"),
        })
        .collect();
    assert_eq!(
        told,
        [
            "duplicate",
            "differs",
            "differs",
            "duplicate",
            "name",
            "name",
            "name",
            "range",
            "range",
            "default",
            "not finite",
            "unit"
        ]
    );
}

/// Loops of 1 ms and of 10 ms, and sets between their slots: each takes all that came before its own cycle's begin, at that.
#[test]
fn each_process_takes_a_set_at_its_own_boundary() {
    let _watch = watchdog();
    for _ in 0..2 {
        let mut system = System::new("boundaries");
        system.virtual_clock();
        let left = system.executor("left").build().unwrap();
        let right = system.executor("right").build().unwrap();
        let seen = Arc::new(Mutex::new(String::new()));
        for (executor, name, period) in [(&left, "fast", 1), (&right, "slow", 10)] {
            let seen = seen.clone();
            let declare = move || {
                let own = Parameter::with_default(&format!("{name}/own"), 0).register()?;
                let common = Parameter::with_default("common", 0).shared().register()?;
                Ok((own, common))
            };
            let body = async move |(own, common): &(Parameter<i32>, Parameter<i32>)| {
                let begin = luna::now();
                let mut tick = luna::periodic(name, MS * period)?;
                let mut last = (0, 0);
                while luna::now() < begin + 25 * MS {
                    tick.next().await;
                    let now = (own.get(), common.get());
                    if now != last {
                        let at = (luna::now() - begin).as_millis();
                        write!(seen.lock().unwrap(), "{name} at {at}: {now:?}. ").unwrap();
                    }
                    last = now;
                    // Whatever comes in the middle of a cycle.
                    luna::after(MS * period * 2 / 3).await;
                    assert_eq!((own.get(), common.get()), now);
                }
                Ok(())
            };
            executor.process(name).spawn(made(declare, body)).unwrap();
        }
        let parameters = system.parameters();
        left.process("operator")
            .spawn(async move {
                let begin = luna::now();
                luna::at(begin + 4 * MS + MS / 2).await;
                assert_eq!(
                    parameters.set([("fast/own", 1), ("slow/own", 1), ("common", 1)])?,
                    1
                );
                luna::at(begin + 6 * MS + MS / 2).await;
                assert_eq!(parameters.set([("common", 2)])?, 2);
                // Nobody sees the third.
                luna::at(begin + 12 * MS + MS / 4).await;
                parameters.set([("fast/own", 3)])?;
                assert!(!parameters.is_taken(3));
                parameters.set([("fast/own", 4)])?;
                luna::at(begin + 13 * MS + MS / 2).await;
                assert!(parameters.is_taken(4) && !parameters.is_taken(5));
                Ok(())
            })
            .unwrap();
        drop((left, right));
        system.run().unwrap();
        assert_eq!(
            *seen.lock().unwrap(),
            "fast at 5: (1, 1). fast at 7: (1, 2). slow at 10: (1, 2). fast at 13: (4, 2). "
        );
    }
}

/// Threads set as fast as they can, consistent sets over two processes' parameters; each process reads sums that are right, and the same until it takes another set.
#[test]
fn a_storm_of_sets_is_never_seen_by_halves() {
    let _watch = watchdog();
    const LATCHES: u64 = 20_000;
    let mut system = System::new("storm");
    let over = Arc::new(AtomicU64::new(0));
    let last = Arc::new(Mutex::new(Vec::new()));
    for name in ["one", "two"] {
        let executor = system.executor(name).build().unwrap();
        let declare = move || {
            let number = |part: &str| {
                Parameter::<u64>::with_default(&format!("{name}/{part}"), 0).register()
            };
            let list =
                Parameter::with_default(&format!("{name}/list"), [0_u64, 1, 2, 3, 4, 5, 6, 7])
                    .register()?;
            Ok((number("a")?, number("b")?, list))
        };
        let (over, last) = (over.clone(), last.clone());
        let body =
            async move |(a, b, list): &(Parameter<u64>, Parameter<u64>, Parameter<[u64; 8]>)| {
                let read = || {
                    let value = a.get();
                    assert_eq!(b.get(), value.wrapping_mul(3));
                    assert_eq!(list.get(), std::array::from_fn(|n| value + n as u64));
                    value
                };
                // A reader elsewhere sees no parts of two sets either.
                let elsewhere = list.clone();
                let over_there = over.clone();
                let looks = std::thread::spawn(move || {
                    while over_there.load(Ordering::Relaxed) < 2 {
                        let list = elsewhere.get();
                        assert_eq!(list, std::array::from_fn(|n| list[0] + n as u64));
                    }
                });
                // It has come to a value, and to another.
                let (mut latches, mut values, mut before) = (0, 0, 0);
                while latches < LATCHES || values < 10 {
                    a.latch();
                    latches += 1;
                    let value = read();
                    values += u64::from(value != before);
                    before = value;
                    luna::yield_now().await;
                    assert_eq!(read(), value);
                }
                over.fetch_add(1, Ordering::Relaxed);
                // All handles must have gone before the last word is said.
                while over.load(Ordering::Relaxed) < 2 {
                    luna::yield_now().await;
                }
                looks
                    .join()
                    .map_err(|_| Error::other("the reader elsewhere saw parts of two sets"))?;
                last.lock().unwrap().push(before);
                Ok(())
            };
        executor.process(name).spawn(made(declare, body)).unwrap();
    }
    let setters: Vec<_> = (0..2)
        .map(|who| {
            let (parameters, over) = (system.parameters(), over.clone());
            std::thread::spawn(move || {
                let mut value = who;
                while over.load(Ordering::Relaxed) < 2 {
                    value += 2;
                    let of = |name: &str| {
                        let list: [u64; 8] = std::array::from_fn(|n| value + n as u64);
                        [
                            ("a", value.into()),
                            ("b", (value.wrapping_mul(3)).into()),
                            ("list", list.into()),
                        ]
                        .map(|(part, value): (&str, Value)| (format!("{name}/{part}"), value))
                    };
                    match parameters.set(of("one").into_iter().chain(of("two"))) {
                        Ok(_) => {}
                        // Before the start, or after the end.
                        Err(SetError::NotRunning { .. }) => std::thread::yield_now(),
                        Err(error) => panic!("{error}"),
                    }
                }
                value
            })
        })
        .collect();
    let outcome = system.run();
    over.store(2, Ordering::Relaxed);
    let most = setters
        .into_iter()
        .map(|setter| setter.join().unwrap())
        .max();
    outcome.unwrap();
    for last in last.lock().unwrap().iter() {
        assert!((1..=most.unwrap()).contains(last));
    }
}

#[test]
fn a_process_that_comes_again_goes_on_with_its_parameters_and_one_that_is_gone_leaves_its_names() {
    let _watch = watchdog();
    let mut system = System::new("again");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let spawner = main.clone();
    main.process("spawner").spawn(async move {
        for round in 0..20 {
            let declare = || Ok(Parameter::with_default("again/x", 0).range(0..=100).register()?);
            let body = async move |x: &Parameter<i32>| {
                assert_eq!(x.get(), round);
                Ok(())
            };
            let handle = spawner.process("again").one_of_many().start(made(declare, body))?;
            handle.join().await;
            // The name is free when its `post_run` is over and it was dropped, on another thread.
            while parameters.list()[0].processes == ["again"] {
                luna::after(MS).await;
            }
            assert_eq!(parameters.list().len(), 1);
            parameters.set([("again/x", round + 1)])?;
        }
        let differs = || Ok(Parameter::with_default("again/x", 0).range(0..=101).register()?);
        let outcome = spawner.process("again").one_of_many().start(made(differs, async |_: &_| Ok(())));
        assert!(matches!(
            outcome.unwrap_err(),
            Error::Process { source, .. }
                if matches!(&*source, Error::Setup(SetupError::Parameter(DeclareError::Differs { .. })))
        ));
        Ok(())
    }).unwrap();
    drop(main);
    system.run().unwrap();
}

/// Two processes that take sets when they are told to. A set that does not concern one of them is taken by it, whatever comes after; and who has ended is not waited for.
#[test]
fn a_set_that_is_taken_stays_so_and_nobody_waits_for_who_has_ended() {
    let _watch = watchdog();
    let mut system = System::new("taken");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let mut turns = Vec::new();
    for name in ["a", "b"] {
        let (turn, turned) = luna::channel::<bool>();
        turns.push(turn);
        let declare = move || Ok(Parameter::with_default(name, 0).register()?);
        let body = async move |own: &Parameter<i32>| {
            while turned.recv().await? {
                own.latch();
            }
            Ok(())
        };
        main.process(name).spawn(made(declare, body)).unwrap();
    }
    main.process("operator")
        .spawn(async move {
            // Which have taken the sets 1, 2, ..., so far.
            let taken = || -> Vec<bool> { (1..=4).map(|set| parameters.is_taken(set)).collect() };
            parameters.set([("a", 1)])?;
            assert_eq!(taken(), [false; 4]);
            turns[0].send(true).await?;
            luna::after(MS).await; // it has done so before time goes on
            assert_eq!(taken(), [true, false, false, false]);
            // `b` was not concerned by 1, and is offered 2: that does not undo 1.
            parameters.set([("b", 1)])?;
            assert_eq!(taken(), [true, false, false, false]);
            parameters.set([("a", 2)])?;
            turns[0].send(true).await?;
            luna::after(MS).await; // it has done so before time goes on
            assert_eq!(taken(), [true, false, false, false]);
            let has_taken: Vec<bool> = parameters.list().iter().map(|one| one.taken).collect();
            assert_eq!(has_taken, [true, false]);
            turns[1].send(true).await?;
            luna::after(MS).await; // it has done so before time goes on
            assert_eq!(taken(), [true, true, true, false]);
            // `b` ends without the fourth, on a thread that buries it.
            parameters.set([("b", 2)])?;
            turns[1].send(false).await?;
            while !parameters.list()[1].processes.is_empty() {
                luna::after(MS).await;
            }
            assert_eq!(taken(), [true; 4]);
            assert_eq!(parameters.set([("b", 3)])?, 5);
            assert!(parameters.is_taken(5));
            turns[0].send(false).await?;
            Ok(())
        })
        .unwrap();
    drop(main);
    system.run().unwrap();
}

/// Whether a name is shared is for those to say who have it, not for one that has ended.
#[test]
fn a_name_that_is_free_again_is_shared_if_the_next_say_so() {
    let _watch = watchdog();
    let mut system = System::new("shared anew");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let spawner = main.clone();
    let operator = async move {
        for (round, is_shared) in [false, true, false].into_iter().enumerate() {
            let description = format!("of round {round}");
            let start = |name: &str| {
                let description = description.clone();
                let declare = move || {
                    let x = Parameter::with_default("x", 0).description(&description);
                    let x = if is_shared { x.shared() } else { x };
                    Ok(x.register()?)
                };
                // It stays until its sender is gone.
                let (stay, stays) = luna::channel::<()>();
                let body = async move |_: &Parameter<i32>| {
                    let _ = stays.recv().await;
                    Ok(())
                };
                let process = spawner.process(name).one_of_many();
                let handle = process.start(made(declare, body))?;
                Ok((handle, stay))
            };
            let (first, stay) = start("first")?;
            let second = start("second");
            let all = parameters.list();
            assert_eq!((all.len(), &all[0].description), (1, &description));
            assert_eq!(all[0].processes.len(), 1 + usize::from(is_shared));
            drop(stay);
            first.join().await;
            match second {
                Ok((second, stay)) if is_shared => {
                    drop(stay);
                    second.join().await;
                }
                Err(Error::Process { source, .. }) if !is_shared => assert!(
                    matches!(
                        &*source,
                        Error::Setup(SetupError::Parameter(DeclareError::Duplicate { process, .. })) if process == "first"
                    ),
                    "{source}"
                ),
                other => panic!("round {round}: {other:?}"),
            }
            // They are dropped on another thread.
            while !parameters.list()[0].processes.is_empty() {
                luna::after(MS).await;
            }
        }
        Ok(())
    };
    main.process("operator").spawn(operator).unwrap();
    drop(main);
    system.run().unwrap();
}

#[test]
fn the_file_again_makes_what_a_start_would() {
    let _watch = watchdog();
    let file = TempFile::new("again", "count = 4\n[pan]\nkp = 3.0\n");
    let mut system = System::new("reload");
    system
        .virtual_clock()
        .parameters_from(&file.0)
        .set_parameter("offset", 5);
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let path = file.0.display().to_string();
    let body = async move |all: &All| {
        let (kp, limit, _, offset, is_on, mode, gains) = DEFAULTS;
        assert_eq!(all.get(), (3.0, limit, 4, 5, is_on, mode, gains));
        parameters.set([("pan/limit", 0.25), ("pan/kp", 9.0)])?;
        file.write("count = 5\n");
        let set = parameters.reload()?;
        all.kp.latch();
        assert_eq!(all.get(), (kp, limit, 5, 5, is_on, mode, gains));
        assert!(parameters.is_taken(set));
        // Nothing of one that is wrong.
        file.write("count = 6\nkount = 7\n");
        let error = parameters.reload().unwrap_err();
        assert_eq!(
            error.to_string(),
            format!(
                "no parameter was set: {path}:2: `kount` = 7: there is no such parameter; did you mean `count`?"
            )
        );
        all.kp.latch();
        assert_eq!(all.get(), (kp, limit, 5, offset + 12, is_on, mode, gains));
        Ok(())
    };
    main.process("all").spawn(made(All::declare, body)).unwrap();
    system.run().unwrap();
    assert!(matches!(
        system.parameters().reload(),
        Err(SetError::NotRunning { .. })
    ));
    assert_eq!(
        System::new("none").parameters().reload(),
        Err(SetError::NoFile)
    );
}

#[test]
fn a_file_that_changes_is_read_again_if_that_is_asked_for() {
    let _watch = watchdog();
    let file = TempFile::new("watched", "count = 4\n");
    let mut system = System::new("watch");
    system
        .parameters_from(&file.0)
        .reload_parameters_on_change();
    let main = system.executor("main").build().unwrap();
    let body = async move |all: &All| {
        assert_eq!(all.count.get(), 4);
        let mut tick = luna::periodic("loop", MS)?;
        // Of another length too, since file times may be coarse.
        file.replace("count = 77 \n\n");
        while all.count.get() == 4 {
            tick.next().await;
        }
        assert_eq!(all.count.get(), 77);
        Ok(())
    };
    main.process("all").spawn(made(All::declare, body)).unwrap();
    system.run().unwrap();
}

/// What the start has read is older than what is there when the first process runs.
#[test]
fn a_file_that_changes_during_the_start_is_read_again() {
    let _watch = watchdog();
    let file = TempFile::new("slow", "count = 4\n");
    let mut system = System::new("slow start");
    system
        .parameters_from(&file.0)
        .reload_parameters_on_change();
    let main = system.executor("main").build().unwrap();
    let declare = move || {
        let all = All::declare()?;
        assert_eq!(all.count.get(), 4);
        file.replace("count = 77 \n\n");
        Ok(all)
    };
    let body = async |all: &All| {
        let mut tick = luna::periodic("loop", MS)?;
        while all.count.get() == 4 {
            tick.next().await;
        }
        assert_eq!(all.count.get(), 77);
        Ok(())
    };
    main.process("all").spawn(made(declare, body)).unwrap();
    system.run().unwrap();
}

#[test]
fn the_list_says_all_there_is_to_say() {
    let _watch = watchdog();
    let parameters = Arc::new(Mutex::new(None::<Parameters>));
    let mine = parameters.clone();
    run_with_all(
        |system| {
            let handle = system.parameters();
            assert!(handle.list().is_empty());
            assert!(matches!(handle.set([("pan/kp", 1.0)]), Err(SetError::NotRunning { .. })));
            *mine.lock().unwrap() = Some(handle);
        },
        async move |all: &All| {
            let parameters = parameters.lock().unwrap().take().unwrap();
            parameters.set_text("pan/kp = 4, mode=speed, gains=[3, 2, 1]")?;
            let told: Vec<String> = parameters.list().iter().map(ToString::to_string).collect();
            assert_eq!(
                told,
                [
                    "count = 3 (u8, default 3)",
                    "gains = [3.0, 2.0, 1.0] ([f64; 3], default [1.0, 2.0, 3.0], 0.0 to 9.0)",
                    "is on = false (bool, default false)",
                    "mode = speed (choice, default position, one of position, speed)",
                    "offset = -7 (i64, default -7, -10 to 10)",
                    "pan/kp = 4.0 1/rad (f64, default 2.0, 0.0 to 50.0)",
                    "pan/limit = 0.5 (f32, default 0.5, 0.1 to 0.9)",
                ]
            );
            let kp = &parameters.list()[5];
            assert_eq!((kp.set, kp.taken, kp.processes.as_slice()), (1, false, &["all".to_owned()][..]));
            assert_eq!((kp.description.as_str(), &kp.most), ("of the controller", &Some(Value::Float(50.0))));
            assert_eq!(all.get(), DEFAULTS);
            all.mode.latch();
            assert!(parameters.list().iter().all(|one| one.taken));
            assert_eq!((all.kp.get(), all.mode.get(), all.gains.get()), (4.0, Mode::Speed, [3.0, 2.0, 1.0]));
            // The same value twice in a set, a syntax that is none.
            let twice = parameters.set([("count", 1), ("count", 1)]).unwrap_err();
            assert!(matches!(&twice, SetError::Refused(refused) if refused[0].reason == Reason::Twice && refused[0].source == Source::Program));
            assert!(matches!(parameters.set_text("count"), Err(SetError::Syntax { .. })));
            assert_eq!(parameters.set(Vec::<(String, f64)>::new()), Ok(1));
            Ok(())
        },
    )
    .unwrap();
}

/// By a process that is not theirs, and by a loop that another has made: nothing is taken.
#[test]
fn only_its_own_process_takes_a_set() {
    let _watch = watchdog();
    let mut system = System::new("others");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let (handle, handles) = luna::channel::<(Parameter<f64>, luna::Periodic)>();
    let parameters = system.parameters();
    let declare = || Ok(Parameter::with_default("x", 0.0).register()?);
    main.process("owner")
        .spawn(made(declare, async move |x: &Parameter<f64>| {
            let tick = luna::periodic("handed on", MS)?;
            parameters.set([("x", 1.0)])?;
            handle.send((x.clone(), tick)).await?;
            luna::after(MS * 20).await;
            assert_eq!(x.get(), 0.0);
            x.latch();
            assert_eq!(x.get(), 1.0);
            Ok(())
        }))
        .unwrap();
    main.process("other")
        .spawn(async move {
            let (x, mut tick) = handles.recv().await?;
            for _ in 0..3 {
                tick.next().await;
                x.latch();
                assert_eq!(x.get(), 0.0);
            }
            luna::after(MS * 40).await;
            assert_eq!(x.get(), 1.0);
            Ok(())
        })
        .unwrap();
    drop(main);
    system.run().unwrap();
}
