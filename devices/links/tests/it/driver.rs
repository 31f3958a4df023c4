//! Drivers that block, on threads of their own: an `embedded-hal` driver over a simulated bus, a
//! slow one, one that hangs, and one that fails.

use crate::common;
use common::{SpawnOk, counter, run_to_loss, watchdog};
use luna::Error;
use luna::channel::CallError;
use luna::devices::{Device, DeviceState, OnLoss, Sharing};
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna_links::driver::driver;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

/// What a driver uses.
fn bus(system: &System) -> Device<()> {
    let opened = system
        .devices()
        .open("bus", "bus", Sharing::Shared, || Ok(()));
    opened.unwrap()
}

#[test]
fn calls_are_answered_in_turn_while_the_executor_goes_on() {
    let _watch = watchdog();
    let mut system = System::new("driver");
    let devices = system.devices();
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<u32, u32>();
    // The driver waits for another process of the same executor: if it blocked the executor, the
    // test would hang.
    let (go, gone) = mpsc::channel::<u32>();
    let link = driver(&bus, gone, calls, |gone, request| {
        Ok(request + gone.recv().map_err(Error::other)?)
    })
    .lost_after(Duration::from_secs(60));
    let counts = link.counts();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    let others = client.clone();
    main.process("one").spawn_ok(async move {
        assert_eq!(client.call(1).await?, 101);
        Ok(())
    });
    main.process("two").spawn_ok(async move {
        assert_eq!(others.call(2).await?, 102);
        Ok(())
    });
    main.process("lets them go on").spawn_ok(async move {
        for _ in 0..2 {
            go.send(100).map_err(Error::other)?;
        }
        Ok(())
    });
    drop(bus);
    system.run().unwrap();
    assert_eq!((counts.records(), counts.bad()), (2, 0));
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn errors_are_unanswered_calls_and_so_many_in_a_row_the_loss() {
    let _watch = watchdog();
    let mut system = System::new("errors");
    let devices = system.devices();
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<bool, ()>();
    let link = driver(&bus, (), calls, |(), works| match works {
        true => Ok(()),
        false => Err(Error::other("no acknowledge")),
    })
    .errors_before_loss(2);
    let counts = link.counts();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        for works in [false, true, false, true] {
            match client.call(works).await {
                Ok(()) => assert!(works),
                Err(error) => assert!(!works && matches!(error, CallError::Unanswered)),
            }
        }
        let _ = client.call(false).await;
        let _ = client.call(false).await;
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(bus);
    let error = run_to_loss(&system, &devices);
    assert!(
        error.contains("the bus `bus` is lost: no acknowledge"),
        "{error}"
    );
    assert_eq!((counts.records(), counts.bad()), (6, 4));
}

#[test]
fn a_transaction_that_hangs_is_a_loss_while_it_hangs() {
    let _watch = watchdog();
    let mut system = System::new("hangs");
    let devices = system.devices();
    let bus = bus(&system);
    let (ran, mut function) = counter();
    bus.on_emergency("off", move |()| function()).unwrap();
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let (end, ended) = mpsc::channel::<()>();
    let link = driver(&bus, ended, calls, |ended, ()| {
        // Until the test is over.
        let _ = ended.recv();
        Ok(())
    })
    .lost_after(Duration::from_millis(20));
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        let _ = client.call(()).await;
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(bus);
    let error = run_to_loss(&system, &devices);
    assert!(error.contains("no answer for 20ms"), "{error}");
    assert_eq!(ran.load(Ordering::Relaxed), 1);
    drop(end);
}

#[test]
fn what_takes_too_long_is_counted() {
    let _watch = watchdog();
    let mut system = System::new("late");
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<bool, ()>();
    let link = driver(&bus, (), calls, |(), is_slow| {
        let end = std::time::Instant::now() + Duration::from_millis(3);
        while is_slow && std::time::Instant::now() < end {}
        Ok(())
    })
    .late_after(Duration::from_millis(2));
    let counts = link.counts();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        for is_slow in [true, false, true] {
            client.call(is_slow).await?;
        }
        Ok(())
    });
    system.run().unwrap();
    // The quick one may have been held up by others, too.
    assert!((2..=3).contains(&counts.late()), "{counts:?}");
    assert!(counts.longest() >= Duration::from_millis(3));
    drop(bus);
}

