//! The link as a process between channels.

use super::loopback::{Link, bound, pair, patient};
use crate::common::{SpawnOk, with_files};
use luna::prelude::*;
use luna_links::cycle::{OnStale, Reading, Settings};
use std::time::Duration;

fn newest<T: Send>() -> (luna::Sender<T>, luna::Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

#[test]
fn channels_on_both_sides_carry_values() {
    let Some(_watch) = with_files() else { return };
    let (here, there): (Link, Link) = pair(&patient());
    let mut system = System::new("channels");
    let main = system.executor("main").build().unwrap();
    let mut sides = Vec::new();
    for (name, link) in [("here", here), ("there", there)] {
        let (values, outgoing) = newest();
        let (incoming, readings) = newest();
        let link = link.process(outgoing, incoming);
        let status = link.status();
        main.process(name).spawn_ok(link);
        sides.push((values, readings, status));
    }
    let (far_values, far_readings, far_status) = sides.pop().unwrap();
    let (values, readings, status) = sides.pop().unwrap();
    let (over, ended) = luna::channel::<()>();
    main.process("echo").spawn_ok(async move {
        loop {
            luna::alt! {
                reading = far_readings.recv() => match reading? {
                    Reading::Fresh(sample) => far_values.send(sample.value).await?,
                    Reading::Stale(silence) => panic!("{silence:?}"),
                },
                _ = ended.recv() => return Ok(()),
            }
        }
    });
    main.process("user").spawn_ok(async move {
        let _over = over;
        let mut came = 0;
        for number in 1..u64::MAX {
            values.send(number.to_le_bytes()).await?;
            luna::after(Duration::from_micros(200)).await;
            if let Ok(Reading::Fresh(sample)) = readings.try_recv() {
                assert!(u64::from_le_bytes(sample.value) <= number);
                came += 1;
            }
            if came == 50 {
                break;
            }
        }
        Ok(())
    });
    system.run().unwrap();
    assert!(status.received() >= 50 && far_status.received() >= 50);
}

/// A partner that never speaks.
fn alone(limit: Duration) -> Link {
    let (here, _) = bound();
    let (_there, far) = bound();
    Link::over(here, far, &Settings::new(limit).stale_after(1)).unwrap()
}

#[test]
fn a_partner_that_starts_late_is_awaited_and_one_that_falls_silent_poisons_both_ends() {
    let Some(_watch) = with_files() else { return };
    let settings = Settings::new(Duration::from_millis(20)).stale_after(1);
    let (here, mut there): (Link, Link) = pair(&settings);
    let mut system = System::new("poison");
    let main = system.executor("main").build().unwrap();
    let (values, outgoing) = newest();
    let (incoming, readings) = newest();
    let link = here.process(outgoing, incoming);
    let status = link.status();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        luna::after(settings.limit() * 2).await;
        loop {
            there.send(&[3; 8])?;
            // It hears nothing but hellos.
            let _ = there.newest();
            luna::after(Duration::from_micros(200)).await;
            match readings.try_recv() {
                Ok(Reading::Fresh(sample)) => assert_eq!(sample.value, [3; 8]),
                Ok(Reading::Stale(silence)) => panic!("{silence:?}"),
                Err(error) if error.is_poisoned() => break,
                Err(_) => continue,
            }
            break;
        }
        let end = loop {
            if let Err(error) = readings.recv().await {
                break error;
            }
        };
        assert!(end.is_poisoned());
        assert!(
            values
                .send([0; 8])
                .await
                .is_err_and(|error| error.is_poisoned())
        );
        Ok(())
    });
    let error = system.run().unwrap_err().to_string();
    assert!(
        error.contains("link") && error.contains("no value for more than"),
        "{error}"
    );
    assert_eq!((status.stale(), status.sessions()), (2, 1));
}

#[test]
fn a_silent_partner_is_reported_once_and_the_link_goes_on() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("report");
    let main = system.executor("main").build().unwrap();
    let (values, outgoing) = newest();
    let (incoming, readings) = luna::buffered(Buffer::fifo(4));
    let link = alone(Duration::from_millis(2)).process(outgoing, incoming);
    main.process("link")
        .spawn_ok(link.on_stale(OnStale::Report));
    main.process("user").spawn_ok(async move {
        let reading = readings.recv().await?;
        assert!(matches!(reading, Reading::Stale(silence) if !silence.has_heard));
        values.send([0; 8]).await?;
        luna::after(Duration::from_millis(10)).await;
        assert!(readings.try_recv().is_err(), "it says so once");
        Ok(())
    });
    system.run().unwrap();
}
