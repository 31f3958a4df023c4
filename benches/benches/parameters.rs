//! `parameters`: the cost of reading a parameter and of checking for a new set, on one core,
//! compared with a plain atomic, a mutex and a reader-writer lock of std.

use std::{
    hint::black_box,
    sync::{
        Arc, Mutex, RwLock,
        atomic::{AtomicU64, Ordering},
        mpsc,
    },
    time::{Duration, Instant},
};

use luna::parameters::Tunable;
use luna::{Parameter, System};
use luna_benches::{
    cores::{on_core, one_core},
    harness::{Case, Goal, run},
};

const READ: &str = "read a parameter, one core";
const TAKE: &str = "take the latest set, one core";
const SET: &str = "replace a parameter, one core";
const UNIT: &str = "ns";

/// Times `step` in a process that has a parameter.
fn in_process<T: Tunable + Sync, S: Fn(&Parameter<T>) + Send + 'static>(
    steps: u64,
    default: T,
    make: impl FnOnce(&System) -> S,
) -> Duration {
    let (sender, elapsed) = mpsc::channel();
    let mut system = System::new("bench");
    let step = make(&system);
    let main = system
        .executor("main")
        .core(one_core().id)
        .build()
        .expect("the core is there");
    let timed = main.process("timed");
    let parameter = timed.parameter("p", default).register();
    let parameter = parameter.expect("its name is free");
    let body = async move {
        let start = Instant::now();
        for _ in 0..steps {
            step(black_box(&parameter));
        }
        let _ = sender.send(start.elapsed());
        Ok(())
    };
    timed.spawn(body).expect("its name is free");
    system.run().expect("it ends");
    elapsed.recv().expect("it was timed")
}

fn read<T: Tunable + Sync>(steps: u64, default: T) -> Duration {
    in_process(steps, default, |_| {
        |parameter: &Parameter<T>| {
            black_box(parameter.get());
        }
    })
}

fn beside(steps: u64, step: impl Fn() -> u64 + Sync) -> Duration {
    on_core(one_core(), || {
        let start = Instant::now();
        for _ in 0..steps {
            black_box(step());
        }
        start.elapsed()
    })
}

fn main() {
    let case = |scenario, peer, block: fn(u64) -> Duration| Case::new(scenario, peer, UNIT, block);
    run(
        "parameters",
        vec![
            case(READ, "LUNA, f64", |steps| read(steps, 1.0)).goal(Goal::AtMost(5.0)),
            case(READ, "LUNA, [f64; 4]", |steps| read(steps, [1.0; 4])),
            case(READ, "atomic, relaxed", |steps| {
                let value = Arc::new(AtomicU64::new(1));
                beside(steps, || black_box(&value).load(Ordering::Relaxed))
            }),
            case(READ, "std::sync::Mutex, uncontended", |steps| {
                let value = Mutex::new(1);
                beside(steps, || *value.lock().expect("no holder panics"))
            }),
            case(READ, "std::sync::RwLock, uncontended", |steps| {
                let value = RwLock::new(1);
                beside(steps, || *value.read().expect("no holder panics"))
            }),
            case(TAKE, "LUNA, there is none", |steps| {
                in_process(steps, 1.0, |_| {
                    |parameter: &Parameter<f64>| parameter.latch()
                })
            })
            .goal(Goal::AtMost(10.0)),
            case(SET, "LUNA, set, take and read", |steps| {
                in_process(steps, 0, |system| {
                    let parameters = system.parameters();
                    move |parameter: &Parameter<u64>| {
                        let next = parameter.get() + 1;
                        parameters.set([("p", next)]).expect("it can be set");
                        parameter.latch();
                        assert_eq!(parameter.get(), next);
                    }
                })
            }),
        ],
    );
}