#[test]
fn in_an_emergency_the_driver_makes_it_safe_and_serves_no_calls_after() {
    let _watch = watchdog();
    let mut system = System::new("safe");
    let bus = bus(&system);
    bus.on_loss(OnLoss::Fail);
    let (client, calls) = luna::channel::call_channel::<u32, ()>();
    let written = Arc::new(Mutex::new(Vec::new()));
    let link = driver(&bus, written.clone(), calls, |written, value| {
        written.lock().unwrap().push(value);
        Ok(())
    })
    .on_emergency(|written| written.lock().unwrap().push(0))
    .unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    let seen = written.clone();
    main.process("control").spawn_ok(async move {
        client.call(7).await?;
        let cause = luna::emergency(Error::other("a test"));
        while seen.lock().unwrap().last() != Some(&0) {
            luna::yield_now().await;
        }
        assert!(client.call(8).await.is_err());
        Err(cause)
    });
    assert!(system.run().is_err());
    assert_eq!(*written.lock().unwrap(), [7, 0]);
    drop(bus);
}

#[test]
fn a_panic_in_a_driver_is_a_loss() {
    let _watch = watchdog();
    let mut system = System::new("panics");
    let devices = system.devices();
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    // The panic hook takes some time to report, before the thread ends.
    let link = driver(&bus, (), calls, |(), ()| panic!("a bug in a driver"))
        .lost_after(Duration::from_secs(60));
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        let _ = client.call(()).await;
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(bus);
    let error = run_to_loss(&system, &devices);
    assert!(error.contains("panicked"), "{error}");
}

/// The report's outcome of the only emergency function.
fn outcome(system: &System) -> FunctionOutcome {
    let safety = system.report().unwrap().safety;
    let [function] = &safety.functions[..] else {
        panic!("not one function: {safety:?}");
    };
    let failed = safety.failed().count();
    assert_eq!(failed == 0, function.outcome == FunctionOutcome::Ran);
    function.outcome
}

/// Runs a system with one process, which calls the driver, and waits for its end.
fn run_caller(
    system: &mut System,
    link: luna_links::driver::Driver<impl Send + 'static, (), ()>,
    call: luna::channel::Client<(), ()>,
) {
    let devices = system.devices();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        let _ = call.call(()).await;
        let _ = call.call(()).await;
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(main);
    run_to_loss(system, &devices);
}

#[test]
fn a_driver_that_hangs_is_not_reported_as_safe() {
    let _watch = watchdog();
    let mut system = System::new("hangs");
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let (end, ended) = mpsc::channel::<()>();
    let link = driver(&bus, ended, calls, |ended, ()| {
        let _ = ended.recv();
        Ok(())
    })
    .lost_after(Duration::from_millis(200))
    .on_emergency(|_| ())
    .unwrap();
    drop(bus);
    run_caller(&mut system, link, client);
    assert_eq!(outcome(&system), FunctionOutcome::Panicked);
    drop(end);
}

#[test]
fn a_driver_that_panicked_still_makes_it_safe() {
    let _watch = watchdog();
    let mut system = System::new("panics");
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let (ran, mut function) = counter();
    let link = driver(&bus, (), calls, |(), ()| panic!("a bug in a driver"))
        .lost_after(Duration::from_secs(60))
        .on_emergency(move |()| function())
        .unwrap();
    drop(bus);
    run_caller(&mut system, link, client);
    assert_eq!(ran.load(Ordering::Relaxed), 1);
    assert_eq!(outcome(&system), FunctionOutcome::Ran);
}

#[test]
fn a_panic_while_it_is_made_safe_is_reported() {
    let _watch = watchdog();
    let mut system = System::new("panics");
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let link = driver(&bus, (), calls, |(), ()| {
        Err(Error::other("no acknowledge"))
    })
    .errors_before_loss(1)
    .lost_after(Duration::from_secs(60))
    .on_emergency(|()| panic!("the bus does not acknowledge that either"))
    .unwrap();
    drop(bus);
    run_caller(&mut system, link, client);
    assert_eq!(outcome(&system), FunctionOutcome::Panicked);
}

