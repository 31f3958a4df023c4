//! Channels between programs. Both sides are here, each with a link of its own.

use super::{Places, ROUNDS};
use luna::Buffer;
use luna_ipc::{Blackboard, Endpoint};

/// Of the channel of a scenario in a placement.
fn endpoint(places: &Places, name: &str) -> Endpoint {
    let process = std::process::id();
    Endpoint::new(&format!("guard/{process}/{name}/{:?}", places.placement))
}

/// Links that sleep, and links that look first.
const LOOKS: [u32; 2] = [0, 50];

pub(crate) fn values_to_other_programs(places: &mut Places) {
    for looks in LOOKS {
        let endpoint = endpoint(places, &format!("values {looks}").replace(' ', "-"));
        let (sender, link) = endpoint.sender::<[u64; 4]>().unwrap();
        places.next(&format!("sending link {looks}")).spawn(link.looks(looks)).unwrap();
        let (receiver, link) = endpoint.receiver::<[u64; 4]>().unwrap();
        places.next(&format!("receiving link {looks}")).spawn(link.looks(looks)).unwrap();
        places.process(&format!("sends {looks}"), async move {
            for n in 0..ROUNDS {
                sender.send([n; 4]).await?;
            }
            luna::realtime::off_path(|| drop(sender));
            Ok(())
        });
        places.process(&format!("receives {looks}"), async move {
            for n in 0..ROUNDS {
                assert_eq!(receiver.recv().await?, [n; 4]);
            }
            assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
            luna::realtime::off_path(|| drop(receiver));
            Ok(())
        });
    }
}

pub(crate) fn values_through_a_buffer(places: &mut Places) {
    let endpoint = endpoint(places, "buffered");
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::overwrite_oldest(2)).unwrap();
    places.next("sending link").spawn(link).unwrap();
    let (receiver, link) = endpoint.receiver::<u64>().unwrap();
    places.next("receiving link").spawn(link).unwrap();
    places.process("sends", async move {
        for n in 1..=ROUNDS {
            sender.try_send(n).map_err(luna::Error::other)?;
            luna::yield_now().await;
        }
        luna::realtime::off_path(|| drop(sender));
        Ok(())
    });
    places.process("receives", async move {
        let mut last = 0;
        while let Ok(n) = receiver.recv().await {
            assert!(n > last);
            last = n;
        }
        assert_eq!(last, ROUNDS);
        luna::realtime::off_path(|| drop(receiver));
        Ok(())
    });
}

pub(crate) fn values_that_are_lent(places: &mut Places) {
    let endpoint = endpoint(places, "lent");
    let (loans, sender, link) = endpoint.loan_sender(3, &[0_u64; 64]).unwrap();
    places.next("sending link").spawn(link).unwrap();
    let (receiver, link) = endpoint.loan_receiver::<[u64; 64]>(3).unwrap();
    places.next("receiving link").spawn(link).unwrap();
    places.process("sends", async move {
        for n in 0..ROUNDS {
            let mut loan = loans.loan().expect("one is written, one under way, one is read");
            *loan = [n; 64];
            sender.send(loan).await?;
        }
        luna::realtime::off_path(|| drop((loans, sender)));
        Ok(())
    });
    places.process("receives", async move {
        for n in 1..ROUNDS {
            assert_eq!(*receiver.recv().await?, [n - 1; 64]);
        }
        // The links may have ended: then the last value keeps the memory of all.
        let last = receiver.recv().await?;
        assert_eq!(*last, [ROUNDS - 1; 64]);
        luna::realtime::off_path(|| drop((last, receiver)));
        Ok(())
    });
}

pub(crate) fn calls_to_other_programs(places: &mut Places) {
    let endpoint = endpoint(places, "calls");
    let (client, link) = endpoint.client::<u64, u64>().unwrap();
    places.next("calling link").spawn(link).unwrap();
    let (server, link) = endpoint.server::<u64, u64>().unwrap();
    places.next("serving link").spawn(link).unwrap();
    places.process("calls", async move {
        for n in 0..ROUNDS {
            assert_eq!(client.call(n).await.map_err(luna::Error::other)?, n + 1);
        }
        luna::realtime::off_path(|| drop(client));
        Ok(())
    });
    places.process("serves", async move {
        while let Ok(call) = server.accept().await {
            let answer = *call + 1;
            let _ = call.reply(answer);
        }
        luna::realtime::off_path(|| drop(server));
        Ok(())
    });
}

pub(crate) fn blackboards(places: &mut Places) {
    let process = std::process::id();
    let name = format!("guard/{process}/board/{:?}", places.placement);
    let mut writer = Blackboard::new(&name).entry("pose", [0_u64; 4]).write().unwrap();
    let mut pose = writer.take::<[u64; 4]>("pose").unwrap();
    let reader = Blackboard::new(&name).read().unwrap();
    let entry = reader.entry::<[u64; 4]>("pose").unwrap();
    let (written, next) = luna::channel();
    places.process("writes", async move {
        for n in 1..=ROUNDS {
            pose.set([n; 4]);
            written.send(n).await?;
        }
        luna::realtime::off_path(|| drop((pose, writer)));
        Ok(())
    });
    places.process("reads", async move {
        for _ in 1..=ROUNDS {
            let least = next.recv().await?;
            if let Ok(reading) = entry.get() {
                assert_eq!(reading.value, [reading.number - 1; 4]);
                assert!(reading.value[0] >= least);
            }
        }
        luna::realtime::off_path(|| drop((entry, reader)));
        Ok(())
    });
}
