//! Values of types that are known at run time alone.

use crate::child::Program;
use crate::shared::watchdog;
use crate::{channel_name, files, run, spawn};
use luna::Policy;
use luna_ipc::any::{self, AnyError, AnyType};
use luna_ipc::look;
use luna_ipc::{Blackboard, Endpoint, IpcError, TypeInfo};
use std::path::Path;

/// What the other program states.
fn stated(name: &str) -> TypeInfo {
    look::at(name).unwrap().expect("it is there").value
}

#[test]
fn values_go_to_a_program_that_knows_their_type() {
    let _watchdog = watchdog();
    let name = channel_name("any-sent");
    let (receiver, link) = luna_ipc::receiver::<[i32; 3]>(&name).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, [1, -2, i32::MAX]);
        assert_eq!(receiver.recv().await?, [0; 3]);
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let of = AnyType::of(&stated(&name)).unwrap();
    let values = ["[1, -2, 2147483647]", "0 0 0"].map(|text| of.parse(text).unwrap());
    let (sender, link) = Endpoint::new(&name).any_sender(&of).unwrap();
    run(Policy::Other, link, async move {
        for value in values {
            sender.send(value).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn values_come_from_a_program_that_knows_their_type() {
    let _watchdog = watchdog();
    let name = channel_name("any-received");
    let endpoint = Endpoint::new(&name).layout_version(7);
    let (sender, link) = endpoint.sender::<[[f32; 2]; 2]>().unwrap();
    let sent = spawn(Policy::Other, link, async move {
        sender.send([[1.5, -0.25], [f32::NAN, 1e9]]).await?;
        Ok(())
    });
    let of = AnyType::of(&stated(&name)).unwrap();
    let (receiver, link) = Endpoint::new(&name).any_receiver(&of).unwrap();
    run(Policy::Other, link, async move {
        let value = receiver.recv().await?;
        assert_eq!(value.to_string(), "[[1.5, -0.25], [NaN, 1000000000.0]]");
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
}

#[cfg(feature = "serde")]
#[test]
fn strings_of_serde_go_both_ways() {
    let _watchdog = watchdog();
    let name = channel_name("any-text");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<String>(200).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, "ü".repeat(90));
        assert_eq!(receiver.recv().await?, "");
        Ok(())
    });
    let of = AnyType::of(&stated(&name)).unwrap();
    assert!(of.parse(&"ü".repeat(101)).is_err(), "it has no room");
    let values = [of.parse(&"ü".repeat(90)).unwrap(), of.parse("").unwrap()];
    let (sender, link) = endpoint.any_sender(&of).unwrap();
    run(Policy::Other, link, async move {
        for value in values {
            sender.send(value).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();

    let (sender, link) = endpoint.serde_sender::<String>(200).unwrap();
    let sent = spawn(Policy::Other, link, async move {
        sender.send("two words".to_owned()).await?;
        Ok(())
    });
    let (receiver, link) = endpoint.any_receiver(&of).unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?.to_string(), "two words");
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
}

#[test]
fn a_type_that_says_nothing_of_its_fields_is_bytes_and_is_not_sent() {
    let _watchdog = watchdog();
    let name = channel_name("any-raw");
    let mut program = Program::start("feed", &name, Path::new(""));
    let info = loop {
        match look::at(&name).unwrap() {
            Some(found) if found.is_alive() => break found.value,
            _ => std::thread::yield_now(),
        }
    };
    let error = AnyType::of(&info).unwrap_err();
    assert!(matches!(error, AnyError::Form { .. }), "{error}");
    assert!(
        error.to_string().contains("luna_ipc_test::Block"),
        "{error}"
    );
    let raw = AnyType::raw(&info).unwrap();
    assert!(raw.parse("00").is_err());
    let (receiver, link) = Endpoint::new(&name).any_receiver(&raw).unwrap();
    let value = std::sync::Arc::new(std::sync::Mutex::new(None));
    let kept = value.clone();
    run(Policy::Other, link, async move {
        *kept.lock().unwrap() = Some(receiver.recv().await?);
        Ok(())
    })
    .unwrap();
    program.kill();
    program.wait();
    let value = value.lock().unwrap().take().unwrap();
    // Number 1, weight 1.0, color 1, and what is no field.
    assert_eq!(value.bytes()[..8], 1_u64.to_ne_bytes());
    assert_eq!(value.bytes()[8..12], 1_f32.to_ne_bytes());
    assert_eq!((value.bytes()[12], value.bytes().len()), (1, 16));
    assert_eq!(value.to_string().len(), 32);

    let (receiver, link) = luna_ipc::receiver::<crate::Block>(&name).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert!(receiver.recv().await.is_err());
        Ok(())
    });
    let (sender, link) = Endpoint::new(&name).any_sender(&raw).unwrap();
    let refused = run(Policy::Other, link, async move {
        assert!(sender.send(value).await.is_err());
        Ok(())
    });
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("cannot be encoded"), "{refused}");
    assert!(received.join().unwrap().is_err());
    assert!(files(&name).is_empty());
}

#[test]
fn calls_and_loans_have_no_single_values() {
    let name = channel_name("any-call");
    let _opened = luna_ipc::client::<u32, u32>(&name).unwrap();
    for refused in [AnyType::of(&stated(&name)), AnyType::raw(&stated(&name))] {
        assert!(matches!(
            refused,
            Err(AnyError::Kind {
                kind: look::Kind::Call,
                ..
            })
        ));
    }
}

#[test]
fn a_key_is_set_where_no_program_writes() {
    let name = channel_name("any-set");
    let board = || {
        Blackboard::new(&name)
            .entry("speed", 1.0_f64)
            .entry("ok", false)
    };
    let mut writer = board().write().unwrap();
    let keys = look::at(&name).unwrap().unwrap().keys;
    let [speed, ok] = [0, 1].map(|index: usize| AnyType::of(&keys[index].value).unwrap());
    let value = speed.parse("-2.5").unwrap();
    let busy = any::set(&name, "speed", &value).unwrap_err();
    assert!(matches!(busy, IpcError::Busy { .. }), "{busy}");
    let entry = writer.take::<bool>("ok").unwrap();
    let reader = Blackboard::new(&name).read().unwrap();
    drop((writer, entry));

    assert_eq!(any::set(&name, "speed", &value).unwrap(), 2);
    assert_eq!(
        any::set(&name, "ok", &ok.parse("true").unwrap()).unwrap(),
        2
    );
    let reading = reader.entry::<f64>("speed").unwrap().get().unwrap();
    assert_eq!((reading.value, reading.number), (-2.5, 2));
    assert!(reader.entry::<bool>("ok").unwrap().get().unwrap().value);
    let wrong = any::set(&name, "ok", &value).unwrap_err();
    assert!(matches!(wrong, IpcError::Type { .. }), "{wrong}");
    let none = any::set(&name, "color", &value).unwrap_err();
    assert!(none.to_string().contains("`color` is not there"), "{none}");
    let bytes = AnyType::raw(speed.info()).unwrap().read(&[0; 8]).unwrap();
    assert!(any::set(&name, "speed", &bytes).is_err());

    // The next writer goes on with the numbers.
    let writer = board().write().unwrap();
    let reading = reader.entry::<f64>("speed").unwrap().get().unwrap();
    assert_eq!((reading.value, reading.number), (1.0, 3));
    drop((writer, reader));
    let none = any::set(&name, "speed", &value).unwrap_err();
    assert!(matches!(none, IpcError::NoBoard { .. }), "{none}");
    assert!(files(&name).is_empty());
}