#[test]
fn a_virtual_clock_is_refused() {
    let _watch = watchdog();
    let mut system = System::new("virtual");
    system.virtual_clock();
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let link = driver(&bus, (), calls, |(), ()| Ok(()));
    let counts = link.counts();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        let _ = client.call(()).await;
        Ok(())
    });
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("a virtual clock"), "{error}");
    assert_eq!(counts.records(), 0);
    drop(bus);
}

#[test]
fn the_thread_ends_with_the_link() {
    let _watch = watchdog();
    /// Says when it is dropped: with the driver's thread.
    struct Ends(Arc<AtomicBool>);
    impl Drop for Ends {
        fn drop(&mut self) {
            self.0.store(true, Ordering::Release);
        }
    }
    let has_ended = Arc::new(AtomicBool::new(false));
    let mut system = System::new("ends");
    let bus = bus(&system);
    let (client, calls) = luna::channel::call_channel::<(), ()>();
    let link = driver(&bus, Ends(has_ended.clone()), calls, |_, ()| Ok(()));
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user")
        .spawn_ok(async move { Ok(client.call(()).await?) });
    system.run().unwrap();
    assert!(has_ended.load(Ordering::Acquire));
    drop(bus);
}

/// A typical driver for `embedded-hal`: it uses only the trait.
#[cfg(feature = "i2c")]
mod i2c {
    use super::common::skip;
    use super::*;
    use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
    use luna_links::i2c::{self, Settings};

    struct Thermometer<B>(B);

    impl<B: I2c> Thermometer<B> {
        const ADDRESS: u8 = 0x48;

        /// In degrees Celsius.
        fn read(&mut self) -> Result<f32, B::Error> {
            let mut raw = [0; 2];
            self.0.write_read(Self::ADDRESS, &[0], &mut raw)?;
            Ok(f32::from(i16::from_be_bytes(raw)) / 256.0)
        }
    }

    /// A bus with one thermometer.
    struct Simulated {
        raw: [u8; 2],
    }

    impl ErrorType for Simulated {
        type Error = ErrorKind;
    }

    impl I2c for Simulated {
        fn transaction(
            &mut self,
            address: u8,
            operations: &mut [Operation<'_>],
        ) -> Result<(), ErrorKind> {
            if address != 0x48 {
                let source = NoAcknowledgeSource::Address;
                return Err(ErrorKind::NoAcknowledge(source));
            }
            let [Operation::Write(register), Operation::Read(to)] = operations else {
                return Err(ErrorKind::Other);
            };
            assert_eq!(*register, [0]);
            to.copy_from_slice(&self.raw);
            Ok(())
        }
    }

    #[test]
    fn an_embedded_hal_driver_is_a_link_driver() {
        let _watch = watchdog();
        let mut system = System::new("oven");
        let bus = bus(&system);
        let (thermometer, calls) = luna::channel::call_channel::<(), f32>();
        let chip = Thermometer(Simulated { raw: [0x15, 0x80] });
        let link = driver(&bus, chip, calls, |chip, ()| {
            chip.read()
                .map_err(|error| Error::other(format!("{error:?}")))
        });
        let main = system.executor("main").build().unwrap();
        main.process("thermometer").spawn_ok(link);
        main.process("user").spawn_ok(async move {
            assert_eq!(thermometer.call(()).await?, 21.5);
            Ok(())
        });
        system.run().unwrap();
        drop(bus);
    }

    /// A chip of the module `i2c-stub` at 0x48, on the bus that LUNA_I2C_STUB names. It only
    /// supports SMBus transfers, so the test covers opening, settings, and how its refusal is
    /// reported.
    #[test]
    fn a_bus_of_the_kernel() {
        let _watch = watchdog();
        let Ok(path) = std::env::var("LUNA_I2C_STUB") else {
            return skip(
                "no simulated bus: load i2c-dev and i2c-stub, and set LUNA_I2C_STUB to its file",
            );
        };
        let system = System::new("kernel");
        let bus = i2c::open(&system.devices(), &path, &Settings::default()).unwrap();
        let same = i2c::open(&system.devices(), &path, &Settings::default()).unwrap();
        assert_eq!(system.devices().list()[0].users, 2);
        let mut chip = Thermometer(i2c::I2c::new(&same));
        assert!(chip.read().is_err());
        drop(bus);
    }
}
