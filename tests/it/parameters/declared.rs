//! What is declared, and what the start makes of it.

use super::*;
use crate::common::SpawnOk;

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
    let file = TempFile::with(
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
    let file = TempFile::with(
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
    let reported: Vec<String> = refused.iter().map(ToString::to_string).collect();
    assert_eq!(reported, expected);
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
    let file = TempFile::with("none", "a = 1\nb = = 2\n");
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
    let mut system = System::new("bad");
    let main = system.executor("main").build().unwrap();
    let bad = main.process("bad");
    let a = bad.parameter("a", 1.0).unit("m").register().unwrap();
    let shared = bad.parameter("s", 1).shared();
    let s = shared.clone().register().unwrap();
    let reported = [
        bad.parameter("a", 1.0).unit("m").register().unwrap_err(),
        bad.parameter("a", 1.0).register().unwrap_err(),
        bad.parameter("a", 1.0_f32)
            .unit("m")
            .register()
            .unwrap_err(),
        bad.parameter("s", 1).register().unwrap_err(),
        bad.parameter("", 1.0).register().unwrap_err(),
        bad.parameter("x=1", 1.0).register().unwrap_err(),
        bad.parameter("a//b", 1.0).register().unwrap_err(),
        bad.parameter("r", 1.0)
            .range(2.0..=1.0)
            .register()
            .unwrap_err(),
        bad.parameter("r", 1.0)
            .range(0.0..=f64::NAN)
            .register()
            .unwrap_err(),
        bad.parameter("d", 3.0)
            .range(0.0..=2.0)
            .register()
            .unwrap_err(),
        bad.parameter("d", [0.0, f64::INFINITY])
            .register()
            .unwrap_err(),
        bad.parameter("d", 1.0)
            .unit(&"m".repeat(64))
            .register()
            .unwrap_err(),
    ];
    // A second handle of a shared one.
    let again = shared.register().unwrap();
    bad.spawn_ok(async move {
        assert_eq!((a.get(), s.get(), again.get()), (1.0, 1, 1));
        Ok(())
    });
    system.run().unwrap();
    let reported: Vec<&str> = reported
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
        reported,
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

#[test]
fn a_process_that_comes_again_goes_on_with_its_parameters_and_one_that_is_gone_leaves_its_names() {
    let _watch = watchdog();
    let mut system = System::new("again");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let spawner = main.clone();
    main.process("spawner").spawn_ok(async move {
        for round in 0..20 {
            let again = spawner.process("again").one_of_many();
            let x = again.parameter("again/x", 0).range(0..=100).register()?;
            let handle = again.start(async move {
                assert_eq!(x.get(), round);
                Ok(())
            })?;
            handle.join().await;
            // The name is free when its body has been dropped.
            while parameters.list()[0].processes == ["again"] {
                luna::after(MS).await;
            }
            assert_eq!(parameters.list().len(), 1);
            parameters.set([("again/x", round + 1)])?;
        }
        let again = spawner.process("again").one_of_many();
        let differs = again.parameter("again/x", 0).range(0..=101).register();
        assert!(matches!(differs, Err(DeclareError::Differs { .. })));
        Ok(())
    });
    drop(main);
    system.run().unwrap();
}

/// The processes that have a name decide whether it is shared; a process that has ended does not
/// count.
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
                let process = spawner.process(name).one_of_many();
                let x = process.parameter("x", 0).description(&description);
                let x = if is_shared { x.shared() } else { x };
                let x = x.register()?;
                // It stays until its sender is gone.
                let (stay, stays) = luna::channel::<()>();
                let handle = process.start(async move {
                    let _ = stays.recv().await;
                    drop(x);
                    Ok(())
                })?;
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
                Err(error) if !is_shared => {
                    assert!(
                        matches!(
                            &error,
                            Error::Setup(SetupError::Parameter(
                                DeclareError::Duplicate { process, .. }
                            )) if process == "first"
                        ),
                        "{error}"
                    );
                }
                other => panic!("round {round}: {other:?}"),
            }
            // They are dropped on another thread.
            while !parameters.list()[0].processes.is_empty() {
                luna::after(MS).await;
            }
        }
        Ok(())
    };
    main.process("operator").spawn_ok(operator);
    drop(main);
    system.run().unwrap();
}
