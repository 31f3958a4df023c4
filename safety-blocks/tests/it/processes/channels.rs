//! Two channels, of which one fails.

use super::*;
use crate::common::SpawnOk;

/// A motor driven by two controllers through a vote; B fails after 300 ms. Returns the outputs and
/// when they came.
fn voted(vote: Vote, b_after: fn(f64) -> Option<f64>) -> (Vec<(u128, Finding)>, Instant, f64) {
    let (system, main) = system();
    let ((a, from_a), (b, from_b)) = (luna::channel::<f64>(), luna::channel());
    let (safe, duties) = luna::buffered(Buffer::overwrite_oldest(1));
    let (angle, angles) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (again, angles_again) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (reports, causes) = luna::buffered(Buffer::overwrite_oldest(16));
    let agreement = Agreement::new(vote, 0.0, 0.05, 10 * MS).unwrap();
    let process = AgreementProcess::new(
        "vote",
        agreement,
        Response::new(Reaction::Neutral).limited_for(Duration::from_millis(100)),
        [from_a, from_b],
        safe,
        MS / 2,
        20 * MS,
    );
    main.process("vote")
        .priority(15)
        .spawn_ok(process.unwrap().report_to(reports));
    let controllers = [("a", a, angles, true), ("b", b, angles_again, false)];
    for (name, output, angles, is_a) in controllers {
        main.process(name).spawn_ok(async move {
            let mut tick = luna::periodic(name, MS)?;
            for n in 1..=1000 {
                tick.next().await;
                let angle = angles.try_recv().unwrap_or_default();
                let duty = 4.0 * (0.5 * (f64::from(n) * 5e-3).sin() - angle);
                let said = match is_a || n < 300 {
                    true => Some(duty),
                    false => b_after(duty),
                };
                if let Some(duty) = said {
                    output.send(duty).await?;
                }
            }
            Ok(())
        });
    }
    let alarms = note(&main, causes);
    let mut motor = PlantLink::new("motor", Motor::new(PAN));
    motor.actuator("duty", duties).unwrap();
    motor.sensor("angle", angle).unwrap();
    motor.sensor("angle", again).unwrap();
    let end = Arc::new(Mutex::new(None));
    let at_end = end.clone();
    motor.at_end(move |motor| *at_end.lock().unwrap() = Some((luna::now(), motor.state())));
    main.process("motor")
        .priority(20)
        .spawn_ok(motor.periodic(MS).unwrap());
    system.run().unwrap();
    let (at, state) = end.lock().unwrap().take().unwrap();
    (taken(&alarms), at, state.speed)
}

#[test]
fn one_out_of_two_stops_for_a_channel_that_is_silent_or_wrong() {
    let (alarms, ..) = voted(Vote::OneOutOfTwo, |_| None);
    // Half a millisecond after the other's value.
    assert_eq!(alarms[0].0, 300);
    assert!(matches!(alarms[0].1.fault, Fault::Missing { .. }));
    let (alarms, ..) = voted(Vote::OneOutOfTwo, |_| Some(f64::NAN));
    assert_eq!(alarms[0].0, 300);
    assert!(matches!(alarms[0].1.fault, Fault::NotFinite { .. }));
    let (alarms, _, speed) = voted(Vote::OneOutOfTwo, |duty| Some(duty + 0.06));
    assert_eq!((alarms.len(), alarms[0].0, speed), (1, 310, 0.0));
    assert!(matches!(alarms[0].1.fault, Fault::Disagree { .. }));
    assert!(
        voted(Vote::OneOutOfTwo, |duty| Some(duty + 0.04))
            .0
            .is_empty()
    );
}

#[test]
fn two_out_of_two_goes_on_with_one_channel_for_as_long_as_it_may() {
    let (alarms, ..) = voted(Vote::TwoOutOfTwo, |_| None);
    // Its response allows a missing channel for 100 ms, from the first such round on.
    assert_eq!((alarms.len(), alarms[0].0), (1, 400));
    let (alarms, ..) = voted(Vote::TwoOutOfTwo, |duty| Some(-duty + 1.0));
    assert!((310..320).contains(&alarms[0].0), "{alarms:?}");
}
