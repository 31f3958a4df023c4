//! A card as a device of its system: open once, neutral in an emergency, lost with its link.

use crate::common;
use common::{FASTEST, PERIOD, SpawnOk, patient_link, register, samples, turning, wait_until};
use luna::End;
use luna::devices::{DeviceError, DeviceState, Holder, OnLoss};
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna_mesa::{CardProcess, OpenError};
use luna_mesa_sim::{Card as SimCard, Server};
use std::sync::Arc;
use std::time::Duration;

/// A link to the card, as a device of the system; `control` gets its readings and its generator 0.
fn connect<F: Future<Output = luna::Result<()>> + Send + 'static>(
    system: &System,
    server: &Server,
    control: impl FnOnce(Receiver<luna_mesa::Sample<luna_mesa::Reading>>, Sender<f64>) -> F,
) -> (CardProcess, F) {
    let card = luna_mesa::open(&system.devices(), server.address()).unwrap();
    let (count, counts) = samples();
    let (duty, duties) = register::<f64>();
    let mut link = patient_link(card);
    link.encoder(0, FASTEST, count).pwm(0, duties);
    (link.process().unwrap(), control(counts, duty))
}

#[test]
fn a_card_is_open_once_until_its_link_has_ended() {
    let server = turning();
    let mut system = System::new("test");
    let devices = system.devices();
    let (process, control) = connect(&system, &server, async |counts, duty| {
        for _ in 0..5 {
            counts.recv().await?;
            duty.send(0.25).await?;
        }
        Ok(())
    });
    let again = luna_mesa::open(&devices, server.address()).unwrap_err();
    let OpenError::Device(DeviceError::Busy { device, by }) = again else {
        panic!("not busy: {again}");
    };
    assert_eq!(device, format!("mesa:{}", server.address()));
    assert_eq!(by, Holder::ThisProgram);
    let main = system.executor("main").build().unwrap();
    main.process("control").spawn_ok(control);
    main.process("card").spawn_ok(process);
    let report = system.run().unwrap();
    assert_eq!(report.safety.failed().count(), 0);
    let about = &devices.list()[0];
    assert_eq!((about.state, about.users), (DeviceState::Closed, 0));
    assert_eq!(about.loss, None);
    wait_until(&server, SimCard::is_neutral);
    // It is not open any more.
    luna_mesa::open(&System::new("next").devices(), server.address()).unwrap();
}

#[test]
fn its_own_emergency_function_takes_the_outputs_away() {
    let server = Arc::new(turning());
    let looked = server.clone();
    let mut system = System::new("test");
    let devices = system.devices();
    let (process, control) = connect(&system, &server, async move |counts, duty| {
        loop {
            counts.recv().await?;
            duty.send(0.25).await?;
            if looked.with_card(|card, _| card.duty(0) == 0.25) {
                return Err(luna::emergency(luna::Error::other("a test")));
            }
        }
    });
    let main = system.executor("main").build().unwrap();
    main.process("control").spawn_ok(control);
    main.process("card").spawn_ok(process);
    system.run().unwrap_err();
    let safety = system.report().unwrap().safety;
    let [function] = &safety.functions[..] else {
        panic!("not one function: {safety:?}");
    };
    assert_eq!(function.outcome, FunctionOutcome::Ran);
    let name = format!("mesa:{}: outputs off", server.address());
    assert_eq!(function.name, name);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
    wait_until(&server, SimCard::is_neutral);
}

#[test]
fn a_card_that_is_silent_is_lost_as_was_chosen() {
    for (policy, end) in [
        (OnLoss::Emergency, End::Emergency),
        (OnLoss::Fail, End::Completed),
    ] {
        let server = Arc::new(turning());
        let breaker = server.clone();
        let mut system = System::new("test");
        let devices = system.devices();
        let card = luna_mesa::open(&devices, server.address()).unwrap();
        card.device().unwrap().on_loss(policy);
        let (count, counts) = samples();
        let mut link = card.link("card", PERIOD);
        link.watchdog(Duration::from_secs(5))
            .tolerance(luna_mesa::Bucket::new(10, 1, 50));
        link.encoder(0, FASTEST, count);
        let process = link.process().unwrap();
        let main = system.executor("main").build().unwrap();
        main.process("control").spawn_ok(async move {
            counts.recv().await?;
            breaker.silence(Duration::from_secs(60));
            while counts.recv().await.is_ok() {}
            Ok(())
        });
        main.process("card").spawn_ok(process);
        let error = system.run().unwrap_err().to_string();
        assert!(error.contains("Mesa card `mesa:"), "{error}");
        assert!(error.contains("did not come in time"), "{error}");
        assert_eq!(system.report().unwrap().end, end, "{error}");
        let about = &devices.list()[0];
        assert_eq!(about.state, DeviceState::Closed);
        assert!(about.loss.is_some(), "{about:?}");
    }
}
