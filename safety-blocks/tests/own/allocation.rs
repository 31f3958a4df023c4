//! From their first value on the blocks' processes neither allocate nor free, also while faults
//! begin and end.

use crate::counting::Counting;
use crate::spawn::SpawnOk;
use luna::prelude::*;
use luna_safety_blocks::{
    Agreement, AgreementProcess, Blocked, Chain, DeadMan, DeadManProcess, Disagreement, EndStop,
    Finding, Frozen, Limit, MaxRate, Noise, Range, RateLimit, Reaction, Recovery, Response,
    Timeout, Vote,
};
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

const MS: Duration = Duration::from_millis(1);

/// What comes: in order, then wrong in one way after the other.
fn wrong(n: u32) -> f64 {
    match n % 40 {
        3 => f64::NAN,
        5 => f64::INFINITY,
        7 => 100.0,
        11 => -1.5,
        12..20 => 0.5,
        n => 0.1 * f64::from(n % 7),
    }
}

fn recovering() -> Response {
    Response::new(Reaction::Neutral)
        .recovery(Recovery::After(3 * MS))
        .limited_for(5 * MS)
}

fn all() -> Chain {
    let warned = Reaction::Warn;
    let chain = Chain::new(0.0).unwrap();
    let chain = chain.then("range", Range::new(-2.0, 2.0).unwrap(), recovering());
    let chain = chain
        .unwrap()
        .then("jump", MaxRate::new(500.0).unwrap(), warned);
    let chain = chain
        .unwrap()
        .then("noise", Noise::new(0.1, 10).unwrap(), warned);
    let frozen = Frozen::new(0.0, 2 * MS).unwrap();
    let chain = chain.unwrap().then("frozen", frozen, recovering());
    let apart = Disagreement::new(0.1, MS).unwrap();
    let chain = chain.unwrap().then("apart", apart, warned);
    let chain = chain
        .unwrap()
        .then("limit", Limit::new(-1.0, 1.0).unwrap(), recovering());
    let chain = chain
        .unwrap()
        .then("rate", RateLimit::new(50.0).unwrap(), warned);
    let stop = EndStop::new(-0.5, 0.5).unwrap();
    let chain = chain.unwrap().then("stop", stop, recovering());
    let blocked = Blocked::new(0.1, 1e-3, 3 * MS).unwrap();
    chain
        .unwrap()
        .then("blocked", blocked, recovering())
        .unwrap()
}

/// Runs a network made by `build` on an executor that must not allocate or free while values come
/// at its end. Returns the number of reported causes.
fn run(
    build: impl FnOnce(&luna::Executor, [Receiver<f64>; 2], Receiver<u32>, Sender<f64>, Sender<Finding>),
) -> u32 {
    let mut system = System::new("allocation");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let ((a, from_a), (b, from_b)) = (luna::channel(), luna::channel());
    let (key, keys) = luna::channel();
    let (output, values) = luna::buffered(Buffer::overwrite_oldest(1));
    let (reports, causes) = luna::buffered(Buffer::overwrite_oldest(4));
    build(&main, [from_a, from_b], keys, output, reports);
    let (counted, count) = std::sync::mpsc::channel();
    main.process("control").spawn_ok(async move {
        let (mut before, mut alarms) = ((0, 0), 0);
        for n in 0..2000 {
            if n == 100 {
                (before, alarms) = (ALLOCATOR.here(), 0);
            }
            luna::after(MS).await;
            let _ = key.send_timeout(u32::from(n % 50 != 1), MS / 4).await;
            let _ = a.send_timeout(wrong(n), MS / 4).await;
            if n % 9 != 0 {
                let _ = b.send_timeout(wrong(n / 2), MS / 4).await;
            }
            if n % 100 == 0 {
                luna::after(20 * MS).await;
            }
            let _ = values.try_recv();
            while causes.try_recv().is_ok() {
                alarms += 1;
            }
        }
        assert_eq!(ALLOCATOR.here(), before);
        luna::realtime::off_path(|| counted.send(alarms).unwrap());
        Ok(())
    });
    system.run().unwrap();
    count.recv().unwrap()
}

#[test]
fn blocks_allocate_nothing() {
    let alarms = run(|main, [a, b], _, output, reports| {
        let process = all().process(a, output).feedback(b, 3 * MS).unwrap();
        let timeout = Timeout::new(5 * MS, 0.0).unwrap().repeat(MS).unwrap();
        let (process, _) = process.timeout("silence", timeout, recovering()).unwrap();
        main.process("chain").spawn_ok(process.report_to(reports));
    });
    assert!(alarms > 300, "{alarms}");

    let alarms = run(|main, channels, _, output, reports| {
        let agreement = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.05, MS).unwrap();
        let process = AgreementProcess::new(
            "vote",
            agreement,
            Reaction::Warn,
            channels,
            output,
            MS / 2,
            10 * MS,
        );
        main.process("vote")
            .spawn_ok(process.unwrap().report_to(reports));
    });
    assert!(alarms > 100, "{alarms}");

    let alarms = run(|main, [a, _b], keys, output, reports| {
        let grip = DeadMan::new(10 * MS).unwrap();
        let process = DeadManProcess::new("grip", grip, 0.0, recovering(), a, keys, output);
        main.process("grip")
            .spawn_ok(process.unwrap().report_to(reports));
    });
    assert!(alarms > 10, "{alarms}");

    // The counter counts.
    let before = ALLOCATOR.here();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(ALLOCATOR.here(), (before.0 + 1, before.1 + 1));
}
