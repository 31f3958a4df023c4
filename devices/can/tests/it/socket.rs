//! Interfaces of the kernel.

use crate::common::{SpawnOk, frame, skip, watchdog};
use luna::prelude::*;
use luna_can::{Filter, Frame, OpenError, Port, StandardId};

#[test]
fn an_interface_that_is_missing_is_named_with_its_remedy() {
    let system = System::new("none");
    let error = luna_can::open(&system.devices(), "can-none").unwrap_err();
    let name = "can-none".to_owned();
    assert_eq!(error, OpenError::NoInterface { name });
    let text = error.to_string();
    assert!(text.starts_with("there is no CAN interface `can-none`; create one with `ip link add"));
}

#[test]
fn an_interface_of_another_kind_is_refused() {
    let system = System::new("none");
    let error = luna_can::open(&system.devices(), "lo").unwrap_err();
    let name = "lo".to_owned();
    assert!(
        [OpenError::NoCan, OpenError::OtherKind { name }].contains(&error),
        "{error}"
    );
}

/// Two programs on one virtual bus, as two systems. The interface is LUNA_VCAN, or `vcan0`.
#[test]
fn frames_over_a_virtual_interface_of_the_kernel() {
    let _watch = watchdog();
    let named = std::env::var("LUNA_VCAN").ok();
    let name = named.clone().unwrap_or_else(|| "vcan0".to_owned());
    let mut near = System::new("near");
    let far = System::new("far");
    let device = match luna_can::open(&near.devices(), &name) {
        Ok(device) => device,
        // One that was named has to be there.
        Err(OpenError::NoInterface { .. } | OpenError::NoCan) if named.is_none() => {
            return skip(&format!(
                "no virtual CAN interface `{name}`: `ip link add dev {name} type vcan && ip link set {name} up`, or set LUNA_VCAN"
            ));
        }
        Err(error) => panic!("{name}: {error}"),
    };
    let other = luna_can::open(&far.devices(), &name).unwrap();
    // From before the start: it is not received.
    other.transmit_at_once(frame(0x102, &[0])).unwrap();
    let main = near.executor("main").build().unwrap();
    let mut far = far;
    let there = far.executor("there").build().unwrap();
    let (send, outgoing) = luna::channel::<Frame>();
    let (incoming, received) = luna::buffered::<Frame>(Buffer::fifo(8));
    let only = [Filter::exact(StandardId::new(0x102).unwrap())];
    let controller = luna_can::controller(&device)
        .send(outgoing)
        .receive(&only, incoming);
    main.process("controller").spawn_ok(controller);
    let (answer, answers) = luna::channel::<Frame>();
    let (request, requests) = luna::buffered::<Frame>(Buffer::fifo(8));
    let echo = luna_can::controller(&other)
        .send(answers)
        .receive(&[Filter::ANY], request);
    there.process("controller").spawn_ok(echo);
    drop((device, other));
    main.process("user").spawn_ok(async move {
        let remote = Frame::remote(StandardId::new(0x101).unwrap(), 2).unwrap();
        for frame in [
            frame(0x101, &[1, 2, 3]),
            Frame::extended(0x101, &[]).unwrap(),
            remote,
        ] {
            send.send(frame).await?;
        }
        assert_eq!(received.recv().await?, frame(0x102, &[3]));
        Ok(())
    });
    there.process("user").spawn_ok(async move {
        assert_eq!(requests.recv().await?, frame(0x101, &[1, 2, 3]));
        assert_eq!(requests.recv().await?, Frame::extended(0x101, &[]).unwrap());
        assert!(requests.recv().await?.is_remote());
        answer.send(frame(0x101, &[9])).await?;
        answer.send(frame(0x102, &[3])).await?;
        Ok(())
    });
    let there = std::thread::spawn(move || far.run());
    near.run().unwrap();
    there.join().unwrap().unwrap();
}
