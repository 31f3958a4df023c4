//! What a process waits for.

use super::*;
use futures_lite::future::poll_once;

/// What a process waits for at the end of each turn that does not leave it ready: the kind, and the
/// name of a channel or loop.
fn waits<'a>(decoded: &'a Decoded, process: &str) -> Vec<(u64, &'a str)> {
    decoded
        .of(code::WAITING)
        .filter(|event| decoded.process(event.subject.into()) == process)
        .filter(|event| event.arguments[0] != code::STILL_READY)
        .map(|event| {
            let [kind, number] = event.arguments;
            let name = match kind {
                _ if kind == Subject::Channel as u64 => decoded.name(Subject::Channel, number),
                _ if kind == Subject::Loop as u64 => decoded.name(Subject::Loop, number),
                _ => "",
            };
            (kind, name)
        })
        .collect()
}

#[test]
fn what_a_process_waits_for_is_one_thing_or_not_known() -> luna::Result<()> {
    const NOT_KNOWN: (u64, &str) = (code::WAITS_UNKNOWN, "");
    let mut system = System::new("waits");
    system.virtual_clock();
    let memory = recorded(&mut system);
    let period = std::time::Duration::from_millis(10);
    let main = system.executor("main").build()?;
    // No process sends on this channel. Its sender lives as long as the others need it.
    let (silent, never) = luna::channel::<u8>();
    let never = Arc::new(never.named("never"));
    let (answers, answer) = luna::channel::<u8>();
    let answer = answer.named("answer");
    main.process("looper").spawn(async move {
        let mut tick = luna::periodic("loop", period)?;
        for _ in 0..2 {
            tick.next().await;
        }
        Ok(())
    })?;
    let of_both = never.clone();
    main.process("both").spawn(async move {
        let mut tick = luna::periodic("beside", period)?;
        luna::par!(
            async {
                let received = of_both.recv_timeout(period / 2).await;
                assert!(received.unwrap_err().is_timeout());
                Ok(())
            },
            async {
                tick.next().await;
                Ok::<_, luna::Error>(())
            },
        )
        .await?;
        Ok(())
    })?;
    main.process("patient").spawn(async move {
        // Gives up in its turn, and then waits for something else.
        let given_up = never.recv_unless(async {}).await;
        assert!(given_up.unwrap_err().is_timeout());
        luna::after(period).await;
        let given_up = never.recv_unless(async {}).await;
        assert!(given_up.unwrap_err().is_timeout());
        assert_eq!(answer.recv().await?, 1);
        // Its deadline is not what it waits for.
        assert!(never.recv_timeout(period).await.is_err());
        luna::pri_alt! {
            _ = never.recv() => (),
            _ = luna::after(period) => (),
        }
        Ok(())
    })?;
    main.process("answers").spawn(async move {
        luna::after(3 * period).await;
        answers.send(1).await?;
        luna::after(3 * period).await;
        drop(silent);
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    let (channel, in_loop) = (Subject::Channel as u64, Subject::Loop as u64);
    assert_eq!(waits(&decoded, "looper"), [(in_loop, "loop"); 2]);
    // The other branch waits on when this one has given up.
    assert_eq!(waits(&decoded, "both")[0], NOT_KNOWN);
    assert_eq!(
        waits(&decoded, "patient"),
        [
            NOT_KNOWN,
            (channel, "answer"),
            (channel, "never"),
            NOT_KNOWN
        ]
    );
    Ok(())
}

/// Calls `f` on a thread of its own, and waits for it.
fn elsewhere<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    std::thread::scope(|scope| scope.spawn(f).join().unwrap())
}

#[test]
fn what_is_done_in_the_turn_in_which_it_was_to_wait_is_not_waited_for() -> luna::Result<()> {
    let mut system = System::new("hasty");
    let memory = recorded(&mut system);
    let main = system.executor("main").build()?;
    let (early, first) = luna::channel::<u8>();
    let (second, early_too) = luna::channel::<u8>();
    let (later, last) = luna::channel::<u8>();
    let (first, last) = (first.named("first"), last.named("last"));
    main.process("hasty").priority(2).spawn(async move {
        let mut receives = std::pin::pin!(first.recv());
        let mut sends = std::pin::pin!(second.send(2));
        // One turn, which goes on until the partners have been there.
        std::future::poll_fn(|cx| {
            assert!(receives.as_mut().poll(cx).is_pending());
            assert_eq!(elsewhere(|| early.blocking_send(1)), Ok(()));
            assert_eq!(receives.as_mut().poll(cx), Poll::Ready(Ok(1)));
            assert!(sends.as_mut().poll(cx).is_pending());
            assert_eq!(elsewhere(|| early_too.blocking_recv()), Ok(2));
            assert_eq!(sends.as_mut().poll(cx), Poll::Ready(Ok(())));
            Poll::Ready(())
        })
        .await;
        assert_eq!(last.recv().await, Ok(3));
        Ok(())
    })?;
    // Comes when the other waits.
    main.process("last").priority(1).spawn(async move {
        later.send(3).await?;
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    assert_eq!(
        waits(&decoded, "hasty")[0],
        (Subject::Channel as u64, "last")
    );
    Ok(())
}

#[test]
fn what_was_dropped_before_it_came_is_not_waited_for() -> luna::Result<()> {
    let mut system = System::new("fickle");
    let memory = recorded(&mut system);
    let safety = system.safety();
    let main = system.executor("main").build()?;
    let (silent, never) = luna::channel::<u8>();
    let (later, last) = luna::channel::<u8>();
    let last = last.named("last");
    main.process("fickle").priority(2).spawn(async move {
        assert_eq!(poll_once(never.ended()).await, None);
        assert_eq!(poll_once(safety.safe_state_entered()).await, None);
        assert_eq!(last.recv().await, Ok(3));
        Ok(())
    })?;
    main.process("last").priority(1).spawn(async move {
        later.send(3).await?;
        drop(silent);
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    assert_eq!(
        waits(&decoded, "fickle")[0],
        (Subject::Channel as u64, "last")
    );
    Ok(())
}

#[test]
fn named_parts_of_a_process_are_told_with_what_they_wait_for() -> luna::Result<()> {
    let mut system = System::new("parts");
    system.virtual_clock();
    let memory = recorded(&mut system);
    let (left, from_left) = luna::channel::<u8>();
    let (right, from_right) = luna::channel::<u8>();
    let (left, right) = (left.named("left channel"), right.named("right channel"));
    let main = system.executor("main").build()?;
    main.process("whole").spawn(async move {
        par!(
            luna::named("left", async {
                from_left.recv().await?;
                Ok(())
            }),
            luna::named("right", async {
                luna::named("within right", from_right.recv()).await?;
                Ok(())
            }),
            async {
                let lost = luna::named("lost", std::future::pending::<()>());
                let quick = luna::named("quick", luna::yield_now());
                futures_lite::future::or(lost, quick).await;
                Ok(())
            },
        )
        .await?;
        Ok(())
    })?;
    main.process("feeder").spawn(async move {
        right.send(1).await?;
        left.send(2).await?;
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    let name = |number: u64| decoded.name(Subject::SubProcess, number);
    let mut parts: BTreeMap<&str, Vec<(u16, u64, String)>> = BTreeMap::new();
    for event in &decoded.events {
        let [a, b] = event.arguments;
        let about = match event.code {
            code::SUB_RUNNING => format!("{} {}", decoded.process(a), name(b)),
            code::SUB_WAITING => decoded.name(Subject::Channel, b).to_owned(),
            code::SUB_DONE => String::new(),
            _ => continue,
        };
        let part = parts.entry(name(event.subject.into())).or_default();
        part.push((event.code, a, about));
    }
    let (returned, dropped) = (code::sub_ended::RETURNED, code::sub_ended::DROPPED);
    let expected = [
        ("left", "whole ", "left channel", returned),
        ("lost", "whole ", "", dropped),
        ("quick", "whole ", "", returned),
        ("right", "whole ", "right channel", returned),
        ("within right", "whole right", "right channel", returned),
    ];
    assert_eq!(parts.len(), expected.len(), "{parts:?}");
    for ((part, of), (name, within, awaited, how)) in parts.iter().zip(expected) {
        assert_eq!(*part, name);
        // In each turn it begins, and then waits for its channel or has ended. Not every turn of
        // its process is one of its own.
        let (last, turns) = of.split_last().unwrap();
        assert_eq!((last.0, last.1), (code::SUB_DONE, how), "{part}");
        let mut turns = turns.chunks_exact(2);
        assert!(turns.len() > 0, "{part}");
        for turn in turns.by_ref() {
            assert_eq!((turn[0].0, turn[0].2.as_str()), (code::SUB_RUNNING, within));
            assert_eq!(
                (turn[1].0, turn[1].2.as_str()),
                (code::SUB_WAITING, awaited)
            );
        }
        let rest = turns.remainder();
        assert_eq!(rest.len(), usize::from(how == returned), "{part}");
        assert!(rest.iter().all(|(code, ..)| *code == code::SUB_RUNNING));
        // Its name says to which process the part belongs.
        let number = decoded
            .names
            .iter()
            .find(|(_, text)| text == part)
            .unwrap()
            .0;
        assert_eq!(decoded.process(decoded.parents[number].into()), "whole");
    }
    Ok(())
}
